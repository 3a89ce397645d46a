"""Line solves on the map: their arrays and their recorded launches, for both schemes of diffusion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import leaf_conductance
from leafwarp.sim.fluid.spans import line_spans
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp_kernels.tridiagonal import eliminate_lines, solve_lines

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
        ArraySpec("forward_weight_x", shape, "real", "weights of the sweeps along rows, forward"),
        ArraySpec("backward_weight_x", shape, "real", "weights of the sweeps along rows, backward"),
        ArraySpec("forward_weight_y", shape, "real", "weights of the sweeps along columns, forward"),
        ArraySpec("backward_weight_y", shape, "real", "weights of the sweeps along columns, backward"),
        ArraySpec("row_span", (rows, 2), "int32", "first leaf cell of each row and the one after its last"),
        ArraySpec("column_span", (columns, 2), "int32", "first leaf cell of each column and the one after its last"),
    )


def upload_conductance(scene: Scene, leaf: Leaf, state: State, time_step: float) -> None:
    """Fill the conductances and the spans of leaf cells."""
    conductance = leaf_conductance(scene, leaf, time_step)
    state.upload("conductance_x", conductance.x)
    state.upload("conductance_y", conductance.y)
    state.upload("row_span", line_spans(leaf.mask))
    state.upload("column_span", line_spans(leaf.mask.T))


class LineSolves:
    """The line solves of one direction, eliminated at once.

    Columns go through the same kernels as rows, on transposed views.

    Args:
        state: Holds the arrays of :func:`line_arrays`; conductances and spans filled.
        direction: "x" for rows, "y" for columns.
        time_step: [s].
        excess_diagonal: Array of what is added to the diagonal of the systems; None for none.
    """

    def __init__(
        self, state: State, direction: Literal["x", "y"], time_step: float, excess_diagonal: str | None = None
    ):
        self._state = state
        self._along_rows = direction == "x"
        self._span = "row_span" if self._along_rows else "column_span"
        self._excess = None if excess_diagonal is None else self._lines(excess_diagonal)
        self._weights = [self._lines(f"{sweep}_weight_{direction}") for sweep in ("forward", "backward")]
        conductance = self._lines(f"conductance_{direction}")
        inputs = [conductance, self._excess, self._span, time_step]
        self._elimination = state.record(eliminate_lines, len(conductance), inputs, self._weights)
        self.eliminate()

    def eliminate(self) -> None:
        """Make the weights of the sweeps anew, after the excess of the diagonal has changed."""
        self._elimination.run()

    def record(self, right_side: str, solution: str, divided: bool = False) -> Command:
        """Record the solve of every line, from one array of the state to another or in place.

        Args:
            right_side: Array of the systems' right sides.
            solution: Array to write.
            divided: The right sides are divided by 1 and the excess of the diagonal already.
        """
        target = self._lines(solution)
        excess = None if divided else self._excess
        inputs = [*self._weights, excess, self._span, self._lines(right_side)]
        return self._state.record(solve_lines, len(target), inputs, [target])

    def _lines(self, name: str) -> wp.array:
        array = self._state[name]
        return array if self._along_rows else array.transpose((1, 0))
