"""An outline filled with so many uniform triangles (netgen)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh import mesh_from_triangles
from leafwarp.leaf.outline import resample_closed, smooth_closed

LEAST_VERTICES, MOST_VERTICES = 30, 400_000
COUNT_TOLERANCE = 0.01
TRIES = 10
KEEP_BOUNDARY = 0.06  # error of the count below which only the inner edge length is still changed
RASTER = 10  # pixels an edge while the outline is made fit for the edge length
NARROWEST_GAP = 0.55  # [edges] a notch narrower than this is closed
NARROWEST_STRIP = 0.65  # [edges] a petiole thinner than this is widened
CORNER_TURN = np.radians(38.0)  # a tooth or a notch turns the margin at least so much within one edge
CLOSEST_POINTS = 0.85  # [edges]; a short side makes a light, stiff corner that sets the motion's step


def triangulate(outline: np.ndarray, tip: np.ndarray, vertices: int) -> LeafMesh:
    """Triangulate a leaf uniformly.

    Args:
        outline: Corners of the closed outline [m], shape [count, 2], y up, the petiole base at the origin (on
            the outline).
        tip: Point of the outline farthest from the base [m], shape [2].
        vertices: Number of vertices asked for; met within 1 % (or one vertex).

    Raises:
        InputError: The count is out of range, or the outline cannot be filled.
    """
    if not LEAST_VERTICES <= vertices <= MOST_VERTICES:
        raise InputError(
            f"mesh: vertices: value {vertices} is not accepted; accepted: {LEAST_VERTICES} to {MOST_VERTICES}"
        )
    x, y = outline.T
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    perimeter = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum()
    # V = 1 + (F + B)/2 with F = area / (sqrt(3)/4 h^2) triangles and B = perimeter / h boundary edges.
    edge = (perimeter + np.sqrt(perimeter**2 + 32.0 / np.sqrt(3.0) * area * (vertices - 1))) / (4.0 * (vertices - 1))
    best, best_error, polygon = None, np.inf, None
    for _ in range(TRIES):
        # Near the target the boundary stays as it is: another choice of teeth would change the count by
        # leaps.
        if best_error > KEEP_BOUNDARY:
            polygon = boundary_polygon(outline, tip, edge)
        positions, triangles = _fill(polygon, edge)
        error = abs(len(positions) - vertices) / vertices
        if error < best_error:
            best, best_error = (positions, triangles), error
        if error <= max(COUNT_TOLERANCE, 1.0 / vertices):
            break
        edge *= np.sqrt(len(positions) / vertices)
    positions, triangles = best
    # By distance from the base: neighbours are then near in memory too (the front is as narrow as the leaf is
    # wide), and vertex 0 is the base.
    order = np.argsort(np.hypot(*positions.T), kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    triangles = rank[triangles]
    triangles = np.take_along_axis(triangles, (triangles.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return mesh_from_triangles(positions[order], triangles[np.lexsort(triangles.T[::-1])])


def boundary_polygon(outline: np.ndarray, tip: np.ndarray, edge: float) -> np.ndarray:
    """Outline with points about one edge length apart, fit to be filled with triangles of that size.

    Base (the first point, the origin) and tip are kept; so are teeth and notches of at least the edge length.
    Notches narrower than an edge are closed and a petiole thinner than an edge is widened: triangles of the asked
    size could not stand there.
    """
    fit = _fit_to_edge(outline, edge)
    anchored = _insert(_insert(fit, tip, edge), np.zeros(2), edge)
    polygon = _resample_between(anchored, _corners(anchored, tip, edge), edge)
    if not _is_simple(polygon):
        count = max(8, round(np.linalg.norm(np.roll(fit, -1, axis=0) - fit, axis=1).sum() / edge))
        polygon = resample_closed(anchored, count)
        if not _is_simple(polygon):
            raise InputError("mesh: the outline crosses itself at this edge length; accepted: more vertices, or a mask")
    return polygon


def _fit_to_edge(outline: np.ndarray, edge: float) -> np.ndarray:
    """Outline with narrow notches closed and thin parts widened, counter-clockwise, some 10 points an edge."""
    import cv2

    pixel, pad = edge / RASTER, 2 * RASTER
    low = outline.min(axis=0)
    corners = (outline - low) / pixel + pad
    shape = np.ceil(corners.max(axis=0)).astype(int)[::-1] + pad
    inside = np.zeros(shape, np.uint8)
    cv2.fillPoly(inside, [np.rint(corners * 256 - 128).astype(np.int32)], 1, shift=8)
    inside = cv2.morphologyEx(inside, cv2.MORPH_CLOSE, _disc(0.5 * NARROWEST_GAP * RASTER))
    inside |= _widening(inside)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea)[:, 0].astype(float)
    if cv2.contourArea(contour.astype(np.float32), oriented=True) < 0.0:
        contour = contour[::-1]
    return (smooth_closed(contour, sigma=0.12 * RASTER) + 0.5 - pad) * pixel + low


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


def _is_simple(polygon: np.ndarray) -> bool:
    """Whether no two sides of a closed polygon cross."""
    count = len(polygon)
    if count < 3:
        return False
    a, b = polygon, np.roll(polygon, -1, axis=0)

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    for index in range(count):
        others = np.arange(index + 2, count - (index == 0))
        p, q, r, s = a[index], b[index], a[others], b[others]
        if ((side(p, q, r) * side(p, q, s) <= 0.0) & (side(r, s, p) * side(r, s, q) <= 0.0)).any():
            return False
    return True


def _fill(polygon: np.ndarray, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and triangles of a counter-clockwise polygon; the first polygon point is exactly the first vertex."""
    import netgen.meshing
    from netgen.geom2d import SplineGeometry

    netgen.meshing.SetMessageImportance(0)  # nothing on stdout
    geometry = SplineGeometry()
    corners = [geometry.AppendPoint(*point) for point in (polygon / edge).tolist()]
    for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
        geometry.Append(["line", corner, following], leftdomain=1, rightdomain=0)
    try:
        filled = geometry.GenerateMesh(maxh=1.0, grading=0.6)
    except Exception as error:  # netgen raises its own type with a text of its own
        raise InputError(f"mesh: the outline cannot be filled with triangles: {error}") from error
    positions = np.array([tuple(point.p)[:2] for point in filled.Points()]) * edge
    triangles = np.array([[vertex.nr for vertex in face.vertices] for face in filled.Elements2D()], np.int64) - 1
    if len(triangles) == 0:
        raise InputError("mesh: the outline cannot be filled with triangles")
    positions[np.argmin(np.hypot(*positions.T))] = 0.0
    corner = positions[triangles]
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    if np.sum(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) < 0.0:
        triangles = triangles[:, ::-1]
    return positions, triangles
