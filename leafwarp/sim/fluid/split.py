"""Diffusion line by line: rows, then columns (the paper's scheme)."""

from __future__ import annotations

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.lines import LineSolves, line_arrays, upload_conductance
from leafwarp.sim.fluid.steps import FluidSteps
from leafwarp.sim.launch import State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.tridiagonal import eliminate_lines, solve_lines


class SplitDiffusion(Stage):
    """One implicit step along every row, then along every column.

    Stable and between the extremes for any step; but what a step carries along a diagonal vein is limited to
    about the vein's width, and sources and sinks are damped by it. The step is therefore a matter of
    accuracy.
    """

    name = "split_diffusion"
    purpose = "water flows along veins and lamina: rows, then columns"
    rate = "fluid step"
    kernels = (eliminate_lines, solve_lines)
    writes = ("water",)
    launches = 2

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.arrays = line_arrays(leaf.mask.shape)

    def bind(self, state: State) -> None:
        time_step = FluidSteps.of(self.scene).length
        upload_conductance(self.scene, self.leaf, state, time_step)
        self.commands = [LineSolves(state, direction, time_step).record("water", "water") for direction in ("x", "y")]
