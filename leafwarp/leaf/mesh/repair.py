"""Corners that are too sharp, opened by moving a vertex a little."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.mesh.quality import corner_angles

SHARP = np.radians(25.0)
FARTHEST = 0.25  # [mean edges] that a vertex moves in all; a notch is at least twice as wide
SWEEPS = 8
LEAST_GAIN = np.radians(0.1)
TURNS = np.arange(12) * (np.pi / 6.0)
TRIALS = (np.array([0.03, 0.08, 0.16, 0.25])[:, None] * np.exp(1j * TURNS)).ravel()  # [mean edges]


def open_corners(positions: np.ndarray, triangles: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Positions at which sharp triangles are less sharp, as far as small moves of their vertices can do that.

    Args:
        positions: Vertex positions [mean edges], shape [vertex_count, 2].
        triangles: Vertex indices, counter-clockwise, shape [triangle_count, 3].
        fixed: Indices of the vertices that stay in place. Others of the boundary may move.
    """
    start = positions[:, 0] + 1j * positions[:, 1]
    place = start.copy()
    movable = np.ones(len(place), bool)
    movable[fixed] = False
    order = np.argsort(triangles.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(triangles.ravel(), minlength=len(place)))])
    for _ in range(SWEEPS):
        sharpest = corner_angles(np.column_stack([place.real, place.imag]), triangles).min(axis=1)
        moved = False
        for triangle in np.flatnonzero(sharpest < SHARP)[np.argsort(sharpest[sharpest < SHARP], kind="stable")]:
            for vertex in triangles[triangle][movable[triangles[triangle]]].tolist():
                around = triangles[order[first[vertex] : first[vertex + 1]] // 3]
                moved |= _move(place, start, vertex, around)
        if not moved:
            break
    return np.column_stack([place.real, place.imag])


def _move(place: np.ndarray, start: np.ndarray, vertex: int, around: np.ndarray) -> bool:
    """Move a vertex to where the sharpest corner of the triangles around it is widest; whether it moved."""
    trials = place[vertex] + np.append(0.0, TRIALS)
    trials = trials[np.abs(trials - start[vertex]) <= FARTHEST]
    corners = np.where(around[None] == vertex, trials[:, None, None], place[around][None])
    ahead, behind = np.roll(corners, -1, axis=2) - corners, np.roll(corners, 1, axis=2) - corners
    angles = np.angle(behind / ahead).min(axis=(1, 2))  # negative in a triangle that is turned over
    best = int(np.argmax(angles))
    if angles[best] < angles[0] + LEAST_GAIN:
        return False
    place[vertex] = trials[best]
    return True
