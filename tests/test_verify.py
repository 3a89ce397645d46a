"""The verification cases, each once, and ``python -m leafwarp verify``."""

from __future__ import annotations

import importlib.util
import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError, LeafwarpError, SimulationError
from leafwarp.study.verify import beams, cases, sheets, table
from leafwarp.study.verify.case import Case, Check, at_most, near, near_share
from leafwarp.study.verify.elastica import elastica, greenhill_number
from leafwarp.study.verify.layers import timoshenko_curvature
from leafwarp.study.verify.plate import Plate, plate_drops, rolled_plate

KEYS = {"case", "quantity", "expected", "got", "error", "tolerance", "pass"}


@pytest.mark.long
@pytest.mark.parametrize("case", cases.CASES, ids=lambda case: case.name)
def test_case(case: Case, device: str) -> None:
    result = table.Result(case, tuple(case.run(device)), 0.0)
    assert result.passed, "\n" + table.as_text([result])
    # What a case computes with is of no concern to JSON.
    for row in json.loads(json.dumps(table.as_data([result]), allow_nan=False)):
        assert set(row) == KEYS and isinstance(row["pass"], bool)
    # Rows known to fail are few, and only of cases that say so.
    assert len(result.explained) <= {"own_weight": 10, "mesh_independence": 1}.get(case.name, 0)


def test_every_case_has_a_name_of_its_own_and_a_function() -> None:
    assert len({case.name for case in cases.CASES}) == len(cases.CASES)
    for case in cases.CASES:
        assert callable(case.function)
        assert case.summary.endswith(".")


def shot_elastica(weight: float) -> tuple[float, float, float]:
    """Drop, reach and slope of the end of a beam under its own weight, integrated from there until its root is level.

    ``theta'' = -weight sigma cos(theta)`` along the distance sigma from the end; the end's angle to the vertical is
    sought, as its logarithm: under a large weight it is tiny.
    """
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    def root(logarithm: float) -> np.ndarray:
        def slopes(s: float, y: np.ndarray) -> list[float]:
            return [y[1], weight * s * np.sin(y[0]), np.sin(y[0]), np.cos(y[0])]

        start = [np.exp(logarithm), 0.0, 0.0, 0.0]
        return solve_ivp(slopes, (0.0, 1.0), start, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]

    end = brentq(lambda logarithm: root(logarithm)[0] - np.pi / 2, -40.0, np.log(np.pi / 2), xtol=1e-14)
    _, _, reach, drop = root(end)
    return drop, reach, np.pi / 2 - np.exp(end)


@pytest.mark.parametrize("weight", [0.1, 0.5, 2.0, 10.0, 30.0, 80.0, 200.0])
def test_the_elastica_is_that_of_a_shot_from_its_end(weight: float) -> None:
    beam = elastica(weight=weight)
    found = beam.drop[-1], beam.reach[-1], beam.slope[-1]
    assert found == pytest.approx(shot_elastica(weight), abs=1e-7)


def test_the_elastica_has_the_known_ends() -> None:
    # Small loads: w L^4 / 8 EI and P L^3 / 3 EI; P L^2 / EI = 4: Bisshopp and Drucker (1945).
    assert elastica(weight=1e-3).drop[-1] == pytest.approx(1e-3 / 8.0, rel=1e-6)
    assert elastica(end_load=1e-3).drop[-1] == pytest.approx(1e-3 / 3.0, rel=1e-6)
    assert elastica(end_load=4.0).drop[-1] == pytest.approx(0.66996, abs=1e-5)
    assert elastica(end_load=4.0).reach[-1] == pytest.approx(1.0 - 0.32894, abs=1e-5)
    assert greenhill_number() == pytest.approx(7.83735, abs=1e-5)


def test_an_elastica_that_is_not_found_is_an_error_for_people(monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.integrate

    failed = SimpleNamespace(success=False, message="no luck")
    monkeypatch.setattr(scipy.integrate, "solve_bvp", lambda *arguments, **options: failed)
    with pytest.raises(LeafwarpError, match=r"weight number 0\.123 and end load 0 was not found: no luck"):
        elastica(weight=0.123)


def layered_curvature(mismatch: float, thickness: float, m: float, n: float) -> float:
    """Curvature of two layers whose fibres, a thousand each, bear neither a force nor a moment together."""
    border = m / (1.0 + m)
    share = (np.arange(1000) + 0.5) / 1000
    height = thickness * np.concatenate([border * share, border + (1.0 - border) * share])
    area = np.repeat([border, 1.0 - border], 1000) / 1000
    modulus, shrunk = np.repeat([n, 1.0], 1000) * area, np.repeat([mismatch, 0.0], 1000)
    # The strains a + b z - shrunk of least energy.
    root = np.sqrt(modulus)
    terms = np.column_stack((root, root * height))
    return abs(np.linalg.lstsq(terms, root * shrunk, rcond=None)[0][1])


@pytest.mark.parametrize(("m", "n"), [(1.0, 1.0), (0.5, 3.0), (4.0, 0.1)])
def test_timoshenkos_curvature_is_that_of_fibres_in_balance(m: float, n: float) -> None:
    expected = layered_curvature(1e-3, 2e-4, m, n)
    assert timoshenko_curvature(1e-3, 2e-4, m, n) == pytest.approx(expected, rel=1e-5)


def test_two_equal_layers_bend_to_one_and_a_half_times_the_mismatch_over_the_thickness() -> None:
    assert timoshenko_curvature(1e-3, 2e-4, 1.0, 1.0) == pytest.approx(1.5 * 1e-3 / 2e-4, rel=1e-12)


@pytest.mark.parametrize(
    ("width", "slenderness", "share"),
    [(0.02, 70.0, 8.0 / 9.0), (0.5, 4000.0, 1.0)],
    ids=["a narrow strip curves crosswise", "a leaf-thin plate cannot"],
)
def test_the_plate_droops_like_the_elastica_of_its_limits(width: float, slenderness: float, share: float) -> None:
    for weight, drop in plate_drops(width, slenderness, (2.0, 10.0)).items():
        # A strip's clamped end is stiffer over about its width, and a plate's margins are softer.
        assert drop == pytest.approx(elastica(weight=weight / share).drop[-1], rel=0.01)


def test_the_plate_half_as_wide_as_long_has_the_bending_stiffness_of_the_cantilevers() -> None:
    weight = 1e-3
    share = weight / 8.0 / plate_drops(0.5, 70.0, (weight,))[weight]
    assert 8.0 / 9.0 < share < 1.0 and share == pytest.approx(beams.SHARE, abs=0.005)


def test_the_plate_needs_no_more_polynomials() -> None:
    drops = []
    for along, across in ((12, 4), (16, 6), (20, 8)):
        plate = Plate(0.5, 70.0, along, across)
        plate.bend(0.5)
        y = np.linspace(-0.25, 0.25, 21)
        drops.append(-plate.points(np.ones_like(y), y)[:, 2].mean())
    assert abs(drops[1] - drops[2]) < 5e-4 * drops[2] and abs(drops[1] - drops[2]) < abs(drops[0] - drops[2])


def test_a_narrow_strip_of_two_layers_has_their_curvature() -> None:
    plate = rolled_plate(0.05, 70.0, 0.1)
    s = np.linspace(0.4, 0.8, 21)
    x, _, z = plate.points(s, 0.0 * s).T
    slope = np.arctan2(np.gradient(z, s), np.gradient(x, s))[1:-1]
    assert np.polyfit(s[1:-1], slope, 1)[0] == pytest.approx(0.1, rel=2e-3)


def test_a_plate_that_finds_no_rest_says_so() -> None:
    with pytest.raises(LeafwarpError, match="the plate found no rest: its last step turned it by "):
        Plate(0.5, 70.0, 6, 3).bend(1e9)


@pytest.mark.parametrize("kind", sheets.KINDS)
def test_sheets_are_made_of_triangles_that_are_equilateral_on_the_average(kind: sheets.Kind) -> None:
    sheet = sheets.clamped_sheet(kind, 0.1, 0.05, 20)
    corner = sheet.mesh.positions[sheet.mesh.triangles]
    whole = (corner[:, :, 0].min(axis=1) > 0.01) & (np.abs(corner[:, :, 1]).max(axis=1) < 0.4 * sheet.width)
    sides = corner[whole][:, [1, 2, 0]] - corner[whole]
    spread = np.einsum("tsi,tsj->ij", sides, sides)
    assert spread[0, 0] == pytest.approx(spread[1, 1], rel=1e-9 if kind == "hexagonal" else 0.05)
    assert sheet.width == pytest.approx(0.05, rel=0.03)


def test_checks_pass_within_their_tolerance_and_never_without_a_number() -> None:
    assert near("x", 2.0, 2.1, 0.11).passed and not near("x", 2.0, 2.1, 0.09).passed
    assert near_share("x", -2.0, -2.1, 0.051).passed and not near_share("x", -2.0, -2.1, 0.049).passed
    assert at_most("x", 1.0, 0.5).passed and at_most("x", 1.0, 1.0).passed and not at_most("x", 1.0, 1.001).passed
    for check in (near("x", 0.0, math.nan, 1.0), near_share("x", 1.0, math.nan, 1.0), at_most("x", 1.0, math.nan)):
        assert not check.passed
    assert not table.Result(cases.CASES[0], (), 0.0).passed


def test_a_check_known_to_fail_is_shown_as_failed_with_its_reason() -> None:
    known = replace(near("a known one", 1.0, 2.0, 0.1), explanation="it is known")
    passing = replace(near("a good one", 1.0, 1.0, 0.1), explanation="it is known")
    assert known.is_explained and not known.passed and not passing.is_explained
    result = table.Result(Case("known", "What it compares.", "lines:x"), (known, passing), 0.0)
    assert result.passed and result.explained == (known,)
    assert not table.Result(result.case, (known, near("a bad one", 1.0, 2.0, 0.1)), 0.0).passed
    lines = table.as_text([result]).splitlines()
    assert lines[2].endswith("NO") and "known: it is known" in lines
    assert lines[-1].startswith("1 of 2 checks of 1 cases passed and 1 failed for the reason given in ")
    assert [row["pass"] for row in table.as_data([result])] == [False, True]
    assert table.explanations([result]) == [{"case": "known", "quantity": "a known one", "explanation": "it is known"}]


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
    from leafwarp.study.verify import plots

    # The sheets themselves take seconds; the picture does not care where the drops come from.
    drops = np.array([[beams.expected_droop(weight) for weight in beams.WEIGHTS]])
    monkeypatch.setattr(beams, "droops", lambda kind, cells, device: drops)
    plots.write_plots([*plots.PLOTS, "momentum"], device, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.png" for name in plots.PLOTS}
    assert set(plots.PLOTS) <= {case.name for case in cases.CASES}
    (tmp_path / "kohlrabi_drying.png").unlink()
    plots.write_plots(["momentum"], device, tmp_path)
    assert not (tmp_path / "kohlrabi_drying.png").exists()
