"""The water of the flat leaf as a picture."""

from __future__ import annotations

import cv2
import numpy as np

from leafwarp.leaf.leaf import Leaf

# CIELAB at evenly spaced contents, from dry to saturated: dry straw, sage, teal, deep blue. Lightness only falls, and
# the hues run from yellow to blue, which red-green colour-blind eyes tell apart.
RAMP_LAB = ((82.0, 8.0, 42.0), (72.0, -9.0, 24.0), (57.0, -22.0, -3.0), (41.0, -10.0, -29.0), (23.0, 6.0, -40.0))
_FINE = 4  # supersampling of the silhouette
_WIDEST_BLUR = 12.0  # [pixel]; a wider one takes long, and a mesh that needs it is no leaf
_FIXED_POINT = 6  # fractional bits of OpenCV's drawing coordinates
_MARGIN_INK = np.array([70.0, 66.0, 58.0])
_MARGIN_STRENGTH = 0.5


def water_colors(water: np.ndarray, lowest: float = 0.0) -> np.ndarray:
    """8-bit sRGB of relative water contents; the ramp runs from ``lowest`` to 1.

    Args:
        water: Relative water contents, any shape.
        lowest: Content at the ramp's dry end, below 1.

    Returns:
        Colours, shape [..., 3], uint8.
    """
    place = np.clip((np.asarray(water, np.float64) - lowest) / (1.0 - lowest), 0.0, 1.0)
    return _TABLE[np.rint(place * (len(_TABLE) - 1)).astype(np.int32)]


def _table() -> np.ndarray:
    knots = np.linspace(0.0, 1.0, len(RAMP_LAB))
    fine = np.linspace(0.0, 1.0, 1024)
    lab = np.stack([np.interp(fine, knots, channel) for channel in zip(*RAMP_LAB, strict=True)], axis=1)
    rgb = cv2.cvtColor(lab.astype(np.float32)[None], cv2.COLOR_Lab2RGB)[0]
    return np.rint(255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)


_TABLE = _table()


class WaterPicture:
    """Draws water in the leaf's own outline, which is finer than the cells of a map.

    Args:
        leaf: The leaf.
        size: Width and height of the picture of the map frame [pixel].
        paper: sRGB of the ground.
    """

    def __init__(self, leaf: Leaf, size: tuple[int, int], paper: tuple[int, int, int]):
        self._leaf = leaf
        self._size = size
        self._paper = np.array(paper, np.float64)
        fine = (size[0] * _FINE, size[1] * _FINE)
        self._corners = _to_pixels(leaf.uv, fine)[leaf.mesh.triangles]
        covered = np.zeros((fine[1], fine[0]), np.uint8)
        for triangle in self._corners:
            cv2.fillConvexPoly(covered, triangle, 255, shift=_FIXED_POINT)
        line = np.zeros_like(covered)
        ends = _to_pixels(leaf.uv, fine)[_boundary(leaf.mesh.triangles)]
        cv2.polylines(line, list(ends), False, 255, round(1.25 * _FINE), cv2.LINE_AA, _FIXED_POINT)
        self._covered = covered
        self._coverage = cv2.resize(covered, size, interpolation=cv2.INTER_AREA) / 255.0
        self._line = _MARGIN_STRENGTH * cv2.resize(line, size, interpolation=cv2.INTER_AREA) / 255.0

    def from_map(self, water: np.ndarray, lowest: float = 0.0) -> np.ndarray:
        """Picture of a water map.

        Args:
            water: Relative water content, row 0 at the bottom, shape [ny, nx].
            lowest: Content at the dry end of the colours.

        Returns:
            8-bit sRGB, top row first, shape [height, width, 3].
        """
        water = np.asarray(water, np.float32)
        mask = self._leaf.mask
        if mask is not None and mask.any():
            water = _extended(water, mask)
        return self._paint(_resized(np.ascontiguousarray(water[::-1]), self._size), lowest)

    def from_vertices(self, water: np.ndarray, lowest: float = 0.0) -> np.ndarray:
        """Picture of water that is known at the vertices, shape [vertex_count]; as :meth:`from_map`."""
        contents = np.asarray(water, np.float64)[self._leaf.mesh.triangles].mean(axis=1)
        picture = np.zeros(self._covered.shape, np.float32)
        for triangle, content in zip(self._corners, contents, strict=True):
            cv2.fillConvexPoly(picture, triangle, float(content), shift=_FIXED_POINT)
        share = _resized((self._covered > 0).astype(np.float32), self._size)
        content = _resized(picture, self._size)
        # Smoothed over about a triangle, or its facets would show; normalised, or the margin would look dry.
        facet = float(np.sqrt(share.sum() / len(contents)))
        blur = float(np.clip(0.5 * facet, 0.5, _WIDEST_BLUR))
        weight = cv2.GaussianBlur(share, (0, 0), blur)
        return self._paint(cv2.GaussianBlur(content, (0, 0), blur) / np.maximum(weight, 1e-6), lowest)

    def _paint(self, content: np.ndarray, lowest: float) -> np.ndarray:
        coverage, line = self._coverage[..., None], self._line[..., None]
        picture = coverage * water_colors(content, lowest) + (1.0 - coverage) * self._paper
        return np.rint((1.0 - line) * picture + line * _MARGIN_INK).astype(np.uint8)


def _to_pixels(uv: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Fixed-point drawing coordinates of map coordinates; OpenCV's pixel centres are whole numbers."""
    pixels = np.stack([uv[:, 0] * size[0], (1.0 - uv[:, 1]) * size[1]], axis=1) - 0.5
    return np.rint(pixels * 2**_FIXED_POINT).astype(np.int32)


def _boundary(triangles: np.ndarray) -> np.ndarray:
    """Edges of one triangle only, shape [count, 2]."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    return edges[uses == 1]


def _extended(water: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A map whose cells outside the leaf have the content of the nearest leaf cell."""
    outside = np.where(mask, 0, 255).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(outside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    content = np.zeros(int(labels.max()) + 1, np.float32)
    content[labels[mask]] = water[mask]
    return np.where(mask, water, content[labels])


def _resized(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Area mean where the picture is coarser, bilinear where it is finer; both align cell centres."""
    shape = (min(size[0], values.shape[1]), min(size[1], values.shape[0]))
    values = cv2.resize(values, shape, interpolation=cv2.INTER_AREA)
    return cv2.resize(values, size, interpolation=cv2.INTER_LINEAR)
