"""Where the camera stands so that a leaf, in every pose that will be drawn, fills the picture."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError

FIELD_OF_VIEW = np.radians(22.0)  # of the picture's longer side


def unit(vector: Iterable[float]) -> np.ndarray:
    """The vector over its length, float64.

    Raises:
        InputError: It has no direction.
    """
    values = np.asarray(vector, np.float64)
    length = np.linalg.norm(values)
    if not np.isfinite(length) or length == 0.0:
        raise InputError(f"direction {tuple(values.tolist())} is not accepted; accepted: a finite vector other than 0")
    return values / length


def checked_points(points: np.ndarray) -> np.ndarray:
    """Positions as float64.

    Raises:
        InputError: One is not finite; the message names the first such vertex.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        vertex = int(np.argmin(finite))
        raise InputError(f"points: vertex {vertex} is at {tuple(points[vertex].tolist())}; accepted: finite positions")
    return points


@dataclass(frozen=True)
class View:
    """A camera: a place, three axes and the half sizes of its picture at distance 1.

    Attributes:
        position: Of the pinhole [m].
        right: Unit vector.
        up: Unit vector.
        back: Unit vector from the leaf to the camera.
        half_size: Half the picture's width and height at distance 1.
    """

    position: np.ndarray
    right: np.ndarray
    up: np.ndarray
    back: np.ndarray
    half_size: np.ndarray

    @classmethod
    def around(cls, center: np.ndarray, radius: float, direction: Iterable[float], aspect: float) -> View:
        """A view of a sphere, in the middle of the picture and just inside it.

        Args:
            center: Of the sphere [m].
            radius: Of the sphere [m].
            direction: From the sphere to the camera.
            aspect: Width over height of the picture.
        """
        right, up, back = axes(direction)
        half = half_size(aspect)
        distance = radius / np.sin(np.arctan(half.min()))
        return cls(np.asarray(center, np.float64) + distance * back, right, up, back, half)

    @classmethod
    def fitted(cls, points: np.ndarray, direction: Iterable[float], aspect: float, margin: float) -> View:
        """The nearest view, with the points in the middle, in which all of them are seen.

        Args:
            points: Positions [m], shape [count, 3].
            direction: From the points to the camera.
            aspect: Width over height of the picture.
            margin: Empty border as a share of the picture's width and height, below 0.5.
        """
        right, up, back = axes(direction)
        half = half_size(aspect)
        frame = np.stack([right, up, back])
        local = points @ frame.T
        middle = 0.5 * (local.min(axis=0) + local.max(axis=0))
        spread = np.abs(local[:, :2] - middle[:2]) / (half * (1.0 - 2.0 * margin))
        toward = local[:, 2] - middle[2]
        extent = max(float(np.linalg.norm(np.ptp(local, axis=0))), 1e-9)
        distance = max(float((spread.max(axis=1) + toward).max()), float(toward.max()) + 0.1 * extent)
        return cls(middle @ frame + distance * back, right, up, back, half)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Place of points in the picture, shape [count, 3]: x and y, [0, 1] from the upper left corner, and distance
        along the axis [m], which is negative behind the camera."""
        offset = points - self.position
        distance = -(offset @ self.back)
        safe = np.where(np.abs(distance) > 1e-12, distance, 1e-12)
        x = 0.5 + 0.5 * (offset @ self.right) / (safe * self.half_size[0])
        y = 0.5 - 0.5 * (offset @ self.up) / (safe * self.half_size[1])
        return np.stack([x, y, distance], axis=1)


def half_size(aspect: float) -> np.ndarray:
    """Half the width and height of a picture at distance 1."""
    return np.tan(0.5 * FIELD_OF_VIEW) * np.array([aspect, 1.0]) / max(aspect, 1.0)


def axes(direction: Iterable[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and backward unit vectors of a camera in a direction; upright, or with y upward where it looks down."""
    back = unit(direction)
    upright = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.9999 else np.array([0.0, np.sign(back[2]), 0.0])
    right = unit(np.cross(upright, back))
    return right, np.cross(back, right), back


def seen_size(points: np.ndarray, direction: Iterable[float]) -> tuple[float, float]:
    """Width and height of the points as seen from far away in a direction [m]."""
    right, up, _ = axes(direction)
    return float(np.ptp(points @ right)), float(np.ptp(points @ up))
