"""Triangles without grain: a mesh melted and cooled again, its outline and its vein lines kept.

A mesher fills an outline row by row. Its triangles are good, but they lie in rows, and the rows are stretched by
several percent one way to fit the outline: the sheet is then stiffer one way than across it, by twice as much.
Here the inner vertices are shaken while they are smoothed. Each step moves every vertex to the mean of its
triangles' circumcentres weighted by their areas, which makes triangles equilateral (optimal Delaunay
triangulation; Chen and Xu 2004), plus noise that falls to nothing, and then flips edges until the mesh is Delaunay
again (Lawson 1977), never an edge that is to stay. Rows melt at the first steps; what freezes has
small patches that lie in all directions. Vertex and triangle counts stay, and no triangle turns over.

Vertices of lines that stay slide along them. Held in place, they would stretch or squeeze the rows beside them all
alike, by as much as a line's pieces differ from the mean edge, and that is grain again.

Lengths are in units of the mean edge.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.mesh.topology import directed_edges, signed_areas

NOISE = 0.25  # standard deviation of the first step's noise along each axis: enough to melt the rows
COOLING, COLD = 30, 10  # steps in which it falls to nothing, and steps without
LEAST_AREA = 0.05  # no triangle is made smaller than this; an equilateral one has 0.43
FARTHEST_CENTRE = 0.6  # a circumcentre farther from the centroid belongs to a triangle too flat to follow it
HALVINGS = 6  # of a step that would make a triangle too small, before it is given up
FLIP_PASSES = 60
BEND = np.radians(15.0)  # a line that turns more at a vertex would be cut short if the vertex slid away


def anneal(
    positions: np.ndarray, triangles: np.ndarray, fixed: np.ndarray, kept: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Melt and cool a mesh.

    Args:
        positions: Vertex positions [mean edges], shape [vertex_count, 2].
        triangles: Vertex indices, counter-clockwise, shape [triangle_count, 3].
        fixed: Indices of the vertices that stay in place; those of the boundary at least.
        kept: Inner edges that are not flipped, as vertex indices, shape [count, 2]. Where two of them meet at a
            vertex that is not fixed, it moves along the line they make only, and not at all where that bends.
        seed: Seed of the noise.

    Returns:
        Positions and triangles, of the same shapes.
    """
    random = np.random.default_rng(seed)
    positions = positions.copy()
    kept = np.asarray(kept, np.int64).reshape(-1, 2)
    kept_keys = _edge_keys(kept, len(positions))
    sliding, along = _rails(positions, kept, fixed)
    triangles = _delaunay(positions, triangles, kept_keys)
    for noise in np.append(np.linspace(NOISE, 0.0, COOLING), np.zeros(COLD)):
        step = _toward_circumcentres(positions, triangles) + noise * random.standard_normal(positions.shape)
        step[fixed] = 0.0
        step[sliding] = (step[sliding] * along).sum(axis=1)[:, None] * along
        positions = _moved(positions, triangles, step)
        triangles = _delaunay(positions, triangles, kept_keys)
    return positions, triangles


def _rails(positions: np.ndarray, kept: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices inside lines of kept edges, but for the fixed, and the line's unit direction at each, 0 at a bend."""
    inside = np.bincount(kept.ravel(), minlength=len(positions)) == 2
    inside[fixed] = False
    # The two neighbours of such a vertex, one behind the other, after sorting the ends of all edges by vertex.
    ends, others = kept.ravel(), kept[:, ::-1].ravel()
    order = np.argsort(ends, kind="stable")
    order = order[inside[ends[order]]]
    sliding, before, after = ends[order[::2]], others[order[::2]], others[order[1::2]]
    behind, ahead = positions[sliding] - positions[before], positions[after] - positions[sliding]
    straight = (ahead * behind).sum(axis=1) > np.cos(BEND) * np.hypot(*ahead.T) * np.hypot(*behind.T)
    along = ahead + behind
    return sliding, np.where(straight[:, None], along, 0.0) / np.maximum(np.hypot(*along.T), 1e-300)[:, None]


def _toward_circumcentres(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """From each vertex to the mean of its triangles' circumcentres, weighted by area, shape [vertex_count, 2]."""
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    uu, vv = (u**2).sum(axis=1), (v**2).sum(axis=1)
    double_area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    centre = (
        a + np.column_stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu]) / (2.0 * double_area)[:, None]
    )
    middle = (a + b + c) / 3.0
    centre = np.where((np.linalg.norm(centre - middle, axis=1) < FARTHEST_CENTRE)[:, None], centre, middle)
    corners, count = triangles.ravel(), len(positions)
    pull = [np.bincount(corners, np.repeat(double_area * centre[:, axis], 3), count) for axis in (0, 1)]
    weight = np.bincount(corners, np.repeat(double_area, 3), count)
    return np.column_stack(pull) / weight[:, None] - positions


def _moved(positions: np.ndarray, triangles: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Positions after a step that is halved, and at last left out, where it would make a triangle too small."""
    step = step.copy()
    floor = np.minimum(LEAST_AREA, signed_areas(positions, triangles))  # what is small already may stay so
    for attempt in range(len(triangles)):
        small = signed_areas(positions + step, triangles) < floor
        if not small.any():
            break
        step[np.unique(triangles[small])] *= 0.5 if attempt < HALVINGS else 0.0
    return positions + step


def _delaunay(positions: np.ndarray, triangles: np.ndarray, kept_keys: np.ndarray) -> np.ndarray:
    """Triangles after flipping inner edges until each is Delaunay: the angles facing it sum to at most half a turn."""
    triangles = triangles.copy()
    for _ in range(FLIP_PASSES):
        one, two, key = _edge_sides(triangles, len(positions))
        first, second = one // 3, two // 3
        a, b = triangles[first, one % 3], triangles[first, (one + 1) % 3]
        c, d = triangles[first, (one + 2) % 3], triangles[second, (two + 2) % 3]
        excess = _sine_of_sum(positions[a], positions[b], positions[c], positions[d])
        wrong = np.nonzero((excess < -1e-9) & ~np.isin(key, kept_keys))[0]
        if len(wrong) == 0:
            break
        wrong = wrong[np.argsort(excess[wrong], kind="stable")]
        # A triangle takes part in one flip at a time: the worst edge of its three.
        rank, best = np.arange(len(wrong)), np.full(len(triangles), len(wrong))
        np.minimum.at(best, first[wrong], rank)
        np.minimum.at(best, second[wrong], rank)
        flip = wrong[(best[first[wrong]] == rank) & (best[second[wrong]] == rank)]
        triangles[first[flip]] = np.column_stack([c[flip], a[flip], d[flip]])
        triangles[second[flip]] = np.column_stack([d[flip], b[flip], c[flip]])
    return triangles


def _sine_of_sum(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Sine of the angles at c and d that face the edge a-b, summed, times the lengths of the four other sides."""
    ca, cb, da, db = a - c, b - c, a - d, b - d
    sine_c = ca[:, 0] * cb[:, 1] - ca[:, 1] * cb[:, 0]
    sine_d = db[:, 0] * da[:, 1] - db[:, 1] * da[:, 0]
    return sine_c * (da * db).sum(axis=1) + sine_d * (ca * cb).sum(axis=1)


def _edge_sides(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each inner edge its two directed edges (3 times the triangle plus the corner it starts at), and its key."""
    key = _edge_keys(directed_edges(triangles), vertex_count)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    shared = np.nonzero(ordered[:-1] == ordered[1:])[0]
    return order[shared], order[shared + 1], ordered[shared]


def _edge_keys(edges: np.ndarray, vertex_count: int) -> np.ndarray:
    return edges.min(axis=1) * vertex_count + edges.max(axis=1)
