"""Where a leaf lies in its picture, and plane curves: smooth, measured, widened to ribbons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Placement:
    """Where a leaf lies in its picture.

    Leaf coordinates have the lamina's base at the origin, +y along the axis and +x to the right, with the
    lamina's length as unit. `bend` holds the coefficients of y^2, y^3, ... that curve the axis sideways.
    """

    width: int
    height: int
    origin: tuple[float, float]  # lamina base, pixels from the top left corner
    scale: float  # pixels per leaf unit
    angle: float = 0.0  # degrees clockwise from upright
    bend: tuple[float, ...] = ()

    def _sideways(self, y: np.ndarray) -> np.ndarray:
        return sum((c * y ** (k + 2) for k, c in enumerate(self.bend)), np.zeros_like(y))

    def to_picture(self, points: np.ndarray) -> np.ndarray:
        """Pixel positions, shape [n, 2], of points in leaf coordinates, shape [n, 2]."""
        x, y = points[:, 0] + self._sideways(points[:, 1]), points[:, 1]
        cosine, sine = np.cos(np.radians(self.angle)), np.sin(np.radians(self.angle))
        across, along = x * cosine + y * sine, y * cosine - x * sine
        return np.stack([self.origin[0] + self.scale * across, self.origin[1] - self.scale * along], axis=1)

    def leaf_coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Leaf coordinates (x, y) of every pixel centre, each of shape [height, width]."""
        columns = (np.arange(self.width) + 0.5 - self.origin[0]) / self.scale
        rows = (self.origin[1] - np.arange(self.height) - 0.5) / self.scale
        across, along = np.meshgrid(columns, rows)
        cosine, sine = np.cos(np.radians(self.angle)), np.sin(np.radians(self.angle))
        x, y = across * cosine - along * sine, along * cosine + across * sine
        return x - self._sideways(y), y


def smooth_curve(points: Sequence[tuple[float, float]], step: float) -> np.ndarray:
    """A smooth curve through the points, sampled about every `step`, shape [n, 2].

    Piecewise cubic Hermite; the tangent at a point weighs the chords beside it by each other's length.
    """
    knots = np.asarray(points, float)
    chord = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    parameter = np.concatenate([[0.0], np.cumsum(chord)])
    slopes = np.diff(knots, axis=0) / chord[:, None]
    tangents = np.concatenate([slopes[:1], slopes, slopes[-1:]])
    weights = np.concatenate([chord[:1], chord, chord[-1:]])[:, None]
    tangents = (tangents[:-1] * weights[1:] + tangents[1:] * weights[:-1]) / (weights[1:] + weights[:-1])
    samples = np.linspace(0.0, parameter[-1], max(2, int(np.ceil(parameter[-1] / step)) + 1))
    span = np.clip(np.searchsorted(parameter, samples, side="right") - 1, 0, len(chord) - 1)
    width = chord[span][:, None]
    q = (samples - parameter[span])[:, None] / width
    return (
        (1 + 2 * q) * (1 - q) ** 2 * knots[span]
        + q * (1 - q) ** 2 * width * tangents[span]
        + q**2 * (3 - 2 * q) * knots[span + 1]
        + q**2 * (q - 1) * width * tangents[span + 1]
    )


def arc_length(points: np.ndarray) -> np.ndarray:
    """Distance along the polyline from its first point to each point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def tangents_of(points: np.ndarray) -> np.ndarray:
    """Unit tangents of a polyline."""
    tangents = np.gradient(points, axis=0)
    return tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)


def ribbon(points: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Closed polygon around a polyline, as wide as `widths` says at each point."""
    tangents = tangents_of(points)
    offset = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) * (0.5 * np.asarray(widths))[:, None]
    return np.concatenate([points + offset, (points - offset)[::-1]])
