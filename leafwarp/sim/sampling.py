"""Sampling tables: the cells of a map around points of the leaf, with weights normalised over leaf cells."""

from __future__ import annotations

import numpy as np

POINTS_AT_ONCE = 256  # bounds the memory for their distances to all cells of the margin


def sampling_stencils(
    uv: np.ndarray, mask: np.ndarray, frame_size: tuple[float, float] = (1.0, 1.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Cells and weights of the mask-normalised bilinear sample at each point.

    A point whose four cells all lie off the leaf takes the nearest leaf cell.

    Args:
        uv: Map coordinates, shape [point_count, 2]; cell centres lie at ((i + 1/2) / nx, (j + 1/2) / ny).
        mask: Leaf cells, shape [ny, nx].
        frame_size: Width and height of the map [m], for the distance to the nearest leaf cell.

    Returns:
        Flat cell indices, int32, and weights with sum 1, float64, both of shape [point_count, 4]. The first cell
        always lies on the leaf; a cell of weight 0 repeats the first.
    """
    height, width = mask.shape
    cells, weights = _bilinear(uv, width, height)
    weights *= mask.reshape(-1)[cells]
    order = np.argsort(-weights, axis=1, kind="stable")
    cells, weights = np.take_along_axis(cells, order, 1), np.take_along_axis(weights, order, 1)
    total = weights.sum(axis=1)
    off_leaf = np.flatnonzero(total == 0.0)
    if len(off_leaf):
        cells[off_leaf, 0] = _nearest_leaf_cells(uv[off_leaf], mask, frame_size)
        weights[off_leaf, 0] = total[off_leaf] = 1.0
    weights /= total[:, None]
    cells = np.where(weights > 0.0, cells, cells[:, :1])
    return cells.astype(np.int32), weights


def _bilinear(uv: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    column = np.clip(uv[:, 0] * width - 0.5, 0.0, width - 1.0)
    row = np.clip(uv[:, 1] * height - 0.5, 0.0, height - 1.0)
    left, low = np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)
    right, high = np.minimum(left + 1, width - 1), np.minimum(low + 1, height - 1)
    across, up = column - left, row - low
    cells = np.stack([low * width + left, low * width + right, high * width + left, high * width + right], axis=1)
    weights = np.stack([(1 - across) * (1 - up), across * (1 - up), (1 - across) * up, across * up], axis=1)
    return cells, weights


def _nearest_leaf_cells(uv: np.ndarray, mask: np.ndarray, frame_size: tuple[float, float]) -> np.ndarray:
    """Flat index of the leaf cell whose centre is nearest to each point off the leaf; one of the leaf's margin."""
    height, width = mask.shape
    around = np.pad(mask, 1)
    inner = around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]
    rows, columns = np.nonzero(mask & ~inner)
    x, y = (columns + 0.5) / width * frame_size[0], (rows + 0.5) / height * frame_size[1]
    nearest = np.empty(len(uv), np.int64)
    for first in range(0, len(uv), POINTS_AT_ONCE):
        part = slice(first, first + POINTS_AT_ONCE)
        points = uv[part] * frame_size
        nearest[part] = np.argmin((points[:, :1] - x) ** 2 + (points[:, 1:] - y) ** 2, axis=1)
    return rows[nearest] * width + columns[nearest]


def smooth_over_leaf(values: np.ndarray, mask: np.ndarray, radius: tuple[float, float]) -> np.ndarray:
    """Gaussian mean of a map over leaf cells only, so that a margin is not mixed with the background.

    Args:
        values: The map, shape [ny, nx].
        mask: Leaf cells, shape [ny, nx].
        radius: Standard deviation along columns' and rows' direction (x, y) [cell].
    """
    import cv2

    weight = mask.astype(np.float64)
    sigma_x, sigma_y = (max(r, 1e-3) for r in radius)
    total = cv2.GaussianBlur(values * weight, (0, 0), sigmaX=sigma_x, sigmaY=sigma_y, borderType=cv2.BORDER_CONSTANT)
    share = cv2.GaussianBlur(weight, (0, 0), sigmaX=sigma_x, sigmaY=sigma_y, borderType=cv2.BORDER_CONSTANT)
    return np.where(mask, total / np.maximum(share, 1e-12), 0.0)
