"""How good the triangles of a mesh are: their angles, their shapes and the evenness of their edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.leaf import LeafMesh


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


def mesh_quality(mesh: LeafMesh) -> MeshQuality:
    """Measure the shapes of a mesh's triangles and the evenness of its edges."""
    edges = np.linalg.norm(np.subtract(*mesh.positions[mesh.edges.T]), axis=1)
    return MeshQuality(
        minimum_angle=float(np.degrees(corner_angles(mesh.positions, mesh.triangles).min())),
        mean_radius_ratio=float(radius_ratios(mesh).mean()),
        edge_variation=float(edges.std() / edges.mean()),
    )


def corner_angles(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Angle of each triangle at each of its vertices [rad], shape [triangle_count, 3]."""
    corners = positions[triangles]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    return np.arctan2(np.abs(cross), (ahead * behind).sum(axis=2))


def radius_ratios(mesh: LeafMesh) -> np.ndarray:
    """Twice the inscribed over the circumscribed circle's radius of each triangle, shape [triangle_count]."""
    corners = mesh.positions[mesh.triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    half = 0.5 * sides.sum(axis=1)
    squared_area = np.maximum(half * (half[:, None] - sides).prod(axis=1), 0.0)
    return 8.0 * squared_area / (half * sides.prod(axis=1))
