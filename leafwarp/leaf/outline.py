"""The leaf's boundary as a polygon, and where its petiole ends.

Coordinates are pixels of the upright photo, x to the right and y down; pixel (0, 0) covers [0, 1] x [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.photo import Photo
from leafwarp.leaf.segment import Silhouette

STALK_SIDE = 512  # [pixels] bound of the long side while looking for the petiole
STALK_OPENINGS = (
    0.1,
    0.16,
    0.24,
    0.34,
    0.45,
)  # radii that a stalk vanishes under, as shares of the blade's inradius
STALK_SLENDERNESS = 2.2  # least length over width
STALK_EVENNESS = 0.55  # least width near the tip over width near the blade; an acuminate tip tapers to nothing
STALK_LENGTH = 0.035  # least length, as a share of the leaf's extent


@dataclass(frozen=True)
class Outline:
    """Boundary of a leaf.

    Attributes:
        points: Corners of a closed polygon without self-contact, about half a pixel apart (of the
            silhouette), shape [count, 2]. Seen with y down they run counter-clockwise or clockwise as the
            tracer left them.
        base: The petiole's end, a point of the polygon.
        tip: The point of the polygon farthest from the base.
        petiole_width: Width of the leaf near the base.
    """

    points: np.ndarray
    base: np.ndarray
    tip: np.ndarray
    petiole_width: float

    @property
    def length(self) -> float:
        """Distance from the base to the tip."""
        return float(np.linalg.norm(self.tip - self.base))


def find_outline(photo: Photo, shape: Silhouette, base: tuple[float, float] | None = None) -> Outline:
    """Outline of a silhouette.

    Args:
        photo: The picture (its veins point to the base where there is no stalk).
        shape: The leaf in it.
        base: The petiole's end where it is known; the nearest point of the outline is taken.

    Raises:
        InputError: The base is not a point of the photo.
    """
    points = trace(shape)
    if base is None:
        found = stalk_end(shape)
        if found is None:
            from leafwarp.leaf.base_by_veins import base_by_veins

            found = base_by_veins(photo, shape, points)
    else:
        found = np.asarray(base, float)
        if found.shape != (2,) or not np.isfinite(found).all() or (found < 0).any() or (found > photo.size).any():
            raise InputError(
                f"{photo.path}: base: value {base!r} is not accepted; accepted: x, y in pixels of the photo, "
                f"within {photo.size[0]} x {photo.size[1]}"
            )
    base_point = points[np.argmin(np.linalg.norm(points - found, axis=1))]
    distances = np.linalg.norm(points - base_point, axis=1)
    tip = points[np.argmax(distances)]
    return Outline(points, base_point, tip, _width_at(shape, base_point, 0.04 * distances.max()))


def trace(shape: Silhouette) -> np.ndarray:
    """Sub-pixel boundary of the silhouette's field in photo pixels, shape [count, 2].

    The field is refined by bilinear interpolation, cut at zero, rid of one-pixel threads (so that the polygon
    never touches itself) and smoothed along its arc by about one pixel.
    """
    import cv2

    rows, columns = np.nonzero(shape.inside)
    top, left = rows.min(), columns.min()
    crop = shape.field[top : rows.max() + 1, left : columns.max() + 1]
    pad = 3
    crop = cv2.GaussianBlur(np.pad(crop, pad, constant_values=-1.0), (0, 0), 0.7)
    factor = int(np.clip(round(2600 / max(crop.shape)), 2, 8))
    fine = cv2.resize(crop, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR) > 0.0
    fine = cv2.morphologyEx(fine.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea)[:, 0].astype(float)
    contour = smooth_closed(contour, sigma=1.0 * factor)[:: max(1, factor // 2)]
    points = (contour + 0.5) / factor - pad + (left, top)
    return points * shape.scale


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


def stalk_end(shape: Silhouette) -> np.ndarray | None:
    """End of the petiole in photo pixels, or None where the leaf has no stalk of nearly constant width."""
    import cv2

    height, width = shape.field.shape
    shrink = min(1.0, STALK_SIDE / max(height, width))
    size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
    inside = cv2.resize(shape.field, size, interpolation=cv2.INTER_AREA) > 0.0
    if not inside.any():
        return None
    padded = np.pad(inside, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    rows, columns = np.nonzero(inside)
    extent = np.hypot(np.ptp(rows), np.ptp(columns))
    best_length, best_end = STALK_LENGTH * extent, None
    for share in STALK_OPENINGS:
        core = (depth <= share * depth.max()).astype(np.uint8)
        reach = cv2.distanceTransform(core, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - share * depth.max()
        outer = inside & (reach > 1.0)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(outer.astype(np.uint8), connectivity=8)
        for label in range(1, count):
            left, top, across, down = boxes[label, :4].tolist()
            if np.hypot(across, down) < best_length:
                continue
            box = np.s_[top : top + down, left : left + across]
            length, end = _as_stalk(labels[box] == label, reach[box])
            if length > best_length * 1.05:
                best_length, best_end = length, np.add(end, (left, top))
    return None if best_end is None else best_end * (width / size[0], height / size[1]) * shape.scale


def _as_stalk(piece: np.ndarray, reach: np.ndarray) -> tuple[float, np.ndarray | None]:
    """Length and end of a piece if it is a stalk, else (0, None). ``reach`` is the distance from the blade."""
    rows, columns = np.nonzero(piece)
    distance = reach[rows, columns]
    length = distance.max()
    if length < 4.0:
        return 0.0, None
    bins = int(np.clip(length / 2.0, 4, 40))
    profile = np.histogram(distance, bins=bins, range=(0.0, length))[0] * (bins / length)
    trunk = profile[max(1, bins // 8) : bins - max(1, bins // 8)]
    mean = trunk.mean()
    quarter = max(1, len(trunk) // 4)
    evenness = trunk[-quarter:].mean() / max(trunk[:quarter].mean(), 1e-6)
    if length < STALK_SLENDERNESS * mean or evenness < STALK_EVENNESS:
        return 0.0, None
    last = distance >= length - max(1.0, 0.25 * mean)
    return float(length), np.array([columns[last].mean() + 0.5, rows[last].mean() + 0.5])


def _width_at(shape: Silhouette, point: np.ndarray, radius: float) -> float:
    """Mean width of the leaf in photo pixels within a radius of a point of its margin: area over radius."""
    height, width = shape.field.shape
    x, y = (np.arange(width) + 0.5) * shape.scale[0], (np.arange(height) + 0.5) * shape.scale[1]
    near = np.hypot(x[None] - point[0], y[:, None] - point[1]) < radius
    area = np.count_nonzero(near & shape.inside) * shape.scale[0] * shape.scale[1]
    return max(area / radius, min(shape.scale))
