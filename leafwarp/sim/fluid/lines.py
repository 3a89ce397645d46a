"""Line solves on the map: their arrays and their recorded launches, for both schemes of diffusion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import leaf_conductance
from leafwarp.sim.fluid.spans import block_spans, line_spans
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.tridiagonal import eliminate_lines, solve_adjacent_lines, solve_distant_lines

if TYPE_CHECKING:
    from leafwarp.sim.fluid.source import Supply


def diffusion_supply(scene: Scene, leaf: Leaf, directions: str, lines_mix: bool = False) -> Supply | None:
    """The supply that a diffusion solves for, or None where no water enters.

    Its module is imported only if the scene has a source. Arguments are those of
    :class:`leafwarp.sim.fluid.source.Supply`.
    """
    if scene.source is None or scene.source.conductance == 0.0:
        return None
    from leafwarp.sim.fluid.source import Supply

    return Supply(scene, leaf, directions, lines_mix)


def line_arrays(shape: tuple[int, int]) -> tuple[ArraySpec, ...]:
    """The arrays that both schemes of diffusion need, for a map of this shape."""
    rows, columns = shape
    return (
        ArraySpec("conductance_x", shape, "real", "exchange of each cell with its right neighbour [1/s]"),
        ArraySpec("conductance_y", shape, "real", "exchange of each cell with its upper neighbour [1/s]"),
        *_weight_arrays("x", rows, columns),
        *_weight_arrays("y", columns, rows),
    )


def _weight_arrays(direction: str, lines: int, cells: int) -> tuple[ArraySpec, ...]:
    name = "row" if direction == "x" else "column"
    blocks = -(-lines // LANES)
    packed = (blocks, cells, LANES)
    return (
        ArraySpec(f"forward_weight_{direction}", packed, "real", f"weights of the sweeps along {name}s, forward"),
        ArraySpec(f"backward_weight_{direction}", packed, "real", f"weights of the sweeps along {name}s, backward"),
        ArraySpec(f"{name}_span", (lines, 2), "int32", f"first leaf cell of each {name} and the one after its last"),
        ArraySpec(f"{name}_block_span", (blocks, 2), "int32", f"the same of each block of {LANES} {name}s together"),
    )


def upload_conductance(scene: Scene, leaf: Leaf, state: State, time_step: float) -> None:
    """Fill the conductances and the spans of leaf cells."""
    conductance = leaf_conductance(scene, leaf, time_step)
    state.upload("conductance_x", conductance.x)
    state.upload("conductance_y", conductance.y)
    for name, span in (("row", line_spans(leaf.mask)), ("column", line_spans(leaf.mask.T))):
        state.upload(f"{name}_span", span)
        state.upload(f"{name}_block_span", block_spans(span))


class LineSolves:
    """The line solves of one direction, eliminated at once.

    Columns go through the same kernels as rows, on transposed views. On a CPU a thread solves a block of lines in its
    vector lanes; on a GPU a line has many threads.

    Args:
        stage: The stage that solves; it gets the arrays that depend on the device.
        state: Holds the arrays of :func:`line_arrays`; conductances and spans filled.
        direction: "x" for rows, "y" for columns.
        time_step: [s].
        excess_diagonal: Array of what is added to the diagonal of the systems; None for none.
        segmented: Share each line among many threads; by default on a GPU only.
    """

    def __init__(
        self,
        stage: Stage,
        state: State,
        direction: Literal["x", "y"],
        time_step: float,
        excess_diagonal: str | None = None,
        segmented: bool | None = None,
    ):
        self._state = state
        self._direction = direction
        self._span = "row_span" if direction == "x" else "column_span"
        self._weights = [f"{sweep}_weight_{direction}" for sweep in ("forward", "backward")]
        conductance = self._lines(f"conductance_{direction}")
        excess = self._lines(excess_diagonal) if excess_diagonal is not None else None
        self._shape = conductance.shape
        inputs = [conductance, excess, self._span, time_step]
        self._elimination = [state.record(eliminate_lines, self._shape[0], inputs, self._weights)]
        self._segments = None
        if state.many_threads if segmented is None else segmented:
            from leafwarp.sim.fluid.segments import Segments

            self._segments = Segments(stage, state, direction, self._shape)
            self._elimination.append(self._segments.record_products(self._weights, self._span))
        elif direction == "x" and "swept" not in state:
            # A CPU runs one thread after another.
            shape = (1, *state["forward_weight_x"].shape[1:])
            stage.add_array(state, ArraySpec("swept", shape, "real", "contents between the two sweeps along rows"))
        self.eliminate()

    def set_time_step(self, seconds: float) -> None:
        """Take steps of another length [s]; the weights are those of the last one until :meth:`eliminate`."""
        self._elimination[0].launch.set_param_by_name("time_step", seconds)

    def eliminate(self) -> None:
        """Make the weights of the sweeps anew, after the excess of the diagonal has changed."""
        for command in self._elimination:
            command.run()

    def record(self, right_side: str, solution: str) -> list[Command]:
        """Record the solve of every line, from one array of the state to another or in place.

        Args:
            right_side: Array of the systems' right sides over 1 and the excess of the diagonal; padded.
            solution: Array to write; padded.
        """
        state = self._state
        if self._segments is not None:
            return self._segments.record([*self._weights, self._span], self._lines(right_side), self._lines(solution))
        along_rows = self._direction == "x"
        lanes = [state.lanes(name)[:, :, 0] for name in self._weights]
        inputs = [*lanes, "row_block_span" if along_rows else "column_block_span"]
        blocks = len(lanes[0])
        if along_rows:
            outputs = [state.lanes("swept")[:, :, 0], state.whole(solution)]
            return [state.record(solve_distant_lines, blocks, [*inputs, state.whole(right_side)], outputs)]
        contents, target = (state.lanes(name).transpose((1, 0)) for name in (right_side, solution))
        return [state.record(solve_adjacent_lines, blocks, [*inputs, contents], [target])]

    def _lines(self, name: str) -> wp.array:
        array = self._state[name]
        return array if self._direction == "x" else array.transpose((1, 0))
