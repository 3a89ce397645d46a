"""Fluid steps of second order: each is taken once whole and once in halves.

The stages of the fluid take the whole step, as they do without this. :class:`HalfSteps` has the same stages once more,
with arrays of their own, for the halves; :class:`Extrapolation` makes one of both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.spans import thread_blocks
from leafwarp.sim.fluid.steps import HALF_STEP, FluidSteps, NotConverged
from leafwarp.sim.fluid.water import content_bounds
from leafwarp.sim.launch import ArraySpec, Command, PartOfState, State
from leafwarp.sim.stage import Interval, Stage, bind_stage
from leafwarp_kernels.extrapolation import (
    ERROR,
    SUM_COUNT,
    TOLD_COUNT,
    compare_halves,
    compare_middle,
    extrapolate_account,
    extrapolate_water,
    judge_step,
)

ACCOUNTS = ("transpired", "added_by_source_x", "added_by_source_y")
# How much of the extrapolation may be held at a bound, over all that it changes, before it is left out.
HELD_SHARE = 0.05
# By how much contents may be beyond a bound, in units of the last place.
ROUNDING = 16.0


class HalfSteps(Stage):
    """Takes every fluid step in two halves, on a map of its own.

    Attributes:
        stages: The stages of the fluid, for steps of half the length.
    """

    name = "half_steps"
    purpose = "the fluid step in two halves, on a map of its own"
    rate = "fluid step"
    host_reads = ("water",)

    def __init__(self, scene: Scene, leaf: Leaf):
        from leafwarp.sim.plan import make_stages

        super().__init__(scene, leaf)
        step = 0.5 * FluidSteps.of(scene).length
        half = scene.with_changes({"fluid.step": step, "fluid.order": 1, "fluid.step_tolerance": None})
        self.stages = [stage for stage in make_stages(half, leaf, "fluid")[0] if stage.rate == "fluid step"]
        shape = leaf.mask.shape
        self._own = [ArraySpec("water", shape, "real", "relative water content in half steps", padded=True)]
        self._shows_middle = scene.fluid.step_tolerance is not None
        if self._shows_middle:
            self._own.append(ArraySpec("middle", shape, "real", "the same after the first half", padded=True))
        self._note_arrays()

    def _note_arrays(self) -> None:
        specs = (*self._own, *(spec for stage in self.stages for spec in stage.arrays))
        self.arrays = tuple(replace(spec, name=HALF_STEP + spec.name) for spec in specs)

    @property
    def host_bytes(self) -> int:
        return sum(stage.host_bytes for stage in self.stages)

    @property
    def launches(self) -> int:
        return 2 * sum(stage.launches for stage in self.stages)

    def bind(self, state: State) -> None:
        self._state = state
        part = PartOfState(state, HALF_STEP)
        for stage in self.stages:
            bind_stage(stage, part)
        self._note_arrays()
        # Accounts of the whole step are there once the stages that come after this one are bound.
        self._copied = ["water", *(name for name in ACCOUNTS if name in part)]
        self._guesses = [prefix for prefix in ("", HALF_STEP) if f"{prefix}unsplit_before" in state]
        if self._guesses:
            names = ("unsplit_before", "unsplit_rounding")
            self.host_writes = tuple(prefix + name for prefix in self._guesses for name in names)

    def set_time_step(self, seconds: float) -> None:
        for stage in self.stages:
            stage.set_time_step(0.5 * seconds)

    def launches_of(self, interval: Interval | None = None) -> None:
        return None

    def run(self, interval: Interval | None = None) -> None:
        """Take both halves.

        Raises:
            NotConverged: One of them cannot be solved.
        """
        for name in self._copied:
            wp.copy(self._state.whole(HALF_STEP + name), self._state.whole(name))
        for prefix in self._guesses:
            # Iterations start from the water as it is: from what was extrapolated they would come back to that.
            wp.copy(self._state.whole(f"{prefix}unsplit_before"), self._state.whole("water"))
            self._state.whole(f"{prefix}unsplit_rounding").zero_()
        middle = 0.5 * (interval.start + interval.end)
        self._run_half(Interval(interval.start, middle))
        if self._shows_middle:
            wp.copy(self._state.whole(HALF_STEP + "middle"), self._state.whole(HALF_STEP + "water"))
        self._run_half(Interval(middle, interval.end))

    def _run_half(self, interval: Interval) -> None:
        for stage in self.stages:
            try:
                stage.run(interval)
            except NotConverged as error:
                raise NotConverged(f"in half a step: {error}") from None


class Extrapolation(Stage):
    """Makes a step of second order of the whole step and the two halves."""

    name = "extrapolation"
    purpose = "fluid step of second order, from one whole step and two halves; error of these"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        told = ArraySpec("extrapolation", (TOLD_COUNT,), "float64", "weight of the extrapolation, error of the halves")
        self.arrays = (told,)

    def bind(self, state: State) -> None:
        water, halves = state.lanes("water"), state.lanes(HALF_STEP + "water")
        length, segments = thread_blocks(water.shape[1], state)
        dim = (segments, water.shape[0])
        self.add_array(state, ArraySpec("extrapolation_sum", (SUM_COUNT, *dim), "float64", "sums of it by segments"))
        held = {"held_at_least": "losing", "held_at_most": "taking up"}
        for name, what in held.items():
            self.add_array(state, ArraySpec(name, dim, "float64", f"content that cells were kept from {what}"))
        # The contents are rounded, these are not.
        rounding = ROUNDING * float(np.finfo(state.precision).eps)
        least, most = content_bounds(self.scene, self.leaf)
        bounds = (least * (1.0 - rounding), most * (1.0 + rounding))
        share_below = HELD_SHARE if "transpired" in state else 0.0
        share_above = HELD_SHARE if "added_by_source_x" in state else 0.0
        sums, told = "extrapolation_sum", "extrapolation"
        straight = []
        if self.scene.fluid.step_tolerance is not None:
            line = [state.lanes(name) for name in ("water_before", HALF_STEP + "middle", HALF_STEP + "water")]
            straight = [state.record(compare_middle, dim, [*line, length], [sums])]
        self.commands = [
            *straight,
            state.record(compare_halves, dim, [water, halves, length, *bounds], [sums]),
            state.record(judge_step, 1, [sums, share_below, share_above], [told]),
            state.record(extrapolate_water, dim, [halves, told, length, *bounds], [water, *held]),
            *(self._account(state, name) for name in ACCOUNTS if name in state),
        ]

    def _account(self, state: State, name: str) -> Command:
        return state.record(extrapolate_account, state[name].shape, [HALF_STEP + name, "extrapolation"], [name])


def step_error(state: State) -> float:
    """How far the halves of the last step, or a straight line between its ends, were off; waits for the device.

    Norm of that over the norm of the contents.
    """
    return float(state["extrapolation"].numpy()[ERROR])
