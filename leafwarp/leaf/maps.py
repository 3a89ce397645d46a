"""The maps of a leaf: which cells are leaf, and venation, stomata, water and source on them.

Everything here is laid out as the simulation reads it: shape [ny, nx], row 0 at the bottom, values averaged
over each cell.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.outline import Outline
from leafwarp.leaf.photo import Photo, read_grey
from leafwarp.leaf.veins import CONDUCTANCE_POWER, Branch, vein_likelihood, vein_tree

RASTER_SIDE = 4096  # [pixels] bound of the fine raster that veins and coverage are drawn on
LEAST_RASTER = 1024  # [pixels] least side of it, however few the cells
VEIN_SIDE, VEIN_LONGEST = (
    480,
    1600,
)  # [pixels] geometric mean of the sides, and the long side, while seeking veins
VEIN_STOMATA = 0.8  # share of the stomata that a main vein takes away
PIECE_SHARE = 0.01  # a loose piece with this share of the leaf's cells is joined to it, a smaller one dropped


@dataclass(frozen=True)
class PixelFrame:
    """The maps' rectangle in whole pixels of the photo: ``left``, ``top`` inclusive, ``right``, ``bottom``
    exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.right - self.left, self.bottom - self.top

    @classmethod
    def around(cls, outline: Outline, margin: float = 0.03) -> PixelFrame:
        """The outline's bounding box, wider by a share of its longer side each way, rounded outwards."""
        low, high = outline.points.min(axis=0), outline.points.max(axis=0)
        pad = margin * float((high - low).max())
        return cls(*np.floor(low - pad).astype(int).tolist(), *np.ceil(high + pad).astype(int).tolist())

    def cells(self, points: np.ndarray, map_size: tuple[int, int]) -> np.ndarray:
        """Continuous cell coordinates (column, row from the **top**) of photo points (x, y)."""
        scale = np.divide(map_size, self.size)
        return (points - (self.left, self.top)) * scale


def make_maps(
    photo: Photo,
    outline: Outline,
    frame: PixelFrame,
    map_size: tuple[int, int],
    maps: Mapping[str, str | float | Path],
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Mask and named maps.

    Args:
        photo: The picture.
        outline: The leaf in it.
        frame: The rectangle to cover.
        map_size: Cells across and up (nx, ny).
        maps: The maps wanted: "auto", a number in [0, 1], or a picture of the same frame as the photo.

    Returns:
        Mask of shape [ny, nx], bool, and the maps, zero off the leaf.
    """
    base_cell, tip_cell = (_cell(frame, point, map_size) for point in (outline.base, outline.tip))
    mask = leaf_cells(_coverage(outline, frame, map_size), base_cell, tip_cell)
    made: dict[str, np.ndarray] = {}
    veins = None
    if any(maps.get(name) == "auto" for name in ("venation", "stomata")):
        veins = _draw(find_veins(photo, outline), outline, frame, map_size)
    for name, value in maps.items():
        if isinstance(value, Path):
            made[name] = _from_image(value, photo, frame, map_size)
        elif value != "auto":
            made[name] = np.full(mask.shape, float(value))
        elif name == "source":
            made[name] = _source(outline, frame, map_size, mask)
        elif name == "water":
            made[name] = np.ones(mask.shape)
        else:
            made[name] = veins if name == "venation" else 1.0 - VEIN_STOMATA * veins
        made[name] = np.where(mask, made[name], 0.0)
    if "source" in made:
        total = made["source"].sum()
        if total <= 0.0:
            raise InputError(
                f"{maps['source']}: maps: source: it is black on the leaf; accepted: light where water enters"
            )
        made["source"] = made["source"] / total
    return mask, made


def _cell(frame: PixelFrame, point: np.ndarray, map_size: tuple[int, int]) -> tuple[int, int]:
    """Row (from the bottom) and column of the cell that holds a photo point."""
    column, down = np.minimum(np.maximum(np.floor(frame.cells(point, map_size)), 0), np.subtract(map_size, 1))
    return map_size[1] - 1 - int(down), int(column)


def _refinement(map_size: tuple[int, int], frame: PixelFrame, least: int) -> tuple[int, int]:
    """Fine raster pixels a cell across and down: nearly square, at least so many where the raster's bound allows."""
    cell = np.divide(frame.size, map_size)
    wanted = np.maximum(least, np.rint(least * cell / cell.min()))
    wanted = np.maximum(wanted, np.ceil(LEAST_RASTER / np.array(map_size)))
    allowed = np.maximum(1, RASTER_SIDE // np.array(map_size))
    across, down = np.minimum(wanted, allowed).astype(int).tolist()
    return across, down


def _coverage(outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Share of each cell that is leaf, shape [ny, nx]."""
    import cv2

    across, down = _refinement(map_size, frame, least=4)
    fine = np.zeros((map_size[1] * down, map_size[0] * across), np.uint8)
    corners = frame.cells(outline.points, map_size) * (across, down)
    cv2.fillPoly(fine, [np.rint(corners * 256 - 128).astype(np.int32)], 255, shift=8)
    return _cell_means(fine, map_size)


def _cell_means(fine: np.ndarray, map_size: tuple[int, int]) -> np.ndarray:
    """Means over the cells of a fine 8-bit raster (top row first), in [0, 1], bottom row first, shape [ny, nx]."""
    import cv2

    means = cv2.resize(fine.astype(np.float32), map_size, interpolation=cv2.INTER_AREA)[::-1] / 255.0
    return np.clip(means.astype(np.float64), 0.0, 1.0)  # the resampling overshoots by a rounding error


def leaf_cells(coverage: np.ndarray, base: tuple[int, int], tip: tuple[int, int]) -> np.ndarray:
    """Leaf cells as one 4-connected region that holds the base and the tip.

    Cells at least half covered are leaf. Where a petiole, a tip or a lobe is too thin for that, the piece is
    joined to the largest one along the path of best coverage.

    Args:
        coverage: Share of each cell that is leaf, shape [ny, nx].
        base: Row and column of the petiole base.
        tip: Row and column of the farthest point.
    """
    import cv2

    mask = coverage >= 0.5
    ends = mask.copy()
    ends[base] = ends[tip] = True
    count, labels = cv2.connectedComponents(ends.astype(np.uint8), connectivity=4)
    sizes = np.bincount(labels[mask], minlength=count) if mask.any() else np.zeros(count, int)
    sizes[0] = 0
    main = int(np.argmax(sizes)) if sizes.any() else int(labels[base])
    joined = labels == main
    wanted = {int(labels[base]), int(labels[tip])} | set(np.nonzero(sizes >= PIECE_SHARE * sizes.sum())[0].tolist())
    for label in sorted(wanted - {main, 0}, key=lambda label: (-sizes[label], label)):
        piece = labels == label
        if (joined & piece).any():
            joined |= piece
            continue
        for cell in _path(coverage, piece, joined):
            joined[cell] = True
        joined |= piece
    return joined


def _path(coverage: np.ndarray, start: np.ndarray, goal: np.ndarray) -> list[tuple[int, int]]:
    """Cells of the cheapest 4-connected path from one region to another; bare cells cost a hundred covered ones."""
    rows, columns = coverage.shape
    cost = {(int(row), int(column)): 0.0 for row, column in zip(*np.nonzero(start), strict=True)}
    heap = [(0.0, cell) for cell in cost]
    heapq.heapify(heap)
    came: dict[tuple[int, int], tuple[int, int]] = {}
    while heap:
        so_far, cell = heapq.heappop(heap)
        if so_far > cost[cell]:
            continue
        if goal[cell]:
            path = [cell]
            while path[-1] in came:
                path.append(came[path[-1]])
            return path
        for step_row, step_column in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            following = (cell[0] + step_row, cell[1] + step_column)
            if not (0 <= following[0] < rows and 0 <= following[1] < columns):
                continue
            price = so_far + 1.0 / (0.01 + float(coverage[following]))
            if price < cost.get(following, np.inf):
                cost[following], came[following] = price, cell
                heapq.heappush(heap, (price, following))
    return []


def find_veins(photo: Photo, outline: Outline) -> list[Branch]:
    """The leaf's veins, their points in photo pixels (x, y)."""
    import cv2

    width, height = photo.size
    low = np.floor(outline.points.min(axis=0)).astype(int).clip(0)
    high = np.minimum(np.ceil(outline.points.max(axis=0)).astype(int), (width, height))
    crop = photo.colour[low[1] : high[1], low[0] : high[0]]
    sides = (high - low).astype(float)
    scale = min(VEIN_SIDE / np.sqrt(sides.prod()), VEIN_LONGEST / sides.max(), 3.0)
    size = tuple(np.maximum(8, np.rint(sides * scale)).astype(int).tolist())
    scales = np.divide(size, sides)
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    inside = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(inside, [np.rint((outline.points - low) * scales * 256 - 128).astype(np.int32)], 1, shift=8)
    likelihood = vein_likelihood(cv2.resize(crop, size, interpolation=way), inside > 0)
    branches = vein_tree(likelihood, inside > 0, (outline.base - low) * scales)
    return [Branch(branch.points / scales + low, branch.flow) for branch in branches]


def _draw(branches: list[Branch], outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Flow capacity of the cells: Q to the power 4/3 * 0.35, drawn antialiased and at least two cells wide.

    A vein narrower than two cells would conduct according to how it happens to lie between cell centres; it is drawn
    wider, and paler by as much, so that what it carries does not depend on the map's size.
    """
    import cv2

    across, down = _refinement(map_size, frame, least=3)
    fine = np.zeros((map_size[1] * down, map_size[0] * across), np.uint8)
    pixel = float(np.mean(np.divide(frame.size, (fine.shape[1], fine.shape[0]))))  # photo pixels, nearly isotropic
    cell = max(np.divide(frame.size, map_size))
    widest = min(0.6 * outline.petiole_width, 0.02 * outline.length)  # a midrib is narrower than the petiole
    narrowest = min(2.0 * cell, 0.06 * outline.length)
    segments = []
    for branch in branches:
        points, flow = branch.points, branch.flow
        keep = np.unique(np.append(np.arange(0, len(points), 3), len(points) - 1))
        corners = np.rint((frame.cells(points[keep], map_size) * (across, down) - 0.5) * 256).astype(int)
        feeds = flow[keep]
        segments += zip(np.minimum(feeds[:-1], feeds[1:]), corners[:-1], corners[1:], strict=True)
    for flow, start, end in sorted(segments, key=lambda segment: segment[0]):  # the larger vein on top
        width = widest * flow ** (1.0 / 3.0)
        thickness = max(1, round(max(width, narrowest) / pixel))
        paleness = min(1.0, width / (thickness * pixel))
        value = max(1, round(255.0 * flow**CONDUCTANCE_POWER * paleness))
        cv2.line(fine, start.tolist(), end.tolist(), value, thickness, cv2.LINE_AA, 8)
    return _cell_means(fine, map_size)


def _source(outline: Outline, frame: PixelFrame, map_size: tuple[int, int], mask: np.ndarray) -> np.ndarray:
    """Cells within half a petiole's width of the base, those at the rim in part; at least the base's own cell."""
    radius = float(np.clip(0.5 * outline.petiole_width, 0.005 * outline.length, 0.03 * outline.length))
    cell = np.divide(frame.size, map_size)
    x = frame.left + (np.arange(map_size[0]) + 0.5) * cell[0] - outline.base[0]
    y = frame.bottom - (np.arange(map_size[1]) + 0.5) * cell[1] - outline.base[1]
    distance = np.hypot(x[None], y[:, None])
    weights = np.where(mask, np.clip((radius - distance) / cell.max() + 0.5, 0.0, 1.0), 0.0)
    row, column = _cell(frame, outline.base, map_size)
    weights[row, column] = max(weights[row, column], 0.01)
    return weights


def _from_image(path: Path, photo: Photo, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Cell averages of a picture that covers the same frame as the photo, shape [ny, nx]."""
    grey = read_grey(path)
    ratio = np.divide(grey.shape[::-1], photo.size)
    x = np.linspace(frame.left, frame.right, map_size[0] + 1) * ratio[0]
    y = np.linspace(frame.top, frame.bottom, map_size[1] + 1) * ratio[1]
    return interval_means(interval_means(grey, y).T, x).T[::-1]


def interval_means(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Means over intervals, along axis 0, of the straight lines through samples at pixel centres.

    Exact for any ratio of interval to pixel, finer or coarser, so that a linear ramp is met at the interval's
    middle. Beyond the first and last sample the value stays.

    Args:
        values: Samples; sample k stands at k + 0.5, shape [count, ...].
        bounds: Rising interval bounds, shape [intervals + 1].
    """
    at = np.asarray(bounds) - 0.5
    last = len(values) - 1
    pairs = 0.5 * (values[1:] + values[:-1])
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(pairs, axis=0)])
    within = np.clip(at, 0.0, last)
    index = np.minimum(within.astype(int), max(last - 1, 0))
    part = (within - index)[:, None]
    ahead = values[np.minimum(index + 1, last)]
    integral = total[index] + values[index] * part + (ahead - values[index]) * (0.5 * part**2)
    integral += values[:1] * np.minimum(at, 0.0)[:, None] + values[-1:] * np.maximum(at - last, 0.0)[:, None]
    return np.diff(integral, axis=0) / np.diff(at)[:, None]
