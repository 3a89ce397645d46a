"""What a leaf's outline says of its veins: a blade, lobes, and the lines that the main veins take."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.venation.drainage import drainage, path_to, smooth_open

BLADE = 6.0  # length over width from which veins run along the leaf
FULLNESS = 0.75  # area of a blade over length times width
STALK_DEPTH = 0.02  # half the width of a stalk at most, as a share of the long side
LOBE = 0.12  # how far a lobe reaches past the notch beside it, as a share of the leaf's reach
LEAST_REACH = 0.35  # of a lobe, as a share of the leaf's
LOBED_ASPECT, ROUND_ASPECT = 0.7, 0.9  # width over length from which a leaf with lobes, or without, is palmate
RASTER_ERROR = 0.08  # of the length of a way in eight directions
RAYS = (-75.0, -38.0, 38.0, 75.0)  # [degrees] main veins of a round leaf, from its midrib


@dataclass(frozen=True)
class LeafShape:
    """A leaf's outline on a raster, in pixel coordinates (x, y).

    Attributes:
        inside: The leaf's pixels, bool, shape [height, width].
        polygon: The outline, shape [count, 2].
        base: The petiole's end.
        tip: The farthest point.
        depth: Distance of each pixel from the margin [pixels], float32.
    """

    inside: np.ndarray
    polygon: np.ndarray
    base: np.ndarray
    tip: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, inside: np.ndarray, polygon: np.ndarray, base: np.ndarray, tip: np.ndarray) -> LeafShape:
        """The shape with its depth measured."""
        import cv2

        padded = np.pad(inside, 1).astype(np.uint8)
        depth = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        return cls(inside, polygon, np.asarray(base, float), np.asarray(tip, float), depth)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Which points (x, y) are inside the leaf, shape [count], bool."""
        height, width = self.inside.shape
        column, row = np.floor(points).astype(int).T
        within = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        return within & self.inside[row.clip(0, height - 1), column.clip(0, width - 1)]


def is_blade(shape: LeafShape) -> bool:
    """Whether the leaf, its stalk aside, is one strip more than six times as long as wide."""
    import cv2

    radius = float(shape.depth.max())
    core = (shape.depth <= 0.3 * radius).astype(np.uint8)
    opened = cv2.distanceTransform(core, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= 0.3 * radius
    area = float(np.count_nonzero(opened & shape.inside))
    return area / (FULLNESS * 4.0 * radius**2) > BLADE and len(lobe_tips(shape)) <= 1


def lobe_tips(shape: LeafShape) -> np.ndarray:
    """Ends of the leaf's lobes or leaflets, the farthest along the leaf first, shape [count, 2].

    A lobe is a peak along the outline of the way to the base inside the leaf.
    """
    from scipy.signal import find_peaks
    from scipy.spatial import cKDTree

    step = max(1, round(max(shape.inside.shape) / 200))
    coarse = shape.inside[::step, ::step]
    rows, columns, way, _ = drainage(coarse.astype(float), coarse, shape.base / step)
    way = np.where(np.isfinite(way), way, 0.0)
    # Dividing by the price of a pixel of likelihood 1 is not needed: only ratios matter.
    points = shape.polygon[np.linspace(0, len(shape.polygon), 480, endpoint=False).astype(int)]
    nearest = cKDTree(np.column_stack([columns, rows]) * step + 0.5).query(points)[1]
    reach = way[nearest]
    start = int(np.argmin(reach))
    reach = np.roll(reach, -start)
    around = np.concatenate([reach, reach[:1]])
    peaks = find_peaks(around, prominence=LOBE * reach.max(), height=LEAST_REACH * reach.max())[0]
    if not len(peaks):
        peaks = np.array([int(np.argmax(reach))])
    peaks = peaks[np.argsort(-around[peaks], kind="stable")]
    tips = points[(peaks + start) % len(points)]
    # Ways along the raster's diagonals are a little too long: the farthest point as the crow flies, where it is as far.
    last = int(np.argmin(np.linalg.norm(points - shape.tip, axis=1)))
    if way[nearest[last]] > (1.0 - RASTER_ERROR) * reach.max():
        tips[0] = shape.tip
    return tips


def midrib(shape: LeafShape) -> np.ndarray:
    """Line from the base to the farthest lobe, along the middle of the leaf, pixels (x, y), shape [count, 2]."""
    return main_veins(shape, "pinnate")[0]


def main_veins(shape: LeafShape, kind: str) -> list[np.ndarray]:
    """Lines of the main veins from the base outwards, the midrib first.

    Args:
        shape: The leaf.
        kind: "pinnate": along the middle of the leaf, into each lobe; "palmate": straight from where the stalk meets
            the lamina into each lobe, or fanned out where there are none.
    """
    tips = lobe_tips(shape)
    middle = np.clip(shape.depth / max(float(shape.depth.max()), 1.0), 0.0, 1.0)
    rows, columns, cost, predecessor = drainage(middle, shape.inside, shape.base)
    points = np.column_stack([columns + 0.5, rows + 0.5])
    rib = _line(points, cost, predecessor, tips[0])
    join = junction(shape, rib)
    if kind == "palmate":
        ends = [*tips[1:]] if len(tips) >= 3 else _fan(shape, rib, join)
        # Inside the leaf every way is as good, so the veins run straight; only the margin is kept away from.
        free = np.clip(shape.depth / max(0.12 * float(shape.depth.max()), 1.0), 0.0, 1.0)
        rows, columns, cost, predecessor = drainage(free, shape.inside, rib[join])
        rays = [_taut(shape, _line(points, cost, predecessor, end)) for end in [tips[0], *ends]]
        return [np.concatenate([rib[:join], rays[0]]), *rays[1:]]
    lines = [_eased(shape, rib, join)]
    along = middle.copy()
    for tip in tips[1:]:
        # A lobe's vein joins those that are there: they cost little.
        for line in lines:
            along[tuple(line.astype(int).T[::-1])] = 1.0
        _, _, cost, predecessor = drainage(along, shape.inside, shape.base)
        lines.append(_line(points, cost, predecessor, tip))
    return lines


def suits_palmate(shape: LeafShape) -> bool:
    """Whether the outline asks for main veins that fan out: wide with three lobes or more, or as wide as long."""
    tips = lobe_tips(shape)
    rows, columns = np.nonzero(shape.inside & (shape.depth >= 1.0))
    deep = shape.depth[rows, columns] > STALK_DEPTH * max(shape.inside.shape)
    if not deep.any():
        return False
    axis = (tips[0] - shape.base) / max(float(np.linalg.norm(tips[0] - shape.base)), 1e-6)
    places = np.column_stack([columns, rows])[deep].astype(float)
    along, across = places @ axis, places @ np.array([-axis[1], axis[0]])
    aspect = float(np.ptp(across) / max(np.ptp(along), 1.0))
    return aspect > (LOBED_ASPECT if len(tips) >= 3 else ROUND_ASPECT)


def junction(shape: LeafShape, rib: np.ndarray) -> int:
    """Index along the midrib where the stalk meets the lamina: the last point before it is wider than a stalk."""
    depth = shape.depth[tuple(rib.astype(int).T[::-1])]
    wide = np.nonzero(depth > STALK_DEPTH * max(shape.inside.shape))[0]
    return int(wide[0]) if len(wide) else 0


def _line(points: np.ndarray, cost: np.ndarray, predecessor: np.ndarray, end: np.ndarray) -> np.ndarray:
    reached = np.where(np.isfinite(cost), np.hypot(*(points - end).T), np.inf)
    return points[path_to(int(np.argmin(reached)), predecessor)]


def _eased(shape: LeafShape, rib: np.ndarray, join: int) -> np.ndarray:
    """A midrib smoothed past the stalk, for the middle of a leaf bends with every bay of the margin."""
    blade = rib[join:]
    for share in (0.25, 0.12, 0.05):
        smooth = smooth_open(blade, sigma=share * len(blade))
        if shape.holds(smooth).all():
            return np.concatenate([rib[:join], smooth])
    return rib


def _taut(shape: LeafShape, line: np.ndarray) -> np.ndarray:
    """The line pulled straight wherever the straight way stays inside the leaf, points a pixel apart."""
    corners, here = [0], 0
    while here < len(line) - 1:
        ahead = len(line) - 1
        while ahead > here + 1 and not shape.holds(_straight(line[here], line[ahead])).all():
            ahead = here + max(1, (ahead - here) * 3 // 4)
        corners.append(ahead)
        here = ahead
    pieces = [_straight(line[start], line[end])[:-1] for start, end in itertools.pairwise(corners)]
    return np.concatenate([*pieces, line[-1:]])


def _straight(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    count = max(2, int(np.ceil(np.linalg.norm(end - start))) + 1)
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def _fan(shape: LeafShape, rib: np.ndarray, join: int) -> list[np.ndarray]:
    """Where rays at set angles from the midrib meet the margin, those that are not too short."""
    origin = rib[join]
    ahead = rib[-1] - origin
    length = float(np.linalg.norm(ahead))
    ends = []
    for degrees in RAYS:
        angle = np.radians(degrees) + np.arctan2(ahead[1], ahead[0])
        ray = origin + np.arange(1.0, length)[:, None] * (np.cos(angle), np.sin(angle))
        column, row = np.clip(ray.astype(int), 0, np.array(shape.inside.shape[::-1]) - 1).T
        outside = np.nonzero(shape.depth[row, column] < 3.0)[0]
        reach = int(outside[outside > 0.05 * length][0]) if (outside > 0.05 * length).any() else len(ray) - 1
        if reach > 0.25 * length:
            ends.append(ray[reach])
    return ends
