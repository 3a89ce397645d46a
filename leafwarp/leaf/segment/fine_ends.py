"""Thin ends of a leaf, and of the gaps in it, that a coarse first look lost.

The opening that clears a guess of specks also takes the tips of narrow pinnae, and what shrinks the picture fills the
narrow gaps between them. Both run on from a part of their own side that is hardly wider than they are, as a point does:
that tells them from a thread at the margin or a pale vein within it, which begin at the full breadth of the other side.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.segment.background import WEIGHT
from leafwarp.leaf.segment.depth import depth_of
from leafwarp.leaf.segment.pieces import pieces_of

NEAR = 20.0  # [pixels] over which the colours on either side of the margin are gathered
COARSE = 4  # [pixels] a cell of that
LEAST_STEP = 14.0  # [Lab units] between both sides, below which no thin thing is told from either
OFF_LINE = 0.35  # most distance from the line between both sides' colours, as a share of their step
LIKE_LEAF, LIKE_GROUND = 0.5, 0.25  # least and most share of the leaf's colour
LOOK = 512  # [pixels] the picture's long side at the first look,
LOST_WIDTH = 2.5  # and half the width there of what it loses
RIM = 1.5  # [pixels] off the guess over which what is seen may be its own blurred margin
LONGEST = 0.15  # of the square root of a leaf's area
TAPER = 0.4  # most gain of half width a pixel of length at the foot of an end; a straight margin has 1


def with_fine_ends(lab: np.ndarray, leaf: np.ndarray, cast: np.ndarray) -> np.ndarray:
    """A leaf with the thin ends that it lost, and without those of the background that it took, bool.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        leaf: The leaf but for its thin ends, bool, shape [height, width].
        cast: What was taken off it as its shadow: nothing of that comes back.
    """

    size = float(np.sqrt(np.count_nonzero(leaf)))
    half = max(1.5, LOST_WIDTH * max(leaf.shape) / LOOK)
    away, depth = depth_of(~leaf), depth_of(leaf)
    zone = (away > 0.0) & (away < LONGEST * size) & ~cast | (depth > 0.0) & (depth < 2.0 * half + NEAR)
    means = [_mean_nearby(lab, side) for side in (depth > RIM, away > RIM)]
    (inner, inner_weight), (ground, ground_weight) = means
    colour, base = lab[zone] * WEIGHT, ground[zone] * WEIGHT
    line = inner[zone] * WEIGHT - base
    step = np.sqrt((line**2).sum(axis=1))
    share = ((colour - base) * line).sum(axis=1) / np.maximum(step**2, 1e-3)
    off = np.sqrt(((colour - base - share[:, None] * line) ** 2).sum(axis=1))
    told = (step > LEAST_STEP) & (off < OFF_LINE * step) & (inner_weight[zone] > 1e-4) & (ground_weight[zone] > 1e-4)
    seen = np.zeros(leaf.shape, np.uint8)
    seen[zone] = np.where(told & (share > LIKE_LEAF), 1, 0) + np.where(told & (share < LIKE_GROUND), 2, 0)
    ends = _ends((seen == 1) & ~leaf, away, depth, half)
    gaps = _ends((seen == 2) & leaf, depth, away, half)
    return (leaf | ends) & ~gaps


def _mean_nearby(lab: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean colour of one side near each pixel, and that side's weight there."""
    import cv2

    size = (lab.shape[1], lab.shape[0])
    small = (-(-size[0] // COARSE), -(-size[1] // COARSE))
    weight = side.astype(np.float32)
    parts = [cv2.resize(part, small, interpolation=cv2.INTER_AREA) for part in (lab * weight[..., None], weight)]
    total, share = (cv2.GaussianBlur(part, (0, 0), NEAR / COARSE) for part in parts)
    return cv2.resize(total / (share[..., None] + 1e-6), size), cv2.resize(share, size)


def _ends(seen: np.ndarray, off: np.ndarray, depth: np.ndarray, half: float) -> np.ndarray:
    """Of what is seen off one side those thin pieces that go on from an end of it.

    Args:
        seen: What is of that side's colour, bool.
        off: Distance of each pixel to that side [pixels].
        depth: Distance of each of the side's pixels from its margin [pixels].
        half: Most half width of such a piece [pixels].
    """
    import cv2

    labels, areas = pieces_of(seen & (off > RIM), connectivity=8)
    if len(areas) < 2:
        return np.zeros_like(seen)
    at = labels > 0
    label_of = labels[at]
    thick, reach, foot = (np.zeros(len(areas)) for _ in range(3))
    np.maximum.at(thick, label_of, depth_of(seen)[at])
    np.maximum.at(reach, label_of, off[at])
    look = int(2.5 * half) + 1
    near = cv2.dilate(depth, np.ones((2 * look + 1, 2 * look + 1), np.uint8))
    joint = at & (off < RIM + 1.5)
    np.maximum.at(foot, labels[joint], near[joint])
    kept = (foot > 0.0) & (thick <= half) & (reach > RIM + 1.0) & (foot <= thick + TAPER * look)
    grown = cv2.dilate(kept[labels].astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return kept[labels] | (grown & seen & (off <= RIM))
