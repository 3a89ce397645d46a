"""The leaf's triangles: counts, topology, holes, hinge directions, and the refusal of what is no disc."""

from __future__ import annotations

import numpy as np
import pytest

from leaf_pictures import BASE, blade_outline, coverage, petiole_outline, true_length
from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh.boundary import boundary_loops
from leafwarp.leaf.mesh.quality import mesh_quality
from leafwarp.leaf.mesh.topology import boundary_edges, check_topology, mesh_from_triangles
from leafwarp.leaf.mesh.triangulate import fill_leaf
from leafwarp.leaf.segment.silhouette import Silhouette
from leafwarp.leaf.shape.outline import trace


def leaf_outline(teeth: int = 0, depth: float = 0.0, petiole: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Outline and tip [m] of a drawn leaf 0.1 m long, the base at the origin."""
    polygons = [blade_outline(teeth, depth)] + ([petiole_outline()] if petiole else [])
    points = trace(Silhouette((2.0 * coverage(*polygons) - 1.0).astype(np.float32), (1.0, 1.0)))
    base = points[np.argmin(np.linalg.norm(points - BASE, axis=1))]
    scale = np.array([1.0, -1.0]) * 0.1 / true_length(teeth, depth)
    points = (points - base) * scale
    return points, points[np.argmax(np.linalg.norm(points, axis=1))]


def signed_area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


@pytest.fixture(scope="module")
def serrated() -> LeafMesh:
    return fill_leaf(*leaf_outline(teeth=40, depth=0.06), 1707).mesh


@pytest.mark.parametrize(
    ("shape", "vertices"),
    [
        ({}, 60),
        ({}, 300),
        ({"teeth": 40, "depth": 0.06}, 300),
        ({"teeth": 90, "depth": 0.04}, 1707),
        ({}, 4000),
    ],
)
def test_counts_and_quality(shape: dict, vertices: int) -> None:
    outline, tip = leaf_outline(**shape)
    mesh = fill_leaf(outline, tip, vertices).mesh
    check_topology(mesh)
    quality = mesh_quality(mesh)
    assert 0 <= mesh.vertex_count - vertices <= max(0.01 * vertices, 1)
    assert quality.minimum_angle > 25.0 and quality.mean_radius_ratio > 0.94
    assert quality.edge_variation < 0.18
    x, y = outline.T
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    assert mesh.vertex_areas.sum() == pytest.approx(area, rel=0.04 if vertices >= 300 else 0.1)


def test_euler_and_area_sums(serrated: LeafMesh) -> None:
    mesh = serrated
    boundary = mesh.edge_count - mesh.hinge_count
    assert mesh.vertex_count - mesh.edge_count + mesh.triangle_count == 1
    assert 2 * mesh.hinge_count + boundary == 3 * mesh.triangle_count
    areas = signed_area(*(mesh.positions[mesh.triangles[:, corner]] for corner in range(3)))
    assert areas.min() > 0.0
    assert mesh.vertex_areas.sum() == pytest.approx(areas.sum(), rel=1e-12)
    assert mesh.edge_areas.sum() == pytest.approx(3.0 * areas.sum(), rel=1e-12)
    assert (mesh.edges[:, 0] < mesh.edges[:, 1]).all()
    assert mesh.triangles.dtype == mesh.edges.dtype == mesh.hinges.dtype == np.int32


def test_base_is_vertex_zero_at_the_origin(serrated: LeafMesh) -> None:
    assert (serrated.positions[0] == 0.0).all()
    assert np.hypot(*serrated.positions.T).max() == pytest.approx(0.1, rel=0.02)


def test_neighbours_are_near_in_memory(serrated: LeafMesh) -> None:
    spread = np.abs(np.diff(serrated.edges.astype(int), axis=1))
    assert spread.max() < serrated.vertex_count / 6


def test_every_hinge_follows_its_first_triangle(serrated: LeafMesh) -> None:
    mesh = serrated
    a, b, c, d = (mesh.positions[mesh.hinges[:, corner]] for corner in range(4))
    assert (signed_area(a, b, c) > 0.0).all() and (signed_area(b, a, d) > 0.0).all()
    number = {tuple(sorted(triangle)): index for index, triangle in enumerate(mesh.triangles.tolist())}
    edges = {tuple(edge) for edge in mesh.edges.tolist()}
    for one, two, opposite, other in mesh.hinges.tolist():
        assert number[tuple(sorted((one, two, opposite)))] < number[tuple(sorted((one, two, other)))]
        assert (min(one, two), max(one, two)) in edges
    assert (mesh.hinges[:, 0] > mesh.hinges[:, 1]).any()  # stored (low, high) they would be wrong


def test_same_input_same_mesh() -> None:
    outline, tip = leaf_outline(teeth=40, depth=0.06)
    one, two = fill_leaf(outline, tip, 400).mesh, fill_leaf(outline, tip, 400).mesh
    np.testing.assert_array_equal(one.positions, two.positions)
    np.testing.assert_array_equal(one.hinges, two.hinges)


def test_mesh_scales_with_the_leaf() -> None:
    outline, tip = leaf_outline()
    # A power of two scales every number without rounding, so that no choice of the mesher may differ.
    small, large = (fill_leaf(outline * scale, tip * scale, 200).mesh for scale in (1.0, 1024.0))
    np.testing.assert_allclose(large.positions, 1024.0 * small.positions, rtol=0.0, atol=1e-9 * 1024.0)
    np.testing.assert_array_equal(large.triangles, small.triangles)


def test_thin_petiole_is_widened_to_a_strip() -> None:
    """At 150 vertices an edge is as long as 1.6 petiole widths."""
    outline, tip = leaf_outline()
    mesh = fill_leaf(outline, tip, 150).mesh
    assert mesh_quality(mesh).minimum_angle > 20.0
    assert np.count_nonzero(mesh.positions[:, 1] < 0.018) >= 5  # [m] the petiole is 0.022 m long


def test_teeth_stay_corners() -> None:
    outline, tip = leaf_outline(teeth=24, depth=0.12, petiole=False)
    polygon = boundary_loops(outline, tip, 0.0025)[0]
    radius = np.linalg.norm(outline - outline.mean(axis=0), axis=1)
    tips = outline[radius >= np.max([np.roll(radius, shift) for shift in range(-20, 21)], axis=0)]
    reach = np.linalg.norm(tips[:, None] - polygon[None], axis=2).min(axis=1)
    assert len(tips) >= 20 and reach.max() < 0.55 * 0.0025  # points an edge apart: half an edge at most


def test_count_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="vertices: value 3 is not accepted"):
        fill_leaf(*leaf_outline(), 3)


def test_a_mesh_much_wider_than_its_leaf_is_refused() -> None:
    """A strip is widened to where triangles of the size asked for can stand; another leaf, then."""
    height = np.linspace(0.0, 0.1, 300)
    strip = np.concatenate([np.column_stack([np.full(300, side * 0.0005), height])[::side] for side in (1, -1)])
    outline = strip - strip[np.argmin(np.hypot(*strip.T))]
    with pytest.raises(InputError, match=r"vertices: value 40 is too few .* \d\.\d times its area; accepted: more"):
        fill_leaf(outline, outline[np.argmax(outline[:, 1])], 40)
    mesh = fill_leaf(outline, outline[np.argmax(outline[:, 1])], 1500).mesh
    assert mesh.vertex_areas.sum() == pytest.approx(polygon_area(outline), rel=0.03)


def test_single_and_double_triangle() -> None:
    one = mesh_from_triangles(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[0, 1, 2]]))
    assert (one.edge_count, one.hinge_count) == (3, 0) and one.hinges.shape == (0, 4)
    np.testing.assert_allclose(one.vertex_areas, 1.0 / 6.0)
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    two = mesh_from_triangles(square, np.array([[2, 3, 0], [0, 1, 2]]))
    np.testing.assert_array_equal(two.hinges, [[0, 2, 3, 1]])  # as (2, 3, 0) runs: from 0 to 2
    np.testing.assert_allclose(two.edge_areas[two.edges.tolist().index([0, 2])], 1.0)


SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


@pytest.mark.parametrize(
    ("positions", "triangles", "message"),
    [
        (SQUARE, [[0, 1, 2]], "vertex 3 belongs to no triangle"),
        (SQUARE, [[0, 1, 1], [0, 2, 3]], "uses a vertex twice"),
        (SQUARE, [[0, 1, 2], [0, 3, 2]], "not counter-clockwise"),
        (SQUARE, [[0, 1, 2], [0, 2, 4]], "vertex index 4 is not accepted"),
        (
            [*SQUARE, [3.0, 0.0], [4.0, 0.0], [4.0, 1.0]],
            [[0, 1, 2], [0, 2, 3], [4, 5, 6]],
            "2 loops; accepted: 1",
        ),
        ([*SQUARE[:3], [2.0, 1.0], [2.0, 2.0]], [[0, 1, 2], [2, 3, 4]], "hourglass"),
        ([*SQUARE, [0.5, 2.0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]], "belongs to 3 triangles"),
        (SQUARE, [[0, 1, 2], [0, 1, 3]], "orientation differs"),
        ([[0.0, np.nan], [1.0, 0.0], [1.0, 1.0]], [[0, 1, 2]], "positions of shape"),
    ],
)
def test_what_is_no_disc_is_refused(positions: list, triangles: list, message: str) -> None:
    with pytest.raises(InputError, match=message):
        mesh_from_triangles(np.array(positions), np.array(triangles))


def test_ring_is_accepted_only_where_a_hole_is() -> None:
    angle = np.arange(8) * (np.pi / 4.0)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    following = np.roll(np.arange(8), -1)
    triangles = np.concatenate(
        [
            np.column_stack([np.arange(8), np.arange(8) + 8, following]),
            np.column_stack([following, np.arange(8) + 8, following + 8]),
        ]
    )
    positions = np.concatenate([circle, 2.0 * circle])
    with pytest.raises(InputError, match="2 loops; accepted: 1"):
        mesh_from_triangles(positions, triangles)
    for holes in (1, None):
        ring = mesh_from_triangles(positions, triangles, holes)
        assert ring.vertex_count - ring.edge_count + ring.triangle_count == 0


def ellipse(x: float, y: float, radius: float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
    return np.column_stack([x + radius * np.cos(angle), y + 1.3 * radius * np.sin(angle)])


def polygon_area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


@pytest.mark.parametrize("vertices", [600, 1707])
def test_holes_stay_open_and_small_ones_are_filled(vertices: int) -> None:
    outline, tip = leaf_outline(teeth=40, depth=0.06)
    open_holes = [ellipse(-0.01, 0.06, 0.006), ellipse(0.012, 0.05, 0.004)]
    leaf = fill_leaf(outline, tip, vertices, holes=[*open_holes, ellipse(0.0, 0.08, 0.0004)])
    mesh = leaf.mesh
    assert leaf.holes == 2
    check_topology(mesh, holes=2)
    assert mesh.vertex_count - mesh.edge_count + mesh.triangle_count == -1
    assert abs(mesh.vertex_count - vertices) <= 0.02 * vertices and mesh_quality(mesh).minimum_angle > 25.0
    start, end = (mesh.positions[ends] for ends in boundary_edges(mesh).T)
    for hole in open_holes:
        rim = np.linalg.norm(start - hole.mean(axis=0), axis=1) < 0.6 * np.ptp(hole[:, 1])
        enclosed = -0.5 * np.sum((start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])[rim])
        assert 0.88 < enclosed / polygon_area(hole) < 1.01  # a polygon of so few sides is inscribed
    area = polygon_area(outline) - sum(map(polygon_area, open_holes))
    assert mesh.vertex_areas.sum() == pytest.approx(area, rel=0.03)  # polygons inscribed in the holes
    middles = mesh.positions[mesh.triangles].mean(axis=1)
    for hole in open_holes:
        assert np.linalg.norm(middles - hole.mean(axis=0), axis=1).min() > 0.9 * (hole - hole.mean(axis=0))[:, 0].max()
    with pytest.raises(InputError, match="3 loops; accepted: 1"):
        check_topology(mesh)


def test_hole_near_the_margin_leaves_a_bridge() -> None:
    """Holes that touch one another or the margin would cut the leaf or leave slivers: they shrink."""
    outline, tip = leaf_outline()
    right = outline[np.argmax(outline[:, 0])]
    holes = [ellipse(right[0] - 0.004, right[1], 0.0042), ellipse(-0.01, 0.05, 0.005), ellipse(-0.01, 0.062, 0.005)]
    leaf = fill_leaf(outline, tip, 1200, holes=holes)
    check_topology(leaf.mesh, holes=leaf.holes)
    assert 2 <= leaf.holes <= 3 and mesh_quality(leaf.mesh).minimum_angle > 20.0


def test_a_bay_with_a_narrow_mouth_is_closed_and_no_hole() -> None:
    """A notch that widens inside the leaf, as where a lesion is torn open."""
    angle = np.linspace(-0.5 * np.pi, 1.5 * np.pi, 720, endpoint=False)
    disc = 0.05 * np.column_stack([np.cos(angle), 1.0 + np.sin(angle)])
    mouth = np.abs(angle - 0.5 * np.pi) > 0.006
    turn = np.linspace(0.5 * np.pi - 0.05, -1.5 * np.pi + 0.05, 120)
    bay = [0.0, 0.085] + 0.009 * np.column_stack([np.cos(turn), np.sin(turn)])[::-1]
    before, after = disc[mouth & (angle < 0.5 * np.pi)], disc[mouth & (angle > 0.5 * np.pi)]
    outline = np.concatenate([before, bay[::-1], after])
    for vertices in (300, 900):
        mesh = fill_leaf(outline, np.array([0.04, 0.08]), vertices).mesh
        check_topology(mesh)
        assert mesh.vertex_areas.sum() == pytest.approx(np.pi * 0.05**2, rel=0.04)


def test_boundary_has_the_leaf_to_its_left() -> None:
    outline, tip = leaf_outline()
    mesh = fill_leaf(outline, tip, 600, holes=[ellipse(0.0, 0.06, 0.008)]).mesh
    start, end = (mesh.positions[ends] for ends in boundary_edges(mesh).T)
    # Over all loops the shoelace formula gives the area once: holes count negative.
    enclosed = 0.5 * np.sum(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])
    assert enclosed == pytest.approx(mesh.vertex_areas.sum(), rel=1e-9)
