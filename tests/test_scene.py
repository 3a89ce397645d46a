"""Scenes: what is accepted, what is refused and in which words."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from leafwarp.errors import InputError
from leafwarp.quantity import UNITS, ZEROS, parse_quantity
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene

SCENES = Path(__file__).parent.parent / "scenes"

SMALL = """
[leaf]
image = "leaf.png"
length = "12 cm"
[time]
duration = "2 h"
[fluid]
step = "1 min"
[shrink]
curve = [[1.0, 0.0], [0.2, 0.3]]
[structure]
membrane_stiffness = 6.0
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def test_quantities_are_si(small: Path) -> None:
    scene = load_scene(small)
    assert scene.leaf.length == pytest.approx(0.12)
    assert scene.time.duration == 7200.0
    assert scene.fluid.step == 60.0
    assert scene.leaf.image == small.parent / "leaf.png"
    assert scene.name == "small"


@pytest.mark.parametrize("dimension", UNITS)
def test_every_unit_converts_by_its_factor(dimension: str) -> None:
    for unit, factor in UNITS[dimension].items():
        assert parse_quantity(f"2.5 {unit}", dimension) == pytest.approx(2.5 * factor + ZEROS.get(unit, 0.0))
    with pytest.raises(ValueError, match="accepted"):
        parse_quantity("2.5 parsec", dimension)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("fluid.stp=3", ["fluid.stp", "unknown key", "did you mean 'step'"]),
        ("flui.step=3", ["flui", "did you mean 'fluid'"]),
        ("time.frames=2.5", ["time.frames = 2.5", "a whole number is wanted"]),
        ("time.fps=true", ["time.fps = True", "a number is wanted"]),
        ("leaf.length=1e-300", ["leaf.length = 1e-300", "greater than or equal to 0.0001"]),
        ("structure.membrane_stiffness=1e39", ["structure.membrane_stiffness", "less than or equal to"]),
        ("mesh.vertices=16", ["mesh.vertices = 16", "greater than or equal to 30"]),
        ("time.frames=-3", ["time.frames = -3", "greater than or equal to 1"]),
        ("fluid.step='3 kg'", ["fluid.step = '3 kg'", "one of s, min, h, d"]),
        ("fluid.step=nan", ["fluid.step = nan", "finite"]),
        ("fluid.lamina_diffusivity=-1.0", ["fluid.lamina_diffusivity = -1.0", "greater than or equal to 0"]),
        ("maps.size=[0,3]", ["maps", "size 0", "[1, 8192]"]),
        ("maps.water=2", ["maps.water", "2"]),
        ("motion.gravity=[1,2]", ["motion.gravity[2]", "missing"]),
        ("shrink.curve=[[1,2]]", ["shrink.curve", "a shrink of 2 is not in"]),
        ("shrink.curve=[[2,0]]", ["shrink.curve", "water content in [0, 1]"]),
        ("shrink.curve=[[1,0],[1,0.1]]", ["shrink.curve", "the same water content"]),
        ("leaf.length=true", ["leaf.length = True", "length"]),
        ("leaf.pixels_per_metre=100", ["leaf", "either 'length' or 'pixels_per_metre'"]),
        ("curl.mismatch=[[1,0]]", ["[curl] needs structure.bending_stiffness"]),
        ("water.curve=[[0,1]]", ["either [fluid]", "or [water]"]),
        ("fluid.scheme='both'", ["fluid.scheme = 'both'", "'split' or 'unsplit'"]),
        ("output.contact_sheet='yes'", ["output.contact_sheet = 'yes'", "boolean"]),
        ("motion.settle=true", ["motion.settle needs motion.gravity or motion.wind"]),
        ("motion={wind = [1.0, 0.0, 0.0], drag = 0.0}", ["motion.wind needs motion.drag"]),
        ("structure.bending='paper'", ["structure.bending needs structure.bending_stiffness"]),
        ("maps.stomata='stomata.png'", ["maps.stomata is given, but nothing in this scene depends on that map"]),
        ("fluid=3", ["fluid = 3"]),
        ("fluid.step.more=3", ["fluid.step.more"]),
        ("nothing", ["--set nothing", "key=value"]),
    ],
)
def test_bad_values_are_named_with_what_is_accepted(small: Path, change: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_scene(small, [change])
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("text", ["[leaf", "a = 1\na = 2", "\x00"])
def test_toml_syntax_errors_name_the_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"broken\.toml: not valid TOML"):
        load_scene(path)


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text(SMALL.replace('duration = "2 h"', ""))
    with pytest.raises(InputError, match=r"time\.duration: missing; Plant time"):
        load_scene(path)


def test_no_such_file_and_not_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such scene file"):
        load_scene(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read as a text file"):
        load_scene(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_scene(tmp_path)


def test_changes_leave_the_original_alone(small: Path) -> None:
    scene = load_scene(small)
    other = scene.with_changes({"fluid.step": 5.0, "maps.size": 64})
    assert (other.fluid.step, other.maps.shape) == (5.0, (64, 64))
    assert (scene.fluid.step, scene.maps.shape) == (60.0, (256, 256))


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ("motion.gravity=[0.0, 0.0, 0.0]", "has_weight"),
        ("structure.bending_stiffness=0.0", "has_angular_springs"),
        ("shrink.curve=[[1.0, 0.1]]", "shrinks"),
        ("structure.stiffness=[[0.0, 2.0], [1.0, 2.0]]", "stiffness_varies"),
    ],
)
def test_what_has_no_effect_is_not_asked_for(small: Path, change: str, asked: str) -> None:
    assert not getattr(load_scene(small, [change]), asked)


def test_only_required_maps_are_asked_for(small: Path) -> None:
    assert load_scene(small).map_names == ("venation", "water")
    plain = load_scene(small, ["fluid.vein_diffusivity=1e-9"])
    assert plain.map_names == ("water",)
    sourced = load_scene(small, ["source.conductance=1e-5", "transpiration.rate=1e-5"])
    assert sourced.map_names == ("venation", "stomata", "water", "source")


def test_schema_documents_every_key() -> None:
    schema = json.loads(json.dumps(Scene.model_json_schema()))
    for table in schema["$defs"].values():
        assert table["additionalProperties"] is False
        for key, field in table["properties"].items():
            assert "description" in field, key


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_scenes_are_valid(path: Path) -> None:
    scene = load_scene(path)
    assert scene.name == path.stem
    assert scene.leaf.image.is_file()
