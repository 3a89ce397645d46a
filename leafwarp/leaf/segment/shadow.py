"""A guess at the leaf without the shadow that the leaf casts."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.segment.background import Background, colour_distance
from leafwarp.leaf.segment.depth import disc
from leafwarp.leaf.segment.pieces import pieces_of

LEAST_LIGHT = 30.0  # [Lab units] of leaf and background, for a shadow to be told from them
DARKER = 0.5  # lightness of a hard shadow over theirs
MOST_SHADOW = 0.4  # of a guess; more is a dark leaf
MIXED = 7.0  # [Lab units] from the line between a shadow's colour and the background's
NOTCH = 0.012  # of the square root of a leaf's area: half the widest mouth of a lesion
COVERED = 0.7  # least share of a lesion that a closing of its mouth covers
GAP = 0.08  # of the square root of a leaf's area: shadow between it and its petiole


def without_shadow(lab: np.ndarray, inside: np.ndarray, background: Background) -> np.ndarray:
    """A guess without the cast shadow at its margin.

    Light that came through the leaf tints its shadow, so that no darkened paper explains it. What is then left is
    that a hard shadow is far darker than both leaf and background, and lies between them.
    """
    import cv2

    light = min(float(np.median(lab[inside][:, 0])), float(np.median(background.colours[:, 0])))
    if light < LEAST_LIGHT:
        return inside
    dark = cv2.morphologyEx(
        (inside & (lab[..., 0] < DARKER * light)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    labels, areas = pieces_of(dark > 0)
    rim = cv2.dilate((~inside).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    cast = np.bincount(labels[rim], minlength=len(areas)) > 0.25 * np.sqrt(areas)
    cast &= areas > max(0.0005 * np.count_nonzero(inside), 6)
    cast[0] = False
    zone = cv2.dilate(cast[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if not zone.any() or np.count_nonzero(zone & inside) > MOST_SHADOW * np.count_nonzero(inside):
        return inside
    # The shadow's own rim mixes its colour with the background's.
    mean = np.median(lab[zone], axis=0)
    share = np.linspace(0.0, 1.0, 6)[:, None, None]
    mixes = (mean + share * (background.colours - mean)).reshape(-1, 3)
    near = cv2.dilate(zone.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    rim = near & (colour_distance(lab, mixes) < max(background.grain, MIXED))
    lit = inside & ~zone & ~rim
    # A notch with a narrow mouth is a dark lesion at the margin: a shadow lies along it.
    mouth = disc(max(1, round(NOTCH * np.sqrt(np.count_nonzero(inside)))))
    whole = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_CLOSE, mouth) > 0
    taken, areas = pieces_of(inside & ~lit)
    lesion = np.bincount(taken[whole], minlength=len(areas)) > COVERED * np.maximum(areas, 1)
    lesion[0] = False
    return _rejoined(lit | lesion[taken])


def _rejoined(lit: np.ndarray) -> np.ndarray:
    """The largest piece and those that a shadow a few pixels wide parted from it."""
    import cv2

    labels, areas = pieces_of(lit)
    main = int(np.argmax(areas))
    joined = (labels == main).astype(np.uint8)
    gap, nearest = cv2.distanceTransformWithLabels(1 - joined, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    rows, columns = np.nonzero(joined)
    place = np.zeros((nearest.max() + 1, 2), int)
    place[nearest[rows, columns]] = np.column_stack([columns, rows])
    for label in np.nonzero(areas > 0.004 * areas[main])[0]:
        piece = labels == label
        if label == main or gap[piece].min() > max(4.0, GAP * np.sqrt(areas[main])):
            continue
        row, column = np.unravel_index(np.argmin(np.where(piece, gap, np.inf)), gap.shape)
        joined |= piece.astype(np.uint8)
        cv2.line(joined, (int(column), int(row)), place[nearest[row, column]].tolist(), 1, 3)
    return joined > 0
