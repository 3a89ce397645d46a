"""Line solves with many threads a line: their arrays and their recorded launches."""

from __future__ import annotations

from collections.abc import Sequence

import warp as wp

from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import SEGMENT
from leafwarp_kernels.tridiagonal_segments import (
    KEPT,
    guess_forward,
    segment_products,
    sweep_backward,
    sweep_forward,
)


class Segments:
    """The segments of the lines of one direction.

    Args:
        stage: The stage that solves; it gets the arrays.
        state: Holds the arrays of the line solves.
        direction: "x" for rows, "y" for columns.
        shape: Number of lines, and of the cells of each.
    """

    def __init__(self, stage: Stage, state: State, direction: str, shape: tuple[int, int]):
        lines, cells = shape
        self._state = state
        self._dim = (-(-cells // SEGMENT), lines)
        self._products = [f"{sweep}_product_{direction}" for sweep in ("forward", "backward")]
        self._kept = [f"{sweep}_segments_{direction}" for sweep in ("forward", "backward")]
        for product, kept in zip(self._products, self._kept, strict=True):
            stage.add_array(state, ArraySpec(product, self._dim, "real", "product of the weights of each segment"))
            stage.add_array(state, ArraySpec(kept, (KEPT, *self._dim), "real", "what a sweep over a segment leaves"))

    def record_products(self, weights: Sequence[str], span: str) -> Command:
        """Record the products of the weights, after these are made."""
        return self._state.record(segment_products, self._dim, [*weights, span], self._products)

    def record(self, system: Sequence[str], right_side: wp.array, solution: wp.array) -> list[Command]:
        """Record the solve of every line.

        Args:
            system: Names of the arrays of the forward and backward weights and of the spans.
            right_side: Shape [line, cell].
            solution: Shape [line, cell].
        """
        forward_weight, backward_weight, span = system
        forward, backward = self._kept
        record, dim = self._state.record, self._dim
        return [
            record(guess_forward, dim, [forward_weight, span, right_side], [forward]),
            record(sweep_forward, dim, [*system, self._products[0], forward, right_side], [backward, solution]),
            record(sweep_backward, dim, [backward_weight, span, self._products[1], backward], [solution]),
        ]
