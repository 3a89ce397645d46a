"""Which elements a vertex belongs to, as flat arrays for gathering kernels."""

from __future__ import annotations

import numpy as np


def vertex_to_slots(element_vertices: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Slots (element * corners + corner) of each vertex, in rising order, so that a gather always sums alike.

    Args:
        element_vertices: Vertex indices of each element, shape [element_count, corners].
        vertex_count: Number of vertices.

    Returns:
        Where each vertex's slots start, shape [vertex_count + 1], and the slots, shape [element_count * corners],
        both int32.
    """
    flat = np.asarray(element_vertices).reshape(-1)
    slots = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[slots], np.arange(vertex_count + 1))
    return start.astype(np.int32), slots.astype(np.int32)
