"""Closed polygons: even resampling and smoothing along the arc."""

from __future__ import annotations

import numpy as np


def smooth_closed(points: np.ndarray, sigma: float) -> np.ndarray:
    """A closed polygon, evenly resampled, convolved along its arc with a Gaussian of sigma (in its mean steps)."""
    points = resample_closed(points, len(points))
    frequency = np.fft.rfftfreq(len(points))
    gain = np.exp(-2.0 * (np.pi * frequency * sigma) ** 2)
    return np.fft.irfft(np.fft.rfft(points, axis=0) * gain[:, None], n=len(points), axis=0)


def resample_closed(points: np.ndarray, count: int) -> np.ndarray:
    """So many points at even distances along a closed polygon, the first one kept."""
    closed = np.concatenate([points, points[:1]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.arange(count) * (arc[-1] / count)
    return np.column_stack([np.interp(at, arc, closed[:, 0]), np.interp(at, arc, closed[:, 1])])
