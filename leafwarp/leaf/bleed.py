"""The leaf's colours carried past its margin, so that neither a filter nor a texture lookup meets the
background."""

from __future__ import annotations

import numpy as np


def inner_pixels(inside: np.ndarray, depth: float) -> np.ndarray:
    """Pixels of a shape at least so deep under its margin [pixels]; of a part thinner than that, its middle.

    Along the margin a photo mixes leaf and background. A plain erosion would lose the petiole's colour
    altogether.
    """
    import cv2

    margin = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    reach = 2 * int(np.ceil(depth)) + 1
    deepest = cv2.dilate(margin, np.ones((reach, reach), np.uint8))
    return inside & (margin >= np.minimum(depth, 0.65 * deepest))


def near_margin(inside: np.ndarray, distance: float) -> np.ndarray:
    """Pixels of a shape up to so far from its margin [pixels]."""
    import cv2

    margin = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    return inside & (margin < distance)


def extend_colours(colour: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """A picture whose outside pixels take the colour of the nearest inside pixel, shape of ``colour``."""
    import cv2

    _, labels = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    palette = np.zeros((int(labels.max()) + 1, *colour.shape[2:]), colour.dtype)
    palette[labels[inside]] = colour[inside]
    return palette[labels]
