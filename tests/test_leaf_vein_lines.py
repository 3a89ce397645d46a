"""Veins as edges of the mesh: on the veins, whole, apart from one another, and never a reason to fail."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from leaf_pictures import BASE, true_length, vein_lines
from leafwarp.errors import InputError
from leafwarp.leaf.mesh import triangulate as triangulation
from leafwarp.leaf.mesh.boundary import boundary_loops
from leafwarp.leaf.mesh.fill import UnfilledError
from leafwarp.leaf.mesh.grain import grain
from leafwarp.leaf.mesh.quality import mesh_quality
from leafwarp.leaf.mesh.segments import conflicts
from leafwarp.leaf.mesh.topology import check_topology
from leafwarp.leaf.mesh.triangulate import FilledLeaf, fill_leaf
from leafwarp.leaf.mesh.vein_lines import CLEARANCE, LONGEST_PIECE, VeinLines, clean_veins
from leafwarp.leaf.venation.veins import Branch
from test_leaf_mesh import leaf_outline

VERTICES = 1707
ON_THE_LINE = 0.3  # [edges] smoothing and forks move a line by less
GRAIN = 0.05
SLIDING = 1e-3  # share of a line's length that is lost as its points slide past where it turns a little


def drawn_veins() -> list[Branch]:
    """The drawn leaf's midrib and five pairs of side veins [m]."""
    scale = np.array([1.0, -1.0]) * 0.1 / true_length()
    branches = []
    for number, line in enumerate(vein_lines()):
        start, end = (line - BASE) * scale
        points = start + np.linspace(0.0, 1.0, 60)[:, None] * (end - start)
        branches.append(Branch(points, np.linspace(1.0 if number == 0 else 0.08, 0.02, 60)))
    return branches


def mean_edge(leaf: FilledLeaf) -> float:
    return float(np.linalg.norm(np.subtract(*leaf.mesh.positions[leaf.mesh.edges.T]), axis=1).mean())


def distance_to_lines(points: np.ndarray, branches: list[Branch]) -> np.ndarray:
    dense = np.concatenate([np.linspace(branch.points[0], branch.points[-1], 2000) for branch in branches])
    return np.array([np.linalg.norm(dense - point, axis=1).min() for point in points])


@pytest.fixture(scope="module")
def cleaned() -> list[VeinLines]:
    return []


@pytest.fixture(scope="module")
def veined(cleaned: list[VeinLines]) -> FilledLeaf:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(triangulation, "clean_veins", lambda *given: cleaned.append(clean_veins(*given)) or cleaned[-1])
        return fill_leaf(*leaf_outline(), VERTICES, veins=drawn_veins())


def test_veined_mesh_is_a_good_disc(veined: FilledLeaf) -> None:
    check_topology(veined.mesh)
    quality = mesh_quality(veined.mesh)
    assert abs(veined.mesh.vertex_count - VERTICES) <= 0.02 * VERTICES
    assert quality.minimum_angle > 20.0 and quality.mean_radius_ratio > 0.93 and quality.edge_variation < 0.18
    assert (veined.mesh.positions[0] == 0.0).all()
    assert grain(veined.mesh).variation < GRAIN


def test_vein_edges_are_mesh_edges_on_the_veins(veined: FilledLeaf) -> None:
    edges = {tuple(edge) for edge in veined.mesh.edges.tolist()}
    pairs = np.sort(veined.vein_edges, axis=1).tolist()
    assert len(pairs) > 100 and all(tuple(pair) in edges for pair in pairs)
    assert len({tuple(pair) for pair in pairs}) == len(pairs)
    ends = veined.mesh.positions[veined.vein_edges]
    for points in (ends[:, 0], ends.mean(axis=1), ends[:, 1]):
        assert distance_to_lines(points, drawn_veins()).max() < ON_THE_LINE * mean_edge(veined)


def test_no_vein_is_lost_on_the_way(veined: FilledLeaf, cleaned: list[VeinLines]) -> None:
    """The edges are as long as the lines, and the lines as the veins less what is too near to the margin."""
    ends = veined.mesh.positions[veined.vein_edges]
    total = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
    assert total == pytest.approx(cleaned[-1].lengths.sum(), rel=SLIDING)
    assert cleaned[-1].count == len(drawn_veins())
    drawn = sum(np.linalg.norm(branch.points[-1] - branch.points[0]) for branch in drawn_veins())
    petiole = 0.03  # [m] too narrow at this edge length for a line along its middle
    assert drawn - petiole < total < drawn


def test_side_veins_share_a_vertex_with_the_midrib(veined: FilledLeaf) -> None:
    degree = np.bincount(veined.vein_edges.ravel())
    assert np.count_nonzero(degree >= 3) >= 5  # five pairs, the two of a pair at one fork or at two
    assert veined.vein_flow.max() > 0.3 and (veined.vein_flow > 0.0).all()


def test_line_begins_at_the_base_of_a_broad_leaf() -> None:
    """A sheath as broad as a blade has room for its midrib from the very base."""
    outline = np.array([[-0.01, 0.0], [0.01, 0.0], [0.01, 0.08], [0.0, 0.1], [-0.01, 0.08]])
    closed = np.concatenate([outline, outline[:1]])
    fine = np.concatenate([np.linspace(a, b, 200, endpoint=False) for a, b in pairwise(closed)])
    midrib = Branch(np.linspace([0.0, 0.0], [0.0, 0.1], 50), np.linspace(1.0, 0.05, 50))
    leaf = fill_leaf(fine, np.array([0.0, 0.1]), 500, veins=[midrib])
    assert 0 in leaf.vein_edges and np.abs(leaf.mesh.positions[leaf.vein_edges][..., 0]).max() < 1e-6


def test_lobe_vein_from_a_narrow_petiole_joins_the_midrib() -> None:
    """Its fork lies where the leaf is too narrow for lines; it is joined where both can first be."""
    midrib = drawn_veins()[0]
    fork = np.array([[0.0, 0.012], [0.0, 0.024], [0.02, 0.055]])
    lobe = Branch(
        np.concatenate([np.linspace(fork[0], fork[1], 30), np.linspace(fork[1], fork[2], 40)[1:]]), np.full(69, 0.3)
    )
    leaf = fill_leaf(*leaf_outline(), VERTICES, veins=[midrib, lobe])
    ends = leaf.mesh.positions[leaf.vein_edges]
    assert ends[..., 0].max() > 0.017 and ends[..., 1].max() > 0.09
    parts = connected_parts(leaf.vein_edges)
    assert parts == 1


def connected_parts(edges: np.ndarray) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    numbers, places = np.unique(edges, return_inverse=True)
    places = places.reshape(-1, 2)
    links = coo_array((np.ones(len(places)), tuple(places.T)), shape=(len(numbers), len(numbers)))
    return connected_components(links, directed=False)[0]


def scribbles(seed: int) -> list[Branch]:
    """Lines that cross one another, themselves and the margin."""
    random = np.random.default_rng(seed)
    lines = []
    for _ in range(20):
        steps = np.concatenate([random.uniform([-0.04, 0.0], [0.04, 0.1], (1, 2)), random.normal(0.0, 0.006, (20, 2))])
        lines.append(Branch(np.cumsum(steps, axis=0), np.full(21, random.uniform(0.01, 1.0))))
    return lines


@pytest.mark.parametrize("seed", range(4))
def test_scribbles_are_cleaned(seed: int) -> None:
    outline, tip = leaf_outline(teeth=40, depth=0.06)
    leaf = fill_leaf(outline, tip, 400, veins=scribbles(seed))
    check_topology(leaf.mesh)
    assert abs(leaf.mesh.vertex_count - 400) <= 8 and len(leaf.vein_edges) > 0
    assert mesh_quality(leaf.mesh).minimum_angle > 20.0
    edge = mean_edge(leaf)
    loops = boundary_loops(outline, tip, edge)
    lines = clean_veins(scribbles(seed), loops, edge)
    assert len(conflicts(lines.points, lines.pieces, 0.4 * edge, np.radians(20.0))) == 0
    assert lines.lengths.max() < 1.01 * LONGEST_PIECE * edge
    sides = np.concatenate([np.linspace(a, b, 30) for a, b in zip(loops[0], np.roll(loops[0], -1, 0), strict=True)])
    reach = np.linalg.norm(lines.points[:, None] - sides[None], axis=2).min(axis=1)
    assert reach.min() > 0.95 * CLEARANCE * edge


def test_thinnest_veins_are_given_up_where_the_mesher_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    fill, counts = triangulation.fill, []

    def choosy(loops: list, lines: VeinLines, edge: float) -> tuple:
        counts.append(lines.count)
        if lines.count > 3:
            raise UnfilledError("too many for this test")
        return fill(loops, lines, edge)

    monkeypatch.setattr(triangulation, "fill", choosy)
    leaf = fill_leaf(*leaf_outline(), 400, veins=drawn_veins())
    assert counts[0] > 3 and 0 < len(leaf.vein_edges)
    assert leaf.vein_flow.max() > 0.3  # the midrib stays


def test_outline_that_the_mesher_refuses_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def unable(*given: object) -> tuple:
        raise UnfilledError("not today")

    monkeypatch.setattr(triangulation, "fill", unable)
    with pytest.raises(InputError, match="cannot be filled with triangles: not today"):
        fill_leaf(*leaf_outline(), 400, veins=drawn_veins())


@pytest.mark.parametrize(
    ("points", "pieces", "found"),
    [
        ([[0, 0], [1, 1], [0, 1], [1, 0]], [[0, 1], [2, 3]], 1),  # crossing
        ([[0, 0], [1, 0], [0, 0.3], [1, 0.3]], [[0, 1], [2, 3]], 1),  # too near
        ([[0, 0], [1, 0], [0, 0.6], [1, 0.6]], [[0, 1], [2, 3]], 0),
        ([[0, 0], [1, 0], [1, 0.2]], [[0, 1], [0, 2]], 1),  # too sharp
        ([[0, 0], [1, 0], [1, 1.0]], [[0, 1], [2, 0]], 0),
        ([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]], 0),  # straight on
    ],
)
def test_conflicts(points: list, pieces: list, found: int) -> None:
    assert len(conflicts(np.array(points, float), np.array(pieces), 0.45, np.radians(25.0))) == found
