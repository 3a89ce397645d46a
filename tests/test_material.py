"""Leaves stated in SI units: presets, what follows from them, and what is refused or warned about."""

from __future__ import annotations

import inspect
import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from conftest import SCENES
from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.scene import Scene, presets
from leafwarp.scene.file import load_scene
from leafwarp.scene.material import FOLLOWS_FROM, MaterialTable
from leafwarp.scene.presets import PRESETS
from leafwarp.scene.warnings import USUAL
from leafwarp.scene.water import AirTable, StomataTable
from leafwarp.sim.pace import couplings_per_frame
from leafwarp.sim.simulation import Simulation
from meshes import scene_of, strip
from test_cli import refused

LEAF = """
[leaf]
image = "leaf.png"
length = "12 cm"
[time]
duration = "48 h"
[fluid]
[air]
temperature = "25 degC"
relative_humidity = 0.5
[stomata]
open_conductance = "200 mmol/m2/s"
[material]
"""


@pytest.fixture
def leaf_file(tmp_path: Path) -> Path:
    path = tmp_path / "leaf.toml"
    path.write_text(LEAF)
    return path


def material_scene(**material) -> Scene:
    return scene_of(material=material)


def at(curve, content: float) -> float:
    return float(np.interp(content, *zip(*curve, strict=True)))


# Presets.


def test_there_are_presets_of_four_kinds_of_leaf_and_each_gives_every_figure() -> None:
    assert list(PRESETS) == ["herb", "tree", "waxy", "grass"]
    for figures in PRESETS.values():
        assert set(figures) == set(MaterialTable.model_fields) - {"preset"}
    assert MaterialTable().preset == "tree"


def test_every_figure_of_a_preset_has_its_source_beside_it() -> None:
    source = inspect.getsource(presets)
    figures = [line for line in source.splitlines() if re.match(r'\s+"\w+": [-\d.]', line)]
    assert len(figures) == sum(len(preset) for preset in PRESETS.values())
    # The papers that the comments name are those of the list of references.
    cited = {tuple(pair) for line in figures for pair in re.findall(r"([A-Z][a-z]+) ((?:19|20)\d\d)", line)}
    listed = re.findall(r"^- ([A-Z][a-z]+)\b.*?((?:19|20)\d\d)", source, re.MULTILINE)
    assert cited and cited <= set(listed)
    for line in figures:
        comment = line.partition("#")[2]
        assert any(word in comment for word in ("chosen here", "artistic", *(name for name, _ in listed))), line


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_coherent(preset: str) -> None:
    material = MaterialTable(preset=preset)
    assert 0.8 <= material.turgor_loss_point <= 0.95
    assert material.density == pytest.approx(1000.0, rel=0.1)  # Vile et al. 2005
    # Real leaves: E h of 1e3 to 1e5 N/m.
    assert 1e3 <= material.membrane_stiffness <= 1e5
    assert 0.05 <= material.area_lost <= 0.4
    assert material_scene(preset=preset).warnings == ()


def test_the_default_leaf_loses_a_fifth_of_its_area() -> None:
    assert MaterialTable().area_lost == pytest.approx(0.22, abs=0.08)


# What follows.


def test_the_tables_of_the_structure_follow_from_the_material() -> None:
    scene = material_scene(
        thickness="0.3 mm",
        vein_thickness="0.9 mm",
        lamina_modulus="40 MPa",
        vein_modulus="120 MPa",
        poisson_ratio=0.2,
        dry_mass="60 g/m2",
        saturated_water="0.2 kg/m2",
        shrink_across=0.2,
        shrink_along=0.05,
        mismatch=-0.02,
        plastic_set=0.4,
    )
    structure = scene.structure
    assert structure.membrane_stiffness == pytest.approx(12e3)
    assert structure.bending_stiffness == pytest.approx(40e6 * 27e-12 / 12 / 0.96)
    assert structure.vein_stiffness == pytest.approx(3.0 * 3.0)
    assert structure.vein_bending_stiffness == pytest.approx(3.0 * 27.0)
    assert (structure.dry_mass, structure.water_mass) == pytest.approx((0.06, 0.2))
    assert scene.shrink.along_veins == pytest.approx(0.25)
    assert scene.curl.thickness == pytest.approx(3e-4)
    assert scene.curl.vein_resistance == pytest.approx(1.0 - 1.0 / 3.0)
    assert scene.shrink.plastic_set == scene.curl.plastic_set == 0.4
    assert scene.motion.method == "quasistatic" and scene.solver.precision == "float64"


def test_a_vein_thinner_than_the_lamina_resists_no_curl() -> None:
    assert material_scene(thickness="0.3 mm", vein_thickness="0.1 mm").curl.vein_resistance == 0.0


@pytest.mark.parametrize("preset", PRESETS)
def test_wilting_and_drying_follow_the_turgor_law(preset: str) -> None:
    """Down to the turgor loss point the leaf softens with its turgor, in its shape as it was; below, it shrinks, curls
    and stiffens."""
    scene = material_scene(preset=preset)
    material, lost = scene.material, scene.material.turgor_loss_point
    assert lost == pytest.approx(1.0 - material.osmotic_potential / material.bulk_modulus)
    for share in (0.0, 0.3, 1.0):
        wet, dry = lost + share * (1.0 - lost), (1.0 - share) * lost
        turgor = (wet - lost) / (1.0 - lost)
        assert at(material.turgor, wet) == pytest.approx(turgor, abs=1e-12)
        assert at(material.turgor, dry) == 0.0
        softened = material.wilted_stiffness + (1.0 - material.wilted_stiffness) * turgor
        stiffened = 1.0 + share * (material.dry_stiffness - 1.0)
        assert at(scene.structure.wilting, wet) == pytest.approx(softened)
        assert at(scene.structure.drying, wet) == 1.0
        assert at(scene.structure.wilting, dry) == material.wilted_stiffness
        assert at(scene.structure.drying, dry) == pytest.approx(stiffened)
        assert at(scene.structure.stiffness_factor, wet) == pytest.approx(softened)
        assert at(scene.structure.stiffness_factor, dry) == pytest.approx(material.wilted_stiffness * stiffened)
        assert at(scene.shrink.curve, wet) == at(scene.curl.mismatch, wet) == 0.0
        assert at(scene.shrink.curve, dry) == pytest.approx(share * material.shrink_across)
        assert at(scene.curl.mismatch, dry) == pytest.approx(share * material.mismatch)


def test_stomata_close_with_turgor_unless_the_scene_says_otherwise(leaf_file: Path) -> None:
    scene = load_scene(leaf_file)
    assert scene.transpiration.closure == scene.material.turgor
    other = load_scene(leaf_file, ["stomata.closure=[[0.5, 0.0], [0.6, 1.0]]"])
    assert other.transpiration.closure == ((0.5, 0.0), (0.6, 1.0))


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("structure.wilting", [[0.0, 0.5]]),
        ("structure.drying", [[0.0, 2.0], [0.5, 1.0]]),
        ("structure.membrane_stiffness", 7.0),
        ("shrink.curve", [[0.0, 0.1], [1.0, 0.0]]),
        ("shrink.along_veins", 1.0),
        ("curl.mismatch", [[0.2, 0.03], [0.7, 0.0]]),
        ("motion.method", "explicit"),
    ],
)
def test_what_a_scene_says_itself_holds(change: str, value) -> None:
    table, key = change.split(".")
    scene = material_scene().with_changes({change: value})
    said = getattr(getattr(scene, table), key)
    assert said == (tuple(map(tuple, value)) if isinstance(value, list) else value)


def test_another_preset_derives_everything_anew() -> None:
    changed = material_scene(preset="herb").with_changes({"material.preset": "waxy"})
    assert changed == material_scene(preset="waxy")
    assert changed.structure.membrane_stiffness == pytest.approx(1e8 * 5e-4)


@pytest.mark.parametrize("columns", [8, 16])
def test_spring_and_hinge_constants_follow_from_material_and_mesh(columns: int) -> None:
    leaf = strip(0.1, 0.04 * 0.75**0.5, columns)
    mesh = leaf.mesh
    state = Simulation(material_scene(shrink_across=0.0, shrink_along=0.0, vein_modulus="50 MPa", vein_thickness=2e-4),
                       leaf).state  # fmt: skip
    figures = PRESETS["tree"]
    length = np.linalg.norm(np.diff(mesh.positions[mesh.edges], axis=1)[:, 0], axis=1)
    edge = figures["lamina_modulus"] * figures["thickness"] * mesh.edge_areas / length**2
    assert state["edge_stiffness"].numpy() == pytest.approx(edge, rel=1e-12)
    bending = figures["lamina_modulus"] * figures["thickness"] ** 3 / (12.0 * (1.0 - figures["poisson_ratio"] ** 2))
    a, b, c, d = np.moveaxis(mesh.positions[mesh.hinges], 1, 0)
    (x, y), (u, v) = (b - a).T, (c - d).T
    hinge = bending * (x * x + y * y) / (0.5 * np.abs(x * v - y * u))
    assert state["hinge_stiffness"].numpy() == pytest.approx(hinge, rel=1e-12)


# What is refused.


# An impossible value of every key, and what is accepted.
IMPOSSIBLE = {
    "material.preset": ("'moss'", "accepted: 'herb', 'tree', 'waxy' or 'grass'"),
    "material.thickness": ("0.0", "accepted: 1e-6 to 0.1 m"),
    "material.vein_thickness": ("-1", "accepted: 1e-6 to 0.1 m"),
    "material.lamina_modulus": ("'-50 MPa'", "accepted: 0.001 to 1e13 Pa"),
    "material.vein_modulus": ("0", "accepted: 0.001 to 1e13 Pa"),
    "material.poisson_ratio": ("0.6", "accepted: -0.99 to 0.5"),
    "material.dry_mass": ("0", "accepted: 1e-6 to 1e6 kg/m2"),
    "material.saturated_water": ("'-1 kg/m2'", "accepted: 1e-6 to 1e6 kg/m2"),
    "material.osmotic_potential": ("'-1.5 MPa'", "accepted: 1 to 1e9 Pa; a positive number"),
    "material.bulk_modulus": ("0", "accepted: 1 to 1e11 Pa"),
    "material.wilted_stiffness": ("1.5", "accepted: 0.001 to 1"),
    "material.dry_stiffness": ("-1", "accepted: 0.001 to 1e6"),
    "material.shrink_across": ("1", "accepted: -0.5 to 0.95"),
    "material.shrink_along": ("'120 %'", "accepted: -0.5 to 0.95"),
    "material.mismatch": ("3", "accepted: -1 to 1"),
    "material.plastic_set": ("1.1", "accepted: 0 to 1"),
    "air.temperature": ("25", "accepted: 233.15 to 373.15 K; a plain number is in kelvin"),
    "air.relative_humidity": ("65", "accepted: 0 to 1; a string may say %"),
    "air.vapour_pressure_deficit": ("'-1 kPa'", "accepted: 0 to 100000 Pa"),
    "air.pressure": ("0", "accepted: 1000 to 1e6 Pa"),
    "stomata.open_conductance": ("200", "accepted: 0 to 100 mol/m2/s"),
    "stomata.minimum_conductance": ("-1e-3", "accepted: 0 to 100 mol/m2/s"),
    "stomata.closure": ("[[0.8, 0.0], [1.0, 1.2]]", "accepted: 0 to 1"),
}
TABLES = {"material": MaterialTable, "air": AirTable, "stomata": StomataTable}
KEYS = {f"{name}.{key}" for name, table in TABLES.items() for key in table.model_fields}


@pytest.mark.parametrize("key", sorted(KEYS))
def test_an_impossible_value_of_every_key_is_one_line_that_says_what_is_accepted(key, leaf_file: Path, capsys) -> None:
    value, accepted = IMPOSSIBLE[key]
    message = refused(capsys, "plan", leaf_file, "--set", f"{key}={value}")
    assert f"{leaf_file}: {key}" in message and accepted in message
    plain = tomllib.loads(f"value = {value}")["value"]
    assert f" = {1.2 if isinstance(plain, list) else plain!r}: " in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("thickness='0 mm'", "material.thickness = '0 mm': accepted: 1e-6 to 0.1 m"),
        ("osmotic_potential='50 MPa'", "turgor loss point at -3.16667; accepted: between 0 and 1"),
        ("bulk_modulus='1 MPa'", "turgor loss point at -0.5; accepted: between 0 and 1"),
        ("shrink_across=0", "shrink_along 0.09 and shrink_across 0; accepted: of one sign"),
        ("shrink_along=-0.1", "shrink_along -0.1 and shrink_across 0.14; accepted: of one sign"),
        ("thickness='thin'", "material.thickness = 'thin': accepted: a number [m]"),
        ("lamina_modulus='5 m'", "material.lamina_modulus = '5 m': accepted: a number [Pa]"),
        ("thickness=nan", "material.thickness = nan"),
        ("thicknes=1", "material.thicknes: unknown key; did you mean 'thickness'?"),
    ],
)
def test_an_impossible_material_is_refused(leaf_file: Path, capsys, change: str, words: str) -> None:
    assert words in refused(capsys, "plan", leaf_file, "--set", f"material.{change}")


@pytest.mark.parametrize(
    ("material", "words", "own"),
    [
        (
            "{vein_modulus = '1e4 GPa', lamina_modulus = 1.0}",
            "material.vein_modulus = 1e13, material.vein_thickness = 0.0015, material.lamina_modulus = 1, "
            "material.thickness = 0.0002: they make structure.vein_stiffness = 7.5e13; accepted: 0 to 1e12",
            ["structure.vein_stiffness=3.0", "structure.vein_bending_stiffness=3.0"],
        ),
        (
            "{vein_thickness = '10 cm', thickness = '1 um'}",
            "material.vein_modulus = 2.5e8, material.vein_thickness = 0.1, material.lamina_modulus = 5e7, "
            "material.thickness = 1e-6: they make structure.vein_bending_stiffness = 5e15; accepted: 0 to 1e12",
            ["structure.vein_bending_stiffness=3.0"],
        ),
        (
            "{thickness = 0.1, lamina_modulus = 1e13, poisson_ratio = -0.99}",
            "material.lamina_modulus = 1e13, material.thickness = 0.1, material.poisson_ratio = -0.99: they make "
            "structure.bending_stiffness = 4.1876e10; accepted: 0 to 1e9 N m",
            ["structure.bending_stiffness=1e-3"],
        ),
    ],
)
def test_what_follows_from_a_material_has_the_bounds_of_what_is_given(leaf_file, capsys, material, words, own) -> None:
    assert refused(capsys, "plan", leaf_file, "--set", f"material={material}").endswith(words)
    scene = load_scene(leaf_file, [f"material={material}", *own])  # what the scene says itself holds
    assert scene.material is not None


def test_what_a_scene_and_its_material_make_together_names_both(leaf_file: Path, capsys) -> None:
    changes = ["material={shrink_across=0.1, shrink_along=0.3}", "shrink.curve=[[0.0, 0.5], [1.0, 0.0]]"]
    message = refused(capsys, "plan", leaf_file, "--set", changes[0], "--set", changes[1])
    assert "shrink.along_veins = 3 (from material.shrink_along = 0.3, material.shrink_across = 0.1)" in message


def test_every_number_that_follows_from_a_material_tells_from_which_keys() -> None:
    material = MaterialTable()
    for name in ("structure", "shrink", "curl"):
        for key, value in getattr(material, name)().items():
            assert isinstance(value, tuple) or all(
                f"material.{source} = " in material.sources(f"{name}.{key}") for source in FOLLOWS_FROM[f"{name}.{key}"]
            )


@pytest.mark.parametrize("along", np.linspace(0.7, 0.95, 6))
def test_a_leaf_may_shrink_as_far_as_its_material_is_accepted(along: float) -> None:
    for across in np.linspace(0.1, 0.95, 30):
        material_scene(shrink_across=float(across), shrink_along=float(along))


def test_the_papers_bending_has_no_equilibrium(leaf_file: Path) -> None:
    with pytest.raises(InputError, match=r"structure\.bending = 'paper': accepted with motion\.method = 'explicit'"):
        load_scene(leaf_file, ["structure.bending='paper'"])
    load_scene(leaf_file, ["structure.bending='paper'", "motion.method='explicit'"])


# What is warned about.


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


@pytest.mark.parametrize("key", sorted(KEYS - {"material.preset"}))
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
    assert "motion.method = 'implicit' takes one" in line
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
    assert "motion.method = 'implicit' takes a real leaf's" in said.out


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


# A whole leaf.


def surface(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_tree_leaf_wilts_then_dries_and_curls(scene_leaf) -> None:
    scene = load_scene(SCENES / "tree.toml").with_changes(
        {"mesh.vertices": 150, "maps.size": 48, "time.frames": 25, "output.contact_sheet": False, "fluid.step": 600.0}
    )
    leaf = scene_leaf(scene)
    tip = int(np.argmax(np.hypot(*leaf.mesh.positions.T)))
    heights, water, areas = [], [], []
    for frame in Simulation(scene, leaf).frames():
        heights.append(frame.points[tip, 2] / leaf.length)
        water.append(frame.water.mean())
        areas.append(surface(frame.points, leaf.mesh.triangles) / leaf.mesh.vertex_areas.sum())
    # Turgid it hangs a little; two hours later, cut off for one, it hangs lower; dry it is curled and smaller.
    lost = scene.material.turgor_loss_point
    assert water[0] == 1.0 and lost - 0.05 < water[1] < lost + 0.02 and water[-1] == pytest.approx(0.0, abs=0.01)
    assert -0.3 < heights[0] < -0.02
    assert heights[1] < heights[0] - 0.05
    assert areas[0] == pytest.approx(1.0, abs=0.01)
    assert 1.0 - areas[-1] == pytest.approx(0.22, abs=0.08)
    assert heights[-1] > heights[1] + 0.1


SCALES = {"mm": 1e3, "MPa": 1e-6, "g/m²": 1e3}


def test_the_readmes_table_has_the_presets_figures() -> None:
    readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    assert "| " + " | ".join(PRESETS) + " | source |" in readme
    for key in PRESETS["tree"]:
        row = next(line for line in readme.splitlines() if line.startswith(f"| `{key}`"))
        unit = re.search(r"\[(.+)\]", row.split("|")[1])
        scale = SCALES[unit[1]] if unit else 1.0
        assert [float(cell) for cell in row.split("|")[2:6]] == pytest.approx(
            [figures[key] * scale for figures in PRESETS.values()]
        )


def test_a_leaf_that_would_shrink_to_less_than_nothing_is_refused(leaf_file: Path, capsys) -> None:
    for changes in (["shrink.along_veins=10"], ["shrink.curve=[[0.0, 0.5], [1.0, 0.0]]", "shrink.along_veins=3"]):
        arguments = [part for change in changes for part in ("--set", change)]
        assert main(["plan", str(leaf_file), *arguments]) == 2
        assert "of its length along the veins; accepted: at most 95%" in capsys.readouterr().err


def test_what_is_none_is_derived(leaf_file: Path) -> None:
    scene = load_scene(leaf_file)
    keys = ("material.thickness", "structure.membrane_stiffness", "structure.vein_bending_stiffness")
    assert scene.with_changes(dict.fromkeys(keys)).structure == scene.structure


def test_a_stiff_leaf_is_told_often_enough_that_it_swells_or_shrinks_along_its_veins(leaf_file: Path) -> None:
    scene = load_scene(leaf_file, ["motion.method='explicit'"])
    slow, fast = (scene.with_changes({"shrink.along_veins": factor}) for factor in (0.5, 5.0))
    assert couplings_per_frame(fast) > 3 * couplings_per_frame(slow)
    dry = {"source.conductance": 1e-3, "maps.water": 0.2, "stomata.open_conductance": 1e-6}
    dry["stomata.minimum_conductance"] = 0.0
    assert couplings_per_frame(scene.with_changes(dry)) > couplings_per_frame(
        scene.with_changes(dry | {"maps.water": "auto"})
    )
