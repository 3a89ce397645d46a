"""The measured trade: what is computed, compared and kept."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.scene.file import load_scene
from leafwarp.study.tradeoff import study, worker
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.reference import TIGHT_FORCE_TOLERANCE, first_setting
from leafwarp.study.tradeoff.setting import Setting, single_changes
from leafwarp.study.tradeoff.study import run_tradeoff
from leafwarp.study.tradeoff.summary import summarise
from leafwarp.study.tradeoff.table import Row
from leafwarp.study.tradeoff.trial import Trial
from leafwarp.study.tradeoff.worker import Request, TrialFailed, compute_apart, compute_here

# Seconds of the made-up clock that stands for a study of every setting.
PLENTY = 1000.0
SMALLER = ("mesh.vertices=60", "maps.size=16", "time.frames=5")


class Counting:
    """Computes trials in this process and counts them; may be told to fail or to be interrupted."""

    def __init__(self, fails=lambda scene: None, interrupted_after: int | None = None):
        self.requests: list[Request] = []
        self._fails, self._interrupted_after = fails, interrupted_after

    def __call__(self, request: Request, seconds: float) -> Trial:
        if len(self.requests) == self._interrupted_after:
            raise KeyboardInterrupt
        self.requests.append(request)
        message = self._fails(request.scene)
        if message:
            raise TrialFailed(message)
        return compute_here(request, seconds)


def few_singles(scene):
    """Of the choices, one of each kind."""
    base = Setting.of(scene)
    yield from (base, base.scaled_map(2.0), base.with_(scheme="unsplit"), base.with_(fluid_step=2400.0))
    yield from (base.with_(order=2), base.with_(order=2, step_tolerance=1e-3))
    yield from (base.with_(vertices=240), base.with_(angular_springs=False), base.with_(motion="quasistatic"))
    yield from (base.with_(coupling_interval=7200.0), base.with_(substep=0.45), base.with_(precision="float64"))


def fewer_singles(scene):
    """The scene as it is, and with two choices: for what does not depend on which there are."""
    base = Setting.of(scene)
    yield from (base, base.with_(scheme="unsplit"), base.with_(motion="quasistatic"))


@pytest.fixture(scope="module")
def quick():
    """A study that looks no further than it must: the reference is what the search begins with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "single_changes", few_singles)
        patch.setattr(study, "preset_settings", lambda scene: {"draft": Setting.of(scene).with_(vertices=80)})
        patch.setattr(study, "REFERENCE_SHARE", 0.0)
        patch.setattr(study, "PARTS_SHARE", 0.001)
        yield


def run(scene_file: Path, output: Path, cache: Path, changes: tuple[str, ...] = (), **arguments) -> dict:
    scene = load_scene(scene_file, changes)
    options = {"budget": PLENTY, "quiet": True, "compute": compute_here, "cache": cache} | arguments
    return run_tradeoff(scene, output, **options)


@pytest.fixture(scope="module")
def folder(small_scene: Path, quick, leaf_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole study of the small scene."""
    folder = tmp_path_factory.mktemp("trade")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "combinations", lambda *arguments: [])
        run(small_scene, folder, leaf_cache)
    return folder


@pytest.fixture(scope="module")
def result(folder: Path) -> dict:
    return json.loads((folder / "tradeoff.json").read_text())


def row_of(result: dict, varied: str) -> dict:
    (row,) = [row for row in result["settings"] if row["varied"] == varied]
    return row


def test_every_choice_is_measured(result: dict) -> None:
    assert result["settings"][0]["varied"] == "as written"
    assert {row["varied"] for row in result["settings"]} == {
        "as written", "maps.size = [48, 64]", "fluid.scheme = unsplit", "fluid.step = 2400", "fluid.order = 2",
        "fluid.order = 2, fluid.step_tolerance = 0.001", "mesh.vertices = 240",
        "no angular springs", "motion.method = quasistatic", "solver.coupling_interval = 7200", "solver.substep = 0.45",
        "solver.precision = float64", "mesh.vertices = 80",
    }  # fmt: skip
    assert [(row["name"], row["varied"]) for row in result["settings"] if row["name"]] == [
        ("scene", "as written"), ("draft", "mesh.vertices = 80"),
    ]  # fmt: skip
    for row in result["settings"]:
        assert row["status"] == "done"
        assert 0.0 < row["fluid_seconds"] < row["seconds"]
        assert row["seconds"] > row["motion_seconds"] > 0.0
        assert row["seconds_per_second"] == pytest.approx(row["seconds"] / (8 / 24))
        assert abs(row["ledger_error"]) < 1e-5
        assert row["motion_substeps"] > 0
        assert 0.0 < row["shape_error"] <= row["largest_shape_error"]
        assert 0.0 < row["water_error"] and 0.0 < row["largest_water_error"] < 1.0
        assert len(row["water_over_time"]) == len(row["shape_over_time"]) == 9
        # A mean of squares over the frames. The first shows the photographed leaf, but that of an equilibrium.
        assert row["shape_error"] == pytest.approx(np.sqrt(np.mean(np.square(row["shape_over_time"]))))
        assert (row["shape_over_time"][0] < 1e-3) == (row["motion"] == "explicit")


def test_choices_do_what_they_say(result: dict) -> None:
    own = row_of(result, "as written")
    finer = row_of(result, "mesh.vertices = 240")
    assert finer["vertices"] == 2 * own["vertices"] and finer["mesh_vertices"] > 1.8 * own["mesh_vertices"]
    assert row_of(result, "fluid.step = 2400")["fluid_steps"] == 12 and own["fluid_steps"] == 48
    assert row_of(result, "solver.substep = 0.45")["motion_substeps"] > 1.9 * own["motion_substeps"]
    # Both round, and stop their iterations, well below this.
    assert row_of(result, "solver.precision = float64")["water_error"] == pytest.approx(own["water_error"], abs=1e-3)
    # What leaves the water alone leaves its error alone.
    for varied in ("no angular springs", "mesh.vertices = 240", "solver.substep = 0.45"):
        assert row_of(result, varied)["water_error"] == own["water_error"]
    assert row_of(result, "no angular springs")["shape_error"] > 2.0 * own["shape_error"]
    # A structure that hears of the water at every second frame, or a scheme that splits rows from columns.
    assert row_of(result, "solver.coupling_interval = 7200")["water_error"] > own["water_error"]
    assert row_of(result, "fluid.scheme = unsplit")["water_error"] < own["water_error"]


def test_the_reference_says_how_far_it_is_from_the_truth(result: dict) -> None:
    reference = result["reference"]
    assert (reference["scheme"], reference["precision"]) == ("unsplit", "float64")
    assert [refinement["kind"] for refinement in reference["refinements"]] == ["map", "step", "mesh", "coupling"]
    own = reference["own_errors"]
    for kind in ("water", "shape"):
        assert own[f"{kind}_error"] == pytest.approx(sum(r[kind] for r in reference["refinements"]))
        assert own[f"{kind}_error"] > 0.0
        for row in result["settings"]:
            assert row[f"{kind}_within_reference"] == (row[f"{kind}_error"] < own[f"{kind}_error"])
        assert any(row[f"{kind}_pareto"] for row in result["settings"])


def test_errors_fall_as_map_and_step_are_refined(small_scene: Path, tmp_path: Path, leaf_cache: Path) -> None:
    """Against a finer map at a shorter step: of the shape as of the water, which it acts on alone."""
    places = tmp_path / "places.npy"
    np.save(places, np.random.default_rng(3).uniform((-0.015, 0.01), (0.015, 0.05), (200, 2)))
    scene = load_scene(small_scene, ["solver.precision='float64'", "time.frames=5"])

    def film(cells: int, step: float, scheme: str = "unsplit") -> Trial:
        changes = {"maps.size": [3 * cells // 4, cells], "fluid.step": step, "fluid.scheme": scheme}
        data = scene.with_changes(changes).model_dump(mode="json", exclude_unset=True)
        name = str(tmp_path / f"{cells}_{step:g}_{scheme}.npz")
        return compute_here(Request(data, "small", str(leaf_cache), str(places), name, "cpu"), 100.0)

    def errors(reference: Trial, *setting) -> np.ndarray:
        found = errors_of(film(*setting), reference, 0.06)
        return np.array([found.water, found.shape])

    truth = film(64, 150.0)
    fine, late = errors(truth, 32, 300.0), errors(truth, 32, 2400.0)
    coarse, both = errors(truth, 16, 300.0), errors(truth, 16, 2400.0)
    # On the coarse map the map's own error rules, whatever the step; a finer map mends it.
    assert (fine < late).all() and (late < both).all() and (fine < coarse).all()
    # The splitting adds its own error to that of the step: each scheme against itself, for their veins differ.
    late_errors, soon_errors = [], []
    for scheme in ("unsplit", "split"):
        truth = film(32, 37.5, scheme)
        soon_errors.append(errors(truth, 32, 300.0, scheme))
        late_errors.append(errors(truth, 32, 2400.0, scheme))
        assert (soon_errors[-1] < late_errors[-1]).all()
    assert (soon_errors[0] < soon_errors[1]).all() and (late_errors[0] < late_errors[1]).all()


def test_the_search_refines_what_changes_the_most(small_scene: Path, leaf_cache: Path, tmp_path: Path, quick) -> None:
    """A made-up scene of which map, step and mesh leave errors of first order."""
    from leafwarp.study.tradeoff.reference import find_reference

    def run_made_up(setting: Setting, seconds: float) -> Trial:
        error = 0.4 / setting.map_size[1] + setting.fluid_step / 1e7 + 0.02 / setting.vertices**0.5
        points = np.zeros((2, 4, 3))
        points[1, :, 2] = error
        return Trial(points, np.ones((2, 4)), 0, 1, 1, 0, 1, 1, 0, 0, setting.vertices)

    clock = iter(range(1000))
    reference = find_reference(
        load_scene(small_scene), 1.0, run_made_up, lambda setting: setting.cells / 1e5,
        lambda: 30.0 - next(clock), lambda text: None,
    )  # fmt: skip
    kinds = [refinement.kind for refinement in reference.refinements]
    # The coupling is without any error here.
    assert kinds[:5] == ["map", "step", "mesh", "coupling", "map"] and "mesh" in kinds[5:]
    assert kinds.count("coupling") == 1
    assert reference.is_converged
    left = 0.4 / reference.setting.map_size[1] + reference.setting.fluid_step / 1e7
    left += 0.02 / reference.setting.vertices**0.5
    assert 0.5 * left < reference.own_shape_error < 2.0 * left
    # Nothing that is left would change more than the last of each kind did.
    assert max(r.size for r in reference.last.values()) < reference.refinements[0].size / 2.0


def test_csv_json_and_text_say_the_same(folder: Path, result: dict) -> None:
    with (folder / "tradeoff.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(result["settings"])
    for line, row in zip(lines, result["settings"], strict=True):
        assert set(line) == set(row) - {"water_over_time", "shape_over_time"}
        for name, text in line.items():
            value = row[name]
            if isinstance(value, bool):
                assert text == str(value).lower()
            elif isinstance(value, float):
                assert float(text) == pytest.approx(value, rel=1e-5)
            else:
                assert text == ("" if value is None else str(value))
    text = (folder / "tradeoff.txt").read_text()
    assert text.splitlines()[: len(result["summary"])] == result["summary"]
    assert all(f"| {part['part']} |" in text for part in result["parts"])


def test_what_each_part_costs_is_told(result: dict) -> None:
    parts = {part["part"]: part for part in result["parts"]}
    assert {"gravity", "curl", "source", "USD output"} <= set(parts)
    measured = [part for part in parts.values() if part["saved"] is not None]
    assert measured and all(part["pairs"] >= 1 for part in measured)


def test_the_text_names_what_costs_error_and_what_buys_speed(result: dict) -> None:
    own = row_of(result, "as written")
    floor = result["reference"]["own_errors"]["shape_error"]
    best = min(result["settings"], key=lambda row: (max(row["shape_error"], floor), row["seconds"]))
    text = "\n".join(result["summary"])
    assert f"{own['seconds']:.3g} s" in text
    if max(best["shape_error"], floor) < 0.8 * max(own["shape_error"], floor):
        assert f"costs the most error: with {best['varied']}" in text
    else:
        assert "No single choice would make the error much smaller." in text


def test_the_text_goes_by_what_the_reference_can_tell_apart(small_scene: Path) -> None:
    setting = Setting.of(load_scene(small_scene))

    def row(name: str, varied: str, seconds: float, error: float) -> Row:
        return Row(setting, name, varied, "done", 1.0, seconds=seconds, seconds_per_second=seconds, shape_error=error)

    rows = [row("scene", "as written", 10.0, 0.05), row("", "finer", 15.0, 0.01), row("", "faster", 2.0, 0.05)]
    text = "\n".join(summarise(rows, "shape", rows, 0.005))
    assert "costs the most error: with finer it is 1 %, in 1.5 times the time." in text
    assert "buys the most speed: with faster it takes 0.2 times the time; its error is 5 %." in text
    text = "\n".join(summarise(rows, "shape", rows, 0.06))
    assert "No single choice would make the error much smaller." in text and "with faster it takes 0.2" in text


def test_the_plot_is_a_picture(folder: Path) -> None:
    pytest.importorskip("matplotlib")
    import cv2

    picture = cv2.imread(str(folder / "tradeoff.png"))
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    for red, green, blue in ((0xC2, 0x57, 0x1A), (0x1F, 0x6F, 0x8B)):  # both schemes are drawn
        assert (picture == (blue, green, red)).all(axis=2).sum() > 100


def test_what_the_budget_does_not_pay_is_listed(small_scene: Path, tmp_path: Path, leaf_cache: Path, quick) -> None:
    result = run(small_scene, tmp_path, leaf_cache, SMALLER, budget=1e-3)
    skipped = [row for row in result["settings"] if row["status"] == "skipped: budget"]
    assert len(skipped) == len(result["settings"]) - 1  # the scene as written was computed first of all
    assert all(row["predicted_seconds"] > 0.0 and row["water_error"] is None for row in skipped)
    assert not any(row["water_pareto"] for row in skipped)


def test_an_interrupted_study_goes_on_where_it_stopped(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch
) -> None:
    monkeypatch.setattr(study, "combinations", lambda *arguments: [])
    monkeypatch.setattr(study, "single_changes", fewer_singles)
    first = Counting(interrupted_after=7)
    with pytest.raises(KeyboardInterrupt):
        run(small_scene, tmp_path, leaf_cache, SMALLER, compute=first)
    assert len((tmp_path / "tradeoff.csv").read_text().splitlines()) > 1
    assert not (tmp_path / "tradeoff.json").exists()
    second = Counting()
    resumed = run(small_scene, tmp_path, leaf_cache, SMALLER, compute=second)
    assert not {request.result for request in first.requests} & {request.result for request in second.requests}
    whole = run(small_scene, tmp_path / "whole", leaf_cache, SMALLER)
    assert len(first.requests) + len(second.requests) == len(list((tmp_path / "whole" / "trials").glob("*.npz")))
    for row in resumed["settings"]:
        other = row_of(whole, row["varied"])
        assert (row["water_error"], row["shape_error"]) == (other["water_error"], other["shape_error"])


def test_a_study_of_another_scene_is_not_continued(small_scene: Path, folder: Path, leaf_cache: Path, quick) -> None:
    before = (folder / "tradeoff.csv").read_bytes()
    with pytest.raises(InputError, match=r"finished study; a --budget above 1000 s goes on with it; --overwrite"):
        run(small_scene, folder, leaf_cache)
    (folder / "tradeoff.json").rename(folder / "kept.json")
    with pytest.raises(InputError, match=r"another scene.*--overwrite"):
        run(small_scene, folder, leaf_cache, SMALLER)
    (folder / "kept.json").rename(folder / "tradeoff.json")
    assert (folder / "tradeoff.csv").read_bytes() == before


@pytest.mark.parametrize("is_finished", [True, False])
def test_what_is_kept_costs_nothing_again(
    is_finished: bool, small_scene: Path, folder: Path, leaf_cache: Path, quick, tmp_path: Path
) -> None:
    """A finished study goes on with more time; an interrupted one, with next to none, has what it had."""
    shutil.copytree(folder, tmp_path / "again")
    before = json.loads((folder / "tradeoff.json").read_text())
    if not is_finished:
        (tmp_path / "again" / "tradeoff.json").unlink()
    counting = Counting()
    budget = 1.001 * PLENTY if is_finished else 1e-3
    result = run(small_scene, tmp_path / "again", leaf_cache, budget=budget, compute=counting)
    kept = {trial.name for trial in (folder / "trials").glob("*.npz")}
    assert not kept & {Path(request.result).name for request in counting.requests}
    assert is_finished or counting.requests == []
    assert result["budget_seconds"] == budget
    assert json.loads(json.dumps(result["reference"])) == before["reference"]
    measured = {row["varied"] for row in before["settings"] if row["seconds"] is not None}
    assert measured <= {row["varied"] for row in result["settings"] if row["seconds"] is not None}


def test_what_a_finished_study_found_stays_until_one_with_more_time_is_done(
    small_scene: Path, folder: Path, leaf_cache: Path, quick, tmp_path: Path
) -> None:
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    results = ("tradeoff.csv", "tradeoff.json", "tradeoff.txt")
    before = [(again / name).read_bytes() for name in results]
    with pytest.raises(KeyboardInterrupt):
        run(small_scene, again, leaf_cache, budget=2.0 * PLENTY, compute=Counting(interrupted_after=0))
    assert [(again / name).read_bytes() for name in results] == before


@pytest.mark.parametrize("damaged", ["{", "[]", '{"budget_seconds": null, "frames": -4}', '{"budget_seconds": 1e999}'])
def test_a_damaged_result_is_made_again_from_what_is_kept(
    damaged: str, small_scene: Path, folder: Path, leaf_cache: Path, quick, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "again")
    before = json.loads((folder / "tradeoff.json").read_text())
    for name in ("tradeoff.json", "trials/film.json"):
        (tmp_path / "again" / name).write_text(damaged)
    result = run(small_scene, tmp_path / "again", leaf_cache, budget=1e-3, compute=Counting(interrupted_after=0))
    assert json.loads(json.dumps(result["reference"])) == before["reference"]


def test_a_setting_that_fails_stays_in_the_table(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch
) -> None:
    monkeypatch.setattr(study, "single_changes", fewer_singles)

    def fails(scene: dict) -> str | None:
        return "frame 2: motion: too hard" if scene["motion"].get("method") == "quasistatic" else None

    result = run(small_scene, tmp_path, leaf_cache, SMALLER, compute=Counting(fails))
    row = row_of(result, "motion.method = quasistatic")
    assert row["status"] == "failed: frame 2: motion: too hard" and row["seconds"] is None
    assert row_of(result, "as written")["status"] == "done"


def test_several_shapes_are_said_instead_of_an_error(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch
) -> None:
    monkeypatch.setattr(study, "ONE_SHAPE", 1e-12)
    monkeypatch.setattr(study, "single_changes", fewer_singles)
    result = run(small_scene, tmp_path, leaf_cache, SMALLER)
    assert not result["reference"]["one_shape"] and result["reference"]["moved_by_camber"] > 0.0
    assert any("does not settle on one shape" in sentence for sentence in result["summary"])
    for row in result["settings"]:
        assert row["water_error"] is not None and row["shape_error"] is None and row["shape_pareto"] is None
    assert (tmp_path / "tradeoff.csv").exists()


def test_a_long_film_is_shortened(small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch) -> None:
    monkeypatch.setattr(study, "FILM_SHARE", 1e-9)
    monkeypatch.setattr(study, "preset_settings", lambda scene: {})
    monkeypatch.setattr(study, "single_changes", lambda scene: [])
    monkeypatch.setattr(study, "combinations", lambda *arguments: [])
    counting = Counting()
    result = run(small_scene, tmp_path, leaf_cache, ("mesh.vertices=60", "time.frames=60"), compute=counting)
    assert [request.scene["time"]["frames"] for request in counting.requests][:2] == [60, 25]
    assert result["playback_seconds"] == 1.0 and result["scene_playback_seconds"] == pytest.approx(59 / 24)
    assert len(result["sampled_frames"]) == 25


def test_a_scene_whose_water_is_prescribed(small_scene: Path, tmp_path: Path, leaf_cache: Path, quick) -> None:
    text = Path(small_scene).read_text()
    head, rest = text.split("[fluid]")
    water = '[water]\ncurve = [["0 h", 1.0], ["8 h", 0.3]]\n[shrink]' + rest.split("[shrink]")[1]
    scene = small_scene.with_name("prescribed.toml")
    scene.write_text(head.replace("[maps]\nsize = [24, 32]\n", "") + water.replace("vein_resistance = 0.5\n", ""))
    settings = list(single_changes(load_scene(scene, ["structure.vein_stiffness=1.0"])))
    assert {s.fluid_step for s in settings} == {s.scheme for s in settings} == {s.map_size for s in settings} == {None}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "single_changes", lambda scene: [])
        changes = ("structure.vein_stiffness=1.0", "mesh.vertices=60", "time.frames=5")
        result = run(scene, tmp_path, leaf_cache, changes)
    (row, *_) = result["settings"]
    assert row["status"] == "done" and row["fluid_steps"] == 0 and row["scheme"] is None
    assert row["water_error"] < 1e-6 and row["shape_error"] > 0.0


def test_the_choices_of_a_scene(small_scene: Path) -> None:
    scene = load_scene(small_scene)
    settings = set(single_changes(scene))
    base = Setting.of(scene)
    varied = {name for setting in settings for name in setting.varied(base)}
    assert varied == {
        "map_size", "fluid_step", "scheme", "order", "step_tolerance", "vertices", "angular_springs", "motion",
        "coupling_interval", "substep", "force_tolerance", "precision",
    }  # fmt: skip
    for setting in settings:
        assert Setting.of(setting.apply(scene)) == setting
    first = first_setting(load_scene(small_scene, ["motion.method='implicit'"]))
    assert first.force_tolerance == TIGHT_FORCE_TOLERANCE and first.scheme == "unsplit"


def test_a_trial_apart_is_the_trial_here(small_scene: Path, tmp_path: Path, leaf_cache: Path) -> None:
    scene = load_scene(small_scene, SMALLER)
    places = tmp_path / "places.npy"
    np.save(places, np.array([[0.0, 0.03], [0.005, 0.04]]))

    def request(name: str, **changes) -> Request:
        data = scene.with_changes(changes).model_dump(mode="json", exclude_unset=True)
        return Request(data, "small", str(leaf_cache), str(places), str(tmp_path / name), "cpu")

    apart = compute_apart(request("apart.npz"), 100.0)
    here = compute_here(request("here.npz"), 100.0)
    assert apart.peak_memory > 50e6
    assert apart.points.tobytes() == here.points.tobytes() and apart.water.tobytes() == here.water.tobytes()
    with pytest.raises(TrialFailed, match=r"frame 2: motion: needs .* substeps"):
        compute_apart(request("failed.npz", **{"solver.maximum_substeps": 1}), 100.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker.sys, "executable", "/bin/false")
        with pytest.raises(TrialFailed, match="its process ended with code 1"):
            compute_apart(request("crashed.npz"), 100.0)
    with pytest.raises(worker.OutOfTime):
        compute_apart(request("late.npz"), 1e-3)
    assert Trial.load(tmp_path / "late.npz") is None
    half = tmp_path / "half.npz"
    half.write_bytes((tmp_path / "apart.npz").read_bytes()[:500])
    assert Trial.load(half) is None
    assert dataclasses.asdict(Trial.load(tmp_path / "apart.npz"))["vertices"] == apart.vertices


def test_the_memory_of_a_process_is_its_own() -> None:
    """Not that of the process which starts it, however much that holds."""
    held = np.ones(40_000_000)  # 320 MB
    told = subprocess.run(
        [sys.executable, "-c", "from leafwarp.report import peak_memory; print(peak_memory())"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert held.sum() == 40_000_000 and 1e6 < int(told.stdout) < 150e6


def test_progress_is_a_bar_on_a_terminal(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch, capsys
) -> None:
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda answer=is_terminal: answer)
        run(small_scene, tmp_path / str(is_terminal), leaf_cache, SMALLER, budget=1e-3, quiet=False)
        told = capsys.readouterr().err
        assert "the scene as written, 5 frames" in told and "skipped: budget" in told
        assert ("█" in told) == is_terminal and ("/0 s" in told)


@pytest.mark.parametrize("budget", ["0", "-3 min", "soon", "10 cm", "nan"])
def test_a_bad_budget_is_refused(small_scene: Path, tmp_path: Path, capsys, budget: str) -> None:
    assert main(["tradeoff", str(small_scene), "-o", str(tmp_path / "out"), f"--budget={budget}", "-q"]) == 2
    message = capsys.readouterr().err
    assert "budget" in message and "accepted" in message and "Traceback" not in message


def test_many_leaves_are_refused(small_scene: Path, tmp_path: Path, capsys) -> None:
    arguments = ["tradeoff", str(small_scene), "-o", str(tmp_path / "out"), "--set", "leaves.count=2", "-q"]
    assert main(arguments) == 2
    assert "[leaves]" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_without_matplotlib_the_table_is_written_and_the_extra_is_named(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(study, "find_spec", lambda name: None)
    run(small_scene, tmp_path, leaf_cache, SMALLER, budget=1e-3)
    assert "leafwarp[plot]" in capsys.readouterr().err
    assert (tmp_path / "tradeoff.json").exists() and not (tmp_path / "tradeoff.png").exists()
