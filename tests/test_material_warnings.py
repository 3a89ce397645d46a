"""Possible but odd values of leaves stated in SI units: each is warned of with the usual range."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

from leafwarp.cli import main
from leafwarp.scene.file import load_scene
from leafwarp.scene.presets import PRESETS
from leafwarp.scene.warnings import USUAL
from material_scenes import SI_KEYS, material_scene
from meshes import scene_of

# A possible but odd value of every key but the preset, with what is changed beside it, and how the warning begins.
SUSPICIOUS = {
    "material.thickness": (["'5 cm'"], "material.thickness = 0.05 m: usual: 5e-5 to 0.003 m ("),
    "material.vein_thickness": (["'5 cm'"], "material.vein_thickness = 0.05 m: usual: 5e-5 to 0.02 m ("),
    "material.lamina_modulus": (["'1 Pa'"], "material.lamina_modulus = 1 Pa: usual: 1e6 to 5e9 Pa ("),
    "material.vein_modulus": (["'1 Pa'"], "material.vein_modulus = 1 Pa: usual: 1e6 to 3e10 Pa ("),
    "material.poisson_ratio": (["-0.5"], "material.poisson_ratio = -0.5: usual: 0 to 0.5 ("),
    "material.dry_mass": (["'5 kg/m2'"], "material.dry_mass = 5 kg/m2: usual: 0.01 to 1.5 kg/m2 ("),
    "material.saturated_water": (["'1 g/m2'"], "material.saturated_water = 0.001 kg/m2: usual: 0.02 to 5 kg/m2 ("),
    "material.osmotic_potential": (
        ["'50 MPa'", "material.bulk_modulus='400 MPa'"],
        "material.osmotic_potential = 5e7 Pa: usual: 300000 to 5e6 Pa (",
    ),
    "material.bulk_modulus": (["'400 MPa'"], "material.bulk_modulus = 4e8 Pa: usual: 1e6 to 6e7 Pa ("),
    "material.wilted_stiffness": (["0.005"], "material.wilted_stiffness = 0.005: usual: 0.01 to 1 ("),
    "material.dry_stiffness": (["0.5"], "material.dry_stiffness = 0.5: usual: 1 to 100 ("),
    "material.shrink_across": (
        ["'90 %'"],
        "material.area_lost = 0.909: usual: 0 to 0.82 (it follows from shrink_across",
    ),
    "material.shrink_along": (
        ["'90 %'"],
        "material.area_lost = 0.914: usual: 0 to 0.82 (it follows from shrink_across",
    ),
    "material.mismatch": (["0.2"], "material.mismatch = 0.2: usual: -0.1 to 0.1 ("),
    "material.plastic_set": (["1.0"], "material.plastic_set = 1: usual: 0 to 0.95 ("),
    "air.temperature": (["'80 degC'"], "air.temperature = 353.15 K: usual: 263.15 to 323.15 K ("),
    "air.relative_humidity": (["'1 %'"], "air.relative_humidity = 0.01: usual: 0.05 to 1 ("),
    "air.vapour_pressure_deficit": (
        ["'9 kPa'", "air={vapour_pressure_deficit = '9 kPa'}"],
        "air.deficit = 9000 Pa: usual: 0 to 8000 Pa (the vapour pressure deficit",
    ),
    "air.pressure": (["'3 bar'"], "air.pressure = 300000 Pa: usual: 50000 to 110000 Pa ("),
    "stomata.open_conductance": (["50.0"], "stomata.open_conductance = 50 mol/m2/s: usual: 0.005 to 1.5 mol/m2/s ("),
    "stomata.minimum_conductance": (["0.1"], "stomata.minimum_conductance = 0.1 mol/m2/s: usual: 0.0001 to 0.05 mol"),
    "stomata.closure": (
        ["[[0.8, 0.0], [0.9, 1.0], [1.0, 0.5]]"],
        "stomata.closure = 1 at a water content of 0.9 and 0.5 at 1: usual: the drier the leaf, the smaller",
    ),
}


@pytest.mark.parametrize("key", sorted(SI_KEYS - {"material.preset"}))
def test_a_suspicious_value_of_every_key_is_a_line_with_the_usual_range(leaf_file: Path, key: str) -> None:
    (value, *others), words = SUSPICIOUS[key]
    assert load_scene(leaf_file).warnings == ()
    warnings = load_scene(leaf_file, [f"{key}={value}", *others]).warnings
    assert any(line.startswith(words) for line in warnings), warnings
    assert not any("\n" in line for line in warnings)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_lamina_of_one_pascal_is_a_warning_in_every_kind_of_leaf(preset: str) -> None:
    (line,) = material_scene(preset=preset, lamina_modulus="1 Pa").warnings
    assert line.startswith("material.lamina_modulus = 1 Pa: usual: 1e6 to 5e9 Pa (")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["material.thickness='5 cm'"], "material.density = 4 kg/m3: usual: 300 to 1500 kg/m3"),
        (["material.bulk_modulus='2 MPa'"], "material.turgor_loss_point = 0.25: usual: 0.6 to 0.98"),
        (["material.shrink_across=-0.2", "material.shrink_along=-0.1"], "material.area_lost = -0.32: usual: 0 to 0.82"),
    ],
)
def test_suspicious_is_also_what_several_keys_make_together(leaf_file: Path, changes: list[str], words: str) -> None:
    assert any(line.startswith(words) for line in load_scene(leaf_file, changes).warnings)


def test_explicit_motion_of_a_stiff_leaf_is_warned_of(small_scene: Path, capsys) -> None:
    """The warning's step is longer than that of the plan, which knows the mesh and its veins; both name the way out."""
    soft, stiff = (
        load_scene(small_scene, [f"structure.membrane_stiffness={stiffness}"]).warnings for stiffness in (6.0, 5e3)
    )
    assert soft == ()
    (line,) = stiff
    step, substeps = map(float, re.search(r"steps below (\S+) s, more than (\S+) a frame", line).groups())
    assert substeps == pytest.approx(1.0 / 24.0 / step, rel=0.05)
    assert "motion.method = 'quasistatic' or 'implicit' takes one" in line
    assert load_scene(small_scene, ["structure.membrane_stiffness=5e3", "motion.method=implicit"]).warnings == ()

    arguments = ["plan", str(small_scene), "--set", "structure.membrane_stiffness=5e3"]
    assert main([*arguments, "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert step / 5.0 < plan["substep_seconds"] < step
    assert plan["warnings"] == [line]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert line in said.err
    assert f"{plan['substeps_per_frame']} motion substeps of {plan['substep_seconds']:.3g} s" in said.out
    assert "motion.method = 'quasistatic' or 'implicit' takes a real leaf's" in said.out


def test_a_scene_without_such_tables_has_nothing_to_warn_about() -> None:
    assert scene_of().warnings == ()


@pytest.mark.parametrize("key", USUAL)
def test_usual_ranges_are_of_things_that_a_scene_has(leaf_file: Path, key: str) -> None:
    table, name = key.split(".")
    value = getattr(getattr(load_scene(leaf_file), table), name)
    usual = USUAL[key]
    assert math.isfinite(value) and usual.low < usual.high and usual.why
    assert usual.low <= value <= usual.high


@pytest.mark.parametrize(
    "verb", [["run", "--frames", "2"], ["plan"], ["tradeoff", "--budget", "1s"]], ids=lambda v: v[0]
)
def test_warnings_go_to_stderr(verb, small_scene: Path, tmp_path: Path, capsys) -> None:
    # A result that is a file already ends run and tradeoff as soon as they have said what they think of the scene.
    taken = tmp_path / "taken.txt"
    taken.write_text("")
    output = [] if verb[0] == "plan" else ["-o", str(taken / "folder")]
    odd = ["--set", "material.thickness='5 cm'", "--set", "motion.method='explicit'"]
    main([verb[0], str(small_scene), *verb[1:], *output, *odd, "-q"])
    said = capsys.readouterr()
    assert "leafwarp: warning: material.thickness = 0.05 m: usual: 5e-5 to 0.003 m (" in said.err
    assert "warning" not in said.out


def test_what_would_swing_a_leaf_has_no_effect_on_one_at_rest(leaf_file: Path) -> None:
    keys = ["structure.damping=0.9", "motion.drag=50.0"]
    lines = load_scene(leaf_file, keys).warnings
    assert [line.partition(":")[0] for line in lines] == ["structure.damping = 0.9", "motion.drag = 50"]
    assert all("motion.method = 'implicit' has inertia" in line for line in lines)
    assert load_scene(leaf_file, [*keys, "motion.method='implicit'", "material.mismatch=0.0"]).warnings == ()
    assert load_scene(leaf_file, ["motion.drag=50.0", "motion.wind=[1.0, 0.0, 0.0]"]).warnings == ()


def test_where_inertia_may_decide_on_the_shape_is_said(leaf_file: Path, small_scene: Path) -> None:
    (line,) = load_scene(leaf_file, ["motion.method='implicit'"]).warnings
    assert line.startswith("motion.method = 'implicit': has inertia in the film's time")
    assert "time.frames and time.fps" in line and "'quasistatic'" in line
    assert load_scene(leaf_file, ["motion.method='quasistatic'"]).warnings == ()
    assert load_scene(small_scene, ["motion.method='implicit'"]).warnings == ()  # an artistic scene


@pytest.mark.parametrize(
    ("curve", "method", "warned"),
    [
        ([[0.1, 0.22], [1.0, 0.0]], "explicit", False),
        ([[0.45, 0.2], [0.5, 0.0]], "explicit", True),
        ([[0.45, 0.2], [0.5, 0.0]], "quasistatic", False),
        ([[0.499, 0.01], [0.5, 0.0]], "explicit", False),
    ],
)
def test_a_leaf_that_shrinks_at_once_is_warned_of(curve: list, method: str, warned: bool) -> None:
    scene = scene_of({}, {"method": method}).with_changes({"shrink.curve": curve})
    lines = [line for line in scene.warnings if line.startswith("shrink.curve")]
    assert len(lines) == warned
    if warned:
        assert "0.2 of the length are lost between the water contents 0.45 and 0.5" in lines[0]
