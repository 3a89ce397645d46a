"""The fluid's own clock: equal steps of plant time, independent of the frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

from leafwarp.errors import InputError
from leafwarp.scene import Scene
from leafwarp.sim.stage import Interval

MAXIMUM_COUNT = 10_000_000
# A moment this close to the end of a step, in steps, is the end.
SNAP = 1e-8


@dataclass(frozen=True)
class FluidSteps:
    """Equal fluid steps that fill the plant time of a scene.

    Attributes:
        count: Number of steps.
        length: Length of each [s]; at most the scene's ``fluid.step``.
    """

    count: int
    length: float

    @classmethod
    def of(cls, scene: Scene) -> FluidSteps:
        """The steps of a scene.

        Raises:
            InputError: Too many steps.
        """
        duration, step = scene.time.duration, scene.fluid.step
        ratio = duration / step
        if not ratio <= MAXIMUM_COUNT:
            raise InputError(
                f"fluid.step = {step:g} s: {ratio:.3g} steps fill time.duration = {duration:g} s; "
                f"accepted: at most {MAXIMUM_COUNT}, a step of {duration / MAXIMUM_COUNT:.3g} s or more"
            )
        count = max(1, math.ceil(ratio * (1.0 - SNAP)))
        return cls(count, duration / count)

    def interval(self, index: int) -> Interval:
        """The span of plant time of a step, counted from 0."""
        return Interval(index * self.length, (index + 1) * self.length)

    def locate(self, plant_time: float) -> tuple[int, float]:
        """How many steps a moment needs, and the share of the last one that has passed.

        Args:
            plant_time: [s]; held to the scene's duration.

        Returns:
            Number of steps begun and a share in (0, 1], exactly 1 at the end of a step and at the start.
        """
        passed = min(max(plant_time / self.length, 0.0), float(self.count))
        whole = round(passed)
        if abs(passed - whole) <= SNAP:
            return whole, 1.0
        begun = math.ceil(passed)
        return begun, passed - (begun - 1)


class NotConverged(Exception):
    """A solver did not reach its tolerance within a fluid step; says how far it came and what would help."""
