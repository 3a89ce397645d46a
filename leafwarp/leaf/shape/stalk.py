"""Petioles: parts of a leaf that are thin, end freely, and keep their width up to that end.

What an opening of the shape removes is thin. A thin part's free end is the point farthest from the rest of the leaf;
within the shape, the pixels at one distance from it give the width there. A petiole's width is nearly constant, a leaf
tip's or a tooth's falls to nothing towards its end. A bend does not matter, as distances are measured inside the shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.shape.pixel_graph import PixelGraph, pixel_graph
from leafwarp.leaf.shape.window import Window

AREA = 70_000  # [pixels] of the leaf in the window to look in
OPENINGS = (0.1, 0.16, 0.24, 0.34, 0.45)  # radii that vanish, as shares of the blade's inradius
SLENDERNESS = 0.9  # least length over width; shorter ones are teeth
EVENNESS = 0.55  # least width near the end over width near the blade
# Of a stalk, whole or cut, as a share of the leaf's extent: in a window of this area two to five times the depth of its
# foot. With 0.015 tips and a rachis are taken for stalks; up to 0.03 forms and photos of the tests keep their base.
LEAST_LENGTH = 0.018
FOOT = 2.5  # [pixels] depth of a thin part's joint with the rest
APART = 0.33  # least distance of an end from the rest of the leaf over the length: a shadow's rim hugs the margin
ENDS = 3  # free ends that are sought in one thin part
SAME_END = 0.03  # ends this near (share of the extent) are one


@dataclass(frozen=True)
class Stalk:
    """A part that may be the petiole.

    Attributes:
        end: Its free end in photo pixels, (x, y).
        foot: Where it joins the rest of the leaf, in photo pixels.
        length: Length along it, as a share of the leaf's extent.
        slenderness: Length over width.
        thinness: Width over the diameter of the largest circle in the leaf.
    """

    end: np.ndarray
    foot: np.ndarray
    length: float
    slenderness: float
    thinness: float


def find_stalks(window: Window) -> list[Stalk]:
    """What may be a petiole, longest first."""
    import cv2

    inside = window.inside
    depth = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    least = LEAST_LENGTH * window.extent
    found: list[Stalk] = []
    for share in OPENINGS:
        radius = share * float(depth.max())
        core = (depth <= radius).astype(np.uint8)
        reach = cv2.distanceTransform(core, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - radius
        outer = inside & (reach > 1.0)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(outer.astype(np.uint8), connectivity=8)
        for label in range(1, count):
            left, top, across, down = boxes[label, :4].tolist()
            if np.hypot(across, down) < least:
                continue
            corner = (left, top)
            box = np.s_[top : top + down, left : left + across]
            for end, foot, length, width in _free_ends(labels[box] == label, reach[box], least):
                ends = window.to_photo(np.add(end, corner)), window.to_photo(np.add(foot, corner))
                thinness = width / (2.0 * float(depth.max()))
                found.append(Stalk(*ends, length / window.extent, length / width, thinness))
    kept: list[Stalk] = []
    for stalk in sorted(found, key=lambda stalk: -stalk.length):
        apart = [np.linalg.norm(stalk.end - other.end) * window.scale for other in kept]
        if all(distance > SAME_END * window.extent for distance in apart):
            kept.append(stalk)
    return kept


def _free_ends(piece: np.ndarray, reach: np.ndarray, least: float) -> list[tuple[np.ndarray, np.ndarray, float, float]]:
    """End, foot, length and width of each stalk in a piece. ``reach`` is the distance from the rest of the leaf."""
    graph = pixel_graph(piece)
    away = reach[piece]
    reach = graph.cost_from_any(np.nonzero(away <= FOOT)[0]) + 1.0
    left = np.isfinite(reach)
    ends = []
    for _ in range(ENDS):
        farthest = int(np.argmax(np.where(left, reach, 0.0)))
        length = float(reach[farthest])
        if not left[farthest] or length < max(4.0, least):
            break
        distance = graph.costs(np.array([farthest]), limit=1.5 * length)[0]
        left &= distance > length
        width = _even_width(distance, length)
        if away[farthest] < APART * length:
            continue
        if width is not None and length >= SLENDERNESS * width and _is_end(graph, piece.shape, distance, length):
            at_end = (reach >= length - max(1.0, 0.25 * width)) & (distance <= 2.0 * width)
            at_foot = (distance > length - 2.0) & (distance <= length + 1.0)
            ends.append((graph.points[at_end].mean(axis=0), graph.points[at_foot].mean(axis=0), length, width))
    return ends


def _even_width(distance: np.ndarray, length: float) -> float | None:
    """Mean width of a stalk, given the distances of its pixels from its end; None where it tapers to its end."""
    bins = int(np.clip(length / 2.0, 4, 40))
    profile = np.histogram(distance, bins=bins, range=(0.0, length))[0] * (bins / length)
    trunk = profile[max(1, bins // 8) : bins - max(1, bins // 8)]
    quarter = max(1, len(trunk) // 4)
    evenness = trunk[:quarter].mean() / max(trunk[-quarter:].mean(), 1e-6)
    return float(trunk.mean()) if evenness >= EVENNESS else None


def _is_end(graph: PixelGraph, shape: tuple[int, int], distance: np.ndarray, length: float) -> bool:
    """Whether the part leaves a point in one direction only; half-way between two leaflets it leaves in two."""
    import cv2

    ring = np.zeros(shape, np.uint8)
    around = (distance > 0.4 * length) & (distance < 0.6 * length + 2.0)
    columns, rows = (graph.points[around] - 0.5).astype(int).T
    ring[rows, columns] = 1
    return cv2.connectedComponents(ring, connectivity=8)[0] == 2
