"""A polygon of the photo as a small raster: what looks for the petiole works at a bounded size, whatever the photo's.

Window pixels are square: one is ``1 / scale`` photo pixels wide, pixel (0, 0) covers [0, 1] x [0, 1] from ``origin``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PAD = 2  # [pixels] of the window around the polygon
LONGEST = 900  # [pixels] bound of a window's long side


@dataclass(frozen=True)
class Window:
    """Raster of a leaf's bounding box.

    Attributes:
        inside: The leaf's pixels, shape [height, width], bool.
        origin: Upper left corner in photo pixels, (x, y).
        scale: Window pixels per photo pixel.
        extent: Largest distance from the leaf's middle to its margin, doubled, in window pixels.
    """

    inside: np.ndarray
    origin: np.ndarray
    scale: float
    extent: float

    def from_photo(self, points: np.ndarray) -> np.ndarray:
        """Window coordinates of photo points, shape [..., 2]."""
        return (points - self.origin) * self.scale

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """Photo coordinates of window points, shape [..., 2]."""
        return np.asarray(points) / self.scale + self.origin

    def colours(self, picture: np.ndarray) -> np.ndarray:
        """The photo's colours in the window, replicated past its border, shape [height, width, 3], uint8.

        Args:
            picture: 8-bit RGB, shape [photo height, photo width, 3].
        """
        import cv2

        height, width = self.inside.shape
        pixel = 1.0 / self.scale
        low = np.floor(self.origin).astype(int).clip(0)
        high = np.ceil(self.origin + np.array((width, height)) * pixel).astype(int)
        crop = picture[low[1] : high[1], low[0] : high[0]]
        if pixel > 1.0:  # averaged to nearly the window's resolution first, so that nothing aliases
            size = tuple(np.maximum(1, np.rint(np.array(crop.shape[1::-1]) / pixel)).astype(int).tolist())
            ratio = np.divide(crop.shape[1::-1], size)
            crop = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
        else:
            ratio = np.ones(2)
        step = pixel / ratio
        shift = (self.origin - low) / ratio + 0.5 * step - 0.5
        matrix = np.array([[step[0], 0.0, shift[0]], [0.0, step[1], shift[1]]])
        flags = cv2.WARP_INVERSE_MAP | cv2.INTER_CUBIC
        return cv2.warpAffine(crop, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)


def window_around(polygon: np.ndarray, area: float) -> Window:
    """Window of a leaf at a resolution that does not depend on its attitude.

    Args:
        polygon: Closed polygon in photo pixels, shape [count, 2].
        area: Window pixels that the leaf is to cover; fewer where it is very long.
    """
    import cv2

    low, high = polygon.min(axis=0), polygon.max(axis=0)
    x, y = (polygon - low).T
    covered = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    scale = min(float(np.sqrt(area / max(covered, 1e-9))), LONGEST / max(float((high - low).max()), 1e-9))
    width, height = (np.ceil((high - low) * scale).astype(int) + 2 * PAD).tolist()
    origin = 0.5 * (low + high) - 0.5 * np.array((width, height)) / scale
    inside = np.zeros((height, width), np.uint8)
    corners = np.rint(((polygon - origin) * scale - 0.5) * 256).astype(np.int32)
    cv2.fillPoly(inside, [corners], 1, lineType=cv2.LINE_8, shift=8)
    away = np.linalg.norm(polygon - polygon.mean(axis=0), axis=1)
    return Window(inside > 0, origin, scale, 2.0 * scale * float(away.max()))


@dataclass(frozen=True)
class PixelGraph:
    """The pixels of a shape, joined to their eight neighbours.

    Attributes:
        points: Pixel centres (x, y), shape [count, 2].
        number: Index of each pixel, -1 off the shape, shape [height, width], int32.
        lengths: Cost of each join, a sparse matrix of shape [count, count]; each join stands once.
    """

    points: np.ndarray
    number: np.ndarray
    lengths: object

    def costs(self, sources: np.ndarray, limit: float = np.inf) -> np.ndarray:
        """Least cost from each source to every pixel (infinite past the limit), shape [sources, count]."""
        from scipy.sparse.csgraph import dijkstra

        return dijkstra(self.lengths, directed=False, indices=sources, limit=limit)

    def cost_from_any(self, sources: np.ndarray) -> np.ndarray:
        """Least cost to every pixel from the cheapest of the sources, shape [count]."""
        from scipy.sparse.csgraph import dijkstra

        return dijkstra(self.lengths, directed=False, indices=sources, min_only=True)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Indices of the pixels nearest to points, shape [count]."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points).query(points)[1]


def pixel_graph(inside: np.ndarray, price: np.ndarray | None = None) -> PixelGraph:
    """Graph of a shape.

    Args:
        inside: The shape, bool, shape [height, width].
        price: Cost of a pixel's length at each pixel of that raster; 1 where absent.
    """
    from scipy.sparse import csr_matrix

    rows, columns = np.nonzero(inside)
    count = len(rows)
    number = np.full(np.add(inside.shape, 2), -1, np.int32)
    number[rows + 1, columns + 1] = np.arange(count)
    each = np.ones(count) if price is None else price[rows, columns].astype(float)
    starts, ends, lengths = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        neighbour = number[rows + 1 + down, columns + 1 + right]
        here = np.nonzero(neighbour >= 0)[0]
        there = neighbour[here]
        starts.append(here)
        ends.append(there)
        lengths.append(0.5 * np.hypot(down, right) * (each[here] + each[there]))
    matrix = csr_matrix((np.concatenate(lengths), (np.concatenate(starts), np.concatenate(ends))), (count, count))
    return PixelGraph(np.column_stack([columns + 0.5, rows + 0.5]), number[1:-1, 1:-1], matrix)
