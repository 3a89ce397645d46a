"""How thick a mask is at each of its pixels, and which of its parts are thin."""

from __future__ import annotations

import numpy as np


def depth_of(mask: np.ndarray) -> np.ndarray:
    """Distance of each pixel of a mask to the nearest one off it [pixels], 0 off it, float32."""
    import cv2

    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)


def thin_parts(mask: np.ndarray, radius: float) -> np.ndarray:
    """The parts of a mask in which no disc of a radius has room."""
    core = depth_of(mask) > radius
    return mask & (depth_of(~core) > radius) if core.any() else mask


def disc(radius: int) -> np.ndarray:
    """A disc to dilate and erode with, uint8."""
    import cv2

    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
