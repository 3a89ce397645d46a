"""Cells of a map: how much of each the leaf covers, and which make up the leaf as one connected region."""

from __future__ import annotations

import heapq

import numpy as np

from leafwarp.leaf.maps.pixel_frame import PixelFrame
from leafwarp.leaf.shape.outline import Outline

RASTER_SIDE = 4096  # [pixels] bound of the fine raster that coverage is drawn on
LEAST_RASTER = 1024  # [pixels] least side of it, however few the cells
ALIKE = 2e-3  # parts of a cell that differ by less hold the same: what a picture of 8 or 16 bits rounds to
PIECE_SHARE = 0.01  # a loose piece with this share of the leaf's cells is joined to it, a smaller one dropped


def _refinement(map_size: tuple[int, int], frame: PixelFrame, least: int) -> tuple[int, int]:
    """Fine raster pixels a cell across and down: nearly square, at least so many where the raster's bound allows."""
    cell = np.divide(frame.size, map_size)
    wanted = np.maximum(least, np.rint(least * cell / cell.min()))
    wanted = np.maximum(wanted, np.ceil(LEAST_RASTER / np.array(map_size)))
    allowed = np.maximum(1, RASTER_SIDE // np.array(map_size))
    across, down = np.minimum(wanted, allowed).astype(int).tolist()
    return across, down


def leaf_coverage(outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Share of each cell that is leaf, its true holes left out, shape [ny, nx]."""
    return _cell_means(_fine_leaf(outline, frame, map_size), map_size)


def _fine_leaf(outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """The leaf on a raster of several pixels a cell, 0 to 255, top row first."""
    import cv2

    across, down = _refinement(map_size, frame, least=4)
    fine = np.zeros((map_size[1] * down, map_size[0] * across), np.uint8)
    rings = [frame.cells(ring, map_size) * (across, down) for ring in (outline.points, *outline.holes)]
    corners = [np.rint(ring * 256 - 128).astype(np.int32) for ring in rings]
    cv2.fillPoly(fine, corners, 255, shift=8)
    cv2.polylines(fine, corners, True, 128, 1, cv2.LINE_8, 8)  # the fill takes in pixels that the outline halves
    return fine


def half_widths(
    points: np.ndarray, outline: Outline, frame: PixelFrame, map_size: tuple[int, int], reach: float
) -> np.ndarray:
    """Half the leaf's width around photo points, in photo pixels, shape [count].

    It is the largest distance from the margin within a reach [photo pixels] of the point.
    """
    import cv2
    from scipy.ndimage import maximum_filter

    fine = _fine_leaf(outline, frame, map_size)
    scale = np.divide((fine.shape[1], fine.shape[0]), frame.size)
    depth = cv2.distanceTransform(np.pad(fine, 1), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1] / scale.mean()
    across, down = 2 * np.ceil(reach * scale).astype(int) + 1
    # Takes the same time whatever the window, which is as wide as the raster on a map of few rows; cv2.dilate does not.
    deepest = maximum_filter(depth, size=(down, across), mode="constant")
    at = np.floor((points - (frame.left, frame.top)) * scale).astype(int)
    column, row = np.clip(at, 0, np.array(fine.shape[::-1]) - 1).T
    return deepest[row, column]


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


def block_means(fine: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Means of a map's cells over whole blocks of them, shape ``shape``."""
    rows, columns = shape
    return fine.reshape(rows, len(fine) // rows, columns, fine.shape[1] // columns).mean((1, 3))


def is_finer(fine: np.ndarray, shape: tuple[int, int]) -> bool:
    """Whether parts of a map's cells hold more than their means: not so of a picture that shows the cells alone."""
    parts = len(fine) // shape[0]
    means = np.kron(block_means(fine, shape), np.ones((parts, parts)))
    return bool(np.abs(fine - means).max() > ALIKE)
