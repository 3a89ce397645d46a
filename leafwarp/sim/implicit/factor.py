"""Factors of the Hessian on the host: LAPACK's banded Cholesky, or SuperLU where the band would be wide.

Measured on one core in float64, factor and solve: a mesh of 1,707 vertices 25 and 0.6 ms banded (SuperLU 87 and 1.2,
QDLDL 72 and 1.9, CHOLMOD by cholespy 60 and 1.3 with its analysis; dense panels along the profile, which needs half of
the band's work, lose it again to their many small calls); one of 8,000 vertices 260 and 14 ms (SuperLU 550 and 10).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.linalg.lapack import dpbtrf, dpbtrs
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from leafwarp.sim.implicit.pattern import BlockPattern

# Entries of a band above which SuperLU takes over: some 10,000 vertices, 160 MB.
LARGEST_BAND = 20_000_000


class Factor:
    """A factor of the Hessian on the vertices that are free.

    Args:
        pattern: Where the blocks lie.
        free: Vertices that are free, shape [free_count].
        vertex_count: Number of vertices.
        largest_band: Entries of a band above which SuperLU is used.

    Attributes:
        values: The factor made last, or None. It is never changed, so that it may be kept and put back.
        byte_count: Memory of the factor [byte].
    """

    def __init__(self, pattern: BlockPattern, free: np.ndarray, vertex_count: int, largest_band: int = LARGEST_BAND):
        place = np.full(vertex_count, -1)
        place[free] = np.arange(len(free))
        rows, columns = place[pattern.rows], place[pattern.columns]
        self._inside = np.flatnonzero((rows >= 0) & (columns >= 0))
        rows, columns = rows[self._inside], columns[self._inside]
        graph = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(free), len(free)))
        order = reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)
        self._order = free[order]
        rank = np.empty(len(free), dtype=np.int64)
        rank[order] = np.arange(len(free))
        axis = np.arange(3)
        # Entries of the blocks' rows and columns in the new order, the lower triangle of either.
        row = (3 * rank[rows])[:, None, None] + axis[None, :, None] + np.zeros((1, 1, 3), dtype=np.int64)
        column = (3 * rank[columns])[:, None, None] + axis[None, None, :] + np.zeros((1, 3, 1), dtype=np.int64)
        low, high = np.minimum(row, column), np.maximum(row, column)
        # A diagonal block has both of its triangles; one is enough.
        self._used = np.flatnonzero(~((rows == columns)[:, None, None] & (row < column)).ravel())
        low, high = low.ravel()[self._used], high.ravel()[self._used]
        self.size = 3 * len(free)
        self.width = int((high - low).max(initial=0)) + 1
        self._banded = self.width * self.size <= largest_band
        self.byte_count = 0
        if self._banded:
            self._target = (high - low) + self.width * low
            self.byte_count = 8 * self.width * self.size
        else:
            self._low, self._high = low, high
        self.values = None

    def factorise(self, blocks: np.ndarray) -> bool:
        """Make the factor of a Hessian given by its blocks, shape [block_count, 3, 3].

        Returns:
            Whether it is positive definite; if not, there is no factor.
        """
        values = blocks[self._inside].reshape(-1)[self._used]
        if self._banded:
            self.values = None
            band = np.zeros((self.width, self.size), order="F")
            band.reshape(-1, order="F")[self._target] = values
            factor, info = dpbtrf(band, lower=1, overwrite_ab=1)
            self.values = factor if info == 0 else None
            return info == 0
        return self._factorise_sparse(values)

    def _factorise_sparse(self, values: np.ndarray) -> bool:
        off = self._low != self._high
        entries = np.concatenate([values, values[off]])
        rows = np.concatenate([self._high, self._low[off]])
        columns = np.concatenate([self._low, self._high[off]])
        matrix = sparse.csc_matrix((entries, (rows, columns)), shape=(self.size, self.size))
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:
            self.values = None
            return False
        self.byte_count = 12 * (factor.L.nnz + factor.U.nnz)
        is_positive = bool((factor.U.diagonal() > 0.0).all())
        self.values = factor if is_positive else None
        return is_positive

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        """The factorised Hessian's inverse times a right side, both of shape [vertex_count, 3]; zero where held."""
        packed = right_side[self._order].reshape(-1)
        packed = dpbtrs(self.values, packed, lower=1)[0] if self._banded else self.values.solve(packed)
        result = np.zeros_like(right_side)
        result[self._order] = packed.reshape(-1, 3)
        return result
