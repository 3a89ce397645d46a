"""The verification cases, each once, and ``python -m leafwarp verify``."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
import os
from pathlib import Path

import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError, SimulationError
from leafwarp.study.verify import cases, table
from leafwarp.study.verify.case import Case, Check, at_most, near, near_share
from leafwarp.study.verify.elastica import elastica, greenhill_number

KEYS = {"case", "quantity", "expected", "got", "error", "tolerance", "pass"}
ELASTICA = Path(
    os.environ.get("LEAFWARP_REFERENCE", Path(__file__).parents[2] / "shared" / "reference")
) / "elastica_master.csv"  # fmt: skip


@pytest.mark.parametrize("case", cases.CASES, ids=lambda case: case.name)
def test_case(case: Case, device: str) -> None:
    result = table.Result(case, tuple(case.run(device)), 0.0)
    assert result.passed, "\n" + table.as_text([result])


def test_every_case_has_a_name_of_its_own_and_a_function() -> None:
    assert len({case.name for case in cases.CASES}) == len(cases.CASES)
    for case in cases.CASES:
        assert callable(case.function)
        assert case.summary.endswith(".")


@pytest.mark.skipif(not ELASTICA.is_file(), reason="the table of the elastica is not beside the repository")
def test_the_elastica_is_that_of_the_table() -> None:
    with ELASTICA.open() as file:
        rows = [row for row in csv.DictReader(file) if 0.1 <= float(row["Gamma"]) <= 250.0]
    assert len(rows) > 20
    for row in rows[::5]:
        beam = elastica(weight=float(row["Gamma"]))
        assert beam.drop[-1] == pytest.approx(float(row["H_over_L"]), abs=1e-6)
        assert beam.reach[-1] == pytest.approx(float(row["W_over_L"]), abs=1e-6)
        assert math.degrees(beam.slope[-1]) == pytest.approx(float(row["tip_deg"]), abs=1e-4)


def test_the_elastica_has_the_known_ends() -> None:
    # Small loads: w L^4 / 8 EI and P L^3 / 3 EI; P L^2 / EI = 4: Bisshopp and Drucker (1945).
    assert elastica(weight=1e-3).drop[-1] == pytest.approx(1e-3 / 8.0, rel=1e-6)
    assert elastica(end_load=1e-3).drop[-1] == pytest.approx(1e-3 / 3.0, rel=1e-6)
    assert elastica(end_load=4.0).drop[-1] == pytest.approx(0.66996, abs=1e-5)
    assert elastica(end_load=4.0).reach[-1] == pytest.approx(1.0 - 0.32894, abs=1e-5)
    assert greenhill_number() == pytest.approx(7.83735, abs=1e-5)


def test_checks_pass_within_their_tolerance_and_never_without_a_number() -> None:
    assert near("x", 2.0, 2.1, 0.11).passed and not near("x", 2.0, 2.1, 0.09).passed
    assert near_share("x", -2.0, -2.1, 0.051).passed and not near_share("x", -2.0, -2.1, 0.049).passed
    assert at_most("x", 1.0, 0.5).passed and at_most("x", 1.0, 1.0).passed and not at_most("x", 1.0, 1.001).passed
    for check in (near("x", 0.0, math.nan, 1.0), near_share("x", 1.0, math.nan, 1.0), at_most("x", 1.0, math.nan)):
        assert not check.passed
    assert not table.Result(cases.CASES[0], (), 0.0).passed


def good(device: str) -> list[Check]:
    return [near("a good one", 1.0, 1.0, 0.1), near_share("a share", 2.0, 2.02, 0.05)]


def bad(device: str) -> list[Check]:
    return [near("a good one", 1.0, 1.0, 0.1), near("a bad one", 1.0, 2.0, 0.1)]


def refused(device: str) -> list[Check]:
    raise SimulationError(3, "motion", "it tore")


@pytest.fixture
def drawn_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three cases of this file instead of the real ones."""
    made = tuple(Case(f.__name__, f"What {f.__name__} compares.", f"lines:{f.__name__}") for f in (good, bad, refused))
    monkeypatch.setattr(cases, "CASES", made)
    from leafwarp.study.verify import lines

    for function in (good, bad, refused):
        monkeypatch.setattr(lines, function.__name__, function, raising=False)


def test_json_is_a_list_of_checks_and_the_exit_code_says_whether_all_pass(drawn_cases: None, capsys) -> None:
    assert main(["verify", "good", "--json"]) == 0
    captured = capsys.readouterr()
    checks = json.loads(captured.out)["cases"]
    assert [check["quantity"] for check in checks] == ["a good one", "a share"]
    assert all(set(check) == KEYS and check["pass"] is True and check["case"] == "good" for check in checks)
    assert checks[1]["error"] == pytest.approx(0.01) and checks[1]["tolerance"] == 0.05
    assert captured.err.startswith("case 1/1 100% ")
    assert main(["verify", "--json", "--quiet"]) == 1
    captured = capsys.readouterr()
    checks = json.loads(captured.out)["cases"]
    assert [check["pass"] for check in checks] == [True, True, True, False, False]
    # What could not be computed says why, and has no number.
    assert checks[-1]["quantity"] == "not computed: frame 3: motion: it tore" and checks[-1]["got"] is None
    assert captured.err == ""


def test_the_table_has_a_row_a_check_and_says_what_failed(drawn_cases: None, capsys) -> None:
    assert main(["verify", "-q"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["case", "quantity", "expected", "got", "error", "tolerance", "pass"]
    assert lines[2].split() == ["good", "a", "good", "one", "1", "1", "0", "0.1", "yes"]
    assert lines[3].split() == ["a", "share", "2", "2.02", "1", "%", "5", "%", "yes"]
    assert lines[5].split()[-1] == "NO"
    assert "bad failed: What bad compares." in lines
    assert lines[-1].startswith("3 of 5 checks of 3 cases passed in ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["verify", "nonsense"], "verify nonsense: no such case; accepted: line_solve, "),
        (["verify", "momentum", "--device", "abacus"], "--device abacus: no such device"),
    ],
)
def test_bad_calls_are_one_line_each(arguments: list[str], message: str, capsys) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert message in captured.err


def test_plots_without_matplotlib_name_the_extra_before_anything_runs(
    drawn_cases: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, package=None: None)
    from leafwarp.study.verify import verification

    monkeypatch.setattr(verification, "find_spec", lambda name: None)
    assert main(["verify", "--plot", str(tmp_path / "plots")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "pip install 'leafwarp[plot]'" in error
    assert not (tmp_path / "plots").exists()


def test_a_folder_that_cannot_be_written_is_refused_before_anything_runs(
    drawn_cases: None, tmp_path: Path, capsys
) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "file").write_text("")
    assert main(["verify", "--plot", str(tmp_path / "file" / "plots")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_cases_keep_their_order_whatever_is_asked() -> None:
    names = [case.name for case in cases.CASES]
    picked = cases.cases_named([names[3], names[1]])
    assert [case.name for case in picked] == [names[1], names[3]]
    assert cases.cases_named(()) == cases.CASES
    with pytest.raises(InputError, match="no such case"):
        cases.cases_named(["", names[0]])


def test_plots_are_drawn_for_the_cases_that_ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    pytest.importorskip("matplotlib")
    from leafwarp.study.verify import beams, plots

    # The sheets themselves take seconds; the picture does not care where the drops come from.
    monkeypatch.setattr(beams, "droop", lambda kind, cells, device: {w: beams.expected_droop(w) for w in beams.WEIGHTS})
    plots.write_plots([*plots.PLOTS, "momentum"], device, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.png" for name in plots.PLOTS}
    assert set(plots.PLOTS) <= {case.name for case in cases.CASES}
    (tmp_path / "kohlrabi_drying.png").unlink()
    plots.write_plots(["momentum"], device, tmp_path)
    assert not (tmp_path / "kohlrabi_drying.png").exists()
