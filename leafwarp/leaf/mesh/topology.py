"""Triangles of a leaf: springs and hinges of any triangulated sheet, and the check of its topology."""

from __future__ import annotations

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh


def mesh_from_triangles(positions: np.ndarray, triangles: np.ndarray, holes: int | None = 0) -> LeafMesh:
    """Springs, hinges and areas of a flat triangulated sheet.

    Args:
        positions: Vertex positions [m], shape [vertex_count, 2]; the petiole base is the origin.
        triangles: Vertex indices, counter-clockwise, shape [triangle_count, 3].
        holes: Number of holes that the sheet must have; None accepts any.

    Raises:
        InputError: It is no such sheet (see :func:`check_topology`).
    """
    positions = np.ascontiguousarray(positions, np.float64)
    triangles = np.ascontiguousarray(triangles, np.int32)
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise InputError(f"mesh: positions of shape {positions.shape} are not accepted; accepted: finite, [count, 2]")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
        raise InputError(f"mesh: triangles of shape {triangles.shape} are not accepted; accepted: [count >= 1, 3]")
    _refuse_bad_indices(triangles, len(positions))
    edges, edge_of = unique_edges(triangles, len(positions))
    areas = signed_areas(positions, triangles)
    mesh = LeafMesh(
        positions=positions,
        triangles=triangles,
        edges=edges.astype(np.int32),
        hinges=_hinges(triangles, edge_of),
        edge_areas=np.bincount(edge_of, np.repeat(areas, 3), len(edges)),
        vertex_areas=np.bincount(triangles.ravel(), np.repeat(areas / 3.0, 3), len(positions)),
    )
    check_topology(mesh, holes)
    return mesh


def check_topology(mesh: LeafMesh, holes: int | None = 0) -> None:
    """Check that a mesh is one flat sheet: a disc, or a disc with holes.

    One connected piece with one boundary loop and one more for each hole, and V - E + F = 1 - holes; every edge
    in one or two triangles, run through in opposite directions by the two; no triangle uses a vertex twice or is
    clockwise; no vertex is unused or joins two pieces like the middle of an hourglass.

    Args:
        mesh: The mesh.
        holes: Number of holes that it must have; None accepts any.

    Raises:
        InputError: One of these fails; the message names the first offender.
    """
    triangles = mesh.triangles
    _refuse_bad_indices(triangles, mesh.vertex_count)
    areas = signed_areas(mesh.positions, triangles)
    if not (areas > 0.0).all():
        bad = int(np.argmin(areas))
        raise InputError(
            f"mesh: triangle {bad} {triangles[bad].tolist()} is not counter-clockwise: area {areas[bad]:.3g}"
        )
    edges, edge_of = unique_edges(triangles, mesh.vertex_count)
    shared = np.bincount(edge_of)
    if shared.max() > 2:
        bad = edges[np.argmax(shared)].tolist()
        raise InputError(f"mesh: edge {bad} belongs to {shared.max()} triangles; accepted: 1 or 2")
    directed = directed_edges(triangles)
    if len(np.unique(directed @ np.array([mesh.vertex_count, 1]))) < len(directed):
        raise InputError("mesh: two triangles run through a shared edge in the same direction; orientation differs")
    loops = _boundary_loops(directed[shared[edge_of] == 1])
    if holes is not None and loops != 1 + holes:
        raise InputError(f"mesh: its boundary is {loops} loops; accepted: {1 + holes}")
    pieces = _piece_count(edges, mesh.vertex_count)
    if pieces != 1:
        raise InputError(f"mesh: it falls into {pieces} pieces; accepted: 1")
    euler = mesh.vertex_count - len(edges) + len(triangles)
    if euler != 2 - loops:
        raise InputError(f"mesh: V - E + F = {euler}; accepted: {2 - loops} (a disc with {loops - 1} holes)")


def directed_edges(triangles: np.ndarray) -> np.ndarray:
    """The three edges of each triangle in turn, as it runs through them, shape [3 triangle_count, 2], int64."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)


def unique_edges(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Each edge once as (low index, high index), ascending, shape [edge_count, 2]; and which of them each of
    :func:`directed_edges` is, shape [3 triangle_count]."""
    directed = directed_edges(triangles)
    key = directed.min(axis=1) * vertex_count + directed.max(axis=1)
    keys, edge_of = np.unique(key, return_inverse=True)
    return np.column_stack(np.divmod(keys, vertex_count)), edge_of.ravel()


def boundary_edges(mesh: LeafMesh) -> np.ndarray:
    """The edges of one triangle only, directed so that the leaf is to their left, shape [count, 2]."""
    _, edge_of = unique_edges(mesh.triangles, mesh.vertex_count)
    return directed_edges(mesh.triangles)[np.bincount(edge_of)[edge_of] == 1]


def signed_areas(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area of each triangle [m^2], positive where counter-clockwise, shape [triangle_count]."""
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _refuse_bad_indices(triangles: np.ndarray, vertex_count: int) -> None:
    if triangles.min() < 0 or triangles.max() >= vertex_count:
        bad = triangles.min() if triangles.min() < 0 else triangles.max()
        raise InputError(f"mesh: vertex index {bad} is not accepted; accepted: 0 to {vertex_count - 1}")
    repeated = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    if repeated.any():
        bad = int(np.argmax(repeated))
        raise InputError(f"mesh: triangle {bad} {triangles[bad].tolist()} uses a vertex twice")
    unused = np.bincount(triangles.ravel(), minlength=vertex_count) == 0
    if unused.any():
        raise InputError(f"mesh: vertex {int(np.argmax(unused))} belongs to no triangle")


def _boundary_loops(boundary: np.ndarray) -> int:
    """Number of loops that the directed edges with one triangle make; each is simple, or the mesh is refused."""
    successor = dict(boundary.tolist())
    if len(successor) < len(boundary):
        starts = np.bincount(boundary[:, 0])
        raise InputError(f"mesh: vertex {int(np.argmax(starts))} joins two pieces like an hourglass")
    if not successor:
        raise InputError("mesh: it has no boundary; accepted: a disc")
    loops = 0
    while successor:
        loops += 1
        first, vertex = successor.popitem()
        while vertex != first:
            vertex = successor.pop(vertex)
    return loops


def _piece_count(edges: np.ndarray, vertex_count: int) -> int:
    """Connected pieces. SciPy would count them too, but every load of a prepared leaf would have to import it."""
    piece = np.arange(vertex_count)
    while True:
        lowest = piece.copy()
        least = piece[edges].min(axis=1)
        for end in edges.T:
            np.minimum.at(lowest, end, least)
        lowest = lowest[lowest]
        if (lowest == piece).all():
            return len(np.unique(piece))
        piece = lowest


def _hinges(triangles: np.ndarray, edge_of: np.ndarray) -> np.ndarray:
    """Angular springs in the order of their edges: (a, b) as its first triangle runs through it, and the
    opposites.

    The sign of the angle follows that direction. An edge stored as (low index, high index) instead would flip
    the sign of half of the angles.
    """
    directed = directed_edges(triangles)
    opposite = triangles[:, [2, 0, 1]].ravel()
    order = np.argsort(edge_of, kind="stable")  # equal edges stay in the order of their triangles
    first = np.nonzero(edge_of[order[:-1]] == edge_of[order[1:]])[0]
    one, two = order[first], order[first + 1]
    return np.column_stack([directed[one], opposite[one], opposite[two]]).astype(np.int32)
