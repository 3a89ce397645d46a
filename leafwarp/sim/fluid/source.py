"""Water that enters at the petiole base."""

from __future__ import annotations

import math

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.steps import SNAP, FluidSteps
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.source import supply_water


class Source(Stage):
    """Water that enters at the petiole base, until the leaf is cut."""

    name = "source"
    purpose = "water that enters at the petiole base"
    rate = "fluid step"
    kernels = (supply_water,)
    writes = ("water",)

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._cells = np.argwhere((leaf.maps["source"] > 0.0) & leaf.mask)
        if len(self._cells) == 0:
            raise InputError(
                "maps.source: the map is 0 on the whole leaf; accepted: a map that is bright where water enters"
            )
        count = len(self._cells)
        self._step = FluidSteps.of(scene).length
        self._end = math.inf if scene.source.cut_at is None else scene.source.cut_at
        self._open = self._step
        self.arrays = (
            ArraySpec("source_cell", (count, 2), "int32", "row and column of each source cell"),
            ArraySpec("source_rate", (count,), "float64", "rate at which each source cell nears the supply [1/s]"),
            ArraySpec("added_by_source", (count,), "float64", "content added to each source cell"),
        )

    def bind(self, state: State) -> None:
        rows, columns = self._cells.T
        weights = self.leaf.maps["source"][rows, columns]
        weights = weights / weights.sum()
        state.upload("source_cell", self._cells)
        state.upload("source_rate", self.scene.source.conductance * weights * self.leaf.mask.sum())
        inputs = ["source_cell", "source_rate", self.scene.source.supply, self._step]
        self.commands = [state.record(supply_water, len(self._cells), inputs, ["water", "added_by_source"])]

    def run(self, interval: Interval | None = None) -> None:
        open_for = min(self._end - interval.start, self._step)
        if open_for <= SNAP * self._step:
            return
        if open_for != self._open:
            self.commands[0].launch.set_param_by_name("time_step", open_for)
            self._open = open_for
        super().run(interval)
