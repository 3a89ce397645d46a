"""Where the blocks of the Hessian lie, and what each is the sum of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp_kernels.hinge_hessian import BLOCK_PAIRS


@dataclass(frozen=True)
class BlockPattern:
    """The 3 x 3 blocks of the Hessian's diagonal and upper triangle, one for each pair of vertices that share a spring.

    Attributes:
        rows: Row of each block, shape [block_count], int32; the diagonal comes first, in the order of the vertices.
        columns: Column of each, not below the row.
        edge_start: Where each block's edges start, shape [block_count + 1].
        edges: The edges of all blocks.
        hinge_start: Where each block's hinge blocks start, shape [block_count + 1].
        hinge_slots: ``2 k`` for block ``k`` of the hinges, ``2 k + 1`` for its transpose.
    """

    rows: np.ndarray
    columns: np.ndarray
    edge_start: np.ndarray
    edges: np.ndarray
    hinge_start: np.ndarray
    hinge_slots: np.ndarray

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.rows)


def block_pattern(vertex_count: int, edges: np.ndarray, hinges: np.ndarray) -> BlockPattern:
    """The pattern of a mesh.

    Args:
        vertex_count: Number of vertices.
        edges: Vertices of each edge, shape [edge_count, 2].
        hinges: Vertices of each hinge, shape [hinge_count, 4]; none for a mesh without bending.
    """
    hinges = hinges.reshape(-1, 4)
    first, second = (hinges[:, [pair[side] for pair in BLOCK_PAIRS]].ravel() for side in (0, 1))
    low, high = np.minimum(first, second), np.maximum(first, second)
    diagonal = np.arange(vertex_count)
    ends = np.sort(edges, axis=1)
    # A key that sorts the diagonal first.
    own = np.concatenate([diagonal, ends[:, 0], low])
    other = np.concatenate([diagonal, ends[:, 1], high])
    keys = np.where(own == other, own, vertex_count * (own + 1) + other).astype(np.int64)
    unique, place = np.unique(keys, return_inverse=True)
    between, of_hinge = place[vertex_count : vertex_count + len(ends)], place[vertex_count + len(ends) :]
    rows = np.where(unique < vertex_count, unique, unique // vertex_count - 1)
    columns = np.where(unique < vertex_count, unique, unique % vertex_count)
    edge_index = np.arange(len(ends))
    edge_start, edge_slots = _grouped(
        np.concatenate([between, ends[:, 0], ends[:, 1]]), np.tile(edge_index, 3), len(unique)
    )
    slots = 2 * np.arange(len(of_hinge)) + (first > second)
    hinge_start, hinge_slots = _grouped(of_hinge, slots, len(unique))
    return BlockPattern(
        rows.astype(np.int32), columns.astype(np.int32), edge_start, edge_slots, hinge_start, hinge_slots
    )


def _grouped(groups: np.ndarray, values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Values sorted by group, and where each group starts; both int32."""
    order = np.argsort(groups, kind="stable")
    start = np.searchsorted(groups[order], np.arange(count + 1))
    return start.astype(np.int32), values[order].astype(np.int32)
