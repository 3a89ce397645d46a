"""The boundary of a mesh: an outline and its holes as polygons with points an edge length apart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.mesh.segments import closed_chain, conflicts
from leafwarp.leaf.shape.outline import resample_closed, smooth_closed

RASTER = 10  # pixels an edge while the outline is made fit for the edge length
NARROWEST_GAP = 0.55  # [edges] a notch narrower than this is closed
NARROWEST_STRIP = 0.65  # [edges] a petiole thinner than this is widened
NARROWEST_BRIDGE = 0.9  # [edges] of leaf left between a hole and the margin or another hole
TOUCHING = 0.2  # [edges] a hole that comes so near to another boundary after all is filled
CROSSING = 1e-6  # [edges] sides so near to one another cross
CORNER_TURN = np.radians(38.0)  # a tooth or a notch turns the margin at least so much within one edge
CLOSEST_POINTS = 0.85  # [edges]; a short side makes a light, stiff corner that sets the motion's step
SMALLEST_HOLE = 1.2  # [edges] diameter of the circle with the area of the smallest hole that stays
FEWEST_SIDES = 5  # of a hole


def boundary_loops(
    outline: np.ndarray, tip: np.ndarray, edge: float, holes: Sequence[np.ndarray] = ()
) -> list[np.ndarray]:
    """Outline and holes with points about one edge length apart, fit to be filled with triangles of that size.

    Base (the first point, the origin) and tip are kept; so are teeth and notches of at least the edge length.
    Notches narrower than an edge are closed, and a petiole (or what is left between a hole and the margin) thinner
    than an edge is widened: triangles of the asked size could not stand there. A hole smaller than about an edge is
    filled.

    Args:
        outline: Corners of the closed outline [m], shape [count, 2], the petiole base at the origin (on it).
        tip: Point of the outline farthest from the base [m].
        edge: Edge length [m].
        holes: Closed polygons inside the outline [m], shape [count, 2] each.

    Returns:
        The outline, counter-clockwise, then the holes, clockwise: the leaf is to the left of each.

    Raises:
        InputError: The outline crosses itself at this edge length.
    """
    fit, fit_holes = _fit_to_edge(outline, edge, holes)
    anchored = _insert(_insert(fit, tip, edge), np.zeros(2), edge)
    polygon = _resample_between(anchored, _corners(anchored, tip, edge), edge)
    if not _is_simple(polygon, edge):
        polygon = resample_closed(anchored, max(8, round(_perimeter(fit) / edge)))
        if not _is_simple(polygon, edge):
            raise InputError("mesh: the outline crosses itself at this edge length; accepted: more vertices, or a mask")
    loops = [polygon]
    for hole in fit_holes:
        sides = resample_closed(hole, max(FEWEST_SIDES, round(_perimeter(hole) / edge)))
        if _is_simple(sides, edge) and not _meet(sides, loops, TOUCHING * edge):
            loops.append(sides)
    return loops


def _meet(polygon: np.ndarray, others: list[np.ndarray], least: float) -> bool:
    """Whether a closed polygon crosses others or comes nearer to them than a distance."""
    first = np.cumsum([0, *map(len, others)])
    pieces = [closed_chain(len(loop), start) for start, loop in zip(first, [*others, polygon], strict=True)]
    pairs = conflicts(np.concatenate([*others, polygon]), np.concatenate(pieces), least, 0.0)
    return bool((pairs >= first[-1]).any())


def _perimeter(polygon: np.ndarray) -> float:
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


def _fit_to_edge(outline: np.ndarray, edge: float, holes: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Outline (counter-clockwise) and holes (clockwise) with narrow gaps closed and thin parts widened, some 10
    points an edge."""
    import cv2

    pixel, pad = edge / RASTER, 2 * RASTER
    low = outline.min(axis=0)

    def corners(polygon: np.ndarray) -> np.ndarray:
        return (polygon - low) / pixel + pad

    shape = np.ceil(corners(outline).max(axis=0)).astype(int)[::-1] + pad
    inside = np.zeros(shape, np.uint8)
    cv2.fillPoly(inside, [np.rint(corners(outline) * 256 - 128).astype(np.int32)], 1, shift=8)
    asked = _drawn(inside.shape, [corners(hole) for hole in holes])
    if len(holes):
        inside = _carved(inside, asked)
    inside = cv2.morphologyEx(inside, cv2.MORPH_CLOSE, _disc(0.5 * NARROWEST_GAP * RASTER))
    inside |= _widening(inside)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outer = max(contours, key=cv2.contourArea)
    # A fill takes in the pixels that its rim runs through, and a contour runs along the middles of those: a hole has
    # to be traced as a thing of its own for the two to cancel, as they do for the outline.
    # A notch whose narrow mouth was closed is enclosed too, but no hole.
    enclosed = cv2.fillPoly(np.zeros_like(inside), [outer], 1) & ~inside & asked
    traced, _ = cv2.findContours(enclosed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    least = 0.25 * np.pi * (SMALLEST_HOLE * RASTER) ** 2
    inner = [contour for contour in traced if cv2.contourArea(contour) >= least]

    def smooth(contour: np.ndarray, counter_clockwise: bool) -> np.ndarray:
        points = contour[:, 0].astype(float)
        if (cv2.contourArea(points.astype(np.float32), oriented=True) > 0.0) != counter_clockwise:
            points = points[::-1]
        return (smooth_closed(points, sigma=0.12 * RASTER) + 0.5 - pad) * pixel + low

    # Seen with the rows running up, as here, OpenCV's positive orientation is counter-clockwise.
    return smooth(outer, True), [smooth(hole, False) for hole in inner]


def _drawn(shape: tuple[int, ...], polygons: list[np.ndarray]) -> np.ndarray:
    import cv2

    drawn = np.zeros(shape, np.uint8)
    for polygon in polygons:
        cv2.fillPoly(drawn, [np.rint(polygon * 256 - 128).astype(np.int32)], 1, shift=8)
    return drawn


def _carved(inside: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The leaf less its holes, which shrink where they leave too narrow a bridge to the margin or to a larger hole."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    left = inside.copy()
    for label in 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA], kind="stable"):
        bridge = cv2.distanceTransform(left, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        left[(labels == label) & (bridge > NARROWEST_BRIDGE * RASTER)] = 0
    return left


def _widening(inside: np.ndarray) -> np.ndarray:
    """A band of the least width along the middle of long parts that are thinner."""
    import cv2

    radius = 0.5 * NARROWEST_STRIP * RASTER
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    thin = inside & (cv2.distanceTransform((depth <= radius).astype(np.uint8), cv2.DIST_L2, 5) > radius + 1.0)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thin.astype(np.uint8), connectivity=8)
    long = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) > 1.5 * RASTER
    long[0] = False
    # The middle: no deeper pixel beside it across at least one direction.
    middle = np.zeros(inside.shape, bool)
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        middle |= (depth >= np.roll(depth, step, (0, 1))) & (depth >= np.roll(depth, (-step[0], -step[1]), (0, 1)))
    middle &= (inside > 0) & long[labels] & (depth >= 0.75 * cv2.dilate(depth, np.ones((5, 5), np.uint8)))
    return cv2.dilate(middle.astype(np.uint8), _disc(radius)) if middle.any() else np.zeros_like(inside)


def _disc(radius: float) -> np.ndarray:
    reach = int(np.ceil(radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return (x**2 + y**2 <= radius**2 + 0.5).astype(np.uint8)


def _insert(points: np.ndarray, point: np.ndarray, edge: float) -> np.ndarray:
    """The nearest stretch (a third of an edge) of a closed polygon replaced by a point, which comes first."""
    distance = np.linalg.norm(points - point, axis=1)
    rolled = np.roll(points, -int(np.argmin(distance)), axis=0)
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean()
    skip = max(1, round(edge / 6.0 / step))
    return np.concatenate([point[None], rolled[skip : len(rolled) - skip + 1]])


def _corners(points: np.ndarray, tip: np.ndarray, edge: float) -> np.ndarray:
    """Indices of the points to keep, ascending from 0: base, tip, and sharp turns not too near to one another."""
    count = len(points)
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    arc = np.concatenate([[0.0], np.cumsum(step)])
    total, arc = arc[-1], arc[:-1]
    reach = max(1, round(0.6 * edge / step.mean()))
    ahead, behind = np.roll(points, -reach, axis=0) - points, points - np.roll(points, reach, axis=0)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    turn = np.abs(np.arctan2(cross, (ahead * behind).sum(axis=1)))
    top = int(np.argmin(np.linalg.norm(points - tip, axis=1)))
    turn[0], turn[top] = 2.0 * np.pi, 1.9 * np.pi
    kept: list[int] = []
    for index in np.argsort(-turn, kind="stable")[: np.count_nonzero(turn > CORNER_TURN)]:
        gaps = np.abs(arc[kept] - arc[index])
        if kept and np.minimum(gaps, total - gaps).min() < CLOSEST_POINTS * edge:
            continue
        kept.append(int(index))
    if len(kept) < 2:
        kept.append(count // 2)
    return np.array(sorted(kept))


def _resample_between(points: np.ndarray, corners: np.ndarray, edge: float) -> np.ndarray:
    """The corners, and points at even distances along the arc between each two."""
    closed = np.concatenate([points, points[:1]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    bounds = np.append(arc[corners], arc[-1])
    at = np.concatenate(
        [
            np.linspace(first, last, max(1, round((last - first) / edge)), endpoint=False)
            for first, last in pairwise(bounds.tolist())
        ]
    )
    return np.column_stack([np.interp(at, arc, closed[:, 0]), np.interp(at, arc, closed[:, 1])])


def _is_simple(polygon: np.ndarray, edge: float) -> bool:
    """Whether no two sides of a closed polygon cross or touch."""
    return len(polygon) >= 3 and not len(conflicts(polygon, closed_chain(len(polygon)), CROSSING * edge, 0.0))
