"""What a study does with its time: what it keeps, goes on with, leaves out, reports and refuses."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.study.tradeoff import study
from tradeoff_studies import PLENTY, SMALLER, Counting, fewer_singles, row_of, run


def test_what_the_budget_does_not_pay_is_listed(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study
) -> None:
    result = run(small_scene, tmp_path, leaf_cache, SMALLER, budget=1e-3)
    skipped = [row for row in result["settings"] if row["status"] == "skipped: budget"]
    assert len(skipped) == len(result["settings"]) - 1  # the scene as written was computed first of all
    assert all(row["predicted_seconds"] > 0.0 and row["water_error"] is None for row in skipped)
    assert not any(row["water_pareto"] for row in skipped)


def test_an_interrupted_study_goes_on_where_it_stopped(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch
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


def test_a_study_of_another_scene_is_not_continued(
    small_scene: Path, study_folder: Path, leaf_cache: Path, quick_study
) -> None:
    before = (study_folder / "tradeoff.csv").read_bytes()
    with pytest.raises(InputError, match=r"finished study; a --budget above 1000 s goes on with it; --overwrite"):
        run(small_scene, study_folder, leaf_cache)
    (study_folder / "tradeoff.json").rename(study_folder / "kept.json")
    with pytest.raises(InputError, match=r"another scene.*--overwrite"):
        run(small_scene, study_folder, leaf_cache, SMALLER)
    (study_folder / "kept.json").rename(study_folder / "tradeoff.json")
    assert (study_folder / "tradeoff.csv").read_bytes() == before


@pytest.mark.parametrize("is_finished", [True, False])
def test_what_is_kept_costs_nothing_again(
    is_finished: bool, small_scene: Path, study_folder: Path, leaf_cache: Path, quick_study, tmp_path: Path
) -> None:
    """A finished study goes on with more time; an interrupted one, with next to none, has what it had."""
    shutil.copytree(study_folder, tmp_path / "again")
    before = json.loads((study_folder / "tradeoff.json").read_text())
    if not is_finished:
        (tmp_path / "again" / "tradeoff.json").unlink()
    counting = Counting()
    budget = 1.001 * PLENTY if is_finished else 1e-3
    result = run(small_scene, tmp_path / "again", leaf_cache, budget=budget, compute=counting)
    kept = {trial.name for trial in (study_folder / "trials").glob("*.npz")}
    assert not kept & {Path(request.result).name for request in counting.requests}
    assert is_finished or counting.requests == []
    assert result["budget_seconds"] == budget
    assert json.loads(json.dumps(result["reference"])) == before["reference"]
    measured = {row["varied"] for row in before["settings"] if row["seconds"] is not None}
    assert measured <= {row["varied"] for row in result["settings"] if row["seconds"] is not None}


def test_what_a_finished_study_found_stays_until_one_with_more_time_is_done(
    small_scene: Path, study_folder: Path, leaf_cache: Path, quick_study, tmp_path: Path
) -> None:
    again = tmp_path / "again"
    shutil.copytree(study_folder, again)
    results = ("tradeoff.csv", "tradeoff.json", "tradeoff.txt")
    before = [(again / name).read_bytes() for name in results]
    with pytest.raises(KeyboardInterrupt):
        run(small_scene, again, leaf_cache, budget=2.0 * PLENTY, compute=Counting(interrupted_after=0))
    assert [(again / name).read_bytes() for name in results] == before


@pytest.mark.parametrize("damaged", ["{", "[]", '{"budget_seconds": null, "frames": -4}', '{"budget_seconds": 1e999}'])
def test_a_damaged_result_is_made_again_from_what_is_kept(
    damaged: str, small_scene: Path, study_folder: Path, leaf_cache: Path, quick_study, tmp_path: Path
) -> None:
    shutil.copytree(study_folder, tmp_path / "again")
    before = json.loads((study_folder / "tradeoff.json").read_text())
    for name in ("tradeoff.json", "trials/film.json"):
        (tmp_path / "again" / name).write_text(damaged)
    result = run(small_scene, tmp_path / "again", leaf_cache, budget=1e-3, compute=Counting(interrupted_after=0))
    assert json.loads(json.dumps(result["reference"])) == before["reference"]


def test_a_setting_that_fails_stays_in_the_table(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch
) -> None:
    monkeypatch.setattr(study, "single_changes", fewer_singles)

    def fails(scene: dict) -> str | None:
        return "frame 2: motion: too hard" if scene["motion"].get("method") == "quasistatic" else None

    result = run(small_scene, tmp_path, leaf_cache, SMALLER, compute=Counting(fails))
    row = row_of(result, "motion.method = quasistatic")
    assert row["status"] == "failed: frame 2: motion: too hard" and row["seconds"] is None
    assert row_of(result, "as written")["status"] == "done"


def test_progress_is_a_bar_on_a_terminal(
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch, capsys
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
    small_scene: Path, tmp_path: Path, leaf_cache: Path, quick_study, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(study, "find_spec", lambda name: None)
    run(small_scene, tmp_path, leaf_cache, SMALLER, budget=1e-3)
    assert "leafwarp[plot]" in capsys.readouterr().err
    assert (tmp_path / "tradeoff.json").exists() and not (tmp_path / "tradeoff.png").exists()
