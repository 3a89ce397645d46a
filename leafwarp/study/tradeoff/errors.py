"""How far two computations of the same leaf lie apart, and which settings are worth their time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.study.tradeoff.trial import Film


@dataclass(frozen=True)
class Errors:
    """Distances of a trial from a reference, over the whole film and frame by frame.

    Attributes:
        water: Relative L2 distance of the water on the leaf.
        largest_water: Largest difference of the relative water content, anywhere at any time.
        shape: Root mean square distance of the leaf's points, as a share of its length.
        largest_shape: Largest distance of a point at any time, as a share of its length.
        water_over_time: Relative L2 distance of each sampled frame, shape [frame_count].
        shape_over_time: Root mean square distance of each, as a share of the length, shape [frame_count].
    """

    water: float
    largest_water: float
    shape: float
    largest_shape: float
    water_over_time: np.ndarray
    shape_over_time: np.ndarray


def errors_of(film: Film, reference: Film, length: float) -> Errors:
    """Compare a film with a reference at the same points of the leaf, which are spread evenly over it.

    The distance is that of a point of the leaf's matter from where the reference has it, so that a leaf that slides or
    turns within its own surface is not taken for right. Neither mesh nor map enters: both are sampled at the same
    points. Frames count alike: ``sqrt(sum_t sum_p (y - y_ref)^2 / sum_t sum_p y_ref^2)``; of a reference that is bone
    dry throughout, relative to a saturated leaf.

    Args:
        film: The film.
        reference: The reference.
        length: Length of the leaf [m].
    """
    difference = np.square(film.water.astype(np.float64) - reference.water)
    content = np.square(reference.water.astype(np.float64))
    distance = np.square(film.points.astype(np.float64) - reference.points).sum(axis=2) / length**2
    size = content.mean() or 1.0
    return Errors(
        water=float(np.sqrt(difference.mean() / size)),
        largest_water=float(np.sqrt(difference.max())),
        shape=float(np.sqrt(distance.mean())),
        largest_shape=float(np.sqrt(distance.max())),
        water_over_time=np.sqrt(difference.mean(axis=1) / np.where(content.any(axis=1), content.mean(axis=1), 1.0)),
        shape_over_time=np.sqrt(distance.mean(axis=1)),
    )


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
