"""What a setting will cost: a few steps of it are timed, the rest follows from how the schemes scale."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.pace import path_times
from leafwarp.sim.simulation import Simulation
from leafwarp.study.trial import Setting, Trial, with_setting

if TYPE_CHECKING:
    from leafwarp.sim.fluid import Fluid

# From a map to one of twice the cells across: four times the cells; a factor has more entries a cell;
# conjugate gradients take some more iterations.
GROWTH = {"split": 4.0, "factor": 6.5, "conjugate_gradients": 5.5}
# Iterations of conjugate gradients grow with the root of the step.
STEP_EXPONENT = {"split": 0.0, "factor": 0.0, "conjugate_gradients": 0.5}
PILOT_STEPS = 5
# The leaf gets lighter as it dries and wants more substeps than in its first frames.
DRYING_FACTOR = 2.0


@dataclass(frozen=True)
class _Pilot:
    """Wall time [s] of setting up and of one fluid step, at the scene's own step."""

    start: float
    step: float


class CostModel:
    """Predicts wall time.

    Args:
        scene: From :func:`leafwarp.study.trial.trial_scene`.
        leaf_of: Gives the leaf for a map size.
        device: Warp device.
        longest_pilot: Where setting up and a step are expected to take longer than this [s], they are not
            tried but extrapolated from half the map.
        smallest: Cells across of the smallest map; it is always tried.
    """

    def __init__(
        self,
        scene: Scene,
        leaf_of: Callable[[tuple[int, int]], Leaf],
        device: str,
        longest_pilot: float,
        smallest: int,
    ):
        self._scene = scene
        self._leaf_of = leaf_of
        self._device = device
        self._longest_pilot = longest_pilot
        self._smallest = smallest
        self._pilots: dict[Setting, _Pilot] = {}
        self._motion: dict[Setting, float] = {}
        self._corrections: dict[tuple[str, str, float | None], float] = {}

    def predict(self, setting: Setting, playback: float) -> float:
        """Wall time of a trial [s].

        Args:
            setting: The setting.
            playback: Playback time of the trial [s].
        """
        start = self._pilot(setting).start
        known = self._corrections
        family = setting.scheme, setting.precision
        correction = known.get((*family, setting.step)) or known.get((*family, None)) or 1.0
        motion = self.motion(setting)
        path = len(path_times(self._scene)) * motion / self._scene.time.fps
        return start + correction * self._fluid_seconds(setting) + playback * motion + path

    def learn(self, trial: Trial) -> None:
        """Correct later predictions of the same scheme and precision by what a trial took."""
        setting = trial.setting
        ratio = trial.seconds["fluid"] / max(self._fluid_seconds(setting), 1e-9)
        for step in (setting.step, None):
            self._corrections[setting.scheme, setting.precision, step] = ratio

    def motion(self, setting: Setting) -> float:
        """Wall time of the motion for each second of playback; only the precision of the setting matters."""
        smallest = replace(
            setting, map_size=self._coarsest(setting).map_size, scheme="split", step=self._scene.fluid.step
        )
        if smallest not in self._motion:
            fps = self._scene.time.fps
            simulation = self._simulation(smallest)
            simulation.advance(2)
            begin = time.perf_counter()
            simulation.advance(3 if self._scene.time.frames > 2 else 2)
            self._motion[smallest] = DRYING_FACTOR * fps * (time.perf_counter() - begin)
        return self._motion[smallest]

    def _coarsest(self, setting: Setting) -> Setting:
        while setting.cells_across > self._smallest:
            setting = setting.coarsened(2)
        return setting

    def _simulation(self, setting: Setting) -> Simulation:
        return Simulation(with_setting(self._scene, setting), self._leaf_of(setting.map_size), self._device)

    def _solver(self, setting: Setting) -> str:
        return "split" if setting.scheme == "split" else with_setting(self._scene, setting).fluid.solver

    def _fluid_seconds(self, setting: Setting) -> float:
        count = math.ceil(self._scene.time.duration / setting.step)
        longer = setting.step / self._scene.fluid.step
        return count * self._pilot(setting).step * longer ** STEP_EXPONENT[self._solver(setting)]

    def _pilot(self, setting: Setting) -> _Pilot:
        setting = replace(setting, step=self._scene.fluid.step)
        if setting not in self._pilots:
            self._pilots[setting] = self._make_pilot(setting)
        return self._pilots[setting]

    def _make_pilot(self, setting: Setting) -> _Pilot:
        if setting.cells_across > self._smallest:
            half = self._pilot(setting.coarsened(2))
            expected = _Pilot(2.0 * half.start, GROWTH[self._solver(setting)] * half.step)
            if expected.start + expected.step > self._longest_pilot:
                return expected
        else:
            # Loads the kernels, which no trial has to do again.
            self._simulation(setting).advance(2)
        begin = time.perf_counter()
        simulation = self._simulation(setting)
        start = time.perf_counter() - begin
        return _Pilot(start, self._time_step(simulation.fluid))

    def _time_step(self, fluid: Fluid) -> float:
        """Wall time of a fluid step [s]: the best of a few, as other programs disturb single ones."""
        best = math.inf
        begin = time.perf_counter()
        try:
            fluid.advance(fluid.steps.length)
            for count in range(PILOT_STEPS):
                lap = time.perf_counter()
                fluid.advance((count + 2) * fluid.steps.length)
                best = min(best, time.perf_counter() - lap)
                if time.perf_counter() - begin > self._longest_pilot:
                    break
        except SimulationError:
            # The trial itself will say so.
            pass
        return best if math.isfinite(best) else time.perf_counter() - begin
