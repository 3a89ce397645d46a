"""The system of a step in which all cells exchange water at once, factorised on the host (SciPy's SuperLU).

With ``L`` the exchange between neighbours in a step and ``E = I + S`` (S is a source's, see
:mod:`leafwarp_kernels.source`) a step solves

    (E + L) y = E f.

The matrix stays the same from step to step, so that it is factorised once. What is solved for is the change of the
contents: its right side ``-L f`` is a sum of differences over faces, exactly 0 where the content is the same
everywhere, and the residual is taken in the same way. Rounding is therefore proportional to differences, and what the
factor loses where ``beta`` is so large that it swallows the 1 of the diagonal is regained by solving again for
the residual. In exact arithmetic a region without a source keeps its content; the rounding of that sum is made up for.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import FaceConductance, leaf_conductance
from leafwarp.sim.fluid.steps import FluidSteps, NotConverged

MAXIMUM_SOLVES = 12
# No step can be asked to be more accurate, relative to the contents.
ROUNDING = 2e-15
# Bytes of a value and its row index in a factor.
BYTES_AN_ENTRY = 12


class ExchangeSystem:
    """The system on the cells of a leaf.

    Args:
        conductance: Rates of exchange over the faces [1/s].
        mask: Cells that are leaf, shape [ny, nx], bool.
        time_step: [s].

    Attributes:
        cells: Flat indices of the leaf's cells in the map, in the order of all arrays here, shape [cell_count].
        solves: Solves so far.
        most_solves: The most that a step has taken.
    """

    def __init__(self, conductance: FaceConductance, mask: np.ndarray, time_step: float):
        self.cells = np.flatnonzero(mask)
        self.solves = 0
        self.most_solves = 0
        count = len(self.cells)
        index = np.full(mask.shape, -1, np.int32)
        index[mask] = np.arange(count)
        right, upper = conductance.x > 0.0, conductance.y > 0.0
        here = np.concatenate([index[right], index[upper]])
        beyond = np.concatenate([index[:, 1:][right[:, :-1]], index[1:][upper[:-1]]])
        self._beta = np.concatenate([conductance.x[right], conductance.y[upper]]) * time_step
        faces = np.arange(len(here), dtype=np.int32)
        ones = np.ones(len(here))
        self._difference = sparse.csr_matrix(
            (np.concatenate([ones, -ones]), (np.concatenate([faces, faces]), np.concatenate([here, beyond]))),
            shape=(len(here), count),
        )
        self._divergence = self._difference.T.tocsr()
        # Neighbours first, so that small terms are not lost one by one in a large diagonal.
        self._exchange = (self._divergence @ sparse.diags(self._beta) @ self._difference).tocsc()
        _, self._region = connected_components(self._exchange, directed=False)
        self._region_size = np.bincount(self._region)
        self._excess = np.zeros(count)
        self._factor = None

    @classmethod
    def of(cls, scene: Scene, leaf: Leaf, time_step: float | None = None) -> ExchangeSystem:
        """The system of a scene's fluid step, or of one of another length [s], without its source."""
        time_step = time_step or FluidSteps.of(scene).length
        return cls(leaf_conductance(scene, leaf, time_step), leaf.mask, time_step)

    def of_step(self, scene: Scene, leaf: Leaf, time_step: float) -> ExchangeSystem:
        """That of a step of another length [s], which counts its solves on from here."""
        system = ExchangeSystem.of(scene, leaf, time_step)
        system.solves, system.most_solves = self.solves, self.most_solves
        return system

    def on_cells(self, values: np.ndarray) -> np.ndarray:
        """Values of the leaf's cells, shape [cell_count], from those of the map, shape [ny, nx]."""
        return values.reshape(-1)[self.cells]

    @property
    def byte_count(self) -> int:
        """Memory of the factor [byte]."""
        if self._factor is None:
            self.factorise()
        return BYTES_AN_ENTRY * (self._factor.L.nnz + self._factor.U.nnz)

    def factorise(self, excess: np.ndarray | None = None) -> None:
        """Make the factor for another source; the first one is made when it is asked for.

        Args:
            excess: ``S`` of each cell, shape [cell_count]; None for no source.

        Raises:
            NotConverged: There is no factor in float64.
        """
        self._excess = np.zeros(len(self.cells)) if excess is None else excess.astype(np.float64)
        self._is_closed = np.bincount(self._region, self._excess) == 0.0
        matrix = (self._exchange + sparse.diags(1.0 + self._excess)).tocsc()
        try:
            # The diagonal dominates: no pivoting is needed, and the symmetric order has the least fill.
            self._factor = splu(
                matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError:
            raise NotConverged(f"the system has no factor in float64; {REMEDY}") from None
        except MemoryError:
            raise NotConverged(f"the factor of {len(self.cells)} cells does not fit into memory; {REMEDY}") from None

    def step(self, content: np.ndarray, tolerance: float) -> np.ndarray:
        """The contents after a step.

        Args:
            content: Those before it (with a source: filled), float64, shape [cell_count].
            tolerance: Norm of the error to reach, over that of the contents; rounding at the least.

        Raises:
            NotConverged: The error stays above it.
        """
        limit = max(tolerance, ROUNDING) * np.linalg.norm(content)
        after = content.copy()
        residual = -self._outflow(content)
        count, error = 0, np.inf
        if not residual.any():
            return after
        if self._factor is None:
            self.factorise()
        while error > limit and count < MAXIMUM_SOLVES:
            change = self._factor.solve(residual)
            after += change
            kept = np.bincount(self._region, content - after) / self._region_size
            after += np.where(self._is_closed, kept, 0.0)[self._region]
            residual = (1.0 + self._excess) * (content - after) - self._outflow(after)
            # No eigenvalue is below 1, so that the residual bounds the error. Where beta is so large that it is mere
            # rounding, it bounds nothing; then the last change shows how far off the contents were before it.
            error = np.linalg.norm(residual)
            if count > 0:
                error = min(error, np.linalg.norm(change))
            count += 1
        self.solves += count
        self.most_solves = max(self.most_solves, count)
        if not error <= limit:
            raise NotConverged(
                f"after {count} solves the error is {error / max(limit, 1e-300):.3g} times what fluid.tolerance "
                f"accepts; {REMEDY}"
            )
        return after

    def _outflow(self, content: np.ndarray) -> np.ndarray:
        """``L content``: what leaves each cell over its faces in a step."""
        return self._divergence @ (self._beta * (self._difference @ content))


REMEDY = (
    "a shorter fluid.step, a larger fluid.tolerance, fluid.solver = 'conjugate_gradients' or fluid.scheme = 'split' "
    "would help"
)
