"""The water of a leaf as a flat picture: a colour ramp that is ordered in lightness and safe for colour-blind eyes."""

from __future__ import annotations

import cv2
import numpy as np

from leafwarp.leaf.leaf import Leaf

# (relative water content, sRGB): pale sand where dry, through green, to deep blue where saturated; ever darker.
_RAMP = (
    (0.00, (243, 226, 190)),
    (0.25, (204, 210, 158)),
    (0.50, (122, 184, 160)),
    (0.75, (47, 131, 158)),
    (1.00, (20, 60, 112)),
)
_FINE = 3  # supersampling of pictures that are drawn from triangles


def water_colors(water: np.ndarray) -> np.ndarray:
    """sRGB of relative water contents, float64 in [0, 255], shape [..., 3]."""
    contents, colors = zip(*_RAMP, strict=True)
    return np.stack([np.interp(water, contents, channel) for channel in zip(*colors, strict=True)], axis=-1)


def map_picture(water: np.ndarray, mask: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A water map as a picture.

    Args:
        water: Relative water content, row 0 at the bottom, shape [ny, nx].
        mask: Cells that are leaf, shape [ny, nx].
        size: Width and height of the picture [pixel].

    Returns:
        sRGB, top row first, shape [height, width, 3], and how much of each pixel is leaf, shape [height, width].
    """
    weight = mask[::-1].astype(np.float64)
    total = _resize(water[::-1].astype(np.float64) * weight, size)
    share = _resize(weight, size)
    content = total / np.maximum(share, 1e-9)
    # A map coarser than the picture has blurred edges; half a cell of leaf is where the margin lies.
    sharpness = max(size[0] / mask.shape[1], size[1] / mask.shape[0], 1.0)
    coverage = np.clip((share - 0.5) * sharpness + 0.5, 0.0, 1.0)
    return water_colors(content), coverage


def vertex_picture(leaf: Leaf, water: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The water at the vertices as a picture of the flat leaf, for scenes without a water map; as :func:`map_picture`.

    Args:
        leaf: The leaf.
        water: Relative water content, shape [vertex_count].
        size: Width and height of the picture [pixel].
    """
    width, height = size[0] * _FINE, size[1] * _FINE
    corners = np.round(leaf.uv[leaf.mesh.triangles] * (width, -height) + (0, height)).astype(np.int32)
    contents = np.asarray(water, np.float64)[leaf.mesh.triangles].mean(axis=1)
    picture = np.zeros((height, width), np.float32)
    coverage = np.zeros((height, width), np.float32)
    for triangle, content in zip(corners, contents, strict=True):
        cv2.fillConvexPoly(picture, triangle, float(content))
    cv2.fillPoly(coverage, list(corners), 1.0)
    share = _resize(coverage.astype(np.float64), size)
    content = _resize(picture.astype(np.float64), size) / np.maximum(share, 1e-9)
    return water_colors(content), share


def _resize(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    shrinks = size[0] <= values.shape[1] and size[1] <= values.shape[0]
    return cv2.resize(values, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
