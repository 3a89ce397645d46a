"""Leaves built by hand, for tests of the structure."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf, LeafMesh
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of, strip_triangles

__all__ = ["leaf_of", "mesh_of", "one_triangle", "scene_of", "strip", "two_triangles"]


def mesh_of(positions, triangles) -> LeafMesh:
    """A mesh from positions [m] and counter-clockwise triangles, built edge by edge."""
    positions = np.asarray(positions, dtype=np.float64)
    triangles = np.asarray(triangles, dtype=np.int32)
    owners: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    area_of = {}
    vertex_areas = np.zeros(len(positions))
    for index, (a, b, c) in enumerate(triangles.tolist()):
        (ux, uy), (vx, vy) = positions[b] - positions[a], positions[c] - positions[a]
        area_of[index] = 0.5 * abs(ux * vy - uy * vx)
        vertex_areas[[a, b, c]] += area_of[index] / 3.0
        for first, second, opposite in ((a, b, c), (b, c, a), (c, a, b)):
            owners.setdefault((min(first, second), max(first, second)), []).append((first, second, opposite, index))
    edges = sorted(owners)
    hinges = [(*owners[e][0][:3], owners[e][1][2]) for e in edges if len(owners[e]) == 2]
    return LeafMesh(
        positions=positions,
        triangles=triangles,
        edges=np.array(edges, dtype=np.int32).reshape(-1, 2),
        hinges=np.array(hinges, dtype=np.int32).reshape(-1, 4),
        edge_areas=np.array([sum(area_of[owner[3]] for owner in owners[e]) for e in edges]),
        vertex_areas=vertex_areas,
    )


def one_triangle(side: float = 1e-2) -> Leaf:
    return leaf_of(mesh_of(side * np.array([[0, 0], [1, 0], [0.5, 0.75**0.5]]), [[0, 1, 2]]))


def two_triangles(side: float = 1e-2) -> Leaf:
    """One hinge, its edge along x; vertices 0 and 1 are on it, 2 is at +y and 3 at -y."""
    height = 0.75**0.5
    return leaf_of(mesh_of(side * np.array([[0, 0], [1, 0], [0.5, height], [0.5, -height]]), [[0, 1, 2], [1, 0, 3]]))


def strip(length: float = 0.1, *shape: float, **named: float) -> Leaf:
    """The strip of :func:`strip_triangles`."""
    return leaf_of(mesh_of(*strip_triangles(length, *shape, **named)), length)
