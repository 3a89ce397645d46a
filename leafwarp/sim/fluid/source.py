"""The exchange with a supply at the petiole base."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import warp as wp

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import MAXIMUM_BETA
from leafwarp.sim.fluid.spans import line_spans
from leafwarp.sim.fluid.steps import SNAP, FluidSteps
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.source import count_lines, fill_lines, open_source


class Supply:
    """The source as the stages see it that solve for the water of a step.

    A stage calls :meth:`update` at the start of a step. While the source is open it runs the two commands of
    :meth:`record` around each solve, with the array "source_exchange" added to the diagonal of the solved system.

    Args:
        scene: With [source].
        leaf: The leaf.
        directions: Line directions, "x" for rows and "y" for columns, of the stage's solves in a step; each takes
            an equal share of the step's exchange.
        lines_mix: The solve moves water between the lines of its direction, so that all of them are counted, and
            not only those with a source cell.

    Attributes:
        arrays: The arrays that the stage has to declare.
        is_source: Cells that exchange water with the supply, shape [ny, nx], bool.
        open_for: How long the source is open in the present step [s]; 0 before the first one.

    Raises:
        InputError: The map shows no source on the leaf.
    """

    def __init__(self, scene: Scene, leaf: Leaf, directions: str, lines_mix: bool = False):
        self.open_for = 0.0
        self._scene = scene
        self._leaf = leaf
        self._directions = directions
        self.is_source = (leaf.maps["source"] > 0.0) & leaf.mask
        if not self.is_source.any():
            raise InputError(
                "maps.source: the map is 0 on the whole leaf; accepted: a map that is bright where water enters"
            )
        self._step = FluidSteps.of(scene).length
        self._end = math.inf if scene.source.cut_at is None else scene.source.cut_at
        self._spans = {}
        for direction in directions:
            mask, is_source = (m if direction == "x" else m.T for m in (leaf.mask, self.is_source))
            counted = True if lines_mix else is_source.any(axis=1)[:, None]
            self._spans[direction] = line_spans(mask & counted)
        self.arrays = tuple(self._declare())

    def _declare(self) -> Iterable[ArraySpec]:
        count = int(self.is_source.sum())
        yield ArraySpec("source_cell", (count, 2), "int32", "row and column of each source cell")
        yield ArraySpec("source_rate", (count,), "float64", "rate at which each source cell nears the supply [1/s]")
        yield ArraySpec("source_exchange", self._leaf.mask.shape, "real", "the same rates times the time of a solve")
        for direction, span in self._spans.items():
            lines = "rows" if direction == "x" else "columns"
            count = len(span)
            yield ArraySpec(f"source_span_{direction}", (count, 2), "int32", f"cells of {lines} counted for the source")
            yield ArraySpec(
                f"added_by_source_{direction}", (count,), "float64", f"content added to each of the {lines}"
            )

    def bind(self, state: State) -> None:
        """Fill the arrays."""
        cells = np.argwhere(self.is_source)
        weights = self._leaf.maps["source"][self.is_source]
        with np.errstate(over="ignore"):
            rate = self._scene.source.conductance * (weights / weights.sum()) * self._leaf.mask.sum()
        state.upload("source_cell", cells)
        state.upload("source_rate", np.minimum(rate, min(MAXIMUM_BETA / self._step, MAXIMUM_BETA)))
        for direction, span in self._spans.items():
            state.upload(f"source_span_{direction}", span)
        self._state = state
        self._open = state.record(open_source, len(cells), ["source_cell", "source_rate", 0.0], ["source_exchange"])

    def record(self, direction: str) -> tuple[Command, Command]:
        """Record what is done before and after a solve: fill the source cells, and count what entered."""
        span, added = f"source_span_{direction}", f"added_by_source_{direction}"
        water, exchange = self._lines("water", direction), self._lines("source_exchange", direction)
        fill_inputs = [exchange, span, self._scene.source.supply]
        return (
            self._state.record(fill_lines, len(water), fill_inputs, [water, added]),
            self._state.record(count_lines, len(water), [water, span], [added]),
        )

    def _lines(self, name: str, direction: str) -> wp.array:
        array = self._state[name]
        return array if direction == "x" else array.transpose((1, 0))

    def update(self, interval: Interval) -> bool:
        """Open the source for its part of a step.

        Returns:
            Whether the exchange is another than in the step before: at the start, with the cut and after it.
        """
        open_for = min(self._end - interval.start, self._step)
        if open_for <= SNAP * self._step:
            open_for = 0.0
        elif open_for >= (1.0 - SNAP) * self._step:
            open_for = self._step
        if open_for == self.open_for:
            return False
        self.open_for = open_for
        self._open.launch.set_param_by_name("open_for", open_for / len(self._directions))
        self._open.run()
        return True


class Source(Stage):
    """The exchange with the supply where nothing flows; where water flows, it is part of the diffusion."""

    name = "source"
    purpose = "water exchanged with the supply at the petiole base, until the leaf is cut"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._supply = Supply(scene, leaf, "x")
        self.arrays = self._supply.arrays

    def bind(self, state: State) -> None:
        self._supply.bind(state)
        self.commands = list(self._supply.record("x"))

    def run(self, interval: Interval | None = None) -> None:
        self._supply.update(interval)
        if self._supply.open_for > 0.0:
            super().run(interval)
