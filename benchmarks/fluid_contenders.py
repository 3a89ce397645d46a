"""Other ways to do one step of diffusion on a leaf, for the fluid benchmark; all on the same spans of cells.

Each class holds a map of contents [ny, nx] and has ``step()``; ``content`` is the map after the steps so far.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from benchmarks.naive_thomas import naive_lines
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import FaceConductance, leaf_conductance
from leafwarp.sim.fluid.exchange import ExchangeSystem
from leafwarp.sim.fluid.lines import LineSolves, line_arrays, upload_conductance
from leafwarp.sim.fluid.spans import line_spans
from leafwarp.sim.launch import ArraySpec, State, specialise
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.tridiagonal import solve_adjacent_lines, solve_distant_lines, solve_lines


class Problem:
    """What every contender gets.

    Args:
        scene: The scene, for its diffusivities.
        leaf: With a mask and a venation map.
        time_step: [s].

    Attributes:
        conductance: Rates of exchange over the faces [1/s].
        mask: Leaf cells, shape [ny, nx].
        spans: Of rows and of columns: first leaf cell of each line and the one after its last.
        content: Contents before the first step, 0 off the leaf.
    """

    def __init__(self, scene: Scene, leaf: Leaf, time_step: float):
        self.scene, self.leaf, self.time_step = scene, leaf, time_step
        self.mask = leaf.mask
        self.conductance: FaceConductance = leaf_conductance(scene, leaf, time_step)
        self.spans = {"x": line_spans(leaf.mask), "y": line_spans(leaf.mask.T)}
        self.content = np.where(leaf.mask, np.random.default_rng(1).random(leaf.mask.shape), 0.0)

    def cells(self, direction: str) -> int:
        """Cells of all spans of a direction."""
        return int(np.diff(self.spans[direction], axis=1).sum())

    def least_bytes(self, directions: str, size: int) -> int:
        """What a step must move at least: each content read and written, its two weights read, once a direction.

        Args:
            directions: "x", "y" or both.
            size: Bytes of a number.
        """
        return sum(4 * size * self.cells(direction) for direction in directions)


class Lanes:
    """This project's step on a CPU.

    Args:
        problem: The problem.
        directions: "xy", or one of them alone.
        precision: Of contents and weights.
    """

    def __init__(self, problem: Problem, directions: str = "xy", precision: str = "float32"):
        shape = problem.mask.shape
        specs = (*line_arrays(shape), ArraySpec("water", shape, "real", "relative water content", padded=True))
        self.state = State(specs, "cpu", precision)
        upload_conductance(problem.scene, problem.leaf, self.state, problem.time_step)
        self.state.upload("water", problem.content)
        stage = Stage(problem.scene, problem.leaf)
        solves = {d: LineSolves(stage, self.state, d, problem.time_step, segmented=False) for d in "xy"}
        self.commands = [command for d in directions for command in self._record(solves[d], d)]

    def _record(self, solves: LineSolves, direction: str) -> list:
        return solves.record("water", "water")

    def step(self) -> None:
        for command in self.commands:
            command.run()

    @property
    def content(self) -> np.ndarray:
        return self.state["water"].numpy()


class ScalarThreads(Lanes):
    """One thread a line with the same weights: the reference kernel."""

    def _record(self, solves: LineSolves, direction: str) -> list:
        state = self.state
        water = state["water"] if direction == "x" else state["water"].transpose((1, 0))
        weights = [state[f"{sweep}_weight_{direction}"] for sweep in ("forward", "backward")]
        span = "row_span" if direction == "x" else "column_span"
        return [state.record(solve_lines, water.shape[0], [*weights, span, water], [water])]


class TwoThreads(Lanes):
    """This project's step by two threads of the host, each with half of the blocks of lines."""

    def __init__(self, problem: Problem, precision: str = "float32"):
        super().__init__(problem, "xy", precision)
        self._pool = ThreadPoolExecutor(2)
        self._rooms: list[wp.array] = []  # a recorded launch does not keep its arrays
        self._halves = [self._launches(direction) for direction in "xy"]

    def _launches(self, direction: str) -> list[wp.Launch]:
        state = self.state
        name = "row" if direction == "x" else "column"
        weights = [state.lanes(f"{sweep}_weight_{direction}")[:, :, 0] for sweep in ("forward", "backward")]
        span = state[f"{name}_block_span"]
        blocks = len(span)
        middle = _middle(span.numpy())
        launches = []
        for begin, end in ((0, middle), (middle, blocks)):
            part = slice(begin, end)
            inputs = [*(array[part] for array in weights), span[part]]
            if direction == "x":
                water = state.whole("water")[LANES * begin : LANES * end]
                room = wp.zeros((1, weights[0].shape[1]), dtype=weights[0].dtype, device="cpu")
                self._rooms.append(room)
                kernel, arguments = solve_distant_lines, [*inputs, water, room, water]
            else:
                water = state.lanes("water").transpose((1, 0))[part]
                kernel, arguments = solve_adjacent_lines, [*inputs, water, water]
            concrete = specialise(kernel, state.precision)
            launches.append(wp.launch(concrete, dim=end - begin, inputs=arguments, device="cpu", record_cmd=True))
        return launches

    def step(self) -> None:
        for halves in self._halves:
            for done in [self._pool.submit(launch.launch) for launch in halves]:
                done.result()


def _middle(span: np.ndarray) -> int:
    """Where to part blocks so that both parts have as many cells."""
    cells = np.cumsum(span[:, 1] - span[:, 0])
    return int(np.clip(np.searchsorted(cells, cells[-1] / 2) + 1, 1, len(span) - 1))


class NaiveWarp:
    """Thomas' algorithm of a tutorial, a thread a line."""

    def __init__(self, problem: Problem):
        self._water = wp.array(problem.content, dtype=wp.float32, device="cpu")
        upper = wp.zeros_like(self._water)
        self._launches = []
        for direction in "xy":
            conductance = wp.array(getattr(problem.conductance, direction), dtype=wp.float32, device="cpu")
            arrays = [conductance, upper, self._water]
            if direction == "y":
                arrays = [array.transpose((1, 0)) for array in arrays]
            span = wp.array(problem.spans[direction], dtype=wp.int32, device="cpu")
            inputs = [arrays[0], span, problem.time_step, *arrays[1:]]
            launch = wp.launch(naive_lines, dim=len(span), inputs=inputs, device="cpu", record_cmd=True)
            self._launches.append((launch, conductance, span))

    def step(self) -> None:
        for launch, *_ in self._launches:
            launch.launch()

    @property
    def content(self) -> np.ndarray:
        return self._water.numpy()


class _HostLines:
    """Lines of both directions on the host, columns as rows of the transposed map."""

    def __init__(self, problem: Problem):
        self._content = np.ascontiguousarray(problem.content, np.float32)
        self._systems = []
        for direction in "xy":
            conductance = getattr(problem.conductance, direction)
            beta = (conductance if direction == "x" else conductance.T) * problem.time_step
            self._systems.append(self._prepare(beta, problem.spans[direction]))

    def _prepare(self, beta: np.ndarray, span: np.ndarray) -> object:
        raise NotImplementedError

    def _solve(self, system: object, lines: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def step(self) -> None:
        rows, columns = self._systems
        self._content = self._solve(rows, self._content)
        turned = self._solve(columns, np.ascontiguousarray(self._content.T))
        self._content = np.ascontiguousarray(turned.T)

    @property
    def content(self) -> np.ndarray:
        return self._content


class Lapack(_HostLines):
    """LAPACK's ``sgtsv``, one call a line."""

    def _prepare(self, beta: np.ndarray, span: np.ndarray) -> list:
        systems = []
        for line, (first, end) in enumerate(span):
            if end > first + 1:  # a cell without neighbours keeps its content
                between = beta[line, first : end - 1]
                around = np.concatenate([[0.0], between]) + np.concatenate([between, [0.0]])
                off = (-between).astype(np.float32)
                systems.append((line, first, end, off, (1.0 + around).astype(np.float32)))
        return systems

    def _solve(self, system: list, lines: np.ndarray) -> np.ndarray:
        from scipy.linalg.lapack import sgtsv

        for line, first, end, off, diagonal in system:
            lines[line, first:end] = sgtsv(off, diagonal, off, lines[line, first:end])[3]
        return lines


class AcrossLines(_HostLines):
    """NumPy on all lines at once, cell by cell, with weights made once."""

    def _prepare(self, beta: np.ndarray, span: np.ndarray) -> tuple:
        lines, cells = beta.shape
        forward, backward = np.zeros((2, cells, lines), np.float32)
        carried = np.zeros(lines)
        for cell in range(cells):
            remainder = 1.0 + carried
            weight = beta[:, cell] / (remainder + beta[:, cell])
            forward[cell], backward[cell] = carried / remainder, weight
            carried = remainder * weight
        filled = span[span[:, 1] > span[:, 0]]
        return forward, backward, int(filled[:, 0].min()), int(filled[:, 1].max())

    def _solve(self, system: tuple, lines: np.ndarray) -> np.ndarray:
        forward, backward, first, end = system
        content = np.ascontiguousarray(lines.T)
        for cell in range(first + 1, end):
            content[cell] += forward[cell] * (content[cell - 1] - content[cell])
        for cell in range(end - 2, first - 1, -1):
            content[cell] += backward[cell] * (content[cell + 1] - content[cell])
        return np.ascontiguousarray(content.T)


class Factored:
    """This project's unsplit step, by a sparse factor on the host, to the scene's tolerance."""

    def __init__(self, problem: Problem):
        self._system = ExchangeSystem(problem.conductance, problem.mask, problem.time_step)
        self._tolerance = problem.scene.residual_tolerance
        self._map = problem.content.copy()
        self._water = self._map.reshape(-1)[self._system.cells]

    def step(self) -> None:
        self._water = self._system.step(self._water, self._tolerance)

    @property
    def content(self) -> np.ndarray:
        self._map.reshape(-1)[self._system.cells] = self._water
        return self._map


class SciPySparse:
    """The same system by SciPy's ``splu`` as it comes, factorised once, in float64."""

    def __init__(self, problem: Problem):
        import scipy.sparse as sparse
        from scipy.sparse.linalg import splu

        index = np.cumsum(problem.mask).reshape(problem.mask.shape) - 1
        x, y = problem.conductance.x > 0.0, problem.conductance.y > 0.0
        here = np.concatenate([index[x], index[y]])
        beyond = np.concatenate([index[:, 1:][x[:, :-1]], index[1:][y[:-1]]])
        beta = np.concatenate([problem.conductance.x[x], problem.conductance.y[y]]) * problem.time_step
        count = int(problem.mask.sum())
        off = sparse.coo_matrix((beta, (here, beyond)), shape=(count, count))
        off = off + off.T
        around = np.asarray(off.sum(axis=1)).ravel()
        self._factor = splu((sparse.diags(1.0 + around) - off).tocsc())
        self._mask, self._map = problem.mask, problem.content.copy()
        self._water = problem.content[problem.mask]

    def step(self) -> None:
        self._water = self._factor.solve(self._water)

    @property
    def content(self) -> np.ndarray:
        self._map[self._mask] = self._water
        return self._map


class FiPy:
    """FiPy's finite volumes: rows and columns at once, its own default solver, on the map's rectangle."""

    def __init__(self, problem: Problem):
        import fipy

        rows, columns = problem.mask.shape
        self._shape = problem.mask.shape
        self._time_step = problem.time_step
        mesh = fipy.Grid2D(nx=columns, ny=rows, dx=1.0, dy=1.0)
        self._water = fipy.CellVariable(mesh=mesh, value=problem.content.ravel(), hasOld=True)
        # Its faces: first those between rows, from below, then those between columns, from the left.
        upward, rightward = np.zeros((rows + 1, columns)), np.zeros((rows, columns + 1))
        upward[1:] = problem.conductance.y
        rightward[:, 1:] = problem.conductance.x
        exchange = fipy.FaceVariable(mesh=mesh, value=np.concatenate([upward.ravel(), rightward.ravel()]))
        self._equation = fipy.TransientTerm() == fipy.DiffusionTerm(coeff=exchange)

    def step(self) -> None:
        self._water.updateOld()
        self._equation.solve(var=self._water, dt=self._time_step)

    @property
    def content(self) -> np.ndarray:
        return np.asarray(self._water.value).reshape(self._shape)


class Stream:
    """A plain copy that moves as many bytes as a step must."""

    def __init__(self, byte_count: int):
        self._source = np.ones(byte_count // 8, np.float32)
        self._target = np.zeros_like(self._source)

    def step(self) -> None:
        np.copyto(self._target, self._source)
