"""What the veins of a leaf carry, drawn on the cells of its map, and the cells that thin stalks need for it."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.maps.cells import half_widths
from leafwarp.leaf.maps.pixel_frame import PixelFrame
from leafwarp.leaf.shape.outline import Outline
from leafwarp.leaf.venation.branch import Branch
from leafwarp.leaf.venation.drainage import vein_tree
from leafwarp.leaf.venation.drawing import draw_lines, shown_widths

LARGEST_DRAWN = 2048  # [cells] side of the map that veins are drawn on; a finer one is interpolated
CONDUCTANCE_POWER = 4.0 / 3.0 * 0.35  # Q^(4/3) spans decades; this share of the exponent reads well as a map
MIDRIB_OF_PETIOLE, MIDRIB_OF_LENGTH = 0.6, 0.02  # bounds of the midrib's width
WIDENED = 0.06  # share of the leaf's length that a vein is widened to at most, to span two cells
STALK_SIDE = 384  # [pixels] long side of the raster that stalks are looked for on
STALK_FLOW = 0.02  # share of the leaf that a stalk drains at least
STALK_SHARE = 0.15  # least share of a cell that the vein in a stalk covers


def draw_capacity(branches: list[Branch], outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Flow capacity of the cells in [0, 1], bottom row first, shape [ny, nx]; 0 on the lamina.

    It is Q to the power 4/3 * 0.35, on the width that a vein has by Murray's law.

    Args:
        branches: The veins in photo pixels.
        outline: The leaf.
        frame: The rectangle that the map covers.
        map_size: Cells across and up (nx, ny).
    """
    size, cell = _drawn_size(frame, map_size)
    starts, ends, flow = _segments(branches, frame)
    values = flow**CONDUCTANCE_POWER
    drawn = draw_lines(starts, ends, _widths(flow, outline), values, cell, size, WIDENED * outline.length)
    return _refined(drawn, map_size)[::-1]


def stalk_cells(outline: Outline, frame: PixelFrame, map_size: tuple[int, int]) -> np.ndarray:
    """Cells that a vein is drawn on in stalks thinner than it is drawn, bottom row first, shape [ny, nx], bool.

    A vein narrower than two cells is drawn wider. Cut off at the margin of a thin stalk it would conduct up to half
    less along a diagonal, around the corners of the cells: all cells that it is drawn on have to be leaf. Arguments as
    for :func:`draw_capacity`; the stalks are those of the outline, whatever veins are drawn.
    """
    size, cell = _drawn_size(frame, map_size)
    bound = WIDENED * outline.length
    reach = min(2.0 * float(cell.max()), bound)
    starts, ends, flow = _segments(_stalks(outline, reach), frame)
    main = flow >= STALK_FLOW
    starts, ends = starts[main], ends[main]
    widths = shown_widths(starts, ends, _widths(flow[main], outline), cell, bound)
    half = half_widths(0.5 * (starts + ends) + (frame.left, frame.top), outline, frame, size, reach)
    thin = half < 0.5 * (widths + cell.sum())
    drawn = draw_lines(starts[thin], ends[thin], widths[thin], np.ones(np.count_nonzero(thin)), cell, size, bound)
    return (_refined(drawn, map_size) > STALK_SHARE)[::-1]


def _drawn_size(frame: PixelFrame, map_size: tuple[int, int]) -> tuple[tuple[int, int], np.ndarray]:
    """Cells that are drawn on, across and down, and their width and height in photo pixels."""
    size = tuple(np.minimum(map_size, LARGEST_DRAWN).tolist())
    return size, np.divide(frame.size, size)


def _widths(flow: np.ndarray, outline: Outline) -> np.ndarray:
    """Widths of veins in photo pixels, by Murray's law from the midrib's."""
    return min(MIDRIB_OF_PETIOLE * outline.petiole_width, MIDRIB_OF_LENGTH * outline.length) * flow ** (1.0 / 3.0)


def _stalks(outline: Outline, reach: float) -> list[Branch]:
    """Drainage tree along the middle of parts no wider than some photo pixels, and anyhow elsewhere."""
    import cv2

    low = outline.points.min(axis=0)
    scale = STALK_SIDE / float(np.ptp(outline.points, axis=0).max())
    size = np.ceil(np.ptp(outline.points, axis=0) * scale).astype(int) + 3
    inside = np.zeros(size[::-1], np.uint8)
    rings = [(ring - low) * scale + 1.0 for ring in (outline.points, *outline.holes)]
    cv2.fillPoly(inside, [np.rint(ring * 256 - 128).astype(np.int32) for ring in rings], 1, shift=8)
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    window = 2 * int(np.ceil(reach * scale)) + 1
    deepest = cv2.dilate(depth, np.ones((window, window), np.uint8))
    middle = (depth / np.maximum(deepest, 1.0)) ** 2
    tree = vein_tree(middle, inside > 0, (outline.base - low) * scale + 1.0)
    return [Branch((branch.points - 1.0) / scale + low, branch.flow) for branch in tree]


def _segments(branches: list[Branch], frame: PixelFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Straight pieces of the veins from the frame's top left corner, and the flow through the weaker end of each."""
    starts, ends, flow = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0)]
    for branch in branches:
        keep = np.unique(np.append(np.arange(0, len(branch.points), 3), len(branch.points) - 1))
        points, feeds = branch.points[keep] - (frame.left, frame.top), branch.flow[keep]
        starts.append(points[:-1])
        ends.append(points[1:])
        flow.append(np.minimum(feeds[:-1], feeds[1:]))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(flow)


def _refined(drawn: np.ndarray, map_size: tuple[int, int]) -> np.ndarray:
    """A drawing interpolated to a map that is finer than drawings are made."""
    import cv2

    if drawn.shape == map_size[::-1]:
        return drawn
    return np.clip(cv2.resize(drawn, map_size, interpolation=cv2.INTER_LINEAR), 0.0, 1.0)
