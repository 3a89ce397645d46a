"""Line solves on the map: their arrays and their recorded launches, for both schemes of diffusion."""

from __future__ import annotations

from typing import Literal

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import leaf_conductance
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp_kernels.tridiagonal import eliminate_lines, solve_lines


def leaf_spans(mask: np.ndarray) -> np.ndarray:
    """First leaf cell of each line and the one after its last; (0, 0) for a line without one.

    Args:
        mask: Cells that are leaf, shape [line, cell].

    Returns:
        Shape [line, 2], int32.
    """
    first = np.argmax(mask, axis=1)
    end = mask.shape[1] - np.argmax(mask[:, ::-1], axis=1)
    return np.where(mask.any(axis=1)[:, None], np.stack([first, end], axis=1), 0).astype(np.int32)


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
    state.upload("row_span", leaf_spans(leaf.mask))
    state.upload("column_span", leaf_spans(leaf.mask.T))


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
        state.record(eliminate_lines, len(conductance), inputs, self._weights).run()

    def record(self, right_side: str, solution: str) -> Command:
        """Record the solve of every line, from one array of the state to another or in place."""
        target = self._lines(solution)
        inputs = [*self._weights, self._excess, self._span, self._lines(right_side)]
        return self._state.record(solve_lines, len(target), inputs, [target])

    def _lines(self, name: str) -> wp.array:
        array = self._state[name]
        return array if self._along_rows else array.transpose((1, 0))
