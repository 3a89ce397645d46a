"""The leaf's boundary as a polygon, and where its petiole ends.

Coordinates are pixels of the upright photo, x to the right and y down; pixel (0, 0) covers [0, 1] x [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.segment.silhouette import Silhouette
from leafwarp.leaf.shape.curve import resample_closed, smooth_closed
from leafwarp.leaf.shape.stalk import AREA, find_stalks
from leafwarp.leaf.shape.window import window_around

__all__ = ["Outline", "find_outline", "resample_closed", "smooth_closed", "trace", "trace_holes"]


PAD = 3  # [pixels] of the silhouette around the leaf while tracing
TRACED_SIDE = 2600  # [pixels] the field is refined to about this long side
BLUR = 0.7  # [pixels] of the field before it is cut
LEAST_HOLE = 12.0  # [pixels of the silhouette, squared] a smaller hole has no shape


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
        holes: Closed polygons of the true holes, within the leaf and apart from its boundary, shape [count, 2]
            each.
        base_found: How the base was found: "stalk" where a petiole was seen, "veins" where the veins and the shape
            told it, or "given".
    """

    points: np.ndarray
    base: np.ndarray
    tip: np.ndarray
    petiole_width: float
    holes: tuple[np.ndarray, ...] = ()
    base_found: str = "given"

    @property
    def length(self) -> float:
        """Distance from the base to the tip."""
        return float(np.linalg.norm(self.tip - self.base))


def find_outline(photo: Photo, shape: Silhouette, base: tuple[float, float] | None = None) -> Outline:
    """Outline of a silhouette.

    Args:
        photo: The picture (its veins point to the base where there is no plain stalk).
        shape: The leaf in it.
        base: The petiole's end where it is known; the nearest point of the outline is taken.

    Raises:
        InputError: The base is not a point of the photo.
    """
    points = trace(shape)
    if base is None:
        found, how = find_base(photo, points)
    else:
        found, how = np.asarray(base, float), "given"
        if found.shape != (2,) or not np.isfinite(found).all() or (found < 0).any() or (found > photo.size).any():
            raise InputError(
                f"{photo.path}: base: value {base!r} is not accepted; accepted: x, y in pixels of the photo, "
                f"within {photo.size[0]} x {photo.size[1]}"
            )
    base_point = points[np.argmin(np.linalg.norm(points - found, axis=1))]
    distances = np.linalg.norm(points - base_point, axis=1)
    tip = points[np.argmax(distances)]
    width = _width_at(shape, base_point, 0.04 * distances.max())
    return Outline(points, base_point, tip, width, trace_holes(shape), how)


def find_base(photo: Photo, outline: np.ndarray) -> tuple[np.ndarray, str]:
    """The petiole's end in photo pixels (x, y), and how it was found: "stalk" or "veins".

    Args:
        photo: The picture.
        outline: Closed polygon of the leaf in photo pixels, shape [count, 2].
    """
    from leafwarp.leaf.shape.base_by_veins import base_by_veins

    found, stalk = base_by_veins(photo, outline, find_stalks(window_around(outline, AREA)))
    return found, "veins" if stalk is None else "stalk"


def trace(shape: Silhouette) -> np.ndarray:
    """Sub-pixel boundary of the silhouette's field in photo pixels, shape [count, 2].

    The field is refined by bilinear interpolation, cut at zero, rid of one-pixel threads (so that the polygon
    never touches itself) and smoothed along its arc by about one pixel. Parts that are too thin for that, a petiole of
    one or two pixels, are kept as they are.
    """
    import cv2

    fine, factor, corner = _refined(shape)
    contours, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return _smoothed(max(contours, key=cv2.contourArea), factor, corner) * shape.scale


def trace_holes(shape: Silhouette) -> tuple[np.ndarray, ...]:
    """Polygons of the silhouette's true holes in photo pixels, largest first, shape [count, 2] each.

    A hole keeps at least a pixel of leaf between itself and the outline.
    """
    import cv2

    if shape.holes is None or not shape.holes.any():
        return ()
    fine, factor, corner = _refined(shape)
    left, top = (corner + PAD).astype(int).tolist()
    height, width = np.array(fine.shape) // factor - 2 * PAD
    crop = np.pad(shape.holes[top : top + height, left : left + width].astype(np.float32), PAD)
    grown = cv2.resize(cv2.GaussianBlur(crop, (0, 0), BLUR), fine.shape[::-1], interpolation=cv2.INTER_LINEAR)
    inner = cv2.erode(fine, np.ones((3 * factor, 3 * factor), np.uint8))
    open_ = cv2.morphologyEx((grown > 0.5).astype(np.uint8) & inner, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(open_, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    kept = [contour for contour in contours if cv2.contourArea(contour) >= LEAST_HOLE * factor**2]
    kept.sort(key=lambda contour: -cv2.contourArea(contour))
    return tuple(_smoothed(contour, factor, corner) * shape.scale for contour in kept)


def _refined(shape: Silhouette) -> tuple[np.ndarray, int, np.ndarray]:
    """The leaf on a finer raster, uint8; fine pixels a pixel; the raster's corner in pixels of the silhouette."""
    import cv2

    rows, columns = np.nonzero(shape.inside)
    top, left = int(rows.min()), int(columns.min())
    crop = np.pad(shape.field[top : rows.max() + 1, left : columns.max() + 1], PAD, constant_values=-1.0)
    inside = (crop > 0.0).astype(np.uint8)
    smooth = cv2.GaussianBlur(crop, (0, 0), BLUR)
    factor = int(np.clip(round(TRACED_SIDE / max(crop.shape)), 2, 8))
    size = (crop.shape[1] * factor, crop.shape[0] * factor)
    threads = np.ones((3, 3), np.uint8)
    fine = (cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR) > 0.0).astype(np.uint8)
    fine = cv2.morphologyEx(fine, cv2.MORPH_OPEN, threads)
    thin = inside & (cv2.morphologyEx(inside, cv2.MORPH_OPEN, threads) == 0)
    fine |= cv2.resize(thin, size, interpolation=cv2.INTER_NEAREST)
    return fine, factor, np.array((left - PAD, top - PAD), float)


def _smoothed(contour: np.ndarray, factor: int, corner: np.ndarray) -> np.ndarray:
    """A traced contour, smoothed and thinned out, in pixels of the silhouette."""
    points = smooth_closed(contour[:, 0].astype(float), sigma=1.0 * factor)[:: max(1, factor // 2)]
    return (points + 0.5) / factor + corner


def _width_at(shape: Silhouette, point: np.ndarray, radius: float) -> float:
    """Mean width of the leaf in photo pixels within a radius of a point of its margin: area over radius."""
    height, width = shape.field.shape
    x, y = (np.arange(width) + 0.5) * shape.scale[0], (np.arange(height) + 0.5) * shape.scale[1]
    near = np.hypot(x[None] - point[0], y[:, None] - point[1]) < radius
    area = np.count_nonzero(near & shape.inside) * shape.scale[0] * shape.scale[1]
    return max(area / radius, min(shape.scale))
