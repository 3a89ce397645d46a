"""The USD of many leaves."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pxr import Kind, Usd, UsdGeom, UsdShade

from leafwarp.sim.simulation import Simulation
from leafwarp.usd.check import check_usd
from many_leaves import FRAMES, VARIED, changed


@pytest.fixture(scope="module")
def written(small_scene, tmp_path_factory) -> tuple[Path, dict]:
    """The USD of 5 varied leaves, and the frame that it should hold at its end."""
    from leafwarp.prepare import prepare_scene_leaf
    from leafwarp.run import output_paths, run_scene

    scene = changed(small_scene, leaves=VARIED | {"count": 5}, output__up_axis="Y", output__display_color=True)
    paths = output_paths(scene, tmp_path_factory.mktemp("many") / "many.usda")
    report = run_scene(scene, paths, frames=range(1, FRAMES + 1), progress_level=-1)
    leaves = prepare_scene_leaf(scene, None)
    *_, last = Simulation(scene, leaves).frames(FRAMES)
    return paths.usd, {"report": report, "leaves": leaves, "last": last}


def test_usd_has_a_prim_a_leaf_and_one_material(written) -> None:
    path, run = written
    assert check_usd(path) == []
    stage = Usd.Stage.Open(str(path))
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/Leaves" and Usd.ModelAPI(root).GetKind() == Kind.Tokens.assembly
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 5
    leaves, last = run["leaves"], run["last"]
    for index, (mesh, specimen, own) in enumerate(zip(meshes, leaves.specimens, leaves.vertex_slices, strict=True)):
        model = mesh.GetPrim().GetParent()
        assert model.GetPath() == f"/Leaves/leaf_{index + 1:04d}"
        assert Usd.ModelAPI(model).GetKind() == Kind.Tokens.component
        x, y, z = specimen.place
        assert list(UsdGeom.Xformable(model).GetLocalTransformation().ExtractTranslation()) == [x, z, -y]
        points = np.array(mesh.GetPointsAttr().Get(FRAMES))
        assert np.array_equal(points, last.points[own][:, (0, 2, 1)] * np.float32([1, 1, -1]))
        assert np.array_equal(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("water").Get(FRAMES), last.water[own])
        st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
        assert st == pytest.approx(leaves.photos[0].uv, abs=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == "/Leaves/mtl/photo"
    root.GetVariantSets().SetSelection("shading", "water")
    for mesh in meshes:
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == "/Leaves/mtl/water"
    assert run["report"]["leaf"]["count"] == run["report"]["mesh"]["leaves"] == 5


def test_a_killed_run_of_many_leaves_keeps_its_frames(written, tmp_path) -> None:
    from leafwarp.usd.writer import UsdWriter

    _, run = written
    leaves, last = run["leaves"], run["last"]
    path = tmp_path / "killed.usd"
    rest = dataclasses.replace(last, index=0)
    writer = UsdWriter(path, leaves, rest, frames=range(1, 5), fps=24.0)
    writer.write(dataclasses.replace(last, index=1))
    writer.write(dataclasses.replace(last, index=2, points=last.points + np.float32(1.0)))
    assert check_usd(path, unfinished=True) == []  # never closed
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Leaves/leaf_0005/leaf"))
    moved = last.points[leaves.vertex_slices[4]] + np.float32(1.0)
    assert np.array_equal(mesh.GetPointsAttr().Get(2), moved)
