"""The levels of a multigrid cycle on the map: their arrays and their recorded launches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.sim.fluid.spans import line_spans
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.multigrid import begin_smoothing, correct, restrict_residual, smooth

# Sweeps of the smoother before and after the correction: on the map itself, on the next level, on all others.
SWEEPS = (1, 3, 4)
# The eigenvalues of D^-1 (E + L) lie between 0 and 2. A polynomial of more sweeps damps more of the lower ones.
LARGEST_EIGENVALUE = 2.0
SMALLEST_DAMPED = {1: 0.85, 3: 0.15, 4: 0.1}
OVERCORRECTION = 1.3


def sweep_weights(count: int) -> list[float]:
    """The ``omega`` of successive sweeps: reciprocals of the roots of a Chebyshev polynomial."""
    low, high = SMALLEST_DAMPED[count], LARGEST_EIGENVALUE
    angles = np.pi * (2 * np.arange(count) + 1) / (2 * count)
    return [float(omega) for omega in 1.0 / ((high + low) / 2 + (high - low) / 2 * np.cos(angles))]


def block_columns(mask: np.ndarray) -> np.ndarray:
    """First block of lanes of each row with a marked cell and the one after its last, shape [ny, 2], int32."""
    span = line_spans(mask)
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
    def inverse_diagonal(self) -> np.ndarray:
        diagonal = self.mass + self.faces_x + self.faces_y
        diagonal[:, 1:] += self.faces_x[:, :-1]
        diagonal[1:] += self.faces_y[:-1]
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

    Attributes:
        arrays: The arrays that the stage has to declare.
    """

    def __init__(self, shape: tuple[int, int], right_side: str, begun: str, solution: str):
        self._shapes = [shape]
        while max(self._shapes[-1]) > 1:
            rows, columns = self._shapes[-1]
            self._shapes.append((-(-rows // 2), -(-columns // 2)))
        self._right_side, self._begun, self._solution = right_side, begun, solution
        self.arrays = tuple(spec for level in range(len(self._shapes)) for spec in self._declare(level))

    @property
    def first_weight(self) -> float:
        """``omega`` of the map's own smoother."""
        return sweep_weights(SWEEPS[0])[0]

    def _declare(self, level: int) -> list[ArraySpec]:
        shape = self._shapes[level]
        kinds = {
            "mass": "diagonal without the exchange of the cells",
            "faces_x": "exchange of each cell with its right neighbour in a step",
            "faces_y": "exchange of each cell with its upper neighbour in a step",
            "inverse_diagonal": "one over the diagonal",
        }
        if level > 0:
            kinds |= {
                "right_side": "residual of the finer level",
                "solution": "correction of the finer level",
                "other": "the same, before or after a sweep",
            }
        where = f"level {level} of the multigrid"
        return [
            *(ArraySpec(f"level_{level}_{n}", shape, "real", f"{m}, {where}", padded=True) for n, m in kinds.items()),
            ArraySpec(f"level_{level}_span", (shape[0], 2), "int32", f"blocks of cells of each row, {where}"),
        ]

    def upload_faces(self, state: State, mask: np.ndarray, faces_x: np.ndarray, faces_y: np.ndarray) -> None:
        """Fill conductances and spans.

        Args:
            state: Holds the arrays.
            mask: Leaf cells, shape [ny, nx], bool.
            faces_x: Conductance of each cell to its right neighbour times the step, shape [ny, nx].
            faces_y: The same to its upper neighbour.
        """
        self._faces = (faces_x, faces_y)
        cells = mask.astype(np.float64)
        for level in range(len(self._shapes)):
            state.upload(f"level_{level}_span", block_columns(cells > 0.0))
            cells = add_pairs(add_pairs(cells, 0), 1)

    def upload_mass(self, state: State, mass: np.ndarray) -> None:
        """Fill what depends on the diagonal of E.

        Args:
            state: Holds the arrays.
            mass: Shape [ny, nx]; 0 off the leaf.
        """
        system = System(mass, *self._faces)
        for level in range(len(self._shapes)):
            for name in ("mass", "faces_x", "faces_y", "inverse_diagonal"):
                state.upload(f"level_{level}_{name}", getattr(system, name))
            system = system.coarser()

    def record(self, state: State) -> list[Command]:
        """Record a cycle."""
        return self._cycle(state, 0)

    def _cycle(self, state: State, level: int) -> list[Command]:
        shape = self._shapes[level]
        prefix = f"level_{level}_"
        lanes = {name: state.lanes(prefix + name) for name in ("mass", "faces_x", "faces_y", "inverse_diagonal")}
        if level == 0:
            right_side, now, other = (state.lanes(n) for n in (self._right_side, self._begun, self._solution))
        else:
            right_side, now, other = (state.lanes(prefix + n) for n in ("right_side", "solution", "other"))
        span = prefix + "span"
        length, segments = thread_blocks(right_side.shape[1], state)
        dim = (segments, shape[0])
        omegas = sweep_weights(SWEEPS[min(level, len(SWEEPS) - 1)])
        coarsest = level == len(self._shapes) - 1
        if coarsest:
            omegas = omegas if level == 0 else [1.0]
        system = [lanes[name] for name in ("mass", "faces_x", "faces_y", "inverse_diagonal")]

        def sweep(omega: float) -> Command:
            nonlocal now, other
            command = state.record(smooth, dim, [right_side, now, *system, span, length, omega], [other])
            now, other = other, now
            return command

        commands = []
        if level > 0:
            inputs = [right_side, lanes["inverse_diagonal"], span, length, omegas[0]]
            commands.append(state.record(begin_smoothing, dim, inputs, [now]))
        commands += [sweep(omega) for omega in omegas[1:]]
        if not coarsest:
            coarse = f"level_{level + 1}_"
            coarse_right_side = state.lanes(coarse + "right_side")
            coarse_length, coarse_segments = thread_blocks(coarse_right_side.shape[1], state)
            commands.append(
                state.record(
                    restrict_residual,
                    (coarse_segments, self._shapes[level + 1][0]),
                    [right_side, now, *system[:3], coarse + "span", coarse_length],
                    [coarse_right_side],
                )
            )
            commands += self._cycle(state, level + 1)
            commands.append(state.record(correct, dim, [self._found, span, length, OVERCORRECTION], [now]))
        if not coarsest or level == 0:
            commands += [sweep(omega) for omega in reversed(omegas)]
        self._found = now
        return commands


def thread_blocks(blocks: int, state: State) -> tuple[int, int]:
    """How the blocks of a row are shared among threads: blocks of a segment, and number of segments."""
    return (1, blocks) if state.many_threads else (blocks, 1)
