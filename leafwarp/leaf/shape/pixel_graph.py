"""The pixels of a shape as a graph, for shortest ways within it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
