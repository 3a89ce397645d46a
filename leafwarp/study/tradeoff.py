"""The measured trade: seconds against error for map, fluid step, scheme and precision, on a user's scene."""

from __future__ import annotations

import itertools
import json
import math
import os
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from leafwarp import __version__
from leafwarp.errors import InputError, OutputError, SimulationError
from leafwarp.files import write_text
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.run import CACHE_FOLDER
from leafwarp.scene import Scene
from leafwarp.sim.launch import check_device
from leafwarp.study.costs import CostModel
from leafwarp.study.metrics import (
    errors_fall_with_the_step,
    largest_water_error,
    pareto_front,
    relative_water_error,
    shape_error,
)
from leafwarp.study.reference import (
    ErrorModel,
    check_settings,
    choose_reference,
    fit_error_model,
    probe_settings,
    unsplit_settings,
)
from leafwarp.study.table import Row, append_row, write_rows
from leafwarp.study.trial import OutOfTime, Setting, Trial, film_seconds, run_trial, trial_scene

# Cells across the longer direction of the map, and fluid steps as multiples of the scene's.
MAPS = (128, 256, 512, 1024)
STEP_FACTORS = (0.25, 1.0, 4.0, 16.0)
SCHEMES = ("split", "unsplit")
PRECISIONS = ("float32", "float64")

TABLE, RESULT, PICTURE = "tradeoff.csv", "tradeoff.json", "tradeoff.png"
# Tables of the scene that the result repeats.
TABLES = {"time", "fluid", "transpiration", "source"}
NOT_CONVERGED = "shorter steps move away from it; errors are distances from it, no more. A larger budget would help"

DEFAULT_BUDGET = 600.0  # [s]
# Shares of the budget.
REFERENCE_SHARE = 0.4
MOTION_SHARE = 0.3
PROBE_SHARE = 0.1
PILOT_SHARE = 0.005


def run_tradeoff(
    scene: Scene,
    output: Path,
    *,
    device: str = "cpu",
    overwrite: bool = False,
    quiet: bool = False,
    budget: float = DEFAULT_BUDGET,
    maps: Sequence[int] = MAPS,
    step_factors: Sequence[float] = STEP_FACTORS,
) -> dict[str, Any]:
    """Measure what speed costs in accuracy on a scene.

    Every setting is a full coupled simulation of the whole plant time, compared at 25 frames with an unsplit
    float64 reference that is as fine as the budget allows. The reference's own error is estimated by
    refinement: its distance from a computation with half the map, plus that from one with twice the step,
    each of which is the error itself for a method of first order. Whether the reference can be believed
    (``converged``) is seen from the settings: those with shorter steps must come closer to it. So that motion
    does not dominate, the film may be shorter than the scene's: gravity and inertia then see less time
    (``playback_seconds``), all settings alike.

    Settings run from cheap to dear until the budget is used. Those left out stay in the table with the
    seconds that they would take.

    Args:
        scene: The scene; its water flows.
        output: Folder of ``tradeoff.csv``, ``tradeoff.json`` and ``tradeoff.png``.
        device: Warp device.
        overwrite: Replace a table that is there already.
        quiet: No progress on stderr.
        budget: Wall time to use [s].
        maps: Cells of the maps in the longer direction; the other follows the scene's map.
        step_factors: Fluid steps as multiples of the scene's.

    Returns:
        What ``tradeoff.json`` holds.

    Raises:
        InputError: The scene prescribes its water, or a table is there already, or a bad budget, device or
            photo.
        OutputError: The table cannot be written.
    """
    if scene.fluid is None:
        raise InputError(
            f"{scene.name}: [fluid]: missing; the trade is one of fluid map, step and scheme, and this scene "
            "prescribes its water ([water])"
        )
    if scene.leaves is not None:
        raise InputError(f"{scene.name}: [leaves]: the trade is measured on one leaf; leave this table out")
    if not (math.isfinite(budget) and budget > 0.0):
        raise InputError(f"--budget {budget:g}: accepted: a time above 0, such as '10 min'")
    table = output / TABLE
    if table.exists() and not overwrite:
        raise InputError(f"{table}: exists already; --overwrite replaces it")
    can_plot = find_spec("matplotlib") is not None
    if not can_plot:
        print(
            "leafwarp: matplotlib is not installed: the tables are written without a plot; "
            "pip install 'leafwarp[plot]' brings it",
            file=sys.stderr,
        )
    device = check_device(device)
    try:
        output.mkdir(parents=True, exist_ok=True)
        for stale in (output / RESULT, output / PICTURE):
            stale.unlink(missing_ok=True)
        write_rows(table, [])
    except (OSError, OutputError) as error:
        raise InputError(f"{output}: cannot be written: {error}") from None
    study = _Study(scene, output, device, budget, quiet, maps, step_factors)
    result = study.run()
    write_rows(table, study.rows)
    write_text(output / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    if can_plot and any(row.measured for row in study.rows):
        from leafwarp.study.plot import plot_tradeoff

        plot_tradeoff(result, output / PICTURE)
    return result


def map_sizes(shape: tuple[int, int], across: Sequence[int]) -> list[tuple[int, int]]:
    """Maps (width, height) of the scene's proportions with so many cells in the longer direction."""
    width, height = shape
    longer = max(shape)
    shares = width / longer, height / longer
    return [tuple(max(1, round(cells * share)) for share in shares) for cells in sorted(set(across))]


class _Study:
    """The state of a study: its clock, its leaves, what is computed already."""

    def __init__(
        self,
        scene: Scene,
        output: Path,
        device: str,
        budget: float,
        quiet: bool,
        maps: Sequence[int],
        step_factors: Sequence[float],
    ):
        self.rows: list[Row] = []
        self._begin = time.perf_counter()
        self._scene = scene
        self._output = output
        self._device = device
        self._budget = budget
        self._quiet = quiet
        self._maps = map_sizes(scene.maps.shape, maps)
        self._steps = sorted({min(factor * scene.fluid.step, scene.time.duration) for factor in step_factors})
        self._leaves: dict[tuple[int, int], Leaf] = {}
        self._trials: dict[Setting, Trial] = {}
        self._playback = film_seconds(scene)
        self._trial_scene = trial_scene(scene, self._playback)

    def run(self) -> dict[str, Any]:
        """Do the study; fills ``rows`` and returns the result."""
        # What minimises a potential knows double precision alone.
        precisions = PRECISIONS if self._scene.motion.method == "explicit" else PRECISIONS[1:]
        settings = [
            Setting(size, step, scheme, precision)
            for size, step in itertools.product(self._maps, self._steps)
            for scheme, precision in itertools.product(SCHEMES, precisions)
        ]
        self._costs = CostModel(
            self._trial_scene,
            self._leaf_of,
            self._device,
            PILOT_SHARE * self._budget,
            max(1, max(self._maps[0]) // 4),
        )
        self._say("timing a few steps of each map, scheme and precision")
        self._choose_playback(settings)
        reference = self._compute_reference()
        checks = [self._errors(check, reference) for check in self._checks]
        own = {name: sum(check[name] for check in checks) for name in checks[0]}
        self._say(f"reference's own errors: water {own['water_error']:.2g}, shape {own['shape_error']:.2g}")
        for setting in sorted(settings, key=self._predict):
            self._add_row(setting, reference)
        self._mark(own)
        result = self._result(reference, own)
        if not result["reference"]["converged"]:
            self._say(f"the reference is not converged: {NOT_CONVERGED}")
        return result

    # The clock.

    @property
    def _spent(self) -> float:
        return time.perf_counter() - self._begin

    def _say(self, text: str) -> None:
        if not self._quiet:
            print(f"[{self._spent:.0f}/{self._budget:.0f} s] {text}", file=sys.stderr, flush=True)

    def _predict(self, setting: Setting) -> float:
        return self._costs.predict(setting, self._playback)

    def _choose_playback(self, settings: Sequence[Setting]) -> None:
        """The scene's own film, or one so much shorter that all motion fits into its share of the budget."""
        left = (1.0 - REFERENCE_SHARE - MOTION_SHARE) * self._budget
        per_second = 0.0
        for setting in sorted(settings, key=lambda setting: self._costs.predict(setting, 0.0)):
            left -= self._costs.predict(setting, 0.0)
            if per_second > 0.0 and left < 0.0:
                break
            per_second += self._costs.motion(setting)
        self._playback = min(self._playback, MOTION_SHARE * self._budget / per_second)
        self._trial_scene = trial_scene(self._scene, self._playback)

    # What is computed.

    def _leaf_of(self, size: tuple[int, int]) -> Leaf:
        if size not in self._leaves:
            scene = self._scene.with_changes({"maps.size": size})
            self._leaves[size] = prepare_scene_leaf(scene, self._output / CACHE_FOLDER)
        return self._leaves[size]

    def _run(self, setting: Setting, seconds: float = math.inf) -> Trial:
        """Compute a setting, once.

        Raises:
            OutOfTime: It takes longer than this.
            SimulationError: It cannot be computed.
        """
        if setting not in self._trials:
            leaf = self._leaf_of(setting.map_size)
            deadline = time.perf_counter() + seconds
            trial = run_trial(self._trial_scene, leaf, setting, self._device, deadline)
            self._trials[setting] = trial
            self._costs.learn(trial)
        return self._trials[setting]

    def _compute_reference(self) -> Trial:
        """Choose, compute and check the reference.

        Raises:
            SimulationError: Not even the cheapest reference can be computed.
        """
        # A map below those of the table is there for small budgets.
        smallest = tuple(max(1, cells // 2) for cells in self._maps[0])
        candidates = unsplit_settings([smallest, *self._maps], self._steps)
        end = self._spent + REFERENCE_SHARE * self._budget
        model = self._error_model(candidates)
        while True:
            setting = choose_reference(candidates, model, self._predict, end - self._spent)
            is_cheapest = setting == min(candidates, key=self._predict)
            self._say(f"reference: {setting}, {self._predict(setting):.0f} s expected")
            try:
                reference = self._run(setting, math.inf if is_cheapest else end - self._spent)
                self._checks = [self._run(check) for check in check_settings(setting)]
                return reference
            except (OutOfTime, SimulationError) as error:
                if len(candidates) == 1:
                    raise
                self._say(f"given up: {error}")
                candidates.remove(setting)

    def _error_model(self, candidates: Sequence[Setting]) -> ErrorModel:
        """How the error depends on map and step: measured where that is cheap, else both count alike."""
        coarsest = min(candidates, key=lambda c: (c.cells_across, -c.step))
        probes = probe_settings(coarsest, self._steps)
        if sum(map(self._predict, probes)) > PROBE_SHARE * self._budget:
            return ErrorModel(per_second=1.0 / coarsest.step, per_cell=float(coarsest.cells_across))
        self._say(f"how the error depends on map and step: {len(probes)} trials around {probes[0]}")
        return fit_error_model(*(self._run(probe) for probe in probes), areas=self._areas)

    def _add_row(self, setting: Setting, reference: Trial) -> None:
        """Compute a setting, if there is time, and add it to the table."""
        predicted = self._predict(setting)
        row = Row(*setting.map_size, setting.step, setting.scheme, setting.precision, "done", predicted)
        left = self._budget - self._spent
        if setting not in self._trials and predicted > left:
            row.status = "skipped: budget"
        else:
            try:
                self._fill(row, self._run(setting, left), reference)
            except OutOfTime:
                row.status = "stopped: budget"
            except SimulationError as error:
                row.status = f"failed: {error}"
        self.rows.append(row)
        append_row(self._output / TABLE, row)
        took = f"{predicted:.0f} s expected"
        if row.measured:
            took = f"{row.seconds:.1f} s, water {row.water_error:.2g}"
        self._say(f"{setting}: {row.status}, {took}")

    # What is found.

    @property
    def _areas(self) -> np.ndarray:
        return self._leaf_of(self._maps[0]).mesh.vertex_areas

    def _errors(self, trial: Trial, reference: Trial) -> dict[str, float]:
        length = self._leaf_of(self._maps[0]).length
        return {
            "water_error": relative_water_error(trial.water, reference.water, self._areas),
            "largest_water_error": largest_water_error(trial.water, reference.water),
            "shape_error": shape_error(trial.points, reference.points, self._areas, length),
        }

    def _fill(self, row: Row, trial: Trial, reference: Trial) -> None:
        row.status = "reference" if trial is reference else "done"
        row.fluid_step = trial.fluid_step
        row.seconds = trial.total_seconds
        row.fluid_seconds = trial.seconds["fluid"]
        row.fluid_seconds_per_plant_hour = row.fluid_seconds / (self._scene.time.duration / 3600.0)
        row.motion_substeps = trial.substeps
        row.ledger_error = trial.ledger_error
        for name, value in self._errors(trial, reference).items():
            setattr(row, name, value)

    def _mark(self, own: dict[str, float]) -> None:
        """Mark what lies below the reference's own errors, and the Pareto fronts."""
        measured = [row for row in self.rows if row.measured]
        seconds = np.array([row.fluid_seconds for row in measured])
        for kind in ("water", "shape"):
            floor = own[f"{kind}_error"]
            errors = np.array([getattr(row, f"{kind}_error") for row in measured])
            front = pareto_front(seconds, errors, floor)
            for row, error, on_front in zip(measured, errors, front, strict=True):
                setattr(row, f"{kind}_within_reference", bool(error < floor))
                setattr(row, f"{kind}_pareto", bool(on_front))

    def _is_converged(self, own_water_error: float) -> bool:
        families: dict[tuple, list[Row]] = {}
        for row in self.rows:
            if row.measured:
                family = row.map_width, row.map_height, row.scheme, row.precision
                families.setdefault(family, []).append(row)
        return all(
            errors_fall_with_the_step(
                [row.fluid_step for row in rows], [row.water_error for row in rows], own_water_error
            )
            for rows in families.values()
        )

    def _result(self, reference: Trial, own: dict[str, float]) -> dict[str, Any]:
        import warp as wp

        mesh = self._leaf_of(self._maps[0]).mesh
        versions = {"leafwarp": __version__, "python": platform.python_version(), "numpy": np.__version__}
        return {
            "scene": self._scene.name,
            "tables": self._scene.model_dump(mode="json", include=TABLES),
            "versions": {**versions, "warp": wp.__version__},
            "device": {"name": wp.get_device(self._device).name, "alias": self._device},
            "machine": f"{platform.machine()}, {os.cpu_count()} cores",
            "mesh": {"vertices": mesh.vertex_count, "triangles": mesh.triangle_count},
            "plant_seconds": self._scene.time.duration,
            "frames": len(reference.water),
            "playback_seconds": self._playback,
            "scene_playback_seconds": film_seconds(self._scene),
            "budget_seconds": self._budget,
            "spent_seconds": self._spent,
            "reference": {
                **asdict(reference.setting),
                "seconds": reference.total_seconds,
                "own_errors": own,
                "converged": self._is_converged(own["water_error"]),
                "checks": [
                    asdict(check.setting) | {"seconds": check.total_seconds} | self._errors(check, reference)
                    for check in self._checks
                ],
            },
            "settings": [asdict(row) for row in self.rows],
        }
