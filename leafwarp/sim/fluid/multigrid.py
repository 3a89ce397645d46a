"""The levels of a multigrid cycle on the map: their arrays and their recorded launches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from leafwarp.sim.fluid.spans import line_spans, thread_blocks
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.multigrid import begin_smoothing, correct, restrict_residual, smooth

# Sweeps of the smoother before and after the correction: on the map itself, on the next level, on all others.
SWEEPS = (1, 2, 4)
# The eigenvalues of D^-1 (E + L) lie between 0 and 2. A polynomial of more sweeps damps more of the lower ones.
LARGEST_EIGENVALUE = 2.0
SMALLEST_DAMPED = {1: 0.85, 2: 0.3, 4: 0.1}
OVERCORRECTION = 1.3
# Where there are many levels, the cycles of these are done twice: it regains what constant blocks lose, where that
# costs little. From the first of them on, no correction is taken times more than 1: to repeat a cycle that overshoots
# might not be positive definite.
MANY_LEVELS = 11
REPEATED_LEVELS = (2, 3)


def sweep_weights(count: int) -> list[float]:
    """The ``omega`` of successive sweeps: reciprocals of the roots of a Chebyshev polynomial."""
    low, high = SMALLEST_DAMPED[count], LARGEST_EIGENVALUE
    angles = np.pi * (2 * np.arange(count) + 1) / (2 * count)
    return [float(omega) for omega in 1.0 / ((high + low) / 2 + (high - low) / 2 * np.cos(angles))]


def block_columns(mask: np.ndarray) -> np.ndarray:
    """First block of lanes of each row with a marked cell and the one after its last, int32.

    Rows are taken in pairs by the coarser level; there is one for each, shape [even ny, 2].
    """
    span = line_spans(np.pad(mask, ((0, len(mask) % 2), (0, 0))))
    return np.stack([span[:, 0] // LANES, -(-span[:, 1] // LANES)], axis=1).astype(np.int32)


def add_pairs(values: np.ndarray, axis: int) -> np.ndarray:
    """Sums of two neighbours each along an axis; an odd one at the end stays alone."""
    return np.add.reduceat(values, np.arange(0, values.shape[axis], 2), axis)


@dataclass
class System:
    """The numbers of a level: the diagonal of E and the exchange over the faces in a step, each [ny, nx]."""

    mass: np.ndarray
    faces_x: np.ndarray
    faces_y: np.ndarray

    @property
    def exchange(self) -> np.ndarray:
        """What each cell exchanges with all others in a step, shape [ny, nx]."""
        exchange = self.faces_x + self.faces_y
        exchange[:, 1:] += self.faces_x[:, :-1]
        exchange[1:] += self.faces_y[:-1]
        return exchange

    @property
    def inverse_diagonal(self) -> np.ndarray:
        """One over the diagonal, 0 where that is 0, shape [ny, nx]."""
        diagonal = self.mass + self.exchange
        return np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)

    def coarser(self) -> System:
        """The system of 2 x 2 cells each: sums of the diagonals, and of the faces between the blocks."""
        rows, columns = (-(-count // 2) for count in self.mass.shape)
        between_x = add_pairs(self.faces_x, 0)[:, 1::2]
        between_y = add_pairs(self.faces_y, 1)[1::2]
        return System(
            add_pairs(add_pairs(self.mass, 0), 1),
            np.pad(between_x, ((0, 0), (0, columns - between_x.shape[1]))),
            np.pad(between_y, ((0, rows - between_y.shape[0]), (0, 0))),
        )


class Multigrid:
    """The cycle that preconditions the unsplit scheme.

    Level 0 is the map itself. Its right side and its solution are arrays of the stage.

    Args:
        shape: Of the map, [ny, nx].
        right_side: Name of the array that the cycle is applied to.
        begun: Name of the array that holds the first sweep of the map's own smoother.
        solution: Name of the array to write.
        row_sum: Name of the array of the product of right side and solution.
        has_source: Some cells have more than 1 on the diagonal of E.

    Attributes:
        arrays: The arrays that the stage has to declare.
    """

    def __init__(
        self, shape: tuple[int, int], right_side: str, begun: str, solution: str, row_sum: str, has_source: bool
    ):
        self._shapes = [shape]
        while max(self._shapes[-1]) > 1:
            rows, columns = self._shapes[-1]
            self._shapes.append((-(-rows // 2), -(-columns // 2)))
        self._repeated = REPEATED_LEVELS if len(self._shapes) >= MANY_LEVELS else ()
        self._right_side, self._begun, self._solution, self._row_sum = right_side, begun, solution, row_sum
        self._has_source = has_source
        self.arrays = tuple(spec for level in range(len(self._shapes)) for spec in self._declare(level))

    @property
    def first_weight(self) -> float:
        """``omega`` of the map's own smoother."""
        return sweep_weights(SWEEPS[0])[0]

    def _declare(self, level: int) -> list[ArraySpec]:
        shape = self._shapes[level]
        kinds = {
            "faces_x": "exchange of each cell with its right neighbour in a step",
            "faces_y": "exchange of each cell with its upper neighbour in a step",
            "inverse_diagonal": "one over the diagonal",
        }
        if level > 0:
            kinds |= {
                "mass": "diagonal without the exchange of the cells",
                "right_side": "residual of the finer level",
                "solution": "correction of the finer level",
                "other": "the same, before or after a sweep",
            }
        elif self._has_source:
            kinds["mass"] = "what a source adds to the diagonal"
        where = f"level {level} of the multigrid"
        specs = [ArraySpec(f"level_{level}_{n}", shape, "real", f"{m}, {where}", padded=True) for n, m in kinds.items()]
        spans = (shape[0] + shape[0] % 2, 2)
        specs.append(ArraySpec(f"level_{level}_span", spans, "int32", f"blocks of cells of each row, {where}"))
        if level == 0:
            specs.append(ArraySpec("level_0_mass_span", spans, "int32", "the same of a source's cells"))
        return specs

    def upload_faces(self, state: State, system: System) -> None:
        """Fill conductances and spans.

        Args:
            state: Holds the arrays.
            system: Of the map, without a source.
        """
        self._system = system
        for level in range(len(self._shapes)):
            state.upload(f"level_{level}_span", block_columns(system.mass > 0.0))
            state.upload(f"level_{level}_faces_x", system.faces_x)
            state.upload(f"level_{level}_faces_y", system.faces_y)
            system = system.coarser()

    def upload_mass(self, state: State, source: np.ndarray | None = None) -> None:
        """Fill what depends on the diagonal of E.

        Args:
            state: Holds the arrays.
            source: What a source adds to it, shape [ny, nx]; None: nothing.
        """
        system = self._system
        # On the map itself, cells that exchange nothing are left alone.
        is_coupled = system.exchange > 0.0
        if source is not None:
            state.upload("level_0_mass", source)
            state.upload("level_0_mass_span", block_columns(source > 0.0))
            system = System(system.mass + source, system.faces_x, system.faces_y)
        state.upload("level_0_inverse_diagonal", np.where(is_coupled, system.inverse_diagonal, 0.0))
        for level in range(1, len(self._shapes)):
            system = system.coarser()
            state.upload(f"level_{level}_mass", system.mass)
            state.upload(f"level_{level}_inverse_diagonal", system.inverse_diagonal)

    def system(self, state: State, level: int = 0) -> list:
        """The arguments of kernels that describe ``E + L`` of a level."""
        prefix = f"level_{level}_"
        x, y = prefix + "faces_x", prefix + "faces_y"
        faces = [state.lanes(x), state.lanes(x, -1), state.lanes(y)]
        if level > 0:
            return [0.0, state.lanes(prefix + "mass"), prefix + "span", *faces]
        return [1.0, state.lanes("level_0_mass") if self._has_source else None, "level_0_mass_span", *faces]

    def record(self, state: State) -> list[Command]:
        """Record a cycle."""
        return self._cycle(state, 0)

    def _cycle(self, state: State, level: int, start: str | None = None) -> list[Command]:
        """Record a cycle from a level on, from a solution of 0 or from what one of the level's arrays holds."""
        shape = self._shapes[level]
        prefix = f"level_{level}_"
        if level == 0:
            right_side, now, other = self._right_side, self._begun, self._solution
        else:
            right_side, now, other = (prefix + name for name in ("right_side", "solution", "other"))
        right_side = state.lanes(right_side)
        span = prefix + "span"
        length, segments = thread_blocks(right_side.shape[1], state)
        dim = (segments, shape[0])
        omegas = sweep_weights(SWEEPS[min(level, len(SWEEPS) - 1)])
        coarsest = level == len(self._shapes) - 1
        if coarsest:
            omegas = omegas if level == 0 else [1.0]
        system, inverse_diagonal = self.system(state, level), state.lanes(prefix + "inverse_diagonal")

        def sweep(omega: float, row_sum: str | None = None) -> Command:
            nonlocal now, other
            inputs = [right_side, *with_neighbours(state, now), *system, inverse_diagonal, span, length, omega]
            command = state.record(smooth, dim, inputs, [state.lanes(other), row_sum])
            now, other = other, now
            return command

        commands = []
        if start is not None:
            now, other = (now, other) if start == now else (other, now)
            commands.append(sweep(omegas[0]))
        elif level > 0:
            inputs = [right_side, inverse_diagonal, span, length, omegas[0]]
            commands.append(state.record(begin_smoothing, dim, inputs, [state.lanes(now)]))
        commands += [sweep(omega) for omega in omegas[1:]]
        if not coarsest:
            coarse = f"level_{level + 1}_"
            coarse_right_side = state.lanes(coarse + "right_side")
            coarse_length, coarse_segments = thread_blocks(coarse_right_side.shape[1], state)
            commands.append(
                state.record(
                    restrict_residual,
                    (coarse_segments, self._shapes[level + 1][0]),
                    [right_side, *with_neighbours(state, now), *system, coarse + "span", coarse_length],
                    [coarse_right_side],
                )
            )
            commands += self._cycle(state, level + 1)
            if level + 1 in self._repeated:
                commands += self._cycle(state, level + 1, self._found)
            factor = 1.0 if self._repeated and level >= self._repeated[0] else OVERCORRECTION
            inputs = [state.lanes(self._found), span, length, factor]
            commands.append(state.record(correct, dim, inputs, [state.lanes(now)]))
        if not coarsest or level == 0:
            commands += [sweep(omega) for omega in omegas[:0:-1]]
            commands.append(sweep(omegas[0], self._row_sum if level == 0 else None))
        self._found = now
        return commands


def with_neighbours(state: State, name: str) -> list[wp.array]:
    """Blocks of lanes of an array, of its cells' right neighbours and of their left ones."""
    return [state.lanes(name, displaced) for displaced in (0, 1, -1)]
