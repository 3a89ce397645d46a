"""The mesh has no grain: a disc of it bends alike in all directions, and its edges prefer none."""

from __future__ import annotations

import numpy as np
import pytest

from conftest import SCENES
from leaf_pictures import blade_outline, true_length
from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf, LeafMesh
from leafwarp.leaf.mesh.anneal import anneal
from leafwarp.leaf.mesh.grain import grain
from leafwarp.leaf.mesh.quality import corner_angles, mesh_quality
from leafwarp.leaf.mesh.repair import open_corners
from leafwarp.leaf.mesh.topology import boundary_edges, directed_edges, mesh_from_triangles, signed_areas
from leafwarp.leaf.mesh.triangulate import FilledLeaf, fill_leaf
from leafwarp.leaf.venation.branch import Branch
from leafwarp.scene.file import load_scene
from leafwarp.sim.material import dihedral_angles, hinge_stiffness

GRAIN = 0.05  # of a disc with hinges enough to tell
CHANCE = 2.2  # of 100 meshes without grain, 99 vary by less than so many times what chance makes of theirs
ALIGNMENT = 0.3
# Triangles between lines that run side by side, as on a blade, lie in rows along them.
VEINED_CHANCE, VEINED_ALIGNMENT = 3.0, 0.4
PIECES = 0.05  # by which the pieces of lines may differ from the mean edge, in the mean
ENOUGH = 500  # hinges from which on the alignment is told


def lattice(count: int = 24, stretch: float = 1.0, turn: float = 0.2) -> LeafMesh:
    """Equilateral triangles of side 1 in rows, stretched along x after a turn [rad]."""
    rows, columns = np.divmod(np.arange(count * count), count)
    points = np.column_stack([columns + 0.5 * (rows % 2), rows * np.sqrt(0.75)])
    points = points @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * (stretch, 1.0)
    triangles = []
    for row in range(count - 1):
        for a in range(row * count, row * count + count - 1):
            b, c, d = a + 1, a + count, a + count + 1
            triangles += [(a, b, c), (b, d, c)] if row % 2 == 0 else [(a, b, d), (a, d, c)]
    return mesh_from_triangles(points, np.array(triangles))


def test_lattice_bends_alike_but_is_one_crystal() -> None:
    measured = grain(lattice())
    np.testing.assert_allclose(measured.stiffness, 1.0, rtol=1e-9)  # k = D |e|^2 / (A1 + A2) is made for it
    assert measured.variation < 1e-9 and measured.alignment == pytest.approx(1.0)


def test_stretched_rows_have_grain() -> None:
    """A stretch of 5 % makes the sheet a tenth stiffer one way than the other."""
    measured = grain(lattice(stretch=1.05))
    assert measured.variation > 0.1


def test_stiffness_is_the_energy_of_the_simulation_rolled_up() -> None:
    """Hinge energy from the simulation's own angles and constants on cylinders of small curvature."""
    mesh = fill_leaf(*ellipse_outline(), 300).mesh
    measured = grain(mesh, directions=7)
    middles = mesh.positions[mesh.hinges[:, :2]].mean(axis=1)
    inside = np.linalg.norm(middles - measured.centre, axis=1) < measured.radius
    curvature = 1e-3 / measured.radius
    area = np.zeros(mesh.hinge_count)
    for corner in (2, 3):
        a, b, c = (mesh.positions[mesh.hinges[:, index]] for index in (0, 1, corner))
        u, v = b - a, c - a
        area += 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 3.0
    for phi, stiffness in zip(np.arange(7) * np.pi / 7.0, measured.stiffness, strict=True):
        along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
        offset = mesh.positions - measured.centre
        angle = curvature * (offset @ across)
        flat = (offset @ along)[:, None] * along + (np.sin(angle) / curvature)[:, None] * across
        rolled = np.column_stack([flat, (1.0 - np.cos(angle)) / curvature])
        energy = 0.5 * hinge_stiffness(mesh, 1.0) * dihedral_angles(mesh, rolled) ** 2
        assert stiffness == pytest.approx(energy[inside].sum() / (0.5 * curvature**2 * area[inside].sum()), rel=1e-4)


def ellipse_outline() -> tuple[np.ndarray, np.ndarray]:
    points = blade_outline()[::4] * (1.0, -1.0) * 0.1 / true_length()
    points = points - points[np.argmin(points[:, 1])]
    return points, points[np.argmax(points[:, 1])]


@pytest.fixture(scope="module")
def melted() -> LeafMesh:
    rows = lattice(40)
    boundary = np.unique(boundary_edges(rows))
    return mesh_from_triangles(*anneal(rows.positions, rows.triangles, boundary, np.zeros((0, 2))))


@pytest.mark.parametrize("radius", [2.0, 3.0, 5.0, 8.0])  # [mean edges]
def test_chance_is_what_discs_of_a_mesh_without_grain_vary_by(melted: LeafMesh, radius: float) -> None:
    """40 to 700 hinges."""
    random, middle = np.random.default_rng(0), melted.positions.mean(axis=0)
    shares = []
    for shift in random.uniform(-1.0, 1.0, (40, 2)) * (14.0 - radius):
        measured = grain(melted, tuple(middle + shift), radius)
        shares.append(measured.variation / measured.chance)
    assert 0.6 < np.median(shares) < 1.5 and np.quantile(shares, 0.9) < CHANCE


@pytest.mark.parametrize("name", ["blade", "bramble", "cut", "still"])
def test_scene_meshes_have_no_grain(name: str, scene_leaf) -> None:
    mesh = scene_leaf(load_scene(SCENES / f"{name}.toml")).mesh
    check_grain(mesh, CHANCE, ALIGNMENT)


@pytest.mark.parametrize("name", ["blade", "bramble", "cut"])
def test_scene_meshes_along_veins_have_little_grain(name: str, scene_leaf) -> None:
    scene = load_scene(SCENES / f"{name}.toml")
    check_grain(veined_leaf(scene_leaf(scene), scene.mesh.vertices).mesh, VEINED_CHANCE, VEINED_ALIGNMENT)


@pytest.mark.parametrize(("name", "vertices"), [("blade", 1600), ("blade", 1707), ("blade", 1800), ("cut", 1707)])
def test_many_side_by_side_veins_make_no_grain(name: str, vertices: int, scene_leaf) -> None:
    """Parallel veins of a blade: those that are followed leave room between them, and their pieces are no shorter than
    other edges."""
    leaf = veined_leaf(scene_leaf(load_scene(SCENES / f"{name}.toml")), vertices)
    measured = grain(leaf.mesh)
    assert len(leaf.vein_edges) > 150 and measured.variation < max(GRAIN, CHANCE * measured.chance)
    ends = leaf.mesh.positions[leaf.vein_edges]
    pieces = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean()
    edges = np.linalg.norm(np.subtract(*leaf.mesh.positions[leaf.mesh.edges.T]), axis=1).mean()
    assert pieces == pytest.approx(edges, rel=PIECES)


def check_grain(mesh: LeafMesh, chance: float, alignment: float) -> None:
    measured = grain(mesh)
    hinges = hinges_within(mesh, measured.centre, measured.radius)
    assert measured.chance == pytest.approx(hinges**-0.5)
    assert measured.variation < max(GRAIN, chance * measured.chance)
    if hinges >= ENOUGH:
        assert measured.alignment < alignment
    # The energy of the sheet that the hinges stand for.
    assert measured.stiffness.mean() == pytest.approx(1.0, abs=max(0.06, measured.chance))
    assert mesh_quality(mesh).minimum_angle > 20.0


def veined_leaf(leaf: Leaf, vertices: int) -> FilledLeaf:
    """A prepared leaf filled again along its veins."""
    found, up = leaf.findings, leaf.findings.pixel * np.array([1.0, -1.0])
    veins = [Branch((points - found.base) * up, flow) for points, flow in found.veins]
    outline = (found.outline - found.base) * up
    return fill_leaf(outline, outline[np.argmax(np.hypot(*outline.T))], vertices, veins=veins)


def hinges_within(mesh: LeafMesh, centre: tuple[float, float], radius: float) -> int:
    middles = mesh.positions[mesh.hinges[:, :2]].mean(axis=1)
    return int(np.count_nonzero(np.linalg.norm(middles - centre, axis=1) < radius))


@pytest.mark.parametrize("name", ["bramble", "cut"])
def test_a_mesh_with_hinges_enough_bends_alike_within_five_percent(name: str, scene_leaf) -> None:
    leaf = scene_leaf(load_scene(SCENES / f"{name}.toml"))
    measured = grain(leaf.mesh, directions=12)
    assert len(measured.stiffness) == 12 and measured.variation < GRAIN
    small = 0.5 * measured.radius
    for turn in np.arange(4) * 0.5 * np.pi:
        centre = np.add(measured.centre, small * np.array([np.cos(turn), np.sin(turn)]))
        part = grain(leaf.mesh, tuple(centre), small)
        assert part.variation < max(GRAIN, CHANCE * part.chance)


def test_disc_without_hinges_is_refused() -> None:
    with pytest.raises(InputError, match="holds no hinge"):
        grain(lattice(), radius=1e-3)


def test_annealing_melts_stretched_rows() -> None:
    rows = lattice(stretch=1.1)
    boundary = np.unique(boundary_edges(rows))
    kept = rows.edges[np.isin(rows.edges, boundary, invert=True).all(axis=1)][:40:4]
    fixed = np.union1d(boundary, kept)
    positions, triangles = anneal(rows.positions, rows.triangles, fixed, kept)
    assert triangles.shape == rows.triangles.shape and (signed_areas(positions, triangles) > 0.0).all()
    np.testing.assert_array_equal(positions[fixed], rows.positions[fixed])
    edges = {tuple(edge) for edge in directed_edges(triangles).tolist()}
    assert all((a, b) in edges for a, b in kept.tolist())
    melted = mesh_from_triangles(positions, triangles)
    assert grain(rows).variation > 0.2
    assert grain(melted).variation < 0.1 and grain(melted).alignment < 0.4
    again = anneal(rows.positions, rows.triangles, fixed, kept)
    np.testing.assert_array_equal(positions, again[0])


def test_vertices_of_a_line_slide_along_it_and_its_bends_and_ends_stay() -> None:
    """A line of uneven pieces through a mesh becomes even, so that it does not squeeze the rows beside it."""
    rows = lattice(turn=0.0)
    squeezed = rows.positions.copy()
    line = np.arange(12 * 24 + 4, 12 * 24 + 20)
    share = np.linspace(0.0, 1.0, len(line))
    squeezed[line, 0] += 2.0 * share * (1.0 - share)  # pieces from 1.13 to 0.87 long
    bend = 9
    squeezed[line[bend:], 1] += 0.5 * np.arange(len(line) - bend)  # from here on it rises by 27 degrees
    others = np.setdiff1d(np.arange(rows.vertex_count), line)
    squeezed[others, 1] += 0.5 * np.clip(squeezed[others, 0] - squeezed[line[bend], 0], 0.0, None)
    kept = np.column_stack([line[:-1], line[1:]])
    fixed = np.union1d(boundary_edges(rows), line[[0, -1]])
    positions, triangles = anneal(squeezed, rows.triangles, fixed, kept)
    before, after = squeezed[line], positions[line]
    np.testing.assert_array_equal(after[[0, bend, -1]], before[[0, bend, -1]])
    np.testing.assert_allclose(after[:bend, 1], before[0, 1], rtol=0.0, atol=1e-12)
    straight = np.delete(np.arange(len(line)), [0, bend, len(line) - 1])
    assert np.abs(after - before)[straight].max() > 0.05
    lengths = [np.linalg.norm(np.diff(points[: bend + 1], axis=0), axis=1) for points in (before, after)]
    assert lengths[1].min() > 0.6 and lengths[1].sum() == pytest.approx(lengths[0].sum())
    assert (signed_areas(positions, triangles) > 0.0).all()
    edges = {tuple(edge) for edge in directed_edges(triangles).tolist()}
    assert all((a, b) in edges for a, b in kept.tolist())


def test_sharp_corners_are_opened() -> None:
    angle = np.arange(6) * (np.pi / 3.0)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    positions = np.concatenate([ring, [[0.72, 0.1]]])  # six triangles about an inner vertex far from the middle
    triangles = np.column_stack([np.arange(6), np.roll(np.arange(6), -1), np.full(6, 6)])
    opened = open_corners(positions, triangles, fixed=np.arange(6))
    np.testing.assert_array_equal(opened[:6], ring)
    before, after = (corner_angles(points, triangles).min() for points in (positions, opened))
    assert np.degrees(before) < 20.0 and after > 1.3 * before
    assert np.linalg.norm(opened - positions, axis=1).max() <= 0.25 + 1e-12
    np.testing.assert_array_equal(open_corners(ring_with_middle(), triangles, np.arange(6)), ring_with_middle())


def ring_with_middle() -> np.ndarray:
    angle = np.arange(6) * (np.pi / 3.0)
    return np.concatenate([np.column_stack([np.cos(angle), np.sin(angle)]), np.zeros((1, 2))])


def test_quality_of_equilateral_triangles() -> None:
    quality = mesh_quality(lattice())
    assert quality.minimum_angle == pytest.approx(60.0) and quality.mean_radius_ratio == pytest.approx(1.0)
    assert quality.edge_variation < 1e-12
