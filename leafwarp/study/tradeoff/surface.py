"""Points of the leaf's matter at which computations on different meshes and maps are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from leafwarp.leaf.leaf import LeafMesh

SAMPLES = 1000
# Of the triangles nearest to a point, so many are looked at for the one that holds it.
NEIGHBOURS = 16


@dataclass(frozen=True)
class Places:
    """Where points lie in a mesh.

    Attributes:
        triangles: The triangle of each point, shape [point_count].
        weights: Its barycentric coordinates there, shape [point_count, 3]; of a point outside the mesh, those of the
            triangle that it is least outside of, carried on linearly.
    """

    triangles: np.ndarray
    weights: np.ndarray

    def sample(self, mesh: LeafMesh, values: np.ndarray) -> np.ndarray:
        """Values at the vertices, shape [vertex_count, ...], at the points."""
        corners = values[mesh.triangles[self.triangles]]
        return np.einsum("pc,pc...->p...", self.weights, corners)


def find_places(mesh: LeafMesh, points: np.ndarray) -> Places:
    """Find points of the leaf's plane in a mesh.

    Args:
        mesh: The mesh.
        points: Positions [m] in the photographed leaf, shape [point_count, 2].
    """
    corners = mesh.positions[mesh.triangles]
    count = min(NEIGHBOURS, len(corners))
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=count)
    near = near.reshape(len(points), count)
    origin, a, b = (corners[near][:, :, k] for k in range(3))
    weights = _barycentric(points[:, None] - origin, a - origin, b - origin)
    best = np.argmax(weights.min(axis=2), axis=1)
    row = np.arange(len(points))
    return Places(near[row, best], weights[row, best])


def _barycentric(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    def cross(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]

    double_area = cross(a, b)
    u, v = cross(point, b) / double_area, cross(a, point) / double_area
    return np.stack([1.0 - u - v, u, v], axis=-1)


def sample_points(mesh: LeafMesh, count: int = SAMPLES) -> np.ndarray:
    """Points spread evenly over a leaf: those of a square grid that lie on its mesh, shape [about ``count``, 2] [m]."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    spacing = math.sqrt(mesh.vertex_areas.sum() / count)
    # The grid lies askew, so that no row of it runs along a midrib or an edge of the map.
    turn = np.array([[1.0, 0.5], [-0.5, 1.0]]) / math.sqrt(1.25)
    reach = math.ceil(np.linalg.norm(high - low) / spacing)
    steps = np.arange(-reach, reach + 1)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) @ turn * spacing + 0.5 * (low + high)
    grid = grid[((grid >= low) & (grid <= high)).all(axis=1)]
    inside = grid[find_places(mesh, grid).weights.min(axis=1) >= 0.0]
    # Of a leaf so slender that the grid misses it: its triangles' centroids.
    return inside if len(inside) >= count // 4 else mesh.positions[mesh.triangles].mean(axis=1)[:count]
