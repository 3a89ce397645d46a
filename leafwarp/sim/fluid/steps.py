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
# What names of arrays begin with that belong to half steps.
HALF_STEP = "half_step_"


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
        most = MAXIMUM_COUNT // scene.fluid.order  # those of second order are also taken in halves
        if not ratio <= most:
            raise InputError(
                f"fluid.step = {step:g} s: {ratio:.3g} steps fill time.duration = {duration:g} s; "
                f"accepted: at most {most}, a step of {duration / most:.3g} s or more"
            )
        count = max(1, math.ceil(ratio * (1.0 - SNAP)))
        return cls(count, duration / count)

    def interval(self, position: float, span: float = 1.0) -> Interval:
        """The span of plant time of a step, or of a part of one.

        Args:
            position: Where it begins, in steps.
            span: Its length, in steps.
        """
        return Interval(position * self.length, (position + span) * self.length)

    def passed(self, plant_time: float) -> float:
        """How many steps have passed at a moment, parts of one included; a whole number at the end of a step.

        Args:
            plant_time: [s]; held to the scene's duration.
        """
        passed = min(max(plant_time / self.length, 0.0), float(self.count))
        whole = round(passed)
        return float(whole) if abs(passed - whole) <= SNAP else passed


class NotConverged(Exception):
    """A solver did not reach its tolerance within a fluid step; says how far it came and what would help."""
