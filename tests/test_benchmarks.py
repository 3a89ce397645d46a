"""The quick form of every benchmark: the tables that it prints, and what they can be held to without timing."""

from __future__ import annotations

import argparse
import itertools
import re
import signal
from pathlib import Path

import numpy as np
import pytest

import benchmarks.results as results
from benchmarks import tolerance
from benchmarks.__main__ import ALL, BENCHMARKS, main
from benchmarks.fluid import CONTENDERS, OURS, STREAM
from benchmarks.timing import Timing, exponent, round_robin


def tables(text: str) -> list[list[dict[str, str]]]:
    """The tables of a Markdown text: rows by the names of the columns."""
    found: list[list[dict[str, str]]] = []
    head: list[str] | None = None
    for line in text.splitlines():
        if not line.startswith("|"):
            head = None
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if head is None:
            head = cells
            found.append([])
        elif not set(line) <= set("|-:"):
            found[-1].append(dict(zip(head, cells, strict=True)))
    return found


@pytest.fixture(autouse=True)
def leaves_of_the_session(scene_leaf, monkeypatch: pytest.MonkeyPatch) -> None:
    """Benchmarks that ask for the same leaf share it."""
    for module in BENCHMARKS.values():
        if hasattr(module, "prepare_scene_leaf"):
            monkeypatch.setattr(module, "prepare_scene_leaf", lambda scene, cache: scene_leaf(scene))


def quick(name: str, capsys: pytest.CaptureFixture) -> list[list[dict[str, str]]]:
    assert main([name, "--quick"]) == 0
    text = capsys.readouterr().out
    assert f"Command: `python -m benchmarks {name} --quick`. Machine: " in text
    return tables(text)


def number(cell: str) -> float:
    """The median in a cell."""
    return float(cell.split(" ")[0])


def test_fluid(capsys: pytest.CaptureFixture) -> None:
    (rows,) = quick("fluid", capsys)
    by_name = {row["step"]: row for row in rows}
    installed = {contender.name for contender in CONTENDERS if contender.module is None}
    assert installed | {STREAM} <= set(by_name)
    assert by_name[OURS]["of leafwarp's"] == "1 (1-1)" and by_name[STREAM]["of the copy's"] == "1 (1-1)"
    for name in installed:
        assert number(by_name[name]["ms"]) > 0.0
        # Textbook eliminations round worse than ours, unsplit steps are compared with one another.
        assert float(by_name[name]["largest difference"]) < 1e-4, name
    assert float(by_name[OURS]["largest difference"]) < 1e-6


def test_unsplit(capsys: pytest.CaptureFixture) -> None:
    rows, (film,) = quick("unsplit", capsys)
    assert [(row["scene"], row["source"]) for row in rows] == [
        ("`bramble.toml`", "open"), ("`bramble.toml`", "cut"), ("`cut.toml`", "open"), ("`cut.toml`", "cut"),
    ]  # fmt: skip
    for row in rows:
        assert number(row["split step [ms]"]) > 0.0 and float(row["iterations a step"]) < 20.0
        # Both are accurate to 1e-5 of the contents.
        assert float(row["relative difference of the two"]) < 1e-5
    assert film["scene"] == "`cut.toml`" and film["steps"] == "255"
    assert float(film["of split"]) == pytest.approx(
        float(film["conjugate gradients [s]"]) / float(film["split [s]"]), rel=0.02
    )


def test_structure(capsys: pytest.CaptureFixture) -> None:
    (rows,) = quick("structure", capsys)
    assert len(rows) == 5 and rows[0]["of leafwarp's"] == "1 (1-1)"
    assert all(number(row["ms"]) > 0.0 for row in rows)


def test_scaling(capsys: pytest.CaptureFixture) -> None:
    fluid, structure, leaves = quick("scaling", capsys)
    assert [int(row["map"]) for row in fluid] == [32, 64, 128]
    cells = [int(row["leaf cells"]) for row in fluid]
    assert np.all(np.diff(cells) > 0) and np.all(np.diff([float(row["arrays [MB]"]) for row in fluid]) > 0)
    springs = [int(row["springs"]) for row in structure]
    # A large mesh has three edges and three hinges a vertex.
    assert np.all(np.diff(springs) > 0) and all(
        4.0 < count / int(row["vertices"]) < 6.0 for count, row in zip(springs, structure, strict=True)
    )
    assert [int(row["leaves"]) for row in leaves] == [1, 2, 4]
    for row in leaves:
        # 60 fluid steps and all substeps make most of a frame; medians of different rounds make up the rest.
        parts = 60 * number(row["fluid step [ms]"]) + int(row["substeps"]) * number(row["substep [ms]"])
        assert 0.0 < parts < 3.0 * number(row["frame [ms]"])
        assert float(row["frame, a leaf [ms]"]) == pytest.approx(
            number(row["frame [ms]"]) / int(row["leaves"]), rel=0.01
        )
    assert np.all(np.diff([float(row["arrays [MB]"]) for row in leaves]) > 0)


def test_memory(capsys: pytest.CaptureFixture) -> None:
    ((row,),) = quick("memory", capsys)
    arrays = float(row["arrays [MB]"])
    assert 0.0 < arrays < float(row["peak, leaf prepared before [MB]"])


@pytest.mark.slow
def test_tolerance(capsys: pytest.CaptureFixture) -> None:
    ((row,),) = quick("tolerance", capsys)
    assert row["scene"] == "0" and int(row["level"]) >= 0
    estimate, truth = (float(row[name].rstrip("%")) for name in ("its own estimate", "true error"))
    assert 0.0 < truth < 20.0
    assert float(row["estimate / truth"]) == pytest.approx(estimate / truth, rel=0.05)
    assert int(row["films"]) == 1 and float(row["of the truth itself"].rstrip("%")) > 0.0


def test_tolerance_counts_what_is_kept_and_keeps_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """One within it, one only if the truth is exact, one not; then a signal."""
    measured = [(0.01, 0.007, 0.002), (0.01, 0.009, 0.002), (0.01, 0.031, 0.002)]
    films = iter(tolerance.Measured(asked, 2, 1, 0.01, error, own) for asked, error, own in measured)

    def measure(*_) -> tolerance.Measured:
        film = next(films, None)
        if film is None:
            signal.raise_signal(signal.SIGTERM)
        return film

    for name in ("draw_photo", "draw_scene"):
        monkeypatch.setattr(tolerance, name, lambda *_: None)
    monkeypatch.setattr(tolerance, "measure", measure)
    body = tolerance.make_body(argparse.Namespace(quick=False, cases=10, tolerance=None, seed=1))
    assert "within the tolerance in 2 of 3 scenes, in 1 also where" in body
    assert "within a factor of 3 of the truth in 2 (median ratio 1.11)" in body
    assert "Interrupted after 3 of 10 scenes." in body
    assert [line.split(" | ")[0] for line in body.splitlines()[-3:]] == ["| 0", "| 1", "| 2"]


@pytest.mark.slow
def test_startup(capsys: pytest.CaptureFixture) -> None:
    (rows,) = quick("startup", capsys)
    runs = [row for row in rows if "run" in row["command"]]
    assert [row["command"].rsplit(", ")[-1] for row in runs] == ["cold", "warm"]
    assert all(0.0 < number(row["to the first frame [s]"]) <= number(row["to the end [s]"]) for row in runs)
    assert any("--help" in row["command"] for row in rows)


def test_table2_is_what_no_name_means(capsys: pytest.CaptureFixture) -> None:
    assert main(["--quick"]) == 0
    text = capsys.readouterr().out
    assert "Command: `python -m benchmarks --quick`. Machine: " in text
    (rows,) = tables(text)
    assert [(row["map"], row["paper"]) for row in rows] == [("128 x 128", "11")]


def test_every_benchmark_is_listed(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as done:
        main(["--help"])
    assert done.value.code == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines() if re.match("    [a-z]", line)]
    assert listed == [*BENCHMARKS, "all"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["fluids"], "invalid choice: 'fluids'"), (["--device", "moon:0"], "--device moon:0: no such device")],
)
def test_what_is_not_there_is_refused(arguments: list[str], told: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as refused:
        main(arguments)
    assert refused.value.code == 2
    assert told in capsys.readouterr().err


def test_all_keeps_each_under_its_own_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    kept = {}
    monkeypatch.setattr("benchmarks.__main__.write_section", lambda title, body: kept.update({title: body}))
    for name in ALL:
        monkeypatch.setattr(BENCHMARKS[name], "make_body", lambda options, own=name: f"{own} {options.quick}")
    assert main(["all", "--quick", "--write"]) == 0
    assert list(kept) == [BENCHMARKS[name].TITLE for name in ALL]
    for name, body in zip(ALL, kept.values(), strict=True):
        assert body.startswith(f"{name} True\n") and f"`python -m benchmarks {name} --quick --write`" in body


def test_an_interpreters_path_is_not_kept(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(BENCHMARKS["peers"], "make_body", lambda options: str(options.blender))
    assert main(["peers", "--blender", "/opt/bpy/python"]) == 0
    assert "Command: `python -m benchmarks peers --blender PYTHON`. " in capsys.readouterr().out
    assert main(["peers", "--blender=/opt//bpy/python"]) == 0
    assert "Command: `python -m benchmarks peers --blender=PYTHON`. " in capsys.readouterr().out


def test_results_are_kept_in_their_section(tmp_path: Path) -> None:
    path = tmp_path / "RESULTS.md"
    for title, body in (("One", "first"), ("Two", "second"), ("One", "third")):
        results.write_section(title, body, path)
    assert path.read_text() == f"{results.HEAD}\n## One\n\nthird\n\n## Two\n\nsecond\n"


def test_contenders_take_turns() -> None:
    order: list[str] = []
    timings = round_robin({name: (lambda n=name: order.append(n)) for name in "abc"}, rounds=3, least_lap=0.0)
    assert order[:6] == list("aabbcc")  # once to warm up, once to see how long it takes
    assert order[6:] == list("aabbccbbccaaccaabb")  # untimed, timed
    assert {len(timing.values) for timing in timings.values()} == {3}


def test_work_done_at_once_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count()
    monkeypatch.setattr("benchmarks.timing.time.perf_counter", lambda: next(clock))  # a second from look to look
    timings = round_robin({"four": lambda: 4, "one": lambda: None}, rounds=2, least_lap=1.0)
    assert timings["four"].values == (250.0, 250.0) and timings["one"].values == (1000.0, 1000.0)


def test_ratios_are_taken_round_by_round() -> None:
    ours, theirs = Timing((1.0, 2.0, 4.0)), Timing((3.0, 6.0, 12.0))
    assert theirs.over(ours).values == (3.0, 3.0, 3.0)


def test_an_exponent_is_that_of_a_power_law() -> None:
    sizes = [10.0, 100.0, 1000.0]
    assert exponent(sizes, [3.0 * size**1.5 for size in sizes]) == pytest.approx(1.5)
