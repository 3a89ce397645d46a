"""Where the veins point: the direction of the venation map, and how sure it is, by the structure tensor.

With ``v`` the venation and ``< >`` a Gaussian mean over leaf cells, the structure tensor ``J = <grad v grad v^T>``
(Bigun and Granlund 1987) has its larger eigenvalue ``l1`` across the veins. As a direction has no sign, it is kept with
its angle ``theta`` doubled, which a mean cannot cancel, and as long as it is sure (coherence)::

    q = (l1 - l2) / (l1 + l2) (cos 2 theta, sin 2 theta) = (Jyy - Jxx, -2 Jxy) / (Jxx + Jyy).
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.sim.sampling import sampling_stencils, smooth_over_leaf

# Width of the mean, in lengths of the leaf: between the distance of the finest veins that a map shows and that of the
# secondary veins. Never less than two cells.
WIDTH = 0.02
# Venation that changes by less than this over the width has no direction.
FAINT = 0.01


def vein_directions(leaf: Leaf) -> np.ndarray:
    """Doubled direction ``q`` of the veins in every map cell, shape [ny, nx, 2]: length 1 where it is sure, 0 where
    there is none.

    Args:
        leaf: A leaf with the map ``venation``.
    """
    height, width = leaf.mask.shape
    cell = np.array(leaf.frame.size) / (width, height)
    sigma = np.maximum(WIDTH * leaf.length / cell, 2.0)
    # A derivative of neighbouring cells alone would favour the map's own directions.
    smooth = smooth_over_leaf(leaf.maps["venation"], leaf.mask, (1.0, 1.0))
    along_y, along_x = (_slope(smooth, axis, size) for axis, size in enumerate((cell[1], cell[0])))
    inner = _inner_cells(leaf.mask)
    products = (along_x * along_x, along_y * along_y, along_x * along_y)
    xx, yy, xy = (smooth_over_leaf(values * inner, leaf.mask, tuple(sigma)) for values in products)
    faint = (FAINT / (WIDTH * leaf.length)) ** 2
    return np.stack([yy - xx, -2.0 * xy], axis=-1) / (xx + yy + faint)[..., None]


def _slope(values: np.ndarray, axis: int, cell: float) -> np.ndarray:
    """Derivative along an axis by central differences; across a single cell there is none."""
    return np.gradient(values, cell, axis=axis) if values.shape[axis] > 1 else np.zeros_like(values)


def _inner_cells(mask: np.ndarray) -> np.ndarray:
    """Cells whose neighbours are leaf, two cells each way: the margin is no step of the venation."""
    import cv2

    square = np.ones((3, 3), np.uint8)
    inner = cv2.erode(mask.astype(np.uint8), square, iterations=2, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return inner.astype(bool)


def edge_alignment(leaf: Leaf) -> np.ndarray:
    """How each edge lies to the veins, shape [edge_count]: 1 along them, -1 across them, 0 at 45 degrees or where no
    direction is sure.

    Of an edge at the angle ``phi`` to veins whose direction is sure this is ``cos 2 phi``.
    """
    mesh = leaf.mesh
    cells, weights = sampling_stencils(leaf.uv[mesh.edges].mean(axis=1), leaf.mask, leaf.frame.size)
    direction = np.einsum("ij,ijk->ik", weights, vein_directions(leaf).reshape(-1, 2)[cells])
    along = mesh.positions[mesh.edges[:, 1]] - mesh.positions[mesh.edges[:, 0]]
    x, y = along.T
    doubled = np.stack([x * x - y * y, 2.0 * x * y], axis=1) / (x * x + y * y)[:, None]
    return np.einsum("ij,ij->i", direction, doubled)
