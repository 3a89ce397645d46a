"""Straight pieces in the plane that come too near to one another."""

from __future__ import annotations

import numpy as np


def conflicts(points: np.ndarray, pieces: np.ndarray, least: float, opening: float) -> np.ndarray:
    """Pairs of pieces that cross, come too near, or open too narrowly from a shared end, shape [count, 2].

    Args:
        points: Ends of the pieces, shape [point_count, 2].
        pieces: Their two points, shape [piece_count, 2].
        least: Least distance of two pieces that share no end.
        opening: Least angle between two pieces that share an end [rad].
    """
    from scipy.spatial import cKDTree

    if len(pieces) < 2:
        return np.zeros((0, 2), np.int64)
    ends = points[pieces]
    longest = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max())
    pairs = cKDTree(ends.mean(axis=1)).query_pairs(longest + least, output_type="ndarray")
    one, two = pieces[pairs[:, 0]], pieces[pairs[:, 1]]
    shared = one[:, :, None] == two[:, None, :]
    touching = shared.any(axis=(1, 2))
    bad = np.zeros(len(pairs), bool)
    bad[~touching] = _distance(ends[pairs[~touching, 0]], ends[pairs[~touching, 1]]) < least
    bad[touching] = _angle(ends[pairs[touching, 0]], ends[pairs[touching, 1]], shared[touching]) < opening
    return pairs[bad]


def closed_chain(count: int, first: int = 0) -> np.ndarray:
    """Pieces that join so many points, numbered from the first on, to a closed polygon, shape [count, 2]."""
    numbers = first + np.arange(count)
    return np.column_stack([numbers, np.roll(numbers, -1)])


def _distance(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Distance of the pieces of each pair, 0 where they cross, shape [count]; ends of shape [count, 2, 2]."""
    a, b, c, d = one[:, 0], one[:, 1], two[:, 0], two[:, 1]
    crossing = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    nearest = np.min([_to_piece(a, c, d), _to_piece(b, c, d), _to_piece(c, a, b), _to_piece(d, a, b)], axis=0)
    return np.where(crossing, 0.0, nearest)


def _to_piece(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = end - start
    share = ((point - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
    return np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * along - point, axis=1)


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _angle(one: np.ndarray, two: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Angle of the pieces of each pair at their shared end, shape [count]; ``shared[i, j]``: end i is end j."""
    rows = np.arange(len(one))
    at_one, at_two = shared.any(axis=2).argmax(axis=1), shared.any(axis=1).argmax(axis=1)
    u, v = one[rows, 1 - at_one] - one[rows, at_one], two[rows, 1 - at_two] - two[rows, at_two]
    return np.abs(np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))
