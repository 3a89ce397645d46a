"""Leaves built by hand, for tests of the structure."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf, LeafMesh, MapFrame
from leafwarp.scene import Scene


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


def leaf_of(mesh: LeafMesh, length: float | None = None) -> Leaf:
    """A leaf without maps on a mesh; its base is the origin."""
    reach = np.hypot(*mesh.positions.T).max() if length is None else length
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return Leaf(mesh, MapFrame(tuple(low), tuple(high - low)), float(reach), np.zeros((2, 2, 3), np.uint8))


def one_triangle(side: float = 1e-2) -> Leaf:
    return leaf_of(mesh_of(side * np.array([[0, 0], [1, 0], [0.5, 0.75**0.5]]), [[0, 1, 2]]))


def two_triangles(side: float = 1e-2) -> Leaf:
    """One hinge, its edge along x; vertices 0 and 1 are on it, 2 is at +y and 3 at -y."""
    height = 0.75**0.5
    return leaf_of(mesh_of(side * np.array([[0, 0], [1, 0], [0.5, height], [0.5, -height]]), [[0, 1, 2], [1, 0, 3]]))


def strip(length: float = 0.1, width: float = 0.02, columns: int = 20, jitter: float = 0.0, seed: int = 0) -> Leaf:
    """A strip along x from the origin, of nearly equilateral triangles with flat ends.

    Args:
        length: Extent along x [m].
        width: Extent along y, centred on the x axis [m].
        columns: Edges along the strip; the rows follow so that triangles are nearly equilateral.
        jitter: How far inner vertices are moved at random, as a share of the edge length.
        seed: Seed of the jitter.
    """
    spacing = length / columns
    rows = max(2, 2 * round(width / (spacing * 0.75**0.5) / 2))
    positions, index = [], {}
    for j in range(rows + 1):
        xs = [i * spacing for i in range(columns + 1)]
        if j % 2 != (rows // 2) % 2:
            xs = [0.0, *((i + 0.5) * spacing for i in range(columns)), length]
        for i, x in enumerate(xs):
            index[j, i] = len(positions)
            positions.append((x, (j / rows - 0.5) * width))
    triangles = []
    for j in range(rows):
        low, high = ([index[k, i] for i in range(columns + 2) if (k, i) in index] for k in (j, j + 1))
        a = b = 0
        while a < len(low) - 1 or b < len(high) - 1:
            step_low = a < len(low) - 1 and (
                b == len(high) - 1 or positions[low[a + 1]][0] <= positions[high[b + 1]][0]
            )
            if step_low:
                triangles.append((low[a], low[a + 1], high[b]))
                a += 1
            else:
                triangles.append((low[a], high[b + 1], high[b]))
                b += 1
    positions = np.array(positions)
    inner = (positions[:, 0] > 0) & (positions[:, 0] < length) & (np.abs(positions[:, 1]) < 0.499 * width)
    random = np.random.default_rng(seed)
    positions[inner] += jitter * spacing * random.uniform(-1.0, 1.0, (inner.sum(), 2))
    return leaf_of(mesh_of(positions, triangles), length)


def scene_of(structure: dict | None = None, motion: dict | None = None, **tables) -> Scene:
    """A scene with prescribed, constant water (unless ``fluid`` is given); the tables add to or replace plain ones."""
    data = {
        "leaf": {"image": "leaf.png", "length": 0.1, "camber": 0.0},
        "time": {"duration": 1.0},
        "water": {"curve": [[0.0, 1.0]]},
        "structure": {"membrane_stiffness": 5.0} | (structure or {}),
        "motion": {"drag": 0.0} | (motion or {}),
    }
    if "fluid" in tables:
        del data["water"]
    for name, table in tables.items():
        data[name] = data.get(name, {}) | table
    return Scene.model_validate(data)
