"""What a setting will cost: that of the most similar one computed so far, scaled as the solvers scale."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from leafwarp.study.tradeoff.setting import Setting
from leafwarp.study.tradeoff.trial import Trial

# A fluid step of each kind over a split one in single precision, where no such step was timed yet; and the power of the
# step's length that the iterations of conjugate gradients grow with.
STEP_COSTS = {"split": 1.0, "unsplit": 6.0}
STEP_EXPONENTS = {"split": 0.0, "unsplit": 0.25}
DOUBLE = 1.5
# A step of second order is taken once whole and once in halves; where steps adapt, there are more than of the longest.
SECOND_ORDER, ADAPTIVE = 3.0, 4.0
# The sparse factor that double precision takes: over conjugate gradients, and its growth with the cells.
FACTOR, FACTOR_EXPONENT = 4.0, 1.25
# Explicit motion takes shorter steps on a finer mesh, and Newton's method factors with more fill. Where hinges decide
# the step, it takes more: what two meshes have shown, the finer of twice the vertices or more, up to a limit.
MOTION_EXPONENTS = {"explicit": 1.5, "implicit": 1.3, "quasistatic": 1.3}
LARGEST_EXPONENT, TELLING_RATIO = 2.5, 2.0
# Of one kind of motion that was not timed yet over another: a guess that errs on the dear side.
OTHER_MOTION = 3.0
# A process of its own, and a leaf to prepare, where that was not timed [s].
OVERHEAD = 2.0


@dataclass(frozen=True)
class _Timing:
    setting: Setting
    trial: Trial
    overhead: float


@dataclass(frozen=True)
class _Estimate:
    """Wall time [s], and how far the setting is from the one that it was scaled from."""

    seconds: float
    distance: float


class CostModel:
    """Predicts the wall time of trials from those computed so far.

    Args:
        duration: Plant time of the film [s].
    """

    def __init__(self, duration: float):
        self._duration = duration
        self._known: list[_Timing] = []
        self._exponents: dict[tuple[str, bool], float] = {}  # of each kind of motion, from what is known

    def learn(self, setting: Setting, trial: Trial, seconds: float | None) -> None:
        """Take a trial into account, which took so long from start to end; of a kept one, that is not known: None."""
        overhead = OVERHEAD if seconds is None else max(0.0, seconds - trial.seconds - trial.start_seconds)
        self._known.append(_Timing(setting, trial, overhead))
        self._exponents.clear()

    def predict(self, setting: Setting) -> float:
        """Wall time of a trial from start to end [s]."""
        if not self._known:
            return OVERHEAD
        return self.film(setting) + self._scaled(setting, self._start) + self._scaled(setting, _preparation)

    def film(self, setting: Setting) -> float:
        """Wall time of its film alone [s]; 0 where nothing is known yet."""
        if not self._known:
            return 0.0
        return self._scaled(setting, self._fluid) + self._scaled(setting, self._motion)

    def _scaled(self, setting: Setting, work: Callable[[_Timing, Setting], _Estimate]) -> float:
        """The time that a kind of work takes, by the trial that is nearest to the setting in it."""
        return min((work(timing, setting) for timing in self._known), key=lambda found: found.distance).seconds

    def _fluid(self, timing: _Timing, setting: Setting) -> _Estimate:
        known = timing.setting
        if setting.fluid_step is None:
            return _Estimate(timing.trial.fluid_seconds, 0.0)
        ratio = self._fluid_work(setting) / self._fluid_work(known)
        is_other = _kind_of_fluid(setting) != _kind_of_fluid(known)
        return _Estimate(ratio * timing.trial.fluid_seconds, _distance(ratio, is_other))

    def _fluid_work(self, setting: Setting) -> float:
        """Work of all fluid steps, in any unit."""
        scheme, double = setting.scheme or "split", setting.precision == "float64"
        cells = float(setting.cells)
        each = STEP_COSTS[scheme] * (DOUBLE if double else 1.0)
        if scheme == "unsplit" and double:
            each *= FACTOR
            cells **= FACTOR_EXPONENT
        each *= (SECOND_ORDER if setting.order == 2 else 1.0) * (ADAPTIVE if setting.step_tolerance else 1.0)
        steps = max(1.0, self._duration / setting.fluid_step)
        return steps * cells * each * setting.fluid_step ** STEP_EXPONENTS[scheme]

    def _motion(self, timing: _Timing, setting: Setting) -> _Estimate:
        return self._as_motion(timing, setting, _motion_seconds(timing))

    def _start(self, timing: _Timing, setting: Setting) -> _Estimate:
        """Until the first frame: nearly all of it settling."""
        return self._as_motion(timing, setting, timing.trial.start_seconds)

    def _as_motion(self, timing: _Timing, setting: Setting, seconds: float) -> _Estimate:
        kind = setting.motion, setting.angular_springs
        if kind not in self._exponents:
            self._exponents[kind] = self._motion_exponent(*kind)
        known, exponent = timing.setting, self._exponents[kind]
        is_other = setting.motion != known.motion
        ratio = (setting.vertices / known.vertices) ** exponent
        ratio *= OTHER_MOTION if is_other else _vertex_work(setting) / _vertex_work(known)
        return _Estimate(ratio * seconds, _distance(ratio, is_other))

    def _motion_exponent(self, motion: str, angular_springs: bool) -> float:
        """The power of the vertices that a kind of motion takes time with: of the two finest meshes known."""
        least = MOTION_EXPONENTS[motion]
        alike = [
            timing
            for timing in self._known
            if (timing.setting.motion, timing.setting.angular_springs) == (motion, angular_springs)
            and _motion_seconds(timing) > 0.0
        ]
        finest = max(alike, key=lambda timing: timing.setting.vertices, default=None)
        coarser = [t for t in alike if TELLING_RATIO * t.setting.vertices <= finest.setting.vertices]
        if not coarser:
            return least
        coarse = max(coarser, key=lambda timing: timing.setting.vertices)
        seconds = [_motion_seconds(timing) / _vertex_work(timing.setting) for timing in (coarse, finest)]
        shown = math.log(seconds[1] / seconds[0]) / math.log(finest.setting.vertices / coarse.setting.vertices)
        return min(max(least, shown), LARGEST_EXPONENT)


def _preparation(timing: _Timing, setting: Setting) -> _Estimate:
    """A process of its own, and its leaf: no dearer with a coarser mesh or map, nor cheaper than their like."""
    ratios = setting.vertices / timing.setting.vertices, setting.cells / timing.setting.cells
    distance = sum(_distance(ratio, False) for ratio in ratios)
    return _Estimate(max(1.0, *ratios) * timing.overhead, distance)


def _kind_of_fluid(setting: Setting) -> tuple:
    return setting.scheme, setting.precision, setting.order, setting.step_tolerance


def _motion_seconds(timing: _Timing) -> float:
    return timing.trial.motion_seconds + timing.trial.frame_seconds


def _vertex_work(setting: Setting) -> float:
    """Work of motion for each vertex, in any unit."""
    double = DOUBLE if setting.motion == "explicit" and setting.precision == "float64" else 1.0
    hinges = 2.0 if setting.angular_springs else 1.0
    return double * hinges / (setting.substep or 1.0)


def _distance(ratio: float, is_other_kind: bool) -> float:
    return abs(math.log(max(ratio, 1e-12))) + (100.0 if is_other_kind else 0.0)
