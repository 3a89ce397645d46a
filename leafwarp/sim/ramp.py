"""The way of rest shape, stiffness and mass from one coupling to the next."""

from __future__ import annotations

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.blocks import BLOCK, count_blocks, count_shares, shares
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.rest_state import REST_STATE, following
from leafwarp.sim.stage import Stage
from leafwarp_kernels.ramp import keep, pass_substeps, ramp


class Ramp(Stage):
    """Takes every parameter that the coupling has changed from its old value to the new one within the substeps.

    :class:`leafwarp.sim.motion.Motion` begins it with each span of playback time, puts its launches into
    the graphs of the substeps, and ends it.
    """

    name = "ramp"
    purpose = "rest shape, stiffness and mass on their way from one coupling to the next, every few substeps"
    rate = "frame"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._counts = following(scene, leaf)
        self.arrays = (
            ArraySpec("ramp_clock", (2,), "real", "share of the span that has passed, and that of a substep"),
            *(
                ArraySpec(f"{name}_{when}", (count,), "real", f"{name} at the {which} of the span")
                for name, count in self._counts.items()
                for when, which in (("before", "beginning"), ("after", "end"))
            ),
        )

    def bind(self, state: State) -> None:
        self._state = state
        count = max(self._counts.values())
        nothing = wp.empty(0, dtype=state["ramp_clock"].dtype, device=state.device)

        def named(suffix: str = "") -> list[object]:
            return [name + suffix if name in self._counts else nothing for name in REST_STATE]

        now, before, after = named(), named("_before"), named("_after")
        ends = [array for pair in zip(before, after, strict=True) for array in pair]

        def ramp_to(substeps: float) -> Command:
            return state.record(ramp, count, ["ramp_clock", state.real(substeps), *ends], now)

        sizes = [2**power for power in range(BLOCK.bit_length())]
        self._middles = {middle: ramp_to(middle) for size in sizes for _, middle in shares(size)}
        self._passing = {size: state.record(pass_substeps, 1, [state.real(size)], ["ramp_clock"]) for size in sizes}
        self._remember = state.record(keep, count, now, before)
        self._aim = state.record(keep, count, now, after)
        self._end = state.record(keep, count, after, now)

    def launches_in(self, substeps: int) -> int:
        return 3 + count_shares(substeps) + count_blocks(substeps)

    def remember(self) -> None:
        """Take the parameters of the moment for those that the next span begins with."""
        self._remember.run()

    def aim(self) -> None:
        """Take the parameters of the moment for those that the span ends with."""
        self._aim.run()

    def begin(self, substeps: int) -> None:
        """Begin the span, or begin it anew, in this many substeps."""
        self._state.upload("ramp_clock", np.array([0.0, 1.0 / substeps]))

    def end(self) -> None:
        """Take the parameters of the span's end, to the bit."""
        self._end.run()

    def ramp_to(self, middle: float) -> Command:
        """The launch that takes the parameters to where they are in the ``middle`` of a share of a block."""
        return self._middles[middle]

    def passing(self, size: int) -> Command:
        """The launch at the end of a block of a size."""
        return self._passing[size]
