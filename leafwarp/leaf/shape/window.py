"""A polygon of the photo as a small raster: what looks for the petiole works at a bounded size, whatever the photo's.

Window pixels are square: one is ``1 / scale`` photo pixels wide, pixel (0, 0) covers [0, 1] x [0, 1] from ``origin``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PAD = 2  # [pixels] of the window around the polygon
LONGEST = 900  # [pixels] bound of a window's long side


@dataclass(frozen=True)
class Window:
    """Raster of a leaf's bounding box.

    Attributes:
        inside: The leaf's pixels, shape [height, width], bool.
        origin: Upper left corner in photo pixels, (x, y).
        scale: Window pixels per photo pixel.
        extent: Largest distance from the leaf's middle to its margin, doubled, in window pixels.
    """

    inside: np.ndarray
    origin: np.ndarray
    scale: float
    extent: float

    def from_photo(self, points: np.ndarray) -> np.ndarray:
        """Window coordinates of photo points, shape [..., 2]."""
        return (points - self.origin) * self.scale

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """Photo coordinates of window points, shape [..., 2]."""
        return np.asarray(points) / self.scale + self.origin

    def colours(self, picture: np.ndarray) -> np.ndarray:
        """The photo's colours in the window, replicated past its border, shape [height, width, 3], uint8.

        Args:
            picture: 8-bit RGB, shape [photo height, photo width, 3].
        """
        import cv2

        height, width = self.inside.shape
        pixel = 1.0 / self.scale
        low = np.floor(self.origin).astype(int).clip(0)
        high = np.ceil(self.origin + np.array((width, height)) * pixel).astype(int)
        crop = picture[low[1] : high[1], low[0] : high[0]]
        if pixel > 1.0:  # averaged to nearly the window's resolution first, so that nothing aliases
            size = tuple(np.maximum(1, np.rint(np.array(crop.shape[1::-1]) / pixel)).astype(int).tolist())
            ratio = np.divide(crop.shape[1::-1], size)
            crop = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
        else:
            ratio = np.ones(2)
        step = pixel / ratio
        shift = (self.origin - low) / ratio + 0.5 * step - 0.5
        matrix = np.array([[step[0], 0.0, shift[0]], [0.0, step[1], shift[1]]])
        flags = cv2.WARP_INVERSE_MAP | cv2.INTER_CUBIC
        return cv2.warpAffine(crop, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)


def window_around(polygon: np.ndarray, area: float) -> Window:
    """Window of a leaf at a resolution that does not depend on its attitude.

    Args:
        polygon: Closed polygon in photo pixels, shape [count, 2].
        area: Window pixels that the leaf is to cover; fewer where it is very long.
    """
    import cv2

    low, high = polygon.min(axis=0), polygon.max(axis=0)
    x, y = (polygon - low).T
    covered = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    scale = min(float(np.sqrt(area / max(covered, 1e-9))), LONGEST / max(float((high - low).max()), 1e-9))
    width, height = (np.ceil((high - low) * scale).astype(int) + 2 * PAD).tolist()
    origin = 0.5 * (low + high) - 0.5 * np.array((width, height)) / scale
    inside = np.zeros((height, width), np.uint8)
    corners = np.rint(((polygon - origin) * scale - 0.5) * 256).astype(np.int32)
    cv2.fillPoly(inside, [corners], 1, lineType=cv2.LINE_8, shift=8)
    away = np.linalg.norm(polygon - polygon.mean(axis=0), axis=1)
    return Window(inside > 0, origin, scale, 2.0 * scale * float(away.max()))
