"""The measured trade: what is computed and compared."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.study.tradeoff import study, worker
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.reference import TIGHT_FORCE_TOLERANCE, first_setting
from leafwarp.study.tradeoff.setting import Setting, single_changes
from leafwarp.study.tradeoff.summary import summarise
from leafwarp.study.tradeoff.table import Row
from leafwarp.study.tradeoff.trial import Trial
from leafwarp.study.tradeoff.worker import Request, TrialFailed, compute_apart, compute_here
from tradeoff_studies import SMALLER, Counting, fewer_singles, row_of, run


@pytest.fixture(scope="module")
def result(study_folder: Path) -> dict:
    return json.loads((study_folder / "tradeoff.json").read_text())


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


def test_the_search_refines_what_changes_the_most(
    small_scene: Path, leaf_cache: Path, tmp_path: Path, quick_study
) -> None:
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


def test_where_explicit_motion_is_too_dear_the_search_goes_on_with_implicit_motion(small_scene: Path) -> None:
    """A made-up scene whose mesh errs the most; fine meshes take for ever by explicit motion, which implicit motion is
    a thousandth of the length away from."""
    from leafwarp.study.tradeoff.reference import find_reference

    def run_made_up(setting: Setting, seconds: float) -> Trial:
        points = np.zeros((2, 4, 3))
        points[1, :, 2] = 1.0 / setting.vertices
        points[:, :, 1] = 1e-3 * (setting.motion == "implicit")
        return Trial(points, np.ones((2, 4)), 0, 1, 1, 0, 1, 1, 0, 0, setting.vertices)

    def search(scene: Scene):
        clock = iter(range(1000))
        return find_reference(
            scene, 1.0, run_made_up,
            lambda setting: 100.0 if setting.motion == "explicit" and setting.vertices > 500 else 0.1,
            lambda: 30.0 - next(clock), lambda text: None,
        )  # fmt: skip

    scene = load_scene(small_scene)
    reference = search(scene)
    assert reference.setting.motion == "implicit" and reference.setting.precision == "float64"
    assert reference.setting.force_tolerance == TIGHT_FORCE_TOLERANCE and reference.setting.vertices > 500
    assert reference.last["motion"].shape == pytest.approx(1e-3, rel=1e-3)
    assert reference.own_shape_error == pytest.approx(1e-3 + reference.last["mesh"].shape, rel=1e-3)
    # What has no implicit motion stays with the mesh that it can pay.
    paper = search(scene.with_changes({"structure.bending": "paper"}))
    assert paper.setting.motion == "explicit" and paper.setting.vertices <= 500 and "motion" not in paper.last


def test_csv_json_and_text_say_the_same(study_folder: Path, result: dict) -> None:
    with (study_folder / "tradeoff.csv").open() as file:
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
    text = (study_folder / "tradeoff.txt").read_text()
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


def test_the_plot_is_a_picture(study_folder: Path) -> None:
    pytest.importorskip("matplotlib")
    import cv2

    picture = cv2.imread(str(study_folder / "tradeoff.png"))
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    for red, green, blue in ((0xC2, 0x57, 0x1A), (0x1F, 0x6F, 0x8B)):  # both schemes are drawn
        assert (picture == (blue, green, red)).all(axis=2).sum() > 100


def test_several_shapes_are_said_instead_of_an_error(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch
) -> None:
    monkeypatch.setattr(study, "ONE_SHAPE", 1e-12)
    monkeypatch.setattr(study, "single_changes", fewer_singles)
    result = run(small_scene, tmp_path, leaf_cache, SMALLER)
    assert not result["reference"]["one_shape"] and result["reference"]["moved_by_camber"] > 0.0
    assert any("does not settle on one shape" in sentence for sentence in result["summary"])
    for row in result["settings"]:
        assert row["water_error"] is not None and row["shape_error"] is None and row["shape_pareto"] is None
    assert (tmp_path / "tradeoff.csv").exists()


def test_a_long_film_is_shortened(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch
) -> None:
    monkeypatch.setattr(study, "FILM_SHARE", 1e-9)
    monkeypatch.setattr(study, "preset_settings", lambda scene, leaf: {})
    monkeypatch.setattr(study, "single_changes", lambda scene: [])
    monkeypatch.setattr(study, "combinations", lambda *arguments: [])
    counting = Counting()
    result = run(small_scene, tmp_path, leaf_cache, ("mesh.vertices=60", "time.frames=60"), compute=counting)
    assert [request.scene["time"]["frames"] for request in counting.requests][:2] == [60, 25]
    assert result["playback_seconds"] == 1.0 and result["scene_playback_seconds"] == pytest.approx(59 / 24)
    assert len(result["sampled_frames"]) == 25


def test_a_scene_whose_water_is_prescribed(small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study) -> None:
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
