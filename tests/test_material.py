"""Leaves stated in SI units: presets, what follows from them, and a whole leaf of one."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from conftest import SCENES
from leafwarp.scene import presets
from leafwarp.scene.file import load_scene
from leafwarp.scene.material import FOLLOWS_FROM, MaterialTable
from leafwarp.scene.presets import PRESETS
from leafwarp.sim.pace import couplings_per_frame
from leafwarp.sim.simulation import Simulation
from material_scenes import material_scene
from meshes import strip


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


def test_what_is_none_is_derived(leaf_file: Path) -> None:
    scene = load_scene(leaf_file)
    keys = ("material.thickness", "structure.membrane_stiffness", "structure.vein_bending_stiffness")
    assert scene.with_changes(dict.fromkeys(keys)).structure == scene.structure


def test_every_number_that_follows_from_a_material_tells_from_which_keys() -> None:
    material = MaterialTable()
    for name in ("structure", "shrink", "curl"):
        for key, value in getattr(material, name)().items():
            assert isinstance(value, tuple) or all(
                f"material.{source} = " in material.sources(f"{name}.{key}") for source in FOLLOWS_FROM[f"{name}.{key}"]
            )


def test_a_stiff_leaf_is_told_often_enough_that_it_swells_or_shrinks_along_its_veins(leaf_file: Path) -> None:
    scene = load_scene(leaf_file, ["motion.method='explicit'"])
    slow, fast = (scene.with_changes({"shrink.along_veins": factor}) for factor in (0.5, 5.0))
    assert couplings_per_frame(fast) > 3 * couplings_per_frame(slow)
    dry = {"source.conductance": 1e-3, "maps.water": 0.2, "stomata.open_conductance": 1e-6}
    dry["stomata.minimum_conductance"] = 0.0
    assert couplings_per_frame(scene.with_changes(dry)) > couplings_per_frame(
        scene.with_changes(dry | {"maps.water": "auto"})
    )


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
