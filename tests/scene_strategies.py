"""Random valid scenes from the whole range that a scene accepts, small enough to be computed in a fraction of a second.

Keys and their bounds are those of the scene's own JSON Schema, so that a new key is drawn, too. What is said here is
what the schema cannot say: usual values where there is no default, what keeps a scene small, and what keys ask of each
other.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hypothesis import reject
from hypothesis import strategies as st

from leafwarp.errors import InputError
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import DECIDED, Resolution
from leafwarp.scene.warnings import USUAL

SCHEMA = Scene.model_json_schema()
TABLES = {
    name: choice["$ref"].rpartition("/")[2]
    for name, key in SCHEMA["properties"].items()
    for choice in (key, *key.get("anyOf", ()))
    if "$ref" in choice
}
METHODS = SCHEMA["$defs"][TABLES["motion"]]["properties"]["method"]["enum"]
# What a usual number is near, or its range, where the scene has no default and knows no usual range.
TYPICAL = {
    "leaf.length": 0.08,
    "leaf.pixels_per_metre": 1000.0,
    "time.duration": 3e4,
    "transpiration.rate": 2e-5,
    "source.conductance": 1e-3,
    "source.cut_at": 1e4,
    "structure.membrane_stiffness": 5.0,
    "structure.bending_stiffness": 1e-5,
    "structure.vein_bending_stiffness": 2.0,
    "motion.pin_radius": 0.01,
    "motion.gravity": (-3.0, 1.0),
    "motion.wind": (-2.0, 2.0),
    "leaves.spacing": 0.1,
    "time.fps": 60.0,
    "solver.coupling_interval": 1e4,
    "solver.substep": (0.5, 1.0),
    "air.vapour_pressure_deficit": 1500.0,
}
# The same for the two numbers of a curve's points.
OF_POINTS = {
    "water.curve": ((0.0, 6e4), (0.0, 1.0)),
    "shrink.curve": ((0.0, 1.0), (0.0, 0.3)),
    "curl.mismatch": ((0.0, 1.0), (-0.02, 0.02)),
    "structure.stiffness": ((0.0, 1.0), (0.3, 2.0)),
    "structure.wilting": ((0.0, 1.0), (0.3, 1.0)),
    "structure.drying": ((0.0, 1.0), (1.0, 2.0)),
    "transpiration.closure": ((0.0, 1.0), (0.0, 1.0)),
    "stomata.closure": ((0.0, 1.0), (0.0, 1.0)),
}
# What keeps a scene small: instead of what the schema allows.
SMALL: dict[str, st.SearchStrategy] = {
    "mesh.vertices": st.sampled_from((30, 45)),
    "maps.size": st.sampled_from((1, 2, 9, 24, [1, 24], [24, 1], [1, 2], [13, 24])),
    "time.frames": st.integers(1, 4),
    "leaves.count": st.integers(1, 3),
    "leaf.seed": st.integers(0, 1),
    "leaves.seed": st.integers(0, 5),
    "leaf.holes": st.just("fill"),
    "solver.maximum_substeps": st.sampled_from((1, 32, 256, 256)),
    "output.contact_sheet": st.just(False),
    "output.texture_limit": st.just(32),
}
# Pictures, which the pictures' own tests damage, and what goes with one picture alone.
LEFT_OUT = {"leaf.image", "leaf.mask", "leaf.rect", "leaf.base", "maps.venation", "maps.stomata", "maps.source",
            "leaves.photos"}  # fmt: skip
MOST_FLUID_STEPS = 40
MOST_LONGEST_STEPS, LEAST_STEP_TOLERANCE = 4, 1e-3  # where steps adapt
MOST_COUPLINGS = 12
LENGTH_IN_PIXELS = 70.0  # of the leaf in the picture, at least
SHARES = st.integers(0, 1000).map(lambda count: count / 1000)  # floats would be 0 or 1 too often
SMALLEST, LARGEST = 1e-12, 1e15  # where a bound is 0 or there is none
# Cells across, vertices and fluid steps of the coarsest level, instead of the product's.
SMALL_LEVEL = (10, 40, 12)


def small_resolution(level: int) -> Resolution:
    """A level that is coarser than the product's, to be put in the place of :meth:`Resolution.of`."""
    finer = 2.0 ** (level / 2)
    cells, vertices, fluid_steps = SMALL_LEVEL
    return Resolution(round(cells * finer), round(vertices * finer**2), round(fluid_steps * finer))


def without_decided(scene_file: Path, **top) -> dict:
    """The tables of a scene file without what a quality or a tolerance decides, and with others on top."""
    data = load_scene(scene_file).model_dump(exclude_unset=True)
    for key in DECIDED:
        table, _, name = key.partition(".")
        data.get(table, {}).pop(name, None)
    return {**data, **top}


def numbers(low: float, high: float, near: tuple[float, float] | None, extreme: float) -> st.SearchStrategy[float]:
    """Numbers between two bounds.

    Args:
        low: Least.
        high: Largest.
        near: Usual range; None for none.
        extreme: Share of numbers of any order of magnitude, or at a bound; the others are usual.
    """

    def magnitudes(least: float, most: float) -> st.SearchStrategy[float]:
        least = max(least, min(SMALLEST, most))
        span = math.log(most / least)
        return SHARES.map(lambda share: min(most, max(least, least * math.exp(share * span))))

    parts = [st.just(low), st.just(high)] if high < LARGEST else [st.just(low)]
    if high > 0.0:
        parts.append(magnitudes(max(low, 0.0), high))
    if low < 0.0:
        parts.append(magnitudes(max(-high, 0.0), -low).map(lambda value: -value))
    whole = st.one_of(parts)
    if near is None:
        return whole
    usual = st.floats(max(low, near[0]), min(high, near[1])) if max(low, near[0]) < min(high, near[1]) else st.just(low)
    return SHARES.flatmap(lambda chance: whole if chance < extreme else usual)


def _near(key: str, default: Any) -> tuple[float, float] | None:
    """The usual range of a key."""
    if key in USUAL:
        return USUAL[key].low, USUAL[key].high
    middle = TYPICAL.get(key, default)
    if isinstance(middle, tuple):
        return middle
    if isinstance(middle, bool) or not isinstance(middle, int | float):
        return None
    return (0.1 * middle, 10.0 * middle) if middle > 0.0 else (0.0, 1.0)


def values(
    schema: Mapping[str, Any], key: str, extreme: float, near: tuple[float, float] | None = None
) -> st.SearchStrategy:
    """Values of a key.

    Args:
        schema: Its JSON Schema.
        key: Its dotted name; empty for a part of it.
        extreme: Share of numbers that are not usual.
        near: Usual range of a number; None for that of the key.
    """
    if key in SMALL:
        return SMALL[key]
    choices = [choice for choice in schema.get("anyOf", [schema]) if _says_its_values(choice)]
    if not choices:
        raise ValueError(f"{key}: the strategies know no values of {schema}")
    return st.one_of([_of_one_kind(choice, schema.get("default"), key, extreme, near) for choice in choices])


def _says_its_values(choice: Mapping[str, Any]) -> bool:
    """Whether an alternative of a key's type says which values it has: no path, no quantity as a text, not none."""
    return "enum" in choice or "const" in choice or choice["type"] in ("boolean", "integer", "number", "array")


def _of_one_kind(
    choice: Mapping[str, Any], default: Any, key: str, extreme: float, near: tuple[float, float] | None
) -> st.SearchStrategy:
    """Values of one alternative of a key's type."""
    if "enum" in choice or "const" in choice:
        return st.sampled_from(choice.get("enum", [choice.get("const")]))
    kind = choice["type"]
    if kind == "boolean":
        return st.booleans()
    if kind == "integer":
        usual = st.just(choice["minimum"] if default is None else default)
        return st.one_of(usual, st.integers(choice["minimum"], choice["maximum"]))
    if kind == "number":
        above, below = choice.get("exclusiveMinimum"), choice.get("exclusiveMaximum")
        low = choice.get("minimum", 0.0) if above is None else max(SMALLEST, above * (1.0 + 1e-9))
        high = choice.get("maximum", LARGEST) if below is None else below * (1.0 - 1e-9)
        return numbers(low, high, near or _near(key, default), extreme)
    if "prefixItems" in choice:
        return st.tuples(*(values(item, key, extreme) for item in choice["prefixItems"])).map(list)
    of_point = zip(choice["items"]["prefixItems"], OF_POINTS.get(key, (None, None)), strict=True)
    point = st.tuples(*(values(item, "", extreme, near) for item, near in of_point)).map(list)
    return st.lists(point, min_size=1, max_size=4, unique_by=lambda at: at[0])


@functools.cache
def table(name: str, extreme: float) -> st.SearchStrategy[dict[str, Any]]:
    """The keys of a table, each that has a default being left out at times."""
    schema = SCHEMA["$defs"][TABLES[name]]
    drawn = {
        key: values(one, f"{name}.{key}", extreme)
        for key, one in schema["properties"].items()
        if f"{name}.{key}" not in LEFT_OUT
    }
    required = {key: drawn.pop(key) for key in schema.get("required", ()) if key in drawn}
    return st.fixed_dictionaries(required, optional=drawn)


@st.composite
def scenes(draw: st.DrawFn, image: str) -> Scene:
    """A valid scene of a picture.

    Args:
        draw: Of Hypothesis.
        image: The picture's path.
    """
    extreme = draw(st.sampled_from((0.0, 0.03, 0.1, 0.4)))
    data = {
        name: draw(table(name, extreme))
        for name in ("leaf", "mesh", "maps", "time", "structure", "motion", "solver", "output")
    }
    flows = draw(st.booleans())
    names = ["fluid" if flows else "water", "shrink", "curl", "material", "leaves"]
    names += ["transpiration", "source", "air"] if flows else []
    always = (names[0], "transpiration")
    chances = {"leaves": 0.2, "material": 0.3, "air": 0.3}
    data |= {
        name: draw(table(name, extreme)) for name in names if name in always or draw(SHARES) < chances.get(name, 0.6)
    }
    if "material" not in data:
        data["motion"]["method"] = draw(st.sampled_from(METHODS))
    if "air" in data:
        data["stomata"] = draw(table("stomata", extreme))
        del data["transpiration"]
    make_valid(data)
    if "leaves" not in data and draw(SHARES) < 0.3:
        _leave_to_decide(draw, data)
    data["leaf"]["image"] = image
    while True:
        try:
            return Scene.checked(data, "")
        except InputError as error:
            # A map that nothing depends on.
            unused = str(error).partition("maps.")[2].partition(" is given")[0]
            if data["maps"].pop(unused, None) is None:
                reject()


def _leave_to_decide(draw: st.DrawFn, data: dict[str, Any]) -> None:
    """Leave out some of the keys that a quality or a tolerance decides, and give one."""
    for key in draw(st.sets(st.sampled_from(DECIDED), min_size=1)):
        name, _, value = key.partition(".")
        data.get(name, {}).pop(value, None)
    if draw(st.booleans()):
        data["quality"] = "draft"
    else:
        data["tolerance"] = draw(st.sampled_from((1e-4, 1e-3, 0.1)))


def make_valid(data: dict[str, Any]) -> None:
    """Change what keys do not allow each other."""
    leaf = data["leaf"]
    if ("length" in leaf) == ("pixels_per_metre" in leaf):
        leaf.pop("pixels_per_metre", None)
        leaf["length"] = leaf.get("length", TYPICAL["leaf.length"])
    data["time"].setdefault("frames", 3)
    data["mesh"].setdefault("vertices", 30)
    data["maps"].setdefault("size", 12)
    data["solver"].setdefault("maximum_substeps", 256)
    if "coupling_interval" in data["solver"]:
        least = data["time"]["duration"] / MOST_COUPLINGS
        data["solver"]["coupling_interval"] = max(least, data["solver"]["coupling_interval"])
    if "material" in data:
        _make_material_valid(data["material"])
    _make_water_valid(data)
    _make_structure_valid(data)
    if "leaves" in data:
        data["motion"]["method"] = "explicit"
        if "fluid" not in data:
            data["leaves"].pop("water", None)
        elif data["fluid"].get("solver") == "conjugate_gradients":
            del data["fluid"]["solver"]
    _make_motion_valid(data)


def _make_water_valid(data: dict[str, Any]) -> None:
    if "fluid" in data:
        fluid, most = data["fluid"], MOST_FLUID_STEPS
        if any(data.get(name, {}).get("plastic_set", 0.0) > 0.0 for name in ("shrink", "curl", "material")):
            fluid.pop("step_tolerance", None)
        if "step_tolerance" in fluid:
            fluid |= {"order": 2, "step_tolerance": max(LEAST_STEP_TOLERANCE, fluid["step_tolerance"])}
            most = MOST_LONGEST_STEPS
        fluid["step"] = max(data["time"]["duration"] / most, fluid.get("step", 60.0))
    if "water" in data:
        data["water"]["curve"].sort()
    if "transpiration" in data:
        _order(data["transpiration"], "cuticle_rate", "rate")
    if "source" in data:
        source = data["source"]
        _order(source, "cut_at", "rewatered_at")
        if "cut_at" not in source or source.get("rewatered_at") == source["cut_at"]:
            source.pop("rewatered_at", None)
    if "stomata" in data:
        _order(data["stomata"], "minimum_conductance", "open_conductance", 5.1e-3)
        _make_air_valid(data["air"])
        if "material" not in data:
            data["stomata"].setdefault("closure", [[0.8, 0.0], [1.0, 1.0]])
        if data["structure"].get("water_mass") == 0.0:
            del data["structure"]["water_mass"]


def _make_air_valid(air: dict[str, Any]) -> None:
    if ("relative_humidity" in air) == ("vapour_pressure_deficit" in air):
        air.pop("vapour_pressure_deficit", None)
        air.setdefault("relative_humidity", 0.5)
    if "vapour_pressure_deficit" in air:
        air.pop("temperature", None)
        air["vapour_pressure_deficit"] = min(air["vapour_pressure_deficit"], 0.9 * air.get("pressure", 1e5))
    elif air.get("temperature", 298.15) > 280.0:  # water boils in thin air
        air.pop("pressure", None)


def _make_structure_valid(data: dict[str, Any]) -> None:
    structure = data["structure"]
    if "material" not in data:
        structure.setdefault("membrane_stiffness", TYPICAL["structure.membrane_stiffness"])
        data.get("shrink", {}).setdefault("curve", [[1.0, 0.0], [0.2, 0.2]])
        data.get("curl", {}).setdefault("mismatch", [[1.0, 0.0], [0.2, 0.01]])
    if ("curl" in data or "bending" in structure) and not structure.get("bending_stiffness"):
        structure["bending_stiffness"] = TYPICAL["structure.bending_stiffness"]
    if "along_veins" in data.get("shrink", {}):
        most = max(value for _, value in data["shrink"].get("curve", [[0.0, 0.95]]))
        data["shrink"]["along_veins"] = min(data["shrink"]["along_veins"], 0.95 / max(most, 0.095))


def _make_motion_valid(data: dict[str, Any]) -> None:
    motion, leaf = data["motion"], data["leaf"]
    if "pin_radius" in motion:  # a larger one holds a leaf of a tenth of the size, which others have, as a whole
        length = leaf.get("length", LENGTH_IN_PIXELS / leaf.get("pixels_per_metre", 1.0))
        motion["pin_radius"] = min(motion["pin_radius"], 0.03 * length)
    if motion.get("method", "quasistatic" if "material" in data else "explicit") != "explicit":
        data["solver"].pop("precision", None)
        data["structure"].pop("bending", None)
    if "wind" in motion and motion.get("drag") == 0.0:
        del motion["drag"]
    if "wind" not in motion and not any(motion.get("gravity", ())):
        motion.pop("settle", None)


def _order(values: dict[str, Any], small: str, large: str, default: float = 0.0) -> None:
    """Let one number of a table be no larger than another."""
    if large in values and values.get(small, default) > values[large]:
        values[small], values[large] = values[large], values.get(small, default)


def _make_material_valid(material: dict[str, Any]) -> None:
    """Leave out of a material what cannot be with the rest, and what makes other keys leave their bounds."""
    scene = {"leaf": {"image": "x", "length": 1.0}, "time": {"duration": 1.0}, "water": {"curve": [[0.0, 1.0]]}}
    while True:
        try:
            Scene.checked({**scene, "material": material}, "")
            return
        except InputError as error:
            del material[next((key for key in material if key in str(error)), next(iter(material)))]
