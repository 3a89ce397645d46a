"""The USD that a finished run leaves: values bit for bit, structure, axes, variants, names, bytes."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Kind, Sdf, Usd, UsdGeom, UsdShade

from leafwarp.errors import InputError, OutputError, SimulationError
from leafwarp.usd.check import check_usd
from leafwarp.usd.writer import UsdWriter
from usd_sample import FPS, open_afresh, sample_frame, sample_leaf, write_sample

COUNT = 6
SUFFIXES = ("usd", "usdc", "usda")


@pytest.fixture
def read_mesh() -> Callable[[Path], UsdGeom.Mesh]:
    """Opens a USD afresh and gives its mesh; a stage must outlive what is read of it."""
    stages: list[Usd.Stage] = []

    def read(path: Path) -> UsdGeom.Mesh:
        stages.append(open_afresh(path))
        return UsdGeom.Mesh(stages[-1].GetPrimAtPath("/Leaf/geo/leaf"))

    return read


def primvar(mesh: UsdGeom.Mesh, name: str) -> Usd.Attribute:
    return UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name).GetAttr()


def assert_same_bits(attribute: Usd.Attribute, time, expected: np.ndarray) -> None:
    found = np.asarray(attribute.Get(time))
    assert found.dtype == np.float32
    assert found.tobytes() == np.ascontiguousarray(expected, np.float32).tobytes(), (
        attribute.GetPath(),
        time,
    )


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_array_reads_back_bit_for_bit(tmp_path, read_mesh, suffix):
    mesh = read_mesh(write_sample(tmp_path / f"leaf.{suffix}", COUNT, color=True))
    leaf = sample_leaf()
    for index in range(COUNT + 1):
        time = index or Usd.TimeCode.Default()
        frame = sample_frame(leaf, index, COUNT, color=True)
        assert_same_bits(mesh.GetPointsAttr(), time, frame.points)
        assert_same_bits(mesh.GetNormalsAttr(), time, frame.normals)
        assert_same_bits(mesh.GetVelocitiesAttr(), time, frame.velocities)
        assert_same_bits(mesh.GetExtentAttr(), time, [frame.points.min(axis=0), frame.points.max(axis=0)])
        assert_same_bits(primvar(mesh, "water"), time, frame.water)
        assert_same_bits(primvar(mesh, "displayColor"), time, frame.color)


def test_topology_and_st_stand_still(tmp_path, read_mesh):
    mesh, leaf = read_mesh(write_sample(tmp_path / "leaf.usd", COUNT)), sample_leaf()
    counts, indices = mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()
    assert np.array_equal(indices.Get(), leaf.mesh.triangles.ravel())
    assert np.array_equal(counts.Get(), np.full(leaf.mesh.triangle_count, 3))
    assert_same_bits(primvar(mesh, "st"), Usd.TimeCode.Default(), leaf.uv)
    for attribute in (counts, indices, primvar(mesh, "st")):
        assert attribute.GetNumTimeSamples() == 0
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert mesh.GetDoubleSidedAttr().Get() is True
    assert mesh.GetNormalsInterpolation() == "vertex"
    assert UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").GetInterpolation() == "vertex"
    assert UsdGeom.PrimvarsAPI(mesh).GetPrimvar("water").GetInterpolation() == "vertex"


def test_stage_facts(tmp_path):
    write_sample(tmp_path / "leaf.usd", COUNT, metadata={"seed": "7", "a:b": "colon"})
    stage = open_afresh(tmp_path / "leaf.usd")
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/Leaf" and root.IsA(UsdGeom.Xform)
    assert Usd.ModelAPI(root).GetKind() == Kind.Tokens.component
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and stage.HasAuthoredMetadata("upAxis")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, COUNT)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == FPS
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Leaf/geo/leaf")).GetPointsAttr()
    assert points.GetTimeSamples() == [float(index) for index in range(1, COUNT + 1)]
    assert stage.GetRootLayer().customLayerData == {"leafwarp": {"seed": "7", "a:b": "colon"}}
    assert len(stage.GetLayerStack(includeSessionLayers=False)) == 1  # one file, nothing beside it but the texture


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("color", (False, True))
@pytest.mark.parametrize("up_axis", ("Y", "Z"))
def test_validators_and_own_check_find_nothing(tmp_path, suffix, color, up_axis):
    assert check_usd(write_sample(tmp_path / f"leaf.{suffix}", COUNT, color, up_axis=up_axis)) == []


def test_y_up_turns_every_vector(tmp_path, read_mesh):
    z_up = read_mesh(write_sample(tmp_path / "z.usd", COUNT))
    y_up = read_mesh(write_sample(tmp_path / "y.usd", COUNT, up_axis="Y"))
    assert UsdGeom.GetStageUpAxis(y_up.GetPrim().GetStage()) == "Y"
    for name in ("points", "normals", "velocities"):
        for time in (Usd.TimeCode.Default(), 3.0):
            x, y, z = np.asarray(z_up.GetPrim().GetAttribute(name).Get(time)).T
            turned = y_up.GetPrim().GetAttribute(name)
            assert np.array_equal(turned.Get(time), np.stack((x, z, -y), axis=1))
    points, extent = np.asarray(y_up.GetPointsAttr().Get(3.0)), np.asarray(y_up.GetExtentAttr().Get(3.0))
    assert np.array_equal(extent, [points.min(axis=0), points.max(axis=0)])
    # The photographed face still looks up, and the triangles still run counter-clockwise seen from there.
    rest, triangles = np.asarray(y_up.GetPointsAttr().Get()), sample_leaf().mesh.triangles
    a, b, c = (rest[triangles[:, corner]] for corner in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()


def bound_material(mesh: UsdGeom.Mesh) -> UsdShade.Material:
    return UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]


def diffuse_source(mesh: UsdGeom.Mesh) -> UsdShade.Shader:
    surface = bound_material(mesh).ComputeSurfaceSource()[0]
    return UsdShade.Shader(surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source.GetPrim())


def test_photo_is_bound_with_a_relative_texture(tmp_path, read_mesh):
    mesh = read_mesh(write_sample(tmp_path / "leaf.usd", COUNT))
    assert mesh.GetPrim().HasAPI(UsdShade.MaterialBindingAPI)
    image = diffuse_source(mesh)
    assert image.GetShaderId() == "UsdUVTexture"
    assert image.GetInput("file").Get().path == "./leaf_texture.png"
    reader = UsdShade.Shader(image.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
    assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == ("UsdPrimvarReader_float2", "st")
    stored = cv2.cvtColor(cv2.imread(str(tmp_path / "leaf_texture.png")), cv2.COLOR_BGR2RGB)
    assert np.array_equal(stored, sample_leaf().texture)
    assert not mesh.GetPrim().GetStage().GetDefaultPrim().GetVariantSets().GetNames()


def test_shading_variants_switch_photo_and_water(tmp_path, read_mesh):
    mesh = read_mesh(write_sample(tmp_path / "leaf.usd", COUNT, color=True))
    variants = mesh.GetPrim().GetStage().GetDefaultPrim().GetVariantSet("shading")
    assert variants.GetVariantNames() == ["photo", "water"]
    assert variants.GetVariantSelection() == "photo"
    assert diffuse_source(mesh).GetShaderId() == "UsdUVTexture"
    variants.SetVariantSelection("water")
    reader = diffuse_source(mesh)
    assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == (
        "UsdPrimvarReader_float3",
        "displayColor",
    )
    assert "ramp of primvars:water" in primvar(mesh, "displayColor").GetDocumentation()


def test_color_that_was_not_asked_for_is_not_written(tmp_path, read_mesh):
    leaf = sample_leaf()
    path = tmp_path / "leaf.usd"
    with UsdWriter(path, leaf, sample_frame(leaf, 0, color=True), frames=range(1, 2), fps=FPS) as writer:
        writer.write(sample_frame(leaf, 1, color=True))
    assert not primvar(read_mesh(path), "displayColor").IsAuthored()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_two_runs_give_the_same_bytes(tmp_path, suffix):
    first, second = (
        write_sample(tmp_path / folder / f"leaf.{suffix}", COUNT, color=True) for folder in ("first", "second")
    )
    assert first.read_bytes() == second.read_bytes()
    assert first.with_name("leaf_texture.png").read_bytes() == second.with_name("leaf_texture.png").read_bytes()


def test_suffix_usda_is_text_and_the_others_are_binary(tmp_path):
    heads = {suffix: write_sample(tmp_path / f"leaf.{suffix}", 1).read_bytes()[:8] for suffix in SUFFIXES}
    assert heads == {"usd": b"PXR-USDC", "usdc": b"PXR-USDC", "usda": b"#usda 1."}


def test_only_the_usd_and_its_texture_stay(tmp_path):
    write_sample(tmp_path / "leaf.usd", COUNT)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["leaf.usd", "leaf_texture.png"]


@pytest.mark.parametrize(
    "name", ("two words é", "a#b", "####", "with.dots", "a[1]", "at@@@at", "percent%20d", "quo'te")
)
def test_odd_names_work_during_and_after_a_run(tmp_path, read_mesh, name):
    leaf, path = sample_leaf(), tmp_path / f"{name}.usd"
    writer = UsdWriter(path, leaf, sample_frame(leaf, 0), frames=range(1, 4), fps=FPS)
    writer.write(sample_frame(leaf, 1))
    assert check_usd(path, unfinished=True) == []
    assert_same_bits(read_mesh(path).GetPointsAttr(), 1, sample_frame(leaf, 1).points)
    for index in (2, 3):
        writer.write(sample_frame(leaf, index))
    writer.close()
    assert check_usd(path) == []


def test_the_folder_can_be_moved_in_mid_run_and_after(tmp_path, read_mesh):
    leaf = sample_leaf()
    writer = UsdWriter(tmp_path / "here" / "leaf.usd", leaf, sample_frame(leaf, 0), frames=range(1, 4), fps=FPS)
    writer.write(sample_frame(leaf, 1))
    (tmp_path / "here").rename(tmp_path / "there")
    assert check_usd(tmp_path / "there" / "leaf.usd", unfinished=True) == []
    assert_same_bits(read_mesh(tmp_path / "there" / "leaf.usd").GetPointsAttr(), 1, sample_frame(leaf, 1).points)


@pytest.mark.parametrize("frames", (range(0, 3), range(9998, 10003), range(2, 12, 3)))
def test_frame_numbers_are_the_time_codes(tmp_path, read_mesh, frames):
    leaf, path = sample_leaf(), tmp_path / "leaf.usd"
    writer = UsdWriter(path, leaf, sample_frame(leaf, 0), frames=frames, fps=FPS)
    for index in frames:
        writer.write(sample_frame(leaf, index, count=20000))
    expected = [float(index) for index in frames]
    assert read_mesh(path).GetPointsAttr().GetTimeSamples() == expected  # through the clips
    writer.close()
    mesh = read_mesh(path)
    stage = mesh.GetPrim().GetStage()
    assert mesh.GetPointsAttr().GetTimeSamples() == expected
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (frames[0], frames[-1])


def test_close_with_fewer_frames_narrows_the_time_range(tmp_path):
    leaf, path = sample_leaf(), tmp_path / "leaf.usd"
    with UsdWriter(path, leaf, sample_frame(leaf, 0), frames=range(1, 100), fps=FPS) as writer:
        writer.write(sample_frame(leaf, 1))
        writer.write(sample_frame(leaf, 2))
    stage = open_afresh(path)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 2)
    assert check_usd(path) == []


def test_exception_inside_keeps_finished_frames_readable(tmp_path, read_mesh):
    leaf, path = sample_leaf(), tmp_path / "leaf.usd"
    writer = UsdWriter(path, leaf, sample_frame(leaf, 0), frames=range(1, 10), fps=FPS)
    with pytest.raises(KeyboardInterrupt), writer:
        writer.write(sample_frame(leaf, 1))
        writer.write(sample_frame(leaf, 2))
        raise KeyboardInterrupt
    mesh = read_mesh(path)
    for index in (1, 2):
        assert_same_bits(mesh.GetPointsAttr(), index, sample_frame(leaf, index).points)
    assert_same_bits(mesh.GetPointsAttr(), Usd.TimeCode.Default(), sample_frame(leaf, 0).points)
    assert mesh.GetPointsAttr().GetTimeSamples() == [1.0, 2.0]


@pytest.fixture
def writer(tmp_path):
    leaf = sample_leaf()
    return UsdWriter(tmp_path / "leaf.usd", leaf, sample_frame(leaf, 0), frames=range(1, 5), fps=FPS)


def test_a_frame_that_is_not_finite_is_refused_by_name(writer, tmp_path):
    frame = sample_frame(sample_leaf(), 2)
    frame.points[3:5, 1] = np.nan
    with pytest.raises(SimulationError, match="frame 2: usd: points of 2 of 40 vertices are not finite"):
        writer.write(frame)
    assert not list((tmp_path / "leaf.usd.frames").glob("frame.*"))


def test_misuse_is_refused(writer):
    leaf = sample_leaf()
    frame = sample_frame(leaf, 1)
    with pytest.raises(ValueError, match="frame 5: not one of"):
        writer.write(sample_frame(leaf, 5))
    with pytest.raises(ValueError, match=r"frame 1: primvars:water: shape \(39,\) given, shape \(40,\) expected"):
        writer.write(dataclasses.replace(frame, water=frame.water[1:]))
    writer.write(frame)
    with pytest.raises(ValueError, match=r"frame 1: .* written before"):
        writer.write(frame)
    assert writer.close() == writer.close()
    with pytest.raises(ValueError, match="closed"):
        writer.write(sample_frame(leaf, 2))


def test_color_that_is_asked_for_but_missing_is_refused(tmp_path):
    leaf = sample_leaf()
    with pytest.raises(ValueError, match="primvars:displayColor: nothing given"):
        UsdWriter(
            tmp_path / "leaf.usd",
            leaf,
            sample_frame(leaf, 0),
            frames=range(1, 3),
            fps=FPS,
            display_color=True,
        )


@pytest.mark.parametrize("frames", (range(0), range(5, 1, -1), range(-3, 2)))
def test_impossible_frame_ranges_are_refused(tmp_path, frames):
    leaf = sample_leaf()
    with pytest.raises(ValueError, match="frames: range"):
        UsdWriter(tmp_path / "leaf.usd", leaf, sample_frame(leaf, 0), frames=frames, fps=FPS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name, options, message",
    (
        ("leaf.obj", {}, "suffix '.obj' is not accepted; accepted: .usd, .usda, .usdc"),
        ("leaf.usd", {"up_axis": "X"}, "up_axis: 'X' is not accepted; accepted: Y, Z"),
    ),
)
def test_bad_choices_are_input_errors(tmp_path, name, options, message):
    with pytest.raises(InputError, match=message):
        write_sample(tmp_path / name, 1, **options)
    assert not list(tmp_path.iterdir())


def parent_is_a_file(folder: Path) -> tuple[Path, str]:
    (folder / "file").touch()
    return folder / "file" / "leaf.usd", "Not a directory|File exists"


def root_is_a_folder(folder: Path) -> tuple[Path, str]:
    (folder / "leaf.usd").mkdir()
    return folder / "leaf.usd", "Is a directory"


def frame_folder_is_a_file(folder: Path) -> tuple[Path, str]:
    (folder / "leaf.usd.frames").touch()
    return folder / "leaf.usd", "File exists"


def texture_is_a_folder(folder: Path) -> tuple[Path, str]:
    (folder / "leaf_texture.png").mkdir()
    return folder / "leaf.usd", "Is a directory"


@pytest.mark.parametrize("spoil", (parent_is_a_file, root_is_a_folder, frame_folder_is_a_file, texture_is_a_folder))
def test_a_place_that_cannot_be_written_is_one_line(tmp_path, spoil):
    path, reason = spoil(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(OutputError, match=reason) as caught:
        write_sample(path, 1)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)
    left = set(tmp_path.rglob("*")) - set(before)
    assert {file.name for file in left} <= {"leaf_texture.png"}  # whole, and the next run replaces it


def test_a_read_only_folder_is_one_line(tmp_path):
    tmp_path.chmod(0o500)
    try:
        try:
            (tmp_path / "probe").touch()
            pytest.skip("this user may write anywhere")
        except PermissionError:
            pass
        with pytest.raises(OutputError, match="Permission denied"):
            write_sample(tmp_path / "leaf.usd", 1)
    finally:
        tmp_path.chmod(0o700)


def test_a_folder_that_goes_away_in_mid_run_is_one_line(writer, tmp_path):
    shutil.rmtree(tmp_path / "leaf.usd.frames")
    with pytest.raises(OutputError, match=r"frame\.0001\.usdc: cannot be written: No such file or directory"):
        writer.write(sample_frame(sample_leaf(), 1))
    assert not (tmp_path / "leaf.usd.frames").exists()


def test_frame_layer_holds_samples_only(writer, tmp_path):
    writer.write(sample_frame(sample_leaf(), 3))
    layer = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "leaf.usd.frames" / "frame.0003.usdc"))
    assert layer.ListAllTimeSamples() == [3.0]
    assert not any(attribute.HasDefaultValue() for attribute in layer.GetPrimAtPath("/Leaf/geo/leaf").attributes)
