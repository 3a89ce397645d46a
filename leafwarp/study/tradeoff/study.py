"""The study: what to compute, in which order, within which time; its table, picture and text."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from leafwarp import __version__
from leafwarp.errors import InputError, OutputError
from leafwarp.files import write_text
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.report import package_versions
from leafwarp.run import CACHE_FOLDER
from leafwarp.scene import Scene
from leafwarp.sim.method import with_fitting_method
from leafwarp.study.parts import PartCost, measure_parts, parts_table
from leafwarp.study.tradeoff.costs import CostModel
from leafwarp.study.tradeoff.errors import errors_of, pareto_front
from leafwarp.study.tradeoff.explore import combinations
from leafwarp.study.tradeoff.reference import Reference, errors_fall_with_the_step, find_reference, first_setting
from leafwarp.study.tradeoff.setting import Setting, preset_settings, single_changes
from leafwarp.study.tradeoff.summary import percent, summarise
from leafwarp.study.tradeoff.surface import sample_points
from leafwarp.study.tradeoff.table import Row, append_row, write_rows
from leafwarp.study.tradeoff.trial import SAMPLED_FRAMES, Trial, film_seconds, sampled_frames
from leafwarp.study.tradeoff.worker import OutOfTime, Request, TrialFailed, compute_apart

TABLE, RESULT, PICTURE, TEXT, TRIALS = (
    "tradeoff.csv", "tradeoff.json", "tradeoff.png", "tradeoff.txt", "trials",
)  # fmt: skip
FILM = "film.json"  # beside the trials: the frames of what is computed
# Tables of the scene that the result repeats.
TABLES = {"time", "fluid", "transpiration", "source", "solver", "motion"}

DEFAULT_BUDGET = 600.0  # [s]
# Shares of the budget that the reference and the parts take; and the scene as written, beyond which its film is
# shortened.
REFERENCE_SHARE = 0.45
PARTS_SHARE = 0.08
FILM_SHARE = 0.03
# Where another leaf, cambered by this share more, ends further away than this share of its length, the scene has
# several shapes to offer.
NUDGE = 0.02
ONE_SHAPE = 0.01

Compute = Callable[[Request, float], Trial]


def run_tradeoff(
    scene: Scene,
    output: Path,
    *,
    device: str = "cpu",
    overwrite: bool = False,
    quiet: bool = False,
    budget: float = DEFAULT_BUDGET,
    compute: Compute = compute_apart,
    cache: Path | None = None,
) -> dict[str, Any]:
    """Measure what speed costs in accuracy on a scene.

    Every setting is the whole film of the scene, computed in a process of its own and compared at 25 of its frames, at
    the same thousand points of the leaf whatever mesh and map it has, with a reference: unsplit, in double precision,
    refined in map, fluid step, mesh and coupling for as long as its share of the budget lasts. What each last
    refinement changed adds up to the reference's own error. Where a leaf that is cambered by a fiftieth more ends in
    another shape, the scene has several to offer, and no error of the shape is given.

    Settings are the scene's own, with one choice changed at a time, then combinations that promise to lie on the front.
    They run until the budget is used; those left out stay in the table with the time that they would take. What was
    computed is kept and costs nothing again: the same call goes on where an interrupted one stopped, and one with a
    larger budget where a finished one did.

    Args:
        scene: The scene.
        output: Folder of ``tradeoff.csv``, ``.json``, ``.png`` and ``.txt``.
        device: Warp device.
        overwrite: Replace a finished study, or one of another scene.
        quiet: No progress on stderr.
        budget: Wall time to use [s].
        compute: Computes a trial.
        cache: Folder of prepared leaves; default: in the output folder.

    Returns:
        What ``tradeoff.json`` holds.

    Raises:
        InputError: Many leaves, a finished study is there already, or a bad budget, device or photo.
        OutputError: The table cannot be written.
        LeafwarpError: The scene itself cannot be computed.
    """
    if scene.leaves is not None:
        raise InputError(f"{scene.name}: [leaves]: the trade is measured on one leaf; leave this table out")
    if not (math.isfinite(budget) and budget > 0.0):
        raise InputError(f"--budget {budget:g}: accepted: a time above 0, such as '10 min'")
    from leafwarp.sim.launch import check_device

    device = check_device(device)
    can_plot = find_spec("matplotlib") is not None
    if not can_plot:
        print(
            "leafwarp: matplotlib is not installed: the tables are written without a plot; "
            "pip install 'leafwarp[plot]' brings it",
            file=sys.stderr,
        )
    _begin(scene, output, device, overwrite, budget)
    study = _Study(scene, output, device, budget, quiet, compute, cache or output / CACHE_FOLDER)
    result = study.run()
    write_rows(output / TABLE, study.rows)
    if can_plot and any(row.measured for row in study.rows):
        from leafwarp.study.tradeoff.plot import plot_tradeoff

        plot_tradeoff(result, output / PICTURE)
    write_text(output / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return result


def _begin(scene: Scene, output: Path, device: str, overwrite: bool, budget: float) -> None:
    """Make the folder, or find in it what a study of the same scene left that was interrupted, or had less time.

    Raises:
        InputError: It holds a study that was finished in no less time or of another scene, or cannot be written.
    """
    pictures = [Path(photo.image).read_bytes() for photo in scene.photos if Path(photo.image).is_file()]
    identity = json.dumps(
        {
            "scene": scene.model_dump(mode="json", exclude_unset=True, exclude={"output"}),
            "pictures": [hashlib.sha256(picture).hexdigest() for picture in pictures],
            "device": device,
            "version": __version__,
        },
        indent=1,
    )
    mark = output / TRIALS / "study.json"
    is_same = mark.is_file() and mark.read_text() == identity
    had = _budget_of(output / RESULT)
    is_done = had is not None and not (is_same and budget > had)
    if (output / TABLE).exists() and not overwrite and (is_done or not is_same):
        state = "is a study of another scene, device or version"
        if is_same:
            state = f"is a finished study; a --budget above {had:g} s goes on with it"
        raise InputError(f"{output / TABLE}: {state}; --overwrite replaces it")
    try:
        if overwrite or not is_same:
            shutil.rmtree(output / TRIALS, ignore_errors=True)
        (output / TRIALS).mkdir(parents=True, exist_ok=True)
        if had is None or not is_same or overwrite:
            for stale in (output / RESULT, output / PICTURE, output / TEXT):
                stale.unlink(missing_ok=True)
            write_rows(output / TABLE, [])
        write_text(mark, identity)
    except (OSError, OutputError) as error:
        raise InputError(f"{output}: cannot be written: {error}") from None


def _budget_of(result: Path) -> float | None:
    """Wall time that a finished study was given [s]; None where none is finished, or its result is damaged."""
    try:
        budget = float(json.loads(result.read_text())["budget_seconds"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None
    return budget if math.isfinite(budget) else None


def _frames_of(film: Path, most: int) -> int | None:
    """Frames of the film that a study has begun with; None where it has not, or the file is damaged."""
    try:
        frames = json.loads(film.read_text())["frames"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return frames if isinstance(frames, int) and 1 <= frames <= most else None


class _Study:
    """The state of a study: its clock, and what is computed already."""

    def __init__(
        self, scene: Scene, output: Path, device: str, budget: float, quiet: bool, compute: Compute, cache: Path
    ):
        self.rows: list[Row] = []
        self._begin = time.perf_counter()
        self._leaf: Leaf = prepare_scene_leaf(scene, cache)
        scene = with_fitting_method(scene, self._leaf)
        self._scene, self._output, self._device, self._budget, self._quiet = scene, output, device, budget, quiet
        self._compute, self._cache = compute, cache
        self._costs = CostModel(scene.time.duration)
        self._base = Setting.of(scene)
        self._places = output / TRIALS / "places.npy"
        np.save(self._places, sample_points(self._leaf.mesh))
        self._film = scene
        self._names: dict[Setting, str] = {}
        # What a study with less time has found stays until all of this one is known.
        self._has_result = (output / RESULT).exists()
        self._bar = None
        if not quiet and sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=budget, file=sys.stderr, bar_format="{bar}| {n:.0f}/{total:.0f} s {postfix}")
        self._trials: dict[Setting, Trial] = {}

    def run(self) -> dict[str, Any]:
        """Do the study; fills ``rows`` and returns the result."""
        self._shorten_film()
        end = self._spent + REFERENCE_SHARE * self._budget
        self._say("reference: refined where it changes the most")
        reference = find_reference(
            self._film, self._leaf.length, self._run, self._cost_of, lambda: max(0.0, end - self._spent), self._say
        )
        nudged = self._nudged()
        has_one_shape = nudged is None or nudged <= ONE_SHAPE
        own = {"water_error": reference.own_water_error, "shape_error": reference.own_shape_error}
        self._say(
            f"reference: {reference.setting.in_words(self._base)}; its own errors: water "
            f"{percent(own['water_error'])}, shape {percent(own['shape_error'])}"
        )
        if not has_one_shape:
            self._say(_several_shapes(nudged))
        presets = preset_settings(self._film, self._leaf)
        self._names = {setting: name for name, setting in presets.items()} | {self._base: "scene"}
        self._measure([self._base, *(s for s in self._names if s != self._base)], reference, has_one_shape)
        singles = set(single_changes(self._film)) | {self._base}
        others = sorted(singles - set(self._names), key=self._costs.predict)
        self._measure(others, reference, has_one_shape)
        kind = "shape" if has_one_shape else "water"
        self._measure_combinations(reference, has_one_shape, kind)
        self._mark(own)
        parts = self._measure_parts()
        of_singles = [row for row in self.rows if row.setting in singles]
        summary = summarise(self.rows, kind, of_singles, own[f"{kind}_error"])
        if not has_one_shape:
            summary.append(_several_shapes(nudged))
        is_converged = reference.is_converged and errors_fall_with_the_step(
            {row.setting: row.water_error for row in self.rows if row.measured}, own["water_error"]
        )
        if not is_converged:
            summary.append(
                "The reference is not converged: refining it, or what is held against it, changes more the further it "
                "goes. A larger budget would help."
            )
        for sentence in summary:
            self._say(sentence)
        write_text(self._output / TEXT, "\n".join([*summary, "", parts_table(parts)]))
        if self._bar is not None:
            self._bar.close()
        result = self._result(reference, own, nudged, has_one_shape, is_converged, summary)
        return result | {"parts": [part.as_dict() for part in parts]}

    # The clock.

    @property
    def _spent(self) -> float:
        return time.perf_counter() - self._begin

    @property
    def _left(self) -> float:
        """Wall time left for settings [s]."""
        return max(0.0, (1.0 - PARTS_SHARE) * self._budget - self._spent)

    def _say(self, text: str, ahead: float | None = None) -> None:
        if self._quiet:
            return
        estimate = "" if ahead is None else f", about {max(0.0, min(ahead, self._left)):.0f} s left"
        if self._bar is None:
            print(f"[{self._spent:.0f}/{self._budget:.0f} s{estimate}] {text}", file=sys.stderr, flush=True)
            return
        self._bar.write(text, file=sys.stderr)
        self._bar.n = min(self._spent, self._budget)
        self._bar.set_postfix_str(estimate.removeprefix(", "))

    # What is computed.

    def _run(self, setting: Setting, seconds: float, camber: float | None = None) -> Trial:
        """Compute a setting, once; what an interrupted study computed is taken from it.

        Raises:
            OutOfTime: It takes longer than this.
            LeafwarpError: It cannot be computed.
        """
        if camber is None and setting in self._trials:
            return self._trials[setting]
        begin = time.perf_counter()
        scene = setting.apply(self._film)
        if camber is not None:
            scene = scene.with_changes({"leaf.camber": camber})
        path = self._path_of(setting, camber)
        trial = Trial.load(path)
        if trial is None:
            path.unlink(missing_ok=True)
            prepare_scene_leaf(scene, self._cache)
            request = Request(
                scene=scene.model_dump(mode="json", exclude_unset=True),
                where=self._scene.name,
                leaves=str(self._cache),
                places=str(self._places),
                result=str(path),
                device=self._device,
            )
            trial = self._compute(request, seconds)
            self._costs.learn(setting, trial, time.perf_counter() - begin)
        else:
            self._costs.learn(setting, trial, None)
        if camber is None:
            self._trials[setting] = trial
        return trial

    def _path_of(self, setting: Setting, camber: float | None = None) -> Path:
        """Where a setting's trial is kept."""
        name = json.dumps([setting.as_dict(), camber, self._film.time.frames])
        return self._output / TRIALS / f"{hashlib.sha256(name.encode()).hexdigest()[:20]}.npz"

    def _cost_of(self, setting: Setting, camber: float | None = None) -> float:
        """Wall time that a setting will take [s]: none where its trial is kept."""
        return 0.0 if self._path_of(setting, camber).exists() else self._costs.predict(setting)

    def _shorten_film(self) -> None:
        """Compute the scene as written; where that alone would take much of the budget, with fewer frames.

        A study that goes on keeps the film that it has begun with, whatever budget it is given.
        """
        kept = self._output / TRIALS / FILM
        frames = _frames_of(kept, self._scene.time.frames)
        if frames is not None:
            self._film = self._scene.with_changes({"time.frames": frames})
            self._costs = CostModel(self._film.time.duration)
            self._run(self._base, math.inf)
            return
        self._find_film()
        write_text(kept, json.dumps({"frames": self._film.time.frames}))

    def _find_film(self) -> None:
        allowed = FILM_SHARE * self._budget
        while True:
            frames = self._film.time.frames
            is_shortest = frames <= SAMPLED_FRAMES
            self._say(f"the scene as written, {frames} frames")
            try:
                trial = self._run(self._base, math.inf if is_shortest else 4.0 * allowed + 10.0)
            except OutOfTime:
                fewer = frames // 4
            else:
                if trial.seconds <= allowed or is_shortest:
                    return
                fewer = math.floor(frames * allowed / trial.seconds)
            self._trials.clear()
            self._costs = CostModel(self._film.time.duration)
            self._film = self._scene.with_changes({"time.frames": max(fewer, SAMPLED_FRAMES)})

    def _nudged(self) -> float | None:
        """How far another leaf, cambered a little more, ends from this one; None where there is no camber to change."""
        camber = self._scene.leaf.camber
        if camber == 0.0 or not self._scene.has_angular_springs:
            return None
        setting = first_setting(self._film)
        camber *= 1.0 + NUDGE
        if self._cost_of(setting, camber) > self._left:
            return None
        nudged = self._run(setting, math.inf, camber)
        return float(errors_of(nudged, self._trials[setting], self._leaf.length).shape_over_time.max())

    def _measure(self, settings: list[Setting], reference: Reference, has_one_shape: bool) -> None:
        for index, setting in enumerate(settings):
            ahead = sum(self._cost_of(later) for later in settings[index:] if later not in self._trials)
            self._add_row(setting, reference, has_one_shape, ahead)

    def _measure_combinations(self, reference: Reference, has_one_shape: bool, kind: str) -> None:
        """Try what promises to lie on the front, and look again, until the time is over or nothing new is promised."""
        tried: set[Setting] = set()
        while True:
            errors = {row.setting: getattr(row, f"{kind}_error") for row in self.rows if row.measured}
            if self._base not in errors:
                return
            guesses = [g for g in combinations(self._base, errors, self._costs.film) if g.setting not in tried]
            paid = [guess for guess in guesses if self._cost_of(guess.setting) <= self._left]
            if not paid:
                return
            # Spread over the front: the one furthest from all that is measured.
            known = _place([(self._trials[setting].seconds, error) for setting, error in errors.items()])
            here = _place([(guess.seconds, guess.error) for guess in paid])
            chosen = paid[int(np.argmax(np.linalg.norm(here[:, None] - known, axis=2).min(axis=1)))].setting
            tried.add(chosen)
            ahead = sum(self._cost_of(guess.setting) for guess in paid)
            self._add_row(chosen, reference, has_one_shape, ahead)

    def _add_row(self, setting: Setting, reference: Reference, has_one_shape: bool, ahead: float) -> None:
        """Compute a setting, if there is time, and add it to the table."""
        predicted = self._costs.predict(setting)
        row = Row(setting, self._names.get(setting, ""), setting.in_words(self._base), "done", predicted)
        if setting not in self._trials and self._cost_of(setting) > self._left:
            row.status = "skipped: budget"
        else:
            try:
                self._fill(row, self._run(setting, self._left), reference, has_one_shape)
            except OutOfTime:
                row.status = "stopped: budget"
            except (TrialFailed, InputError) as error:
                row.status = f"failed: {error}"
        self.rows.append(row)
        if not self._has_result:
            append_row(self._output / TABLE, row)
        took = f"{predicted:.0f} s expected"
        if row.measured:
            shape = "" if row.shape_error is None else f", shape {percent(row.shape_error)}"
            took = f"{row.seconds:.2f} s, water {percent(row.water_error)}{shape}"
        self._say(f"{row.varied}: {row.status}, {took}", ahead)

    def _measure_parts(self) -> list[PartCost]:
        """What each part of the scene as written costs, within its share of the budget whatever is left of that."""
        self._say("what each part of the scene costs, with it and without it in turns")
        return measure_parts(self._scene, lambda scene: self._leaf, self._device, PARTS_SHARE * self._budget)

    # What is found.

    def _fill(self, row: Row, trial: Trial, reference: Reference, has_one_shape: bool) -> None:
        errors = errors_of(trial, reference.trial, self._leaf.length)
        row.mesh_vertices = trial.vertices
        row.seconds = trial.seconds
        row.seconds_per_second = trial.seconds / film_seconds(self._film)
        for name in ("start_seconds", "fluid_seconds", "motion_seconds", "fluid_steps", "motion_substeps"):
            setattr(row, name, getattr(trial, name))
        row.ledger_error = trial.ledger_error
        row.peak_memory = trial.peak_memory or None
        row.water_error, row.largest_water_error = errors.water, errors.largest_water
        row.water_over_time = errors.water_over_time.tolist()
        if has_one_shape:
            row.shape_error, row.largest_shape_error = errors.shape, errors.largest_shape
            row.shape_over_time = errors.shape_over_time.tolist()

    def _mark(self, own: dict[str, float]) -> None:
        """Mark what lies below the reference's own errors, and the Pareto fronts."""
        measured = [row for row in self.rows if row.measured]
        seconds = np.array([row.seconds for row in measured])
        for kind in ("water", "shape"):
            floor = own[f"{kind}_error"]
            errors = [getattr(row, f"{kind}_error") for row in measured]
            if None in errors:
                continue
            for row, error, on_front in zip(measured, errors, pareto_front(seconds, errors, floor), strict=True):
                setattr(row, f"{kind}_within_reference", bool(error < floor))
                setattr(row, f"{kind}_pareto", bool(on_front))

    def _result(
        self,
        reference: Reference,
        own: dict[str, float],
        nudged: float | None,
        has_one_shape: bool,
        is_converged: bool,
        summary: list[str],
    ) -> dict[str, Any]:
        import warp as wp

        mesh = self._leaf.mesh
        return {
            "scene": self._scene.name,
            "tables": self._scene.model_dump(mode="json", include=TABLES),
            "versions": package_versions(),
            "device": {"name": wp.get_device(self._device).name, "alias": self._device},
            "machine": f"{platform.machine()}, {os.cpu_count()} cores",
            "mesh": {"vertices": mesh.vertex_count, "triangles": mesh.triangle_count},
            "plant_seconds": self._scene.time.duration,
            "sampled_frames": sampled_frames(self._film),
            "sampled_points": len(np.load(self._places)),
            "playback_seconds": film_seconds(self._film),
            "scene_playback_seconds": film_seconds(self._scene),
            "budget_seconds": self._budget,
            "spent_seconds": self._spent,
            "summary": summary,
            "reference": {
                **reference.setting.as_dict(),
                "in_words": reference.setting.in_words(self._base),
                "seconds": reference.trial.seconds,
                "own_errors": own,
                "converged": is_converged,
                "one_shape": has_one_shape,
                "moved_by_camber": nudged,
                "refinements": [refinement.as_dict() for refinement in reference.refinements],
            },
            "settings": [row.as_dict() for row in self.rows],
        }


def _place(points: list[tuple[float, float]]) -> np.ndarray:
    """Where seconds and errors lie on logarithmic axes."""
    return np.log10(np.maximum(points, 1e-9))


def _several_shapes(nudged: float) -> str:
    return (
        f"This scene does not settle on one shape: a leaf cambered by {percent(NUDGE)} more ends {percent(nudged)} of "
        "its length away. Errors of the shape would say which of them a setting happens to find, and are left out."
    )
