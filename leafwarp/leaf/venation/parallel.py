"""Veins of a blade: lines along it, evenly spaced across, that meet at the base and at the tip.

The base and the tip cut the outline into two sides. Where the distances to them are l and r, ``l / (l + r)`` runs from
0 on one side to 1 on the other; its level lines at even steps are the veins, and they close up as the blade narrows.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.venation.shape import LeafShape

SPACING = 14.0  # [pixels] between veins where the blade is widest
FEWEST, MOST = 5, 17
EVENED = 0.012  # share of the long side over which the margin's teeth are evened out
SIDE_VEIN = 0.97  # likelihood beside the middle vein; much less, and the far ends would drain through the middle one


def parallel_likelihood(shape: LeafShape) -> np.ndarray:
    """Likelihood of a vein, in [0, 1], shape [height, width]; 1 on the middle vein; 0 outside the leaf."""
    inside, polygon = shape.inside, shape.polygon
    first, last = (int(np.argmin(np.linalg.norm(polygon - point, axis=1))) for point in (shape.base, _far_end(shape)))
    ahead = np.arange(first, first + (last - first) % len(polygon) + 1) % len(polygon)
    behind = np.arange(last, last + (first - last) % len(polygon) + 1) % len(polygon)
    left, right = (_distance_to(polygon[side], inside.shape) for side in (ahead, behind))
    width = np.where(inside, left + right, 0.0)
    count = int(np.clip(np.quantile(width[inside], 0.9) / SPACING, FEWEST, MOST)) | 1  # odd: one runs in the middle
    position = _evened(left / np.maximum(left + right, 1e-6), inside) * (count + 1)
    nearest = np.clip(np.rint(position), 1, count)
    distance = np.abs(position - nearest) * width / (count + 1)  # [pixels]
    likelihood = np.exp(-((distance / 1.2) ** 2))
    return np.where(inside, np.where(nearest == (count + 1) // 2, 1.0, SIDE_VEIN) * likelihood, 0.0)


def _far_end(shape: LeafShape) -> np.ndarray:
    """Where the veins end: the tip, or the middle of the far end where the leaf is cut off there."""
    corners = np.diff(shape.polygon, axis=0, append=shape.polygon[:1])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(corners, axis=1))])
    first = int(np.argmin(np.linalg.norm(shape.polygon - shape.base, axis=1)))
    half = (arc[first] + 0.5 * arc[-1]) % arc[-1]
    opposite = shape.polygon[min(int(np.searchsorted(arc, half)), len(shape.polygon) - 1)]
    length = float(np.linalg.norm(shape.tip - shape.base))
    is_cut = (
        np.linalg.norm(opposite - shape.base) > 0.8 * length and np.linalg.norm(opposite - shape.tip) > 0.1 * length
    )
    return opposite if is_cut else shape.tip


def _evened(field: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """A field blurred within the leaf."""
    import cv2

    share = inside.astype(np.float32)
    sigma = EVENED * max(inside.shape)
    blurred = cv2.GaussianBlur(field.astype(np.float32) * share, (0, 0), sigma)
    return blurred / np.maximum(cv2.GaussianBlur(share, (0, 0), sigma), 1e-3)


def _distance_to(line: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Distance of each pixel from a polyline [pixels]."""
    import cv2

    away = np.ones(shape, np.uint8)
    cv2.polylines(away, [np.rint(line * 256 - 128).astype(np.int32)], False, 0, 1, cv2.LINE_8, 8)
    return cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
