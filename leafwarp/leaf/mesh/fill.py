"""Polygons filled with uniform triangles, with lines inside that stay edges (netgen)."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from leafwarp.leaf.mesh.segments import closed_chain, conflicts
from leafwarp.leaf.mesh.vein_lines import VeinLines

GRADING = 0.6  # how fast the triangles may grow away from a short side
APART, OPEN = 1e-3, np.radians(2.0)  # [edges] least distance of two lines, and least angle
MET = 1e-6  # [edges] a vertex so near to a point is that point


class UnfilledError(Exception):
    """The polygons cannot be filled along these lines."""


def fill(loops: list[np.ndarray], lines: VeinLines, edge: float) -> tuple[np.ndarray, np.ndarray, VeinLines]:
    """Fill polygons with triangles.

    Args:
        loops: Closed polygons [m], shape [count, 2] each, the leaf to their left; the first point of the first is the
            origin.
        lines: Lines inside, to be edges of the mesh.
        edge: Edge length [m].

    Returns:
        Positions [m], shape [vertex_count, 2]; counter-clockwise triangles, shape [triangle_count, 3]; and the lines,
        each piece an edge: the mesher halves a piece here and there. The corners of the polygons and the points of
        the lines are exactly vertices.

    Raises:
        UnfilledError: The mesher fails, or a line is not followed.
    """
    _refuse_conflicts(loops, lines, edge)
    import netgen.meshing
    from netgen.geom2d import SplineGeometry

    netgen.meshing.SetMessageImportance(0)  # nothing on stdout
    geometry = SplineGeometry()
    for loop in loops:
        corners = [geometry.AppendPoint(*point) for point in (loop / edge).tolist()]
        if loop is loops[0]:
            base = corners[0]
        for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
            geometry.Append(["line", corner, following], leftdomain=1, rightdomain=0)
    points = [
        base if number == lines.at_base else geometry.AppendPoint(*point)
        for number, point in enumerate((lines.points / edge).tolist())
    ]
    for start, end in lines.pieces.tolist():
        geometry.Append(["line", points[start], points[end]], leftdomain=1, rightdomain=1)
    try:
        filled = geometry.GenerateMesh(maxh=1.0, grading=GRADING)
    except Exception as error:  # netgen raises its own type with a text of its own
        raise UnfilledError(str(error)) from error
    positions = np.array([tuple(point.p)[:2] for point in filled.Points()]).reshape(-1, 2) * edge
    triangles = np.array([[vertex.nr for vertex in face.vertices] for face in filled.Elements2D()], np.int64) - 1
    if len(triangles) == 0:
        raise UnfilledError("no triangle came out")
    for given in (*loops, lines.points):
        places = vertices_at(positions, given)
        if (np.linalg.norm(positions[places] - given, axis=1) > MET * edge).any():
            raise UnfilledError("a corner is missing")
        positions[places] = given
    lines = _followed(lines, positions, triangles, MET * edge)
    corner = positions[triangles]
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    if np.sum(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) < 0.0:
        triangles = triangles[:, ::-1]
    return positions, triangles, lines


def _refuse_conflicts(loops: list[np.ndarray], lines: VeinLines, edge: float) -> None:
    """Refuse sides and pieces that cross or touch: the mesher would run for ever on some."""
    points, pieces = [], []
    for loop in loops:
        pieces.append(closed_chain(len(loop), sum(map(len, points))))
        points.append(loop)
    numbers = sum(map(len, points)) + np.arange(len(lines.points))
    if lines.at_base >= 0:
        numbers[lines.at_base] = 0
    pieces.append(numbers[lines.pieces])
    pairs = conflicts(np.concatenate([*points, lines.points]) / edge, np.concatenate(pieces), APART, OPEN)
    if len(pairs):
        raise UnfilledError("lines cross")


def vertices_at(positions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Index of the vertex nearest to each point, shape [count]."""
    from scipy.spatial import cKDTree

    return cKDTree(positions).query(points)[1] if len(points) else np.zeros(0, np.int64)


def _followed(lines: VeinLines, positions: np.ndarray, triangles: np.ndarray, tolerance: float) -> VeinLines:
    """The lines with every piece an edge: a piece with vertices upon it is cut there."""
    if lines.count == 0:
        return lines
    places = vertices_at(positions, lines.points)
    missing = ~_are_edges(triangles, places[lines.pieces], len(positions))
    pieces, source, points = [], [], list(lines.points)
    for number, (start, end) in enumerate(lines.pieces.tolist()):
        chain = [start, end]
        if missing[number]:
            upon = _upon(positions, lines.points[start], lines.points[end], tolerance)
            chain = [start, *range(len(points), len(points) + len(upon)), end]
            points += list(upon)
        pieces += pairwise(chain)
        source += [number] * (len(chain) - 1)
    cut = replace(
        lines, points=np.array(points), pieces=np.array(pieces), flow=lines.flow[source], line=lines.line[source]
    )
    if not _are_edges(triangles, vertices_at(positions, cut.points)[cut.pieces], len(positions)).all():
        raise UnfilledError("a vein is not followed")
    return cut


def _upon(positions: np.ndarray, start: np.ndarray, end: np.ndarray, tolerance: float) -> np.ndarray:
    """Vertices between two points on the straight line that joins them, in order, shape [count, 2]."""
    along = end - start
    length = np.hypot(*along)
    offset = positions - start
    at = offset @ along / length
    beside = np.abs(offset[:, 0] * along[1] - offset[:, 1] * along[0]) / length
    upon = np.flatnonzero((beside < tolerance) & (at > tolerance) & (at < length - tolerance))
    return positions[upon[np.argsort(at[upon])]]


def _are_edges(triangles: np.ndarray, pairs: np.ndarray, vertex_count: int) -> np.ndarray:
    """Whether each pair of vertices is an edge, shape [count], bool."""
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    present = sides.min(axis=1) * vertex_count + sides.max(axis=1)
    return np.isin(pairs.min(axis=1) * vertex_count + pairs.max(axis=1), present)
