"""Diffusion along rows and columns at once, by a sparse factor on the host: the accurate scheme, and a fast one."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.exchange import ExchangeSystem
from leafwarp.sim.fluid.lines import diffusion_supply
from leafwarp.sim.launch import State
from leafwarp.sim.stage import Interval, Stage


class FactoredDiffusion(Stage):
    """One implicit step along rows and columns at once.

    It is solved in float64 whatever the precision of the scene, to the accuracy that :class:`UnsplitDiffusion` has
    (``fluid.tolerance``), mostly much better. On a GPU the map goes to the host and back in every step.

    Without a source the content of the whole leaf is exact; while one is open, what is missing in it counts as added
    by the source.

    Attributes:
        system: The system that is solved.
    """

    name = "factored_diffusion"
    purpose = "water flows along veins and lamina: rows and columns at once, by a sparse factor on the host"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.host_reads = self.host_writes = ("water",)
        self._supply = diffusion_supply(scene, leaf, directions="x", lines_mix=True)
        if self._supply is not None:
            self.purpose += ", fed at the petiole base"
            self.host_reads += ("source_exchange",)
            self.arrays = self._supply.arrays

    @property
    def host_bytes(self) -> int:
        return self.system.byte_count

    def bind(self, state: State) -> None:
        self._state = state
        self.system = ExchangeSystem.of(self.scene, self.leaf)
        if self._supply is not None:
            self.commands = list(self._supply.record(self, state, "x"))

    def set_time_step(self, seconds: float) -> None:
        self.system = self.system.of_step(self.scene, self.leaf, seconds)
        if self._supply is not None:
            self._supply.opening.set_time_step(seconds)

    def launches_of(self, interval: Interval | None = None) -> None:
        return None

    def run(self, interval: Interval | None = None) -> None:
        """Do one step.

        Raises:
            NotConverged: The step cannot be solved to the tolerance.
        """
        commands = []
        if self._supply is not None:
            if self._supply.opening.update(interval):
                self.system.factorise(self.system.on_cells(self._state["source_exchange"].numpy()))
            if self._supply.opening.seconds > 0.0:
                commands = self.commands
        for command in commands[:1]:
            command.run()
        self._solve()
        for command in commands[1:]:
            command.run()

    def _solve(self) -> None:
        content = self.system.on_cells(self._state["water"].numpy()).astype(np.float64)
        after = np.zeros(self.leaf.mask.shape)  # cells off the leaf hold no water
        after.reshape(-1)[self.system.cells] = self.system.step(content, self.scene.residual_tolerance)
        self._state.upload("water", after)
