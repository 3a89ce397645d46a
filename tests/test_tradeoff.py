"""The measured trade: metrics, Pareto front, budget, table."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.scene.file import load_scene
from leafwarp.study import tradeoff
from leafwarp.study.metrics import (
    errors_fall_with_the_step,
    largest_water_error,
    pareto_front,
    relative_water_error,
    shape_error,
)
from leafwarp.study.reference import ErrorModel, choose_reference, unsplit_settings
from leafwarp.study.trial import film_seconds, trial_scene

MAPS = (16, 32)
STEP_FACTORS = (0.5, 4.0)
# Both float32 schemes round and stop their iterations well below this.
PRECISION_TOLERANCE = 1e-3


def run(scene_file: Path, output: Path, changes: tuple[str, ...] = (), **arguments) -> dict:
    scene = load_scene(scene_file, changes)
    options = {"budget": 600.0, "maps": MAPS, "step_factors": STEP_FACTORS, "quiet": True} | arguments
    return tradeoff.run_tradeoff(scene, output, **options)


@pytest.fixture(scope="module")
def folder(small_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole study of the small scene, with budget for every setting."""
    folder = tmp_path_factory.mktemp("trade")
    run(small_scene, folder)
    return folder


@pytest.fixture(scope="module")
def result(folder: Path) -> dict:
    return json.loads((folder / "tradeoff.json").read_text())


def row_of(result: dict, **wanted) -> dict:
    rows = [row for row in result["settings"] if all(row[name] == value for name, value in wanted.items())]
    assert len(rows) == 1
    return rows[0]


def test_every_setting_is_measured_and_the_reference_has_no_error(result: dict) -> None:
    assert len(result["settings"]) == len(MAPS) * len(STEP_FACTORS) * 2 * 2
    for row in result["settings"]:
        assert row["status"] in ("done", "reference")
        assert 0.0 < row["fluid_seconds"] < row["seconds"]
        assert abs(row["ledger_error"]) < 1e-5
        assert row["motion_substeps"] > 0
    (reference,) = [row for row in result["settings"] if row["status"] == "reference"]
    chosen = result["reference"]
    assert (reference["map_width"], reference["map_height"]) == tuple(chosen["map_size"]) == (24, 32)
    assert reference["fluid_step"] == chosen["step"] == 300.0
    assert (reference["scheme"], reference["precision"]) == ("unsplit", "float64")
    assert reference["water_error"] == reference["largest_water_error"] == reference["shape_error"] == 0.0


def test_errors_shrink_with_refinement(result: dict) -> None:
    def error(cells: int, step: float, scheme: str = "unsplit", kind: str = "water") -> float:
        row = row_of(result, map_height=cells, fluid_step=step, scheme=scheme, precision="float64")
        return row[f"{kind}_error"]

    for kind in ("water", "shape"):
        assert error(32, 300.0, kind=kind) < error(32, 2400.0, kind=kind) < error(16, 2400.0, kind=kind)
        # On the coarse map the map's own error rules, whatever the step; a finer map mends it.
        assert error(32, 300.0, kind=kind) < error(16, 300.0, kind=kind)
    assert error(32, 300.0, "split") < error(32, 2400.0, "split")
    # The splitting adds its own error to that of the step.
    assert error(32, 300.0, "split") > error(32, 300.0)


def test_both_precisions_agree(result: dict) -> None:
    for row in result["settings"]:
        other = row_of(
            result, map_width=row["map_width"], fluid_step=row["fluid_step"], scheme=row["scheme"],
            precision={"float32": "float64", "float64": "float32"}[row["precision"]],
        )  # fmt: skip
        assert row["water_error"] == pytest.approx(other["water_error"], abs=PRECISION_TOLERANCE)


def test_settings_below_the_references_own_error_are_marked(result: dict) -> None:
    for kind in ("water", "shape"):
        own = result["reference"]["own_errors"][f"{kind}_error"]
        assert own > 0.0
        for row in result["settings"]:
            assert row[f"{kind}_within_reference"] == (row[f"{kind}_error"] < own)
        on_front = [row for row in result["settings"] if row[f"{kind}_pareto"]]
        assert min(result["settings"], key=lambda row: row["fluid_seconds"]) in on_front


def test_csv_and_json_say_the_same(folder: Path, result: dict) -> None:
    with (folder / "tradeoff.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(result["settings"])
    for line, row in zip(lines, result["settings"], strict=True):
        assert set(line) == set(row)
        for name, value in row.items():
            if isinstance(value, bool):
                assert line[name] == str(value).lower()
            elif isinstance(value, float):
                assert float(line[name]) == pytest.approx(value, rel=1e-5)
            else:
                assert line[name] == str(value)


def test_the_plot_is_a_picture(folder: Path) -> None:
    pytest.importorskip("matplotlib")
    import cv2

    picture = cv2.imread(str(folder / "tradeoff.png"))
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    for red, green, blue in ((0xC2, 0x57, 0x1A), (0x1F, 0x6F, 0x8B)):  # both schemes are drawn
        assert (picture == (blue, green, red)).all(axis=2).sum() > 200


def test_what_the_budget_does_not_pay_is_listed_as_skipped(small_scene: Path, prepared_folder: Path) -> None:
    result = run(small_scene, prepared_folder, budget=0.001)
    assert (result["reference"]["map_size"], result["reference"]["step"]) == ((6, 8), 2400.0)
    skipped = [row for row in result["settings"] if row["status"] == "skipped: budget"]
    assert len(skipped) == len(result["settings"])
    assert not (prepared_folder / "tradeoff.png").exists()
    assert all(row["predicted_seconds"] > 0.0 and row["water_error"] is None for row in skipped)
    assert not any(row["water_pareto"] for row in skipped)
    lines = (prepared_folder / "tradeoff.csv").read_text().splitlines()
    assert sum("skipped: budget" in line for line in lines) == len(skipped)


def test_rows_are_kept_when_the_study_is_interrupted(small_scene: Path, prepared_folder: Path, monkeypatch) -> None:
    append, written = tradeoff.append_row, []

    def interrupted(path: Path, row) -> None:
        append(path, row)
        written.append(row)
        if len(written) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(tradeoff, "append_row", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(small_scene, prepared_folder, maps=(16,))
    with (prepared_folder / "tradeoff.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["status"] for line in lines] == [row.status for row in written]


def test_a_setting_that_fails_stays_in_the_table(small_scene: Path, prepared_folder: Path, monkeypatch) -> None:
    from leafwarp.errors import SimulationError

    run_trial = tradeoff.run_trial

    def failing(scene, leaf, setting, *rest):
        if setting.precision == "float32":
            raise SimulationError(2, "motion", "too hard")
        return run_trial(scene, leaf, setting, *rest)

    monkeypatch.setattr(tradeoff, "run_trial", failing)
    result = run(small_scene, prepared_folder, maps=(16,), step_factors=(4.0,))
    assert sorted(row["status"] for row in result["settings"]) == [
        "done", "failed: frame 2: motion: too hard", "failed: frame 2: motion: too hard", "reference",
    ]  # fmt: skip


def test_a_scene_without_flowing_water_is_refused(photo: Path, tmp_path: Path, capsys) -> None:
    scene = tmp_path / "still.toml"
    scene.write_text(
        f'[leaf]\nimage = "{photo}"\nlength = 0.08\n[time]\nduration = 10\n[water]\ncurve = [[0, 1.0]]\n'
        "[structure]\nmembrane_stiffness = 5.0\n"
    )
    assert main(["tradeoff", str(scene), "-o", str(tmp_path / "out"), "-q"]) == 2
    message = capsys.readouterr().err
    assert "[fluid]" in message and "[water]" in message and "Traceback" not in message
    assert not (tmp_path / "out").exists()


def test_an_existing_table_is_kept_unless_overwritten(folder: Path, small_scene: Path) -> None:
    before = (folder / "tradeoff.csv").read_bytes()
    with pytest.raises(InputError, match="--overwrite"):
        run(small_scene, folder)
    assert (folder / "tradeoff.csv").read_bytes() == before


@pytest.mark.parametrize("budget", ["0", "-3 min", "soon", "10 cm", "nan"])
def test_a_bad_budget_is_refused(small_scene: Path, tmp_path: Path, capsys, budget: str) -> None:
    assert main(["tradeoff", str(small_scene), "-o", str(tmp_path / "out"), f"--budget={budget}", "-q"]) == 2
    message = capsys.readouterr().err
    assert "budget" in message and "accepted" in message and "Traceback" not in message


def test_without_matplotlib_the_table_is_written_and_the_extra_is_named(
    small_scene: Path, prepared_folder: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(tradeoff, "find_spec", lambda name: None)
    run(small_scene, prepared_folder, budget=0.001, maps=(16,))
    assert "leafwarp[plot]" in capsys.readouterr().err
    assert (prepared_folder / "tradeoff.json").exists() and not (prepared_folder / "tradeoff.png").exists()


def test_pareto_front_of_points_made_by_hand() -> None:
    seconds = [1.0, 2.0, 3.0, 4.0, 4.0, 5.0, np.nan]
    errors = [9.0, 5.0, 6.0, 1.0, 1.0, 0.5, 0.0]
    assert pareto_front(seconds, errors).tolist() == [True, True, False, True, True, True, False]
    # Below the floor errors cannot be told apart: the slower one gains nothing.
    assert pareto_front(seconds, errors, floor=1.0).tolist() == [True, True, False, True, True, False, False]


def test_a_reference_that_finer_steps_move_away_from_is_not_converged() -> None:
    steps = [240.0, 15.0, 60.0]
    assert errors_fall_with_the_step(steps, [0.3, 0.1, 0.2], 0.0)
    assert not errors_fall_with_the_step(steps, [0.03, 0.5, 0.1], 0.1)
    assert errors_fall_with_the_step(steps, [0.03, 0.05, 0.1], 0.1)
    assert errors_fall_with_the_step([1.0], [0.5], 0.0)


def test_water_error_is_weighted_by_area() -> None:
    reference = np.array([[1.0, 1.0], [0.5, 0.5]])
    water = reference + np.array([[0.0, 0.1], [0.0, 0.1]])
    areas = np.array([3.0, 1.0])
    assert relative_water_error(water, reference, areas) == pytest.approx(np.sqrt(0.02 / 5.0))
    assert largest_water_error(water, reference) == pytest.approx(0.1)
    assert relative_water_error(reference, reference, areas) == 0.0
    assert relative_water_error(np.ones((2, 2)), np.zeros((2, 2)), areas) == 1.0


def test_shape_error_is_a_share_of_the_length() -> None:
    reference = np.zeros((2, 3, 3))
    points = reference.copy()
    points[1, :, 2] = 0.03
    assert shape_error(points, reference, np.ones(3), 0.1) == pytest.approx(0.3 / np.sqrt(2.0))


def test_the_reference_is_the_most_accurate_that_can_be_paid() -> None:
    candidates = unsplit_settings([(16, 16), (32, 32)], [10.0, 40.0])
    model = ErrorModel(per_second=1e-3, per_cell=1.0)

    def cost(setting) -> float:
        return setting.cells_across**2 / setting.step

    def chosen(seconds: float) -> tuple[int, float]:
        setting = choose_reference(candidates, model, cost, seconds)
        return setting.cells_across, setting.step

    assert chosen(1000.0) == (32, 10.0)
    assert chosen(50.0) == (32, 40.0)  # error 0.0713; (16, 10.0) costs the same, with 0.0725
    assert chosen(0.0) == (16, 40.0)


def test_trials_keep_plant_time_and_shorten_the_film(small_scene: Path) -> None:
    scene = load_scene(small_scene, ["time.frames=240"])
    trial = trial_scene(scene, 0.5)
    assert trial.time.duration == scene.time.duration
    assert trial.time.frames == 25
    assert film_seconds(trial) == pytest.approx(0.5)


def test_maps_keep_the_scenes_proportions() -> None:
    assert tradeoff.map_sizes((64, 512), (128, 1024)) == [(16, 128), (128, 1024)]
    assert tradeoff.map_sizes((1, 300), (16,)) == [(1, 16)]


def test_a_scene_that_knows_double_precision_alone_is_measured_in_it(small_scene: Path, prepared_folder: Path) -> None:
    changes = ("motion.method='quasistatic'", "time.frames=3")
    table = run(small_scene, prepared_folder, changes, maps=(16,), step_factors=(1.0,))
    assert table["settings"] and {row["precision"] for row in table["settings"]} == {"float64"}
