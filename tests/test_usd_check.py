"""``check_usd`` finds each fault that is planted into a sound file, and says nothing of a sound one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from leafwarp.usd.check import check_usd
from leafwarp.usd.writer import UsdWriter
from usd_sample import sample_frame, sample_leaf, write_sample

COUNT = 4
MESH = "/Leaf/geo/leaf"
SURFACE = "/Leaf/mtl/photo/surface"
TEXTURE = "/Leaf/mtl/photo/texture"


def attribute(stage: Usd.Stage, name: str) -> Usd.Attribute:
    return stage.GetPrimAtPath(MESH).GetAttribute(name)


def put(name: str, value: Callable[[np.ndarray], np.ndarray], time: float | None = 2.0) -> Callable[[Usd.Stage], None]:
    """Plants a changed array at one time (None: the default)."""

    def plant(stage: Usd.Stage) -> None:
        target = attribute(stage, name)
        code = Usd.TimeCode.Default() if time is None else time
        old = target.Get(code)
        target.Set(type(old).FromNumpy(np.ascontiguousarray(value(np.array(old)))), code)

    return plant


def spoiled(index: int | tuple[int, int], value: float) -> Callable[[np.ndarray], np.ndarray]:
    """An array with one element replaced."""

    def change(array: np.ndarray) -> np.ndarray:
        array[index] = value
        return array

    return change


def clear(key: str) -> Callable[[Usd.Stage], None]:
    return lambda stage: stage.GetRootLayer().pseudoRoot.ClearInfo(key)


def texture_path(path: str) -> Callable[[Usd.Stage], None]:
    def plant(stage: Usd.Stage) -> None:
        UsdShade.Shader(stage.GetPrimAtPath(TEXTURE)).GetInput("file").Set(Sdf.AssetPath(path))

    return plant


def no_time_range(stage: Usd.Stage) -> None:
    clear("startTimeCode")(stage)
    clear("endTimeCode")(stage)


def no_kind(stage: Usd.Stage) -> None:
    stage.GetRootLayer().GetPrimAtPath("/Leaf").ClearInfo("kind")


def no_default(name: str) -> Callable[[Usd.Stage], None]:
    return lambda stage: attribute(stage, name).ClearDefault()


def fractional_time(stage: Usd.Stage) -> None:
    for target in stage.GetPrimAtPath(MESH).GetAuthoredAttributes():
        if target.GetNumTimeSamples():
            target.Set(target.Get(2.0), 2.5)


def animated_topology(stage: Usd.Stage) -> None:
    target = attribute(stage, "faceVertexIndices")
    for time in range(1, COUNT + 1):
        target.Set(target.Get(), time)


def one_sample_missing(stage: Usd.Stage) -> None:
    attribute(stage, "primvars:water").ClearAtTime(3.0)


def indexed_primvar_out_of_range(stage: Usd.Stage) -> None:
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(MESH)).CreatePrimvar(
        "zone", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.vertex
    )
    primvar.Set(Vt.IntArray([5, 6]))
    primvar.SetIndices(Vt.IntArray([0] * 39 + [2]))


def empty_static_primvar(stage: Usd.Stage) -> None:
    attribute(stage, "primvars:st").Set(Vt.Vec2fArray())


def no_binding_api(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath(MESH).RemoveAPI(UsdShade.MaterialBindingAPI)


def surface_of_wrong_type(stage: Usd.Stage) -> None:
    prim = stage.GetPrimAtPath(SURFACE)
    prim.RemoveProperty("inputs:roughness")
    prim.CreateAttribute("inputs:roughness", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(1))


def no_mesh(stage: Usd.Stage) -> None:
    stage.RemovePrim(MESH)


def missing_sublayer(stage: Usd.Stage) -> None:
    stage.GetRootLayer().subLayerPaths.append("./gone.usda")


FAULTS = {
    "NaN point": (put("points", spoiled((3, 1), np.nan)), "points: NaN or infinite values at 2"),
    "infinite rest point": (
        put("points", spoiled((3, 1), np.inf), None),
        "points: NaN or infinite values at rest",
    ),
    "NaN water": (put("primvars:water", spoiled(3, np.nan)), "primvars:water: NaN or infinite values at 2"),
    "NaN st": (
        put("primvars:st", spoiled((3, 0), np.nan), None),
        "primvars:st: NaN or infinite values at rest",
    ),
    "too few points": (put("points", lambda points: points[1:]), "points: 39 values at 2, 40 expected"),
    "short primvar": (
        put("primvars:water", lambda water: water[1:]),
        "primvars:water: 39 values at 2, 40 expected",
    ),
    "long rest primvar": (
        put("primvars:water", lambda water: np.append(water, water), None),
        "primvars:water: 80 values at rest, 40 expected",
    ),
    "short velocities": (
        put("velocities", lambda array: array[1:]),
        "velocities: 39 values at 2, 40 expected",
    ),
    "short normals": (put("normals", lambda array: array[1:]), "normals: 39 values at 2, 40 expected"),
    "long normals": (
        put("normals", lambda array: 2 * array),
        "normals: lengths differ from 1 by up to 1 at 2",
    ),
    "empty static primvar": (empty_static_primvar, "primvars:st: 0 values at rest, 40 expected"),
    "primvar index out of range": (indexed_primvar_out_of_range, "primvars:zone: index 2 is out of range"),
    "no time range": (no_time_range, "stage: animated, but no startTimeCode and endTimeCode"),
    "time range reversed": (
        lambda stage: stage.SetStartTimeCode(9),
        "startTimeCode 9 is after endTimeCode 4",
    ),
    "samples outside": (
        lambda stage: stage.SetEndTimeCode(3),
        "points: samples 1 to 4 lie outside the time range 1 to 3",
    ),
    "samples missing": (
        lambda stage: stage.SetEndTimeCode(9),
        "points: samples 1 to 4 do not cover the time range 1 to 9",
    ),
    "fractional time code": (fractional_time, "points: time code 2.5 is not a whole frame"),
    "sample times differ": (one_sample_missing, "primvars:water: has samples at other times than the points"),
    "rates differ": (
        lambda stage: stage.SetFramesPerSecond(24),
        "timeCodesPerSecond 30 is not framesPerSecond 24",
    ),
    "no kind": (no_kind, "/Leaf: kind '' is missing"),
    "no default prim": (clear("defaultPrim"), "stage: no default prim"),
    "no unit": (clear("metersPerUnit"), "stage: no metersPerUnit"),
    "no up axis": (clear("upAxis"), "stage: no upAxis"),
    "vertex twice in a face": (
        put("faceVertexIndices", spoiled(1, 0), None),
        "1 faces use a vertex twice, the first is face 0",
    ),
    "index out of range": (
        put("faceVertexIndices", spoiled(1, 40), None),
        "faceVertexIndices: 40 is out of range",
    ),
    "negative index": (
        put("faceVertexIndices", spoiled(1, -1), None),
        "faceVertexIndices: -1 is out of range",
    ),
    "counts do not fit": (put("faceVertexCounts", spoiled(0, 4), None), "faceVertexCounts add up to 169"),
    "animated topology": (animated_topology, "faceVertexIndices: is animated"),
    "no default": (no_default("points"), "points: animated without a default value"),
    "no default of a primvar": (
        no_default("primvars:water"),
        "primvars:water: animated without a default value",
    ),
    "extent too small": (
        put("extent", lambda extent: extent * np.float32(0.9)),
        "extent: does not hold the points at 2",
    ),
    "no extent": (lambda stage: stage.GetPrimAtPath(MESH).RemoveProperty("extent"), "extent: missing"),
    "absolute texture": (texture_path("/tmp/leaf_texture.png"), "path '/tmp/leaf_texture.png' is absolute"),
    "texture by drive": (texture_path("C:\\leaf.png"), "leaf.png' is absolute"),
    "missing texture": (texture_path("./gone.png"), "file './gone.png' does not exist"),
    "no binding API": (no_binding_api, "MaterialBindingAPI"),  # USD's own validator
    "shader input of a wrong type": (surface_of_wrong_type, "MismatchedPropertyType"),  # USD's own validator
    "no mesh": (no_mesh, "stage: no mesh"),
    "missing sublayer": (missing_sublayer, "stage: Could not load sublayer"),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    return write_sample(tmp_path_factory.mktemp("sound") / "leaf.usda", COUNT, color=True)


def test_a_sound_file_has_no_problem(sound):
    assert check_usd(sound) == []


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(sound, tmp_path, fault):
    plant, expected = FAULTS[fault]
    shutil.copytree(sound.parent, tmp_path, dirs_exist_ok=True)
    stage = Usd.Stage.Open(str(tmp_path / "leaf.usda"))
    plant(stage)
    stage.GetRootLayer().Save()
    problems = check_usd(tmp_path / "leaf.usda")
    assert any(expected in problem for problem in problems), problems
    assert all("\n" not in problem for problem in problems)


@pytest.mark.parametrize("content", (b"", b"not a usd", b"PXR-USDC", b"#usda 1.0\ndef {"))
def test_a_broken_file_is_one_problem(tmp_path, content):
    path = tmp_path / "leaf.usd"
    path.write_bytes(content)
    problems = check_usd(path)
    assert len(problems) == 1 and str(path) in problems[0] and "\n" not in problems[0]
    assert "cannot be opened as USD: " in problems[0]


def test_a_truncated_file_is_a_problem(sound, tmp_path):
    path = write_sample(tmp_path / "leaf.usdc", COUNT)
    path.write_bytes(path.read_bytes()[:-200])
    assert check_usd(path)


def test_a_missing_file_is_one_problem(tmp_path):
    assert check_usd(tmp_path / "gone.usd") == [f"{tmp_path / 'gone.usd'}: no such file"]


def test_an_unfinished_run_is_told_unless_it_is_fine(tmp_path):
    leaf, path = sample_leaf(), tmp_path / "leaf.usd"
    writer = UsdWriter(path, leaf, sample_frame(leaf, 0), frames=range(1, 10), fps=30.0)
    assert check_usd(path) == [f"{MESH}: points: no sample in the time range 1 to 9"]
    assert check_usd(path, unfinished=True) == []
    writer.write(sample_frame(leaf, 1))
    assert check_usd(path) == [f"{MESH}: points: samples 1 to 1 do not cover the time range 1 to 9"]
    assert check_usd(path, unfinished=True) == []
    (tmp_path / "leaf_texture.png").unlink()
    assert any("does not exist" in problem for problem in check_usd(path, unfinished=True))
