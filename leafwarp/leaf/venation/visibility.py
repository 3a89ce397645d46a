"""What a picture shows of its leaf's veins: how much a found tree stands out, and whether they are stripes.

A tree is found in any picture, for paths follow whatever noise is bright. Along a real vein the picture is brighter
than on both sides over long stretches; along a path through noise only here and there.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.venation.branch import Branch
from leafwarp.leaf.venation.shape import STALK_DEPTH, LeafShape

LEAST_CONTRAST = 2.3  # paths through drawn noise reach 2.1, the veins of clear photos 3.9 to 14
BESIDE = 0.012  # distance from a vein of the lamina beside it, as a share of the long side
MAIN_FLOW = 0.015  # share of the leaf that a main vein drains at least
RUN = 21  # [pixels] stretch that the picture is averaged along

STRIPE_SCALES = (1.5, 5.0)  # [pixels] finest and coarsest width of stripes
LEAST_STRIPES = 0.8  # [Lab units] standard deviation of stripes; bands of a compressed shade have less
LEAST_COHERENCE = 0.4  # of the stripes' directions; a corn leaf has 0.5, pinnate leaves 0.06 to 0.24
LEAST_ALONG = 0.9  # cosine between the stripes and the leaf's axis


def shows_stripes(channel: np.ndarray, shape: LeafShape) -> bool:
    """Whether the lamina is striped along the leaf, as that of grasses; arguments as for :func:`vein_contrast`.

    The direction of the gradient, doubled so that both sides of a stripe agree, is averaged over the lamina.
    """
    import cv2

    fine, coarse = (cv2.GaussianBlur(channel, (0, 0), sigma) for sigma in STRIPE_SCALES)
    band = fine - coarse
    lamina = shape.depth > 2.0 * STALK_DEPTH * max(shape.inside.shape)
    if np.count_nonzero(lamina) < 100 or band[lamina].std() < LEAST_STRIPES:
        return False
    gradient = cv2.Sobel(band, cv2.CV_32F, 1, 0)[lamina] + 1j * cv2.Sobel(band, cv2.CV_32F, 0, 1)[lamina]
    size = np.abs(gradient)
    mean = (gradient**2 / np.maximum(size, 1e-6)).sum() / size.sum()
    across = 0.5 * np.angle(mean)
    axis = (shape.tip - shape.base) / max(float(np.linalg.norm(shape.tip - shape.base)), 1e-6)
    along = abs(axis[1] * np.cos(across) - axis[0] * np.sin(across))
    return bool(abs(mean) > LEAST_COHERENCE and along > LEAST_ALONG)


def vein_contrast(channel: np.ndarray, shape: LeafShape, branches: list[Branch]) -> float:
    """Median over the main veins of how much they are brighter than beside, over the same in the lamina at random.

    Args:
        channel: Quantity in which veins are bright, shape [height, width].
        shape: The leaf on the same raster.
        branches: The tree found there.
    """
    points, normals = [], []
    for branch in branches:
        main = branch.flow >= MAIN_FLOW
        if np.count_nonzero(main) < RUN:
            continue
        points.append(branch.points[main])
        tangent = np.gradient(branch.points, axis=0)[main]
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
        normals.append(np.column_stack([-tangent[:, 1], tangent[:, 0]]))
    if not points:
        return 0.0
    contrast = [_brighter(channel, shape, place, normal) for place, normal in zip(points, normals, strict=True)]
    found = np.concatenate([_running_mean(values) for values in contrast])
    found = found[np.isfinite(found)]
    random = np.random.default_rng(0)
    rows, columns = np.nonzero(shape.depth > STALK_DEPTH * max(shape.inside.shape))
    if not len(rows):
        return 0.0
    shifted = []
    for place, normal in zip(points, normals, strict=True):  # the same lines laid elsewhere
        for _ in range(6):
            turn = random.uniform(0.0, 2.0 * np.pi)
            rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            at = random.integers(len(rows))
            moved = (place - place[len(place) // 2]) @ rotate.T + (columns[at], rows[at])
            shifted.append(_running_mean(_brighter(channel, shape, moved, normal @ rotate.T)))
    lamina = np.concatenate(shifted)
    lamina = lamina[np.isfinite(lamina)]
    if len(found) < RUN or len(lamina) < RUN:
        return 0.0
    spread = 0.741 * float(np.subtract(*np.quantile(lamina, [0.75, 0.25])))
    return float(np.median(found) - np.median(lamina)) / max(spread, 0.1)


def _brighter(channel: np.ndarray, shape: LeafShape, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """How much each point is brighter than the brighter of its two sides; NaN outside the lamina."""
    reach = max(2.5, BESIDE * max(shape.inside.shape))
    here, left, right = (_sample(channel, shape, points + side * reach * normals) for side in (0.0, -1.0, 1.0))
    return here - 0.5 * (left + right)


def _sample(channel: np.ndarray, shape: LeafShape, points: np.ndarray) -> np.ndarray:
    height, width = channel.shape
    column, row = np.floor(points).astype(int).T
    within = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    row, column = row.clip(0, height - 1), column.clip(0, width - 1)
    lamina = within & (shape.depth[row, column] > 0.5 * STALK_DEPTH * max(shape.inside.shape))
    return np.where(lamina, channel[row, column], np.nan)


def _running_mean(values: np.ndarray) -> np.ndarray:
    return np.convolve(values, np.full(RUN, 1.0 / RUN), "valid") if len(values) >= RUN else np.zeros(0)
