"""Scenes: what is accepted, what is refused and in which words."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

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
        ("leaf.length=1e-300", ["leaf.length = 1e-300", "accepted: 0.0001 to 100 m"]),
        ("structure.membrane_stiffness=1e39", ["structure.membrane_stiffness = 1e+39", "accepted: 0 to 1e12 N/m"]),
        ("mesh.vertices=16", ["mesh.vertices = 16", "accepted: 30 to 200000"]),
        ("time.frames=-3", ["time.frames = -3", "accepted: 1 to 1000000"]),
        ("fluid.step='3 kg'", ["fluid.step = '3 kg'", "one of s, min, h, d"]),
        ("fluid.step=nan", ["fluid.step = nan", "finite"]),
        ("fluid.lamina_diffusivity=-1.0", ["fluid.lamina_diffusivity = -1.0", "accepted: 0 or more m2/s"]),
        ("maps.size=[0,3]", ["maps.size[0] = 0: accepted: 1 to 8192"]),
        ("maps.water=2", ["maps.water = 2: accepted: 'auto', or 0 to 1, or a file's path is wanted"]),
        ("fluid.step=0", ["fluid.step = 0: accepted: above 0 s"]),
        ("fluid.step=[1]", ["fluid.step = [1]: accepted: a number [s]", "one of s, min, h, d"]),
        ("time.duration=0", ["time.duration = 0: accepted: above 0, to 1e12 s"]),
        ("motion.gravity=[1,2]", ["motion.gravity = [1, 2]: accepted: a list of 3, not of 2"]),
        ("motion.gravity=[1,2,3,4]", ["motion.gravity = [1, 2, 3, 4]: accepted: a list of at most 3, not of 4"]),
        ("shrink.curve=[]", ["shrink.curve = []: accepted: a list of at least 1, not of 0"]),
        ("shrink.curve=[[1]]", ["shrink.curve[0] = [1]: accepted: a list of 2, not of 1"]),
        ("shrink.curve=[1]", ["shrink.curve[0] = 1: a list is wanted"]),
        (
            f"shrink.curve={[[y / 100, 0.0] for y in range(80)]}",
            ["shrink.curve = [[0.0, 0.0],", "at most 64, not of 80"],
        ),
        ("shrink.curve=[[1,2]]", ["shrink.curve[0][1] = 2: accepted: -0.5 to 0.95"]),
        ("shrink.curve=[[2,0]]", ["shrink.curve[0][0] = 2: accepted: 0 to 1"]),
        ("shrink.curve=[['110 %',0]]", ["shrink.curve[0][0] = '110 %': accepted: 0 to 1"]),
        ("shrink.vein_resistance='5 cm'", ["shrink.vein_resistance = '5 cm': accepted: a number, or a number and %"]),
        ("shrink.curve=[[1,0],[1,0.1]]", ["shrink.curve", "the same water content"]),
        ("leaf.length=true", ["leaf.length = True", "length"]),
        ("leaf.pixels_per_metre=100", ["leaf", "either 'length' or 'pixels_per_metre'"]),
        ("curl.mismatch=[[1,0]]", ["[curl] needs structure.bending_stiffness"]),
        ("water.curve=[[0,1]]", ["either [fluid]", "or [water]"]),
        ("fluid.scheme='both'", ["fluid.scheme = 'both': accepted: 'split' or 'unsplit'"]),
        ("output.contact_sheet='yes'", ["output.contact_sheet = 'yes': accepted: true or false"]),
        ("motion.settle=true", ["motion.settle needs motion.gravity or motion.wind"]),
        ("motion={wind = [1.0, 0.0, 0.0], drag = 0.0}", ["motion.wind needs motion.drag"]),
        ("structure.bending='paper'", ["structure.bending needs structure.bending_stiffness"]),
        ("maps.stomata='stomata.png'", ["maps.stomata is given, but nothing in this scene depends on that map"]),
        ("fluid=3", ["fluid = 3"]),
        ("fluid.step.more=3", ["--set fluid.step.more: 'step' is a value, not a table"]),
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
    ("changes", "words"),
    [
        ({"time.frames": 0}, "small.toml: time.frames = 0: accepted: 1 to 1000000"),
        ({"time.frams": 3}, "small.toml: time.frams: unknown key; did you mean 'frames'?"),
        ({"time.duration": "2 kg"}, "small.toml: time.duration = '2 kg': accepted: a number [s]"),
        ({"fluid.step.more": 1.0}, "fluid.step.more: 'step' is a value, not a table"),
        ({"structure.membrane_stiffness": None}, "small.toml: structure.membrane_stiffness: missing"),
    ],
)
def test_changes_are_refused_as_a_scene_file_is(small: Path, changes: dict, words: str) -> None:
    for scene in (load_scene(small), load_scene(small).with_changes({"time.fps": 12.0})):
        with pytest.raises(InputError) as caught:
            scene.with_changes(changes)
        assert words in str(caught.value) and "\n" not in str(caught.value)


def test_changes_of_a_scene_without_a_file_are_refused_by_its_name() -> None:
    tables = {"leaf": {"image": "leaf.png", "length": 0.1}, "time": {"duration": 1.0}, "fluid": {}}
    scene = Scene.model_validate(tables | {"name": "mine", "structure": {"membrane_stiffness": 5.0}})
    with pytest.raises(InputError, match=r"^mine: time\.frames = 0: accepted: 1 to 1000000"):
        scene.with_changes({"time.frames": 0})


@pytest.mark.parametrize(
    ("change", "key", "value"),
    [
        ("maps.water='60 %'", "maps.water", 0.6),
        ("source={conductance = 1.0, supply = '90 %'}", "source.supply", 0.9),
        ("source.conductance='20 h^-1'", "source.conductance", 20.0 / 3600.0),
        ("leaf.camber='2 %'", "leaf.camber", 0.02),
        ("shrink.vein_resistance='50 %'", "shrink.vein_resistance", 0.5),
        ("shrink.curve=[['100 %', '0 %'], ['20 %', '30 %']]", "shrink.curve", ((0.2, 0.3), (1.0, 0.0))),
        ("structure.damping='5 %'", "structure.damping", 0.05),
        ("material.shrink_across='15 %'", "material.shrink_across", 0.15),
        ("material.mismatch='-1 %'", "material.mismatch", -0.01),
        ("material.wilted_stiffness='30 %'", "material.wilted_stiffness", 0.3),
        ("material.plastic_set='40 %'", "material.plastic_set", 0.4),
    ],
)
def test_fractions_may_be_percent(small: Path, change: str, key: str, value) -> None:
    table, name = key.split(".")
    held = getattr(getattr(load_scene(small, [change]), table), name)
    assert np.ravel(held) == pytest.approx(np.ravel(value))


def test_what_happens_after_the_end_is_warned_of(small: Path) -> None:
    plain = "source={conductance = 1e-3, cut_at = '30 min', rewatered_at = '1 h'}"
    assert load_scene(small, [plain]).warnings == ()
    late, later = load_scene(small, ["source={conductance = 1e-3, cut_at = '2 h', rewatered_at = '3 h'}"]).warnings
    assert late.startswith(
        "source.cut_at = 7200 s: the leaf is never cut off; usual: before the end, time.duration = 7200 s"
    )
    assert later.startswith("source.rewatered_at = 10800 s: the leaf is never rewatered; usual: before the end")


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


def number_keys() -> dict[str, dict]:
    """What the JSON Schema says of every key of a table that is, or may be, one number."""
    schema = Scene.model_json_schema()
    fields = {
        f"{table}.{key}": field
        for table in Scene.model_fields
        if f"{table.capitalize()}Table" in schema["$defs"]
        for key, field in schema["$defs"][f"{table.capitalize()}Table"]["properties"].items()
    }
    return {key: field for key, field in sorted(fields.items()) if number_of(field)}


def number_of(field: dict) -> dict | None:
    """The alternative of a key's schema that is a number."""
    return next((a for a in field.get("anyOf", [field]) if a.get("type") in ("number", "integer")), None)


def refusal(name: str, value: float) -> str:
    """What the validator says of a value of a key; empty if it is accepted."""
    table, key = name.split(".")
    annotation = Scene.model_fields[table].annotation
    model = next(part for part in (annotation, *getattr(annotation, "__args__", ())) if hasattr(part, "model_fields"))
    try:
        model.model_validate({key: value})
    except ValidationError as error:
        return "; ".join(found["msg"] for found in error.errors() if found["loc"][:1] == (key,))
    return ""


NUMBERS = number_keys()
# All other numbers are bounded on both sides.
WITHOUT_LARGEST = {
    "fluid.step",
    "fluid.lamina_diffusivity",
    "fluid.vein_diffusivity",
    "transpiration.rate",
    "transpiration.cuticle_rate",
    "source.conductance",
    "source.cut_at",
    "source.rewatered_at",
    "motion.pin_radius",
}


@pytest.mark.parametrize("name", NUMBERS)
def test_the_schema_has_the_limits_of_every_number(name: str) -> None:
    number = number_of(NUMBERS[name])
    low = number.get("minimum", number.get("exclusiveMinimum"))
    high = number.get("maximum", number.get("exclusiveMaximum"))
    assert low is not None and (high is None) == (name in WITHOUT_LARGEST)
    for bound, excluded, outward in (
        (low, "exclusiveMinimum" in number, -math.inf),
        (high, "exclusiveMaximum" in number, math.inf),
    ):
        if bound is not None:
            whole = number["type"] == "integer"
            past = bound + int(math.copysign(1, outward)) if whole else math.nextafter(bound, outward)
            assert refusal(name, past)
            assert bool(refusal(name, bound)) == excluded


def test_the_schema_documents_every_unit() -> None:
    """The number's in SI, and in words with the key; the other units that a string may have."""
    quantities = 0
    for name, field in NUMBERS.items():
        for unit in re.findall(r"^\[(.+)\]$", number_of(field).get("description", "")):
            quantities += 1
            assert f"[{unit}]" in field["description"].replace("^", ""), name
            (string,) = [a for a in field["anyOf"] if "description" in a and a["type"] == "string"]
            units = next(units for units in UNITS.values() if next(iter(units)) == unit)
            assert string == {"type": "string", "description": f"a number with a unit: {', '.join(units)}"}
    assert quantities > 20


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_scenes_are_valid(path: Path) -> None:
    scene = load_scene(path)
    assert scene.name == path.stem
    assert scene.leaf.image.is_file()
