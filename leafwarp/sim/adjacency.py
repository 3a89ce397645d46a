"""Which elements a vertex belongs to, as flat arrays for gathering kernels."""

from __future__ import annotations

import numpy as np

from leafwarp_kernels.lanes import LANES


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


def lane_corners(element_vertices: np.ndarray) -> np.ndarray:
    """Vertices of blocks of elements; vertex 0 in the lanes of the last block that have no element.

    Args:
        element_vertices: Vertex indices of each element, shape [element_count, corners].

    Returns:
        Shape [block, corners, lane], int32.
    """
    count, corners = np.shape(element_vertices)
    padded = np.zeros((-(-count // LANES) * LANES, corners), np.int32)
    padded[:count] = element_vertices
    return padded.reshape(-1, LANES, corners).transpose(0, 2, 1)


def lane_places(slots: np.ndarray, corners: int, components: int) -> np.ndarray:
    """Where values lie that blocks of elements hold as [block, component, lane], three components a corner.

    Args:
        slots: Slots (element * corners + corner).
        corners: Corners of an element.
        components: Components of a block; where they are three, all corners share them.

    Returns:
        Index of the first component of each slot in the flattened array, int32.
    """
    element, corner = np.divmod(slots, corners)
    block, lane = np.divmod(element, LANES)
    component = 3 * corner if components > 3 else 0
    return ((block * components + component) * LANES + lane).astype(np.int32)
