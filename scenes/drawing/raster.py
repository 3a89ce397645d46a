"""Exact-area antialiased filling, cellular networks, smooth noise and colour encoding.

Filling is done here rather than with OpenCV's drawing functions, whose boundary pixels differ between
versions: a picture drawn again must be the same picture.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

SUB_SCANLINES = 8


def coverage(polygons: Sequence[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """Share of each pixel inside the union of the polygons (pixel coordinates), float32 [height, width].

    Each sub-scanline's crossings add their signed, horizontally exact area; a running sum along the row gives
    the winding. Polygons are turned the same way round, so overlaps add up and are clipped to one.
    """
    height, width = shape
    if not polygons:
        return np.zeros(shape, np.float32)
    starts, ends = [], []
    for polygon in polygons:
        following = np.roll(polygon, -1, axis=0)
        area = np.sum(polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1])
        first, second = (polygon, following) if area > 0 else (following, polygon)
        starts.append(first)
        ends.append(second)
    start, end = np.concatenate(starts), np.concatenate(ends)
    direction = np.where(end[:, 1] > start[:, 1], -1.0, 1.0)
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    first = np.clip(np.ceil(low * SUB_SCANLINES - 0.5), 0, height * SUB_SCANLINES).astype(int)
    last = np.clip(np.ceil(high * SUB_SCANLINES - 0.5), 0, height * SUB_SCANLINES).astype(int)
    count = last - first
    edge = np.repeat(np.arange(len(start)), count)
    line = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    y = (line + 0.5) / SUB_SCANLINES
    share = (y - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
    x = np.clip(start[edge, 0] + share * (end[edge, 0] - start[edge, 0]), 0, width)
    column = np.floor(x).astype(int)
    row = line // SUB_SCANLINES
    winding = np.zeros((height, width + 2))
    np.add.at(winding, (row, column), direction[edge] * (column + 1 - x))
    np.add.at(winding, (row, column + 1), direction[edge] * (x - column))
    total = np.cumsum(winding, axis=1)[:, :width] / SUB_SCANLINES
    return np.clip(np.abs(total), 0.0, 1.0).astype(np.float32)


def cell_network(u: np.ndarray, v: np.ndarray, size_u: float, size_v: float, rng: np.random.Generator) -> np.ndarray:
    """Distance from each point (u, v), shape [n], to the nearest border of a jittered Voronoi pattern.

    Cells measure about `size_u` by `size_v`; the answer is in the units of u and v.
    """
    jitter = 0.1 + 0.8 * rng.random((256, 256, 2), np.float32)
    cell_u, cell_v = np.floor(u / size_u).astype(int), np.floor(v / size_v).astype(int)
    place_u, place_v = np.float32(u / size_u - cell_u), np.float32(v / size_v - cell_v)
    index = ((cell_u % 256) * 256 + cell_v % 256).astype(np.int32)
    steps = [(step_u, step_v) for step_u in (-1, 0, 1) for step_v in (-1, 0, 1)]
    distances = np.empty((9, u.size), np.float32)
    for distance, (step_u, step_v) in zip(distances, steps, strict=True):
        seed = np.roll(jitter, (-step_u, -step_v), axis=(0, 1)).reshape(-1, 2)[index]
        distance[:] = (seed[:, 0] + step_u - place_u) ** 2 + (seed[:, 1] + step_v - place_v) ** 2
    column = np.arange(u.size)
    nearest = np.argmin(distances, axis=0)
    first = distances[nearest, column]
    distances[nearest, column] = np.inf
    second = np.argmin(distances, axis=0)
    offsets = np.array(steps)
    seeds = [
        jitter[(cell_u + offsets[which, 0]) % 256, (cell_v + offsets[which, 1]) % 256] + offsets[which]
        for which in (nearest, second)
    ]
    stretch = np.linalg.norm((seeds[1] - seeds[0]) / (size_u, size_v), axis=1)
    return 0.5 * (distances[second, column] - first) / np.maximum(stretch, 1e-9)


def noise(shape: tuple[int, int], feature: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth noise of mean about 0 and deviation about 1, with features about `feature` pixels wide."""
    rows, columns = int(shape[0] / feature) + 4, int(shape[1] / feature) + 4
    grid = rng.standard_normal((rows, columns)).astype(np.float32)
    size = (int(np.ceil(columns * feature)), int(np.ceil(rows * feature)))
    field = cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)
    margin = int(feature)
    return 1.35 * field[margin : margin + shape[0], margin : margin + shape[1]]


def blur(field: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian blur by `sigma` pixels, in float32."""
    return cv2.GaussianBlur(np.asarray(field, np.float32), (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)


def smoothstep(low: float, high: float, value: np.ndarray) -> np.ndarray:
    """0 below `low`, 1 above `high`, smooth between."""
    q = np.clip((value - low) / (high - low), 0.0, 1.0)
    return q * q * (3.0 - 2.0 * q)


def linear(colour: str) -> np.ndarray:
    """Linear-light RGB of an sRGB colour written "#rrggbb"."""
    encoded = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def encode(light: np.ndarray) -> np.ndarray:
    """8-bit sRGB of linear-light RGB in [0, 1]."""
    light = np.clip(light, 0.0, 1.0)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255.0 * encoded).astype(np.uint8)
