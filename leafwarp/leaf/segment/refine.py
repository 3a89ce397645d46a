"""The margin of a leaf, below a pixel."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.segment.background import WEIGHT
from leafwarp.leaf.segment.depth import depth_of
from leafwarp.leaf.segment.pieces import filled, largest_piece

BAND = 3  # [pixels] on either side of a guess's contour within which the margin is looked for
REACH = 7.0  # [pixels] over which the colours on either side of the margin are gathered
LEAST_STEP = 8.0  # [Lab units] between both sides, below which the guess's contour stands
LOST = 0.003  # of a leaf


def margin(lab: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The leaf as a field, zero half way between the colours on either side of its margin.

    Near the contour each pixel's colour is placed on the line from the mean colour outside to the mean colour
    inside, both taken nearby (closed-form matting with known sides): this finds the margin below a pixel and moves a
    contour that a global threshold left a little off.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        inside: A guess, right to a few pixels.

    Returns:
        Positive on the leaf, in [-1, 1], float32.
    """
    import cv2

    rows, columns = np.nonzero(inside)
    pad = 4 * BAND + int(2 * REACH)
    box = np.s_[max(rows.min() - pad, 0) : rows.max() + pad + 1, max(columns.min() - pad, 0) : columns.max() + pad + 1]
    field = np.full(inside.shape, -1.0, np.float32)
    shape, colour = inside[box], lab[box] * WEIGHT
    depth = depth_of(shape) - depth_of(~shape)
    core = (np.abs(depth) > BAND).astype(np.float32)
    sides = []
    for side in (shape, ~shape):
        weight = core * side
        total = cv2.GaussianBlur(weight, (0, 0), REACH)
        sides.append((cv2.GaussianBlur(colour * weight[..., None], (0, 0), REACH) / (total[..., None] + 1e-6), total))
    (leaf, leaf_weight), (ground, ground_weight) = sides
    line = leaf - ground
    step = np.sqrt((line**2).sum(axis=2))
    share = ((colour - ground) * line).sum(axis=2) / np.maximum(step**2, 1e-3)
    known = (leaf_weight > 0.02) & (ground_weight > 0.02) & (step > LEAST_STEP) & (np.abs(depth) <= BAND)
    plain = np.clip((depth - np.sign(depth) * 0.5) / 1.5, -1.0, 1.0)
    field[box] = np.where(known, np.clip(2.0 * share - 1.0, -1.0, 1.0), plain)
    return field


def _bridged(field: np.ndarray, leaf: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """A field with its largest lost piece joined to the rest by the shortest way through the leaf."""
    lost = largest_piece((field > 0.0) & leaf & ~inside)
    if np.count_nonzero(lost) <= LOST * np.count_nonzero(inside):
        return field
    way = np.where(leaf, depth_of(~lost) + depth_of(~inside), np.inf)
    return np.where(way <= way.min() + 1.0, np.maximum(field, 0.1), field)


def cleaned(field: np.ndarray, leaf: np.ndarray) -> np.ndarray:
    """A field whose positive part is one piece without holes: that of the leaf.

    Where a thin link that the leaf had (a petiole's foot in shadow) is lost in the field, it is put back.
    """
    import cv2

    inside = largest_piece(field > 0.0, seed=leaf)
    if np.count_nonzero((field > 0.0) & leaf & ~inside) > LOST * np.count_nonzero(inside):
        depth = depth_of(leaf)
        ridge = leaf & (depth >= cv2.dilate(depth, np.ones((3, 3), np.uint8)) - 0.5) & (depth <= BAND)
        ridge = leaf & (cv2.dilate(ridge.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0)  # joined by sides
        field = np.where(ridge, np.maximum(field, 0.1), field)
        field = _bridged(field, leaf, largest_piece(field > 0.0, seed=leaf))
        inside = largest_piece(field > 0.0, seed=leaf)
    inside = filled(inside)
    # The sign follows the cleaned shape, the magnitude keeps the sub-pixel position of the margin.
    return np.where(inside, np.maximum(field, 0.05), np.minimum(field, -0.05)).astype(np.float32)
