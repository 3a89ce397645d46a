"""Impossible values of leaves stated in SI units: each is refused in one line that says what is accepted."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.scene.file import load_scene
from material_scenes import SI_KEYS, material_scene
from test_cli import refused

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


@pytest.mark.parametrize("key", sorted(SI_KEYS))
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


@pytest.mark.parametrize("along", np.linspace(0.7, 0.95, 6))
def test_a_leaf_may_shrink_as_far_as_its_material_is_accepted(along: float) -> None:
    """The curve takes from a length exactly the shares that the material gives, at no water content more than all."""
    for across in np.linspace(0.1, 0.95, 30):
        shrink = material_scene(shrink_across=float(across), shrink_along=float(along)).shrink
        assert shrink.curve[0] == (0.0, across)
        lost = np.array([share for _, share in shrink.curve])
        assert np.max(lost) == across < 1.0
        assert np.max(lost) * shrink.along_veins == pytest.approx(along, rel=1e-12)


def test_the_papers_bending_has_no_equilibrium(leaf_file: Path) -> None:
    with pytest.raises(InputError, match=r"structure\.bending = 'paper': accepted with motion\.method = 'explicit'"):
        load_scene(leaf_file, ["structure.bending='paper'"])
    load_scene(leaf_file, ["structure.bending='paper'", "motion.method='explicit'"])


def test_a_leaf_that_would_shrink_to_less_than_nothing_is_refused(leaf_file: Path, capsys) -> None:
    for changes in (["shrink.along_veins=10"], ["shrink.curve=[[0.0, 0.5], [1.0, 0.0]]", "shrink.along_veins=3"]):
        arguments = [part for change in changes for part in ("--set", change)]
        assert main(["plan", str(leaf_file), *arguments]) == 2
        assert "of its length along the veins; accepted: at most 95%" in capsys.readouterr().err
