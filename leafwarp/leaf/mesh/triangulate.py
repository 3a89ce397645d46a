"""An outline filled with so many triangles of one size, without grain, along the veins where that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh.anneal import anneal
from leafwarp.leaf.mesh.boundary import boundary_loops
from leafwarp.leaf.mesh.fill import UnfilledError, fill, vertices_at
from leafwarp.leaf.mesh.quality import corner_angles
from leafwarp.leaf.mesh.repair import open_corners
from leafwarp.leaf.mesh.topology import boundary_edges, mesh_from_triangles
from leafwarp.leaf.mesh.vein_lines import NO_LINES, VeinLines, clean_veins
from leafwarp.leaf.venation.veins import Branch

LEAST_VERTICES, MOST_VERTICES = 30, 400_000
SPARED = 0.015  # share of the vertices asked for that the mesher is to leave to be put in afterwards
# Beside given lines the mesher makes triangles larger than their pieces, by 6 % of an edge. With these left out as
# well, a line's pieces are as long as the mean edge in the end: shorter ones squeeze the rows beside them into grain.
VEINED_SPARED = 0.12
MOST_OFF = 0.025  # share of the vertices by which it may miss that
MOST_OF_ROOM = 0.5  # share of the inner triangles that are given a vertex
TRIES = 10
FIRST_EDGE, VEINED_EDGE = 0.95, 0.89  # first guesses, of the edges that uniform triangles would have
LEAST_ANGLE = np.radians(20.0)
MOST_WIDENED = 1.5  # of the mesh over the outline: with thin parts widened further it is another leaf, and heavier
KEEP_BOUNDARY = 0.08  # error of the count below which only the inner edge length is still changed


@dataclass(frozen=True)
class FilledLeaf:
    """A leaf's mesh and the veins that it follows.

    Attributes:
        mesh: The mesh; its first vertex is the petiole base, at the origin.
        holes: Number of its holes.
        vein_edges: Edges along veins, as vertex indices from the base outwards, shape [count, 2], int32.
        vein_flow: Share of the leaf that each of them drains, shape [count].
    """

    mesh: LeafMesh
    holes: int
    vein_edges: np.ndarray
    vein_flow: np.ndarray


def fill_leaf(
    outline: np.ndarray,
    tip: np.ndarray,
    vertices: int,
    *,
    holes: Sequence[np.ndarray] = (),
    veins: Sequence[Branch] = (),
) -> FilledLeaf:
    """Triangulate a leaf uniformly.

    Args:
        outline: Corners of the closed outline [m], shape [count, 2], y up, the petiole base at the origin (on
            the outline).
        tip: Point of the outline farthest from the base [m], shape [2].
        vertices: Number of vertices asked for; met exactly or missed by at most 1 % upwards, but for
            meshes so coarse that the boundary takes most of them.
        holes: Closed polygons [m], shape [count, 2] each, that stay open; one smaller than about an edge is filled.
        veins: Veins with their points in metres; the main ones become edges of the mesh (see
            :mod:`leafwarp.leaf.mesh.vein_lines`).

    Raises:
        InputError: The count is out of range or too small for a leaf so narrow, or the outline cannot be filled.
    """
    if not LEAST_VERTICES <= vertices <= MOST_VERTICES:
        raise InputError(
            f"mesh: vertices: value {vertices} is not accepted; accepted: {LEAST_VERTICES} to {MOST_VERTICES}"
        )
    edge, most_spared = (VEINED_EDGE, VEINED_SPARED) if len(veins) else (FIRST_EDGE, SPARED)
    edge *= _edge_estimate([outline, *holes], vertices)
    best, best_error, keep = None, np.inf, False
    for _ in range(TRIES):
        # Near the target the boundary and the veins stay as they are: another choice of teeth would change the
        # count by leaps.
        if not keep:
            loops = boundary_loops(outline, tip, edge, holes)
            lines = clean_veins(veins, loops, edge) if len(veins) else NO_LINES
        positions, triangles, followed = _fill(loops, lines, veins, edge)
        missing = 1.0 - len(positions) / vertices
        # What is missing is put in afterwards, as far as there is room; what is too much stays.
        given = vertices_at(positions, np.concatenate([*loops, followed.points]))
        spared = min(most_spared, max(SPARED, MOST_OF_ROOM * len(_roomy(positions, triangles, given)) / vertices))
        error = abs(missing - spared)
        if error < best_error:
            best, best_error = (positions, triangles, followed, loops), error
        if error <= MOST_OFF:
            break
        keep = keep or error < KEEP_BOUNDARY
        # While boundary and veins stay, only the other vertices follow the edge length.
        fixed = len(given) if keep else 0
        edge *= np.sqrt(max(len(positions) - fixed, 1) / max((1.0 - spared) * vertices - fixed, 1))
    leaf = _finished(*best, tip, vertices)
    widened = leaf.mesh.vertex_areas.sum() / _area(outline)
    if widened > MOST_WIDENED:
        raise InputError(
            f"mesh: vertices: value {vertices} is too few for a leaf with so narrow parts, whose mesh would have "
            f"{widened:.1f} times its area; accepted: more vertices"
        )
    return leaf


def _area(polygon: np.ndarray) -> float:
    """Area of a closed polygon."""
    x, y = polygon.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _edge_estimate(polygons: Sequence[np.ndarray], vertices: int) -> float:
    """Edge length [m] at which uniform triangles have about so many vertices, the first polygon less the others."""
    area = _area(polygons[0]) - sum(map(_area, polygons[1:]))
    perimeter = sum(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum() for polygon in polygons)
    # V = 1 + (F + B)/2 with F = area / (sqrt(3)/4 h^2) triangles and B = perimeter / h boundary edges.
    return (perimeter + np.sqrt(perimeter**2 + 32.0 / np.sqrt(3.0) * area * (vertices - 1))) / (4.0 * (vertices - 1))


def _fill(
    loops: list[np.ndarray], lines: VeinLines, veins: Sequence[Branch], edge: float
) -> tuple[np.ndarray, np.ndarray, VeinLines]:
    """Positions, triangles and the vein lines that could be followed: the thinnest are given up where need be."""
    while True:
        try:
            return fill(loops, lines, edge)
        except UnfilledError as error:
            if lines.count == 0:
                raise InputError(f"mesh: the outline cannot be filled with triangles: {error}") from error
        most = lines.count - max(1, lines.count // 4)
        lines = clean_veins(veins, loops, edge, most) if most else NO_LINES


def _finished(
    positions: np.ndarray,
    triangles: np.ndarray,
    lines: VeinLines,
    loops: list[np.ndarray],
    tip: np.ndarray,
    vertices: int,
) -> FilledLeaf:
    """The mesh with vertices put in up to the number asked for, without grain, numbered by distance from the base."""
    holes = len(loops) - 1
    rough = mesh_from_triangles(positions, triangles, holes)
    along = vertices_at(positions, lines.points)[lines.pieces]
    boundary = boundary_edges(rough).ravel()
    given = np.concatenate([boundary, along.ravel()])
    positions, triangles = _with_more(positions, triangles, given, vertices - len(positions))
    joints = np.flatnonzero(~np.isin(np.bincount(along.ravel()), (0, 2)))  # forks and ends of the veins
    unit = np.sqrt(rough.vertex_areas.sum() / len(triangles) / np.sqrt(0.1875))  # side of the mean triangle
    moved, triangles = anneal(positions / unit, triangles, np.union1d(boundary, joints), along)
    # Base and tip stay where they are; the veins do not move sideways, unless they alone hold a corner sharp.
    ends = vertices_at(positions, np.stack([np.zeros(2), tip]))
    moved = open_corners(moved, triangles, np.concatenate([along.ravel(), ends]))
    if corner_angles(moved, triangles).min() < LEAST_ANGLE:
        moved = open_corners(moved, triangles, ends)
    moved = np.where(moved == positions / unit, positions, moved * unit)  # what stayed, stays exactly
    # By distance from the base: neighbours are then near in memory too (the front is as narrow as the leaf is
    # wide), and vertex 0 is the base.
    order = np.argsort(np.hypot(*moved.T), kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    triangles = rank[triangles]
    triangles = np.take_along_axis(triangles, (triangles.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return FilledLeaf(
        mesh=mesh_from_triangles(moved[order], triangles[np.lexsort(triangles.T[::-1])], holes),
        holes=holes,
        vein_edges=rank[along].astype(np.int32),
        vein_flow=lines.flow,
    )


def _with_more(
    positions: np.ndarray, triangles: np.ndarray, fixed: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """So many vertices more (or as many as there is room for), each in the middle of an inner triangle, spread evenly
    over the leaf."""
    roomy = _roomy(positions, triangles, fixed)
    count = min(max(count, 0), len(roomy))
    if count == 0:
        return positions, triangles
    middles = positions[triangles].mean(axis=1)
    chosen = roomy[np.argsort(np.hypot(*middles[roomy].T), kind="stable")]
    chosen = chosen[((np.arange(count) + 0.5) * (len(roomy) / count)).astype(int)]
    a, b, c = triangles[chosen].T
    new = len(positions) + np.arange(count)
    triangles = triangles.copy()
    triangles[chosen] = np.column_stack([a, b, new])
    split = [np.column_stack([b, c, new]), np.column_stack([c, a, new])]
    return np.concatenate([positions, middles[chosen]]), np.concatenate([triangles, *split])


def _roomy(positions: np.ndarray, triangles: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Inner triangles: those without a fixed vertex."""
    free = np.ones(len(positions), bool)
    free[fixed] = False
    return np.flatnonzero(free[triangles].all(axis=1))
