"""``python -m leafwarp stability``: the sweeps' own references, how points are judged, and what is written."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
import time
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError, SimulationError
from leafwarp.study.stability import plot, study
from leafwarp.study.stability.envelope import Span, envelopes_of
from leafwarp.study.stability.point import BROKEN, INACCURATE, OUTCOMES, REFUSED, STABLE, Finding, Sweep, Trial, judge
from leafwarp.study.stability.reference import solve_exchange, step_of_diffusion
from leafwarp.study.stability.sweeps import SWEEPS, sweeps_named
from leafwarp.study.stability.table import as_csv, as_data, as_text

SWEEP = Sweep("sweep", "number", "Something.", "something else", "water:sinks")


def trial(compute, value: float = 1.0, method: str = "split") -> Trial:
    return Trial(method, "float32", value, 0.01, compute)


def failing(error: Exception):
    def compute():
        raise error

    return compute


@pytest.mark.parametrize(
    ("compute", "outcome", "message"),
    [
        (lambda: Finding(0.01), STABLE, ""),
        (lambda: Finding(0.011), INACCURATE, ""),
        (lambda: Finding(math.inf, (), "nothing to compare with"), INACCURATE, "nothing to compare with"),
        (lambda: Finding(0.0, ("it leaks", "it burns")), BROKEN, "it leaks; it burns"),
        (lambda: Finding(math.nan), BROKEN, "the error is not a number"),
        (failing(SimulationError(3, "motion", "too\nfast")), REFUSED, "frame 3: motion: too fast"),
        (failing(InputError("no such thing")), REFUSED, "no such thing"),
        (failing(ZeroDivisionError("division by zero")), BROKEN, "ZeroDivisionError: division by zero"),
    ],
)
def test_a_point_ends_as_one_of_four(compute, outcome: str, message: str) -> None:
    point = judge(SWEEP, trial(compute))
    assert (point.outcome, point.message) == (outcome, message)
    assert (point.error is None) == (outcome == REFUSED or "Zero" in message)


def test_an_envelope_has_a_span_for_neighbours_of_one_outcome() -> None:
    errors = {1.0: 0.0, 10.0: 0.005, 100.0: 1.0, 1e3: None, 1e4: 0.001}
    points = [
        judge(SWEEP, trial(failing(InputError("no")) if error is None else lambda e=error: Finding(e), value))
        for value, error in errors.items()
    ]
    other = judge(SWEEP, trial(lambda: Finding(0.5), method="unsplit"))
    first, second = envelopes_of([*points, other])
    assert first.spans == (
        Span(STABLE, 1.0, 10.0),
        Span(INACCURATE, 100.0, 100.0),
        Span(REFUSED, 1e3, 1e3),
        Span(STABLE, 1e4, 1e4),
    )
    assert first.worst == 0.005 and second.worst is None
    text = as_text([*points, other])
    assert "stable 1 to 10, inaccurate 100, refused 1000, stable 10000" in text
    assert text.endswith("6 points in 0 s: 3 stable, 2 inaccurate, 1 refused, 0 broken")


def test_the_tables_hold_every_point_and_no_infinity() -> None:
    points = [judge(SWEEP, trial(lambda e=error: Finding(e))) for error in (0.0, math.inf)]
    rows = list(csv.DictReader(as_csv(points).splitlines()))
    assert [row["error"] for row in rows] == ["0.0", ""] and [row["outcome"] for row in rows] == [STABLE, INACCURATE]
    data = json.loads(json.dumps(as_data(points, "cpu"), allow_nan=False))
    assert data["counts"] == dict(zip(OUTCOMES, (1, 1, 0, 0), strict=True))
    assert data["envelopes"][0]["spans"][1]["outcome"] == INACCURATE


def exact_solution(exchange: np.ndarray, excess: np.ndarray, right: np.ndarray) -> list[float]:
    """Gauss's elimination in rational numbers."""
    count = len(right)
    flow = [[Fraction(value) for value in row] for row in exchange.tolist()]
    rows = [
        [(Fraction(excess[i]) + sum(flow[i]) if i == j else -flow[i][j]) for j in range(count)] + [Fraction(right[i])]
        for i in range(count)
    ]
    for k in range(count):
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(count):
            if i != k and rows[i][k]:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [float(row[-1]) for row in rows]


@pytest.mark.parametrize("decades", [(-12.0, 12.0), (0.0, 30.0)])
def test_the_reference_is_that_of_rational_numbers(decades: tuple[float, float]) -> None:
    rng = np.random.default_rng(0)
    exchange = np.triu(10.0 ** rng.uniform(*decades, (9, 9)) * (rng.random((9, 9)) < 0.5), 1)
    exchange += exchange.T
    excess, right = np.where(rng.random(9) < 0.5, 0.0, 10.0 ** rng.uniform(-6, 6, 9)) + 1.0, rng.random(9)
    expected = exact_solution(exchange, excess, right)
    assert solve_exchange(exchange, excess, right) == pytest.approx(expected, rel=1e-14, abs=0.0)


def test_the_reference_step_splits_rows_from_columns() -> None:
    mask = np.array([[True, True], [True, False]])
    faces = np.array([[2.0, 0.0], [0.0, 0.0]]), np.array([[3.0, 0.0], [0.0, 0.0]])
    water = np.array([[1.0, 0.0], [0.0, 0.0]])
    both = np.linalg.solve([[6.0, -2.0, -3.0], [-2.0, 3.0, 0.0], [-3.0, 0.0, 4.0]], [1.0, 0.0, 0.0])
    assert step_of_diffusion(faces, mask, water, split=False)[mask] == pytest.approx(both, rel=1e-14)
    # Of two cells that exchange beta, (1 + beta) / (1 + 2 beta) stays and the rest goes over.
    split = [0.6 * 4 / 7, 0.4, 0.6 * 3 / 7]
    assert step_of_diffusion(faces, mask, water, split=True)[mask] == pytest.approx(split, rel=1e-14)


def test_every_sweep_is_described_and_rises() -> None:
    assert len({sweep.name for sweep in SWEEPS}) == len(SWEEPS)
    for sweep in SWEEPS:
        assert sweep.summary.endswith(".") and sweep.axis and sweep.against
        bands: dict[tuple[str, str], list[float]] = {}
        for each in sweep.trials("cpu"):
            bands.setdefault((each.method, each.precision), []).append(each.value)
        for values in bands.values():
            assert len(values) > 1 and values[0] > 0.0 and (np.diff(values) > 0.0).all(), sweep.name


def test_the_command_writes_a_table_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = tmp_path / "new" / "out"
    call = ["stability", "sinks", "conductance", "-o", str(folder)]
    assert main(call) == 0
    out, err = capsys.readouterr()
    assert out.strip() == str(folder / "stability.csv")
    assert "sweep 2/2" in err
    rows = list(csv.DictReader((folder / "stability.csv").read_text().splitlines()))
    assert {row["sweep"] for row in rows} == {"sinks", "conductance"}
    for row in rows:
        assert row["outcome"] in (STABLE, REFUSED) and float(row["seconds"]) >= 0.0
        if row["outcome"] == STABLE:
            assert 0.0 <= float(row["error"]) <= float(row["tolerance"])
        else:
            assert row["message"].startswith("frame 2: unsplit_diffusion: ") and row["error"] == ""
    names = sorted(path.name for path in folder.iterdir())
    can_plot = importlib.util.find_spec("matplotlib") is not None
    assert names == ["stability.csv", *(["stability.png"] if can_plot else [])]
    assert main(call) == 2
    assert "exists already; --overwrite replaces it" in capsys.readouterr().err


def test_without_a_folder_the_table_is_printed(capsys: pytest.CaptureFixture) -> None:
    assert main(["stability", "sinks", "-q"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("sweep ") and "closing stomata" in out
    assert main(["stability", "sinks", "-q", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["counts"][STABLE] == len(data["points"]) == 64


def test_without_matplotlib_there_is_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "find_spec", lambda name: None)
    assert main(["stability", "sinks", "-q", "-o", str(tmp_path)]) == 0
    assert capsys.readouterr().err.startswith("leafwarp: matplotlib is not installed: ")
    assert [path.name for path in tmp_path.iterdir()] == ["stability.csv"]


def test_what_is_broken_fails_the_command(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    trials = [trial(lambda: Finding(0.0)), trial(lambda: Finding(0.0, ("it leaks",)), value=2.0)]
    monkeypatch.setattr(Sweep, "trials", lambda self, device: trials)
    assert main(["stability", "sinks", "-q"]) == 1
    out, err = capsys.readouterr()
    assert err == "leafwarp: stability: sinks = 2, split, float32: it leaks\n"
    assert "BROKEN: sinks = 2, split, float32: it leaks" in out


def test_what_does_not_end_is_ended(capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    codes = []
    monkeypatch.setattr(study, "LONGEST", 0.02)
    monkeypatch.setattr(study.os, "_exit", codes.append)
    monkeypatch.setattr(study.faulthandler, "dump_traceback", lambda: None)

    def compute() -> Finding:
        until = time.monotonic() + 10.0
        while not codes and time.monotonic() < until:
            time.sleep(0.005)
        return Finding(0.0)

    monkeypatch.setattr(Sweep, "trials", lambda self, device: [trial(compute)])
    study.run_stability(["sinks"], quiet=True)
    assert codes == [1]
    assert "sinks = 1, split, float32: has not ended within 0.02 s" in capfd.readouterr().err


def test_other_names_and_places_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert sweeps_named([]) == SWEEPS
    assert main(["stability", "everything"]) == 2
    assert "no such sweep; accepted: fluid_step, fed_step," in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["stability", "sinks", "-o", str(tmp_path / "file" / "out")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_bars_meet_half_way_on_the_logarithmic_axis() -> None:
    assert plot._edges(np.array([1.0, 100.0])) == pytest.approx([0.1, 10.0, 1000.0])
    assert plot._edges(np.array([10.0])) == pytest.approx([10.0**0.5, 10.0**1.5])


@pytest.mark.slow
def test_no_point_of_any_sweep_is_broken(device: str) -> None:
    points = study.run_stability(device=device, quiet=True)
    assert not [point for point in points if point.outcome == BROKEN], as_text(points)
    for envelope in envelopes_of(points):
        # Explicit motion follows no abrupt curve.
        abrupt = envelope.sweep == "curve_width" and envelope.method == "explicit"
        assert envelope.worst is not None or abrupt, envelope
