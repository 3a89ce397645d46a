"""What a scene asks of its leaf reaches the USD: holes that stay open, and veins that are edges of the mesh."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from scipy.spatial import cKDTree

from leafwarp.cli import main
from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.mesh.topology import boundary_edges, check_topology
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from leafwarp.usd.check import check_usd

HOLE_CENTRE, HOLE_AXES = (132, 150), (15, 22)  # [pixels] of the drawn photo, between two side veins
VERTICES = 400
# Of the most substeps of a frame without vein edges; their pieces may be a little shorter than the mean edge.
MORE_SUBSTEPS = 1.5


@pytest.fixture(scope="module")
def scene_file(small_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small scene on the drawn photo with a hole that shows the paper."""
    folder = tmp_path_factory.mktemp("options")
    picture = cv2.imread(str(small_scene.with_name("drawn.png")))
    cv2.ellipse(picture, HOLE_CENTRE, HOLE_AXES, 0, 0, 360, (235, 235, 235), -1, cv2.LINE_AA)
    cv2.imwrite(str(folder / "drawn.png"), picture)
    path = folder / "small.toml"
    path.write_text(small_scene.read_text().replace("vertices = 120", f"vertices = {VERTICES}"))
    return path


def run(scene_file: Path, folder: Path, *changes: str) -> dict:
    """The report of a run."""
    arguments = [part for change in changes for part in ("--set", change)]
    assert main(["run", str(scene_file), "-o", str(folder), "-q", *arguments]) == 0
    check_usd(folder / "small.usd")
    return json.loads((folder / "small.report.json").read_text())


@pytest.mark.parametrize(("holes", "euler"), [("fill", 1), ("keep", 0)])
def test_holes_are_filled_or_kept_as_far_as_the_usd(scene_file: Path, tmp_path: Path, holes: str, euler: int) -> None:
    report = run(scene_file, tmp_path, f"leaf.holes='{holes}'")
    ledger = report["fluid"]["ledger"]
    assert 0.0 < ledger["now"] < 0.95 and abs(ledger["error"]) < 1e-6
    stage = Usd.Stage.Open(str(tmp_path / "small.usd"))
    mesh = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    first, last = (np.array(mesh.GetPointsAttr().Get(frame)) for frame in (1.0, 9.0))
    edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert len(first) - len(edges) + len(triangles) == euler
    assert np.isfinite(last).all() and np.abs(last - first).max() > 1e-3  # [m] it wilts
    # The hole is seen either in the mesh or in the texture's opacity.
    texture = cv2.imread(str(tmp_path / "small_texture.png"), cv2.IMREAD_UNCHANGED)
    assert texture.shape[2] == (4 if holes == "fill" else 3)


@pytest.mark.parametrize(("frames", "holes"), [(9, "keep"), (5, "fill")])
def test_frames_hours_apart_do_not_tear_the_leaf(scene_file: Path, frames: int, holes: str) -> None:
    """The water of three or six hours at once would fold the triangles at the hole over."""
    scene = load_scene(scene_file, ["time.duration='24 h'", f"time.frames={frames}", f"leaf.holes='{holes}'"])
    simulation = Simulation(scene, prepare_scene_leaf(scene, None))
    assert simulation.couplings_per_frame > 1
    *_, last = simulation.frames()
    assert last.index == frames and np.isfinite(last.points).all()


def test_kept_hole_is_where_the_photo_has_it(scene_file: Path) -> None:
    kept, filled = (
        prepare_scene_leaf(load_scene(scene_file, [f"leaf.holes='{holes}'"]), None) for holes in ("keep", "fill")
    )
    check_topology(kept.mesh, holes=1)
    check_topology(filled.mesh)
    # The water flows around the hole whether or not the mesh is open there.
    np.testing.assert_array_equal(kept.mask, filled.mask)
    pixel = kept.findings.pixel
    centre = (np.array(HOLE_CENTRE) + 0.5 - kept.findings.base) * (pixel, -pixel)
    start, end = (kept.mesh.positions[ends] - centre for ends in boundary_edges(kept.mesh).T)
    rim = np.hypot(*start.T) < 1.15 * HOLE_AXES[1] * pixel
    area = -0.5 * np.sum((start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])[rim])  # run through clockwise
    assert area == pytest.approx(np.pi * HOLE_AXES[0] * HOLE_AXES[1] * pixel**2, rel=0.1)
    middles = kept.mesh.positions[kept.mesh.triangles].mean(axis=1)
    assert np.hypot(*(middles - centre).T).min() > 0.9 * HOLE_AXES[0] * pixel


def test_followed_veins_are_edges_and_cost_few_substeps(scene_file: Path) -> None:
    plain, veined = (load_scene(scene_file, [f"mesh.follow_veins={follow}"]) for follow in ("false", "true"))
    leaves = [prepare_scene_leaf(scene, None) for scene in (plain, veined)]
    assert midrib_share(leaves[0]) < 0.4 and midrib_share(leaves[1]) > 0.9
    check_topology(leaves[1].mesh)
    assert leaves[1].mesh.vertex_count == pytest.approx(VERTICES, rel=0.02)
    substeps = []
    for scene, leaf in zip((plain, veined), leaves, strict=True):
        simulation = Simulation(scene, leaf)
        *_, last = simulation.frames()
        assert np.isfinite(last.points).all()
        substeps.append(max(simulation.substeps))
    assert substeps[1] < MORE_SUBSTEPS * substeps[0]


def midrib_share(leaf: Leaf) -> float:
    """How much of the lamina's midrib lies on edges of the mesh, within a fifth of their length."""
    found = leaf.findings
    points, _ = found.veins[0]
    midrib = (points - found.base) * (found.pixel, -found.pixel)
    lamina = midrib[(midrib[:, 1] > 0.3 * leaf.length) & (midrib[:, 1] < 0.8 * leaf.length)]
    start, end = (leaf.mesh.positions[ends] for ends in leaf.mesh.edges.T)
    edge = np.linalg.norm(end - start, axis=1).mean()
    tree = cKDTree(lamina)
    share = np.linspace(0.0, 1.0, 5)[:, None, None]
    on = (tree.query(start + share * (end - start))[0] < 0.2 * edge).all(axis=0)
    length = np.linalg.norm(np.diff(lamina, axis=0), axis=1).sum()
    return float(np.linalg.norm((end - start)[on], axis=1).sum() / length)
