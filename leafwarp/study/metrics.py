"""How far two computations of the same leaf lie apart, and which settings are worth their time."""

from __future__ import annotations

import numpy as np


def relative_water_error(water: np.ndarray, reference: np.ndarray, areas: np.ndarray) -> float:
    """Relative L2 distance of the water on the leaf.

    Maps of different size have no cell in common. Both are therefore compared at the vertices of the mesh,
    which is the same for all of them, each sampled as the coupling samples it: this is the water that the
    structure feels and that is written out. Vertices are weighted by their area, frames equally:
    ``sqrt(sum_t sum_v A_v (y - y_ref)^2 / sum_t sum_v A_v y_ref^2)``.

    Args:
        water: Relative water content, shape [frame_count, vertex_count].
        reference: The same of the reference.
        areas: Area of each vertex [m^2], shape [vertex_count].

    Returns:
        The distance; relative to a saturated leaf if the reference is bone dry throughout.
    """
    difference = (np.square(water.astype(np.float64) - reference) * areas).sum()
    size = (np.square(reference.astype(np.float64)) * areas).sum() or len(water) * areas.sum()
    return float(np.sqrt(difference / size))


def largest_water_error(water: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference of the relative water content at any vertex in any frame."""
    return float(np.abs(water.astype(np.float64) - reference).max())


def shape_error(points: np.ndarray, reference: np.ndarray, areas: np.ndarray, length: float) -> float:
    """Root mean square distance from vertex to vertex, as a share of the leaf's length.

    Args:
        points: Vertex positions [m], shape [frame_count, vertex_count, 3].
        reference: The same of the reference.
        areas: Area of each vertex [m^2], shape [vertex_count]; its weight in the mean over the vertices.
        length: Length of the leaf [m].
    """
    squares = np.square(points.astype(np.float64) - reference).sum(axis=2)
    return float(np.sqrt((squares @ (areas / areas.sum())).mean()) / length)


def pareto_front(seconds: np.ndarray, errors: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """Which settings no other one beats: none is as fast and as accurate, and better in one of the two.

    Args:
        seconds: Cost of each setting, shape [count].
        errors: Error of each setting, shape [count].
        floor: Error below which settings cannot be told apart; counted as equal.

    Returns:
        True on the front, shape [count]. Entries that are not finite are never on it.
    """
    seconds = np.asarray(seconds, dtype=np.float64)
    errors = np.maximum(np.asarray(errors, dtype=np.float64), floor)
    usable = np.isfinite(seconds) & np.isfinite(errors)
    no_worse = (seconds[:, None] <= seconds) & (errors[:, None] <= errors) & usable[:, None]
    better = (seconds[:, None] < seconds) | (errors[:, None] < errors)
    return usable & ~(no_worse & better).any(axis=0)


def errors_fall_with_the_step(steps: np.ndarray, errors: np.ndarray, slack: float) -> bool:
    """Whether shorter steps come closer to the reference, as they must if the reference is right.

    Where a reference is far from converged, doubling its step may change little and say nothing; settings
    that are finer than it then move away from it.

    Args:
        steps: Fluid steps of one scheme on one map [s], shape [count].
        errors: Their errors, shape [count].
        slack: By how much an error may rise from a step to a shorter one.
    """
    errors = np.asarray(errors, dtype=np.float64)[np.argsort(steps)]
    least_of_longer = np.minimum.accumulate(errors[::-1])[::-1]
    return bool((errors[:-1] <= least_of_longer[1:] + slack).all())
