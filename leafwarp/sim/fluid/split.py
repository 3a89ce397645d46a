"""Diffusion line by line: rows, then columns (the paper's scheme)."""

from __future__ import annotations

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.lines import LineSolves, diffusion_supply, line_arrays, upload_conductance
from leafwarp.sim.fluid.steps import FluidSteps
from leafwarp.sim.launch import Command, State
from leafwarp.sim.stage import Interval, Stage


class SplitDiffusion(Stage):
    """One implicit step along every row, then along every column.

    Stable and between the extremes for any step; but what a step carries along a diagonal vein is limited to
    about the vein's width, and sinks are damped by it. The step is therefore a matter of accuracy.

    A source takes half of its exchange in each of the two solves, so that a petiole of any direction draws on the
    supply for as long as water flows along it.
    """

    name = "split_diffusion"
    purpose = "water flows along veins and lamina: rows, then columns"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.arrays = line_arrays(leaf.mask.shape)
        self._supply = diffusion_supply(scene, leaf, directions="xy")
        if self._supply is not None:
            self.purpose += ", fed at the petiole base"
            self.arrays += self._supply.arrays

    def bind(self, state: State) -> None:
        time_step = FluidSteps.of(self.scene).length
        upload_conductance(self.scene, self.leaf, state, time_step)
        excess = None
        if self._supply is not None:
            excess = "source_exchange"
        self._solves = {direction: LineSolves(self, state, direction, time_step, excess) for direction in "xy"}
        passes = {direction: solve.record("water", "water") for direction, solve in self._solves.items()}
        self.commands = self._alone = [*passes["x"], *passes["y"]]
        if self._supply is not None:
            self.commands = []
            for direction, solve in passes.items():
                fill, count = self._supply.record(self, state, direction)
                self.commands += [fill, *solve, count]

    def set_time_step(self, seconds: float) -> None:
        for solve in self._solves.values():
            solve.set_time_step(seconds)
            solve.eliminate()
        if self._supply is not None:
            self._supply.opening.set_time_step(seconds)

    def launches_of(self, interval: Interval | None = None) -> list[Command]:
        if self._supply is None:
            return self.commands
        if self._supply.opening.update(interval):
            for solve in self._solves.values():
                solve.eliminate()
        return self.commands if self._supply.opening.seconds > 0.0 else self._alone
