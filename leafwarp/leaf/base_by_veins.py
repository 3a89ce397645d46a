"""The petiole's end of a leaf without a visible stalk: the point of the margin that its veins lead to."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.photo import Photo
from leafwarp.leaf.segment import Silhouette
from leafwarp.leaf.veins import drainage, vein_likelihood

SIDE = 224  # [pixels] bound of the long side: only the main veins matter
TIE = 1.02  # costs this close are equal; then the lower point in the picture is the base
SINUS_DEPTH = 0.06  # least depth of a notch that may hold the petiole, as a share of the extent


def base_by_veins(photo: Photo, shape: Silhouette, outline: np.ndarray) -> np.ndarray:
    """Candidate of lowest mean geodesic cost over the leaf, in photo pixels (x, y).

    Candidates are the outline's protruding points and the bottoms of its deep notches (a heart-shaped base).
    """
    import cv2

    low, high = outline.min(axis=0), outline.max(axis=0)
    shrink = SIDE / float((high - low).max())
    size = tuple(max(4, int(np.ceil(length * shrink))) for length in high - low)
    to_work = np.array([[shrink, 0.0, -low[0] * shrink], [0.0, shrink, -low[1] * shrink]])
    first, last = np.floor(low).astype(int).clip(0), np.ceil(high).astype(int)
    crop = photo.colour[first[1] : last[1], first[0] : last[0]]
    colour = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    inside = np.zeros(size[::-1], np.uint8)
    polygon = outline @ to_work[:, :2].T + to_work[:, 2]
    cv2.fillPoly(inside, [np.rint(polygon * 16 - 8).astype(np.int32)], 1, shift=4)
    inside = inside > 0
    likelihood = vein_likelihood(colour, inside)
    best_cost, best = np.inf, None
    for candidate in sorted(_candidates(polygon).tolist(), key=lambda point: -point[1]):
        cost = drainage(likelihood, inside, np.array(candidate))[2]
        mean = float(cost[np.isfinite(cost)].mean())
        if mean * TIE < best_cost:
            best_cost, best = mean, candidate
    return (np.array(best) - to_work[:, 2]) / shrink


def _candidates(polygon: np.ndarray) -> np.ndarray:
    """Protruding points and notch bottoms of a polygon, shape [count, 2]."""
    import cv2

    step = max(1, len(polygon) // 400)
    points = polygon[::step]
    radius = np.linalg.norm(points - points.mean(axis=0), axis=1)
    window = max(3, len(points) // 12)
    around = np.stack([np.roll(radius, shift) for shift in range(-window, window + 1)])
    protruding = np.nonzero(radius >= around.max(axis=0))[0]
    protruding = protruding[np.argsort(-radius[protruding])][:8]
    contour = np.rint(points * 8).astype(np.int32)
    hull = cv2.convexHull(contour, returnPoints=False)
    hull[::-1].sort(axis=0)
    defects = cv2.convexityDefects(contour, hull) if len(hull) > 3 else None
    notches = np.zeros(0, int)
    if defects is not None:
        defects = defects.reshape(-1, 4)
        depth = defects[:, 3] / 256.0 / 8.0
        deep = np.argsort(-depth)[:3]
        notches = defects[deep[depth[deep] > SINUS_DEPTH * np.ptp(points, axis=0).max()], 2]
    return points[np.concatenate([protruding, notches])]
