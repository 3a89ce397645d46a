"""The map of the water, and the water at the moment of a frame."""

from __future__ import annotations

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.interpolation import interpolate_water


class Water(Stage):
    """Owns the map of the relative water content; blends it to the moment of a frame.

    ``water`` is the state after the last fluid step, ``water_before`` the one before it, ``water_now`` the
    linear blend at the frame's plant time: exactly ``water`` where the frame falls on the end of a step.
    """

    name = "water"
    purpose = "water map at the frame's plant time, between the last two fluid steps"
    rate = "frame"
    host_reads = ("water",)
    host_writes = ("water_before",)

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        shape = leaf.mask.shape
        self.arrays = (
            ArraySpec("water", shape, "real", "relative water content after the last fluid step", padded=True),
            ArraySpec("water_before", shape, "real", "relative water content before the last fluid step", padded=True),
            ArraySpec("water_now", shape, "real", "relative water content at the frame", padded=True),
        )

    def bind(self, state: State) -> None:
        content = np.where(self.leaf.mask, np.clip(self.leaf.maps["water"], 0.0, 1.0), 0.0)
        for name in ("water", "water_before", "water_now"):
            state.upload(name, content)
        self._state = state
        before, water, now = (state.lanes(name) for name in ("water_before", "water", "water_now"))
        self.commands = [state.record(interpolate_water, now.shape, [before, water, 1.0], [now])]

    def keep(self) -> None:
        """Remember the water before the next step."""
        wp.copy(self._state.whole("water_before"), self._state.whole("water"))

    def blend(self, share: float) -> None:
        """Set ``water_now`` to the moment when this share of the last step has passed."""
        for command in self.commands:
            command.launch.set_param_by_name("share", self._state.real(share))
        self.run()
