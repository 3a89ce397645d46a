"""Triangles of a leaf: springs and hinges of any triangulated disc, and the check that it is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class MeshQuality:
    """How good the triangles are.

    Attributes:
        minimum_angle: Smallest corner of any triangle [degree].
        mean_radius_ratio: Twice the inscribed over the circumscribed circle's radius, mean; 1 is equilateral.
        edge_variation: Standard deviation of the edge lengths over their mean.
    """

    minimum_angle: float
    mean_radius_ratio: float
    edge_variation: float


def mesh_from_triangles(positions: np.ndarray, triangles: np.ndarray) -> LeafMesh:
    """Springs, hinges and areas of a flat triangulated disc.

    Args:
        positions: Vertex positions [m], shape [vertex_count, 2]; the petiole base is the origin.
        triangles: Vertex indices, counter-clockwise, shape [triangle_count, 3].

    Raises:
        InputError: It is no disc (see :func:`check_disc`).
    """
    positions = np.ascontiguousarray(positions, np.float64)
    triangles = np.ascontiguousarray(triangles, np.int32)
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise InputError(f"mesh: positions of shape {positions.shape} are not accepted; accepted: finite, [count, 2]")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
        raise InputError(f"mesh: triangles of shape {triangles.shape} are not accepted; accepted: [count >= 1, 3]")
    _refuse_bad_indices(triangles, len(positions))
    topology = _topology(positions, triangles)
    areas = _signed_areas(positions, triangles)
    order = np.lexsort(topology.edges_unique.T[::-1])
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    edge_of = rank[topology.edges_unique_inverse]  # of each triangle's three edges in turn
    mesh = LeafMesh(
        positions=positions,
        triangles=triangles,
        edges=topology.edges_unique[order].astype(np.int32),
        hinges=_hinges(triangles, edge_of),
        edge_areas=np.bincount(edge_of, np.repeat(areas, 3), len(order)),
        vertex_areas=np.bincount(triangles.ravel(), np.repeat(areas / 3.0, 3), len(positions)),
    )
    check_disc(mesh)
    return mesh


def check_disc(mesh: LeafMesh) -> MeshQuality:
    """Check that a mesh is one flat disc, and measure its triangles.

    One connected piece with one boundary loop and V - E + F = 1; every edge in one or two triangles, run
    through in opposite directions by the two; no triangle uses a vertex twice or is clockwise; no vertex is
    unused or joins two pieces like the middle of an hourglass.

    Raises:
        InputError: One of these fails; the message names the first offender.
    """
    triangles = mesh.triangles
    _refuse_bad_indices(triangles, mesh.vertex_count)
    areas = _signed_areas(mesh.positions, triangles)
    if (areas <= 0.0).any():
        bad = int(np.argmin(areas))
        raise InputError(
            f"mesh: triangle {bad} {triangles[bad].tolist()} is not counter-clockwise: area {areas[bad]:.3g}"
        )
    topology = _topology(mesh.positions, triangles)
    shared = np.bincount(topology.edges_unique_inverse)
    if shared.max() > 2:
        bad = topology.edges_unique[np.argmax(shared)].tolist()
        raise InputError(f"mesh: edge {bad} belongs to {shared.max()} triangles; accepted: 1 or 2")
    directed = topology.edges.astype(np.int64) @ np.array([mesh.vertex_count, 1])
    if len(np.unique(directed)) < len(directed):
        raise InputError("mesh: two triangles run through a shared edge in the same direction; orientation differs")
    _check_boundary(topology.edges[shared[topology.edges_unique_inverse] == 1])
    pieces = 1 + int(topology_labels(topology).max())
    if pieces != 1:
        raise InputError(f"mesh: it falls into {pieces} pieces; accepted: 1")
    euler = mesh.vertex_count - len(topology.edges_unique) + len(triangles)
    if euler != 1:
        raise InputError(f"mesh: V - E + F = {euler}; accepted: 1 (a disc)")
    return _quality(mesh, areas)


def topology_labels(topology: trimesh.Trimesh) -> np.ndarray:
    """Number of the connected piece that each triangle belongs to, shape [triangle_count]."""
    import trimesh

    return trimesh.graph.connected_component_labels(topology.face_adjacency, node_count=len(topology.faces))


def _topology(positions: np.ndarray, triangles: np.ndarray) -> trimesh.Trimesh:
    import trimesh

    solid = np.column_stack([positions, np.zeros(len(positions))])
    return trimesh.Trimesh(solid, triangles, process=False, validate=False)


def _refuse_bad_indices(triangles: np.ndarray, vertex_count: int) -> None:
    if triangles.min() < 0 or triangles.max() >= vertex_count:
        raise InputError(f"mesh: vertex index {triangles.max()} is not accepted; accepted: 0 to {vertex_count - 1}")
    repeated = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    if repeated.any():
        bad = int(np.argmax(repeated))
        raise InputError(f"mesh: triangle {bad} {triangles[bad].tolist()} uses a vertex twice")
    unused = np.bincount(triangles.ravel(), minlength=vertex_count) == 0
    if unused.any():
        raise InputError(f"mesh: vertex {int(np.argmax(unused))} belongs to no triangle")


def _check_boundary(boundary: np.ndarray) -> None:
    """Refuse what is not one simple loop; rows are the directed edges with one triangle."""
    successor = dict(boundary.tolist())
    if len(successor) < len(boundary):
        starts = np.bincount(boundary[:, 0])
        raise InputError(f"mesh: vertex {int(np.argmax(starts))} joins two pieces like an hourglass")
    if not successor:
        raise InputError("mesh: it has no boundary; accepted: a disc")
    first = vertex = int(boundary[0, 0])
    steps = 0
    while steps == 0 or (vertex != first and steps <= len(boundary)):
        vertex, steps = successor[vertex], steps + 1
    if steps != len(boundary):
        raise InputError(f"mesh: its boundary is more than one loop ({steps} of {len(boundary)} edges in the first)")


def _hinges(triangles: np.ndarray, edge_of: np.ndarray) -> np.ndarray:
    """Angular springs in the order of their edges: (a, b) as its first triangle runs through it, and the
    opposites.

    The sign of the angle follows that direction. An edge stored as (low index, high index) instead would flip
    the sign of half of the angles.
    """
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)  # the order of trimesh's ``edges``
    opposite = triangles[:, [2, 0, 1]].ravel()
    order = np.argsort(edge_of, kind="stable")  # equal edges stay in the order of their triangles
    first = np.nonzero(edge_of[order[:-1]] == edge_of[order[1:]])[0]
    one, two = order[first], order[first + 1]
    return np.column_stack([directed[one], opposite[one], opposite[two]]).astype(np.int32)


def _signed_areas(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _quality(mesh: LeafMesh, areas: np.ndarray) -> MeshQuality:
    corners = mesh.positions[mesh.triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    product, half = sides.prod(axis=1), 0.5 * sides.sum(axis=1)
    # The smallest angle faces the shortest side: sin = 2 area * shortest / product; it never exceeds 60
    # degrees.
    sine = 2.0 * areas * sides.min(axis=1) / product
    edges = np.linalg.norm(np.subtract(*mesh.positions[mesh.edges.T]), axis=1)
    return MeshQuality(
        minimum_angle=float(np.degrees(np.arcsin(np.clip(sine, 0.0, 1.0)).min())),
        mean_radius_ratio=float((8.0 * areas**2 / (half * product)).mean()),
        edge_variation=float(edges.std() / edges.mean()),
    )
