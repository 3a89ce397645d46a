"""Where the cells of a map's lines begin and end."""

from __future__ import annotations

import numpy as np

from leafwarp.sim.launch import State
from leafwarp_kernels.lanes import LANES, SEGMENT


def line_spans(mask: np.ndarray) -> np.ndarray:
    """First marked cell of each line and the one after its last; (0, 0) for a line without one.

    Args:
        mask: Marked cells, shape [line, cell], bool.

    Returns:
        Shape [line, 2], int32.
    """
    first = np.argmax(mask, axis=1)
    end = mask.shape[1] - np.argmax(mask[:, ::-1], axis=1)
    return np.where(mask.any(axis=1)[:, None], np.stack([first, end], axis=1), 0).astype(np.int32)


def thread_segments(cells: int, state: State) -> tuple[int, int]:
    """How the cells of a line are shared among threads: cells of a segment, and number of segments.

    A CPU runs one thread after another, and adds up a line in one go.
    """
    if not state.many_threads:
        return cells, 1
    return SEGMENT, -(-cells // SEGMENT)


def block_spans(span: np.ndarray) -> np.ndarray:
    """What the spans of each block of lines cover together; (0, 0) for a block of empty ones.

    Args:
        span: First cell of each line and the one after its last, shape [line, 2]; (0, 0) where there is none.

    Returns:
        Shape [block, 2], int32.
    """
    count = -(-len(span) // LANES)
    first = np.full(count * LANES, np.iinfo(np.int32).max, np.int32)
    end = np.zeros(count * LANES, np.int32)
    filled = span[:, 1] > span[:, 0]
    first[: len(span)][filled] = span[filled, 0]
    end[: len(span)] = span[:, 1]
    end = end.reshape(count, LANES).max(axis=1)
    first = np.where(end > 0, first.reshape(count, LANES).min(axis=1), 0)
    return np.stack([first, end], axis=1).astype(np.int32)


def thread_blocks(blocks: int, state: State) -> tuple[int, int]:
    """How the blocks of a row are shared among threads: blocks of a segment, and number of segments."""
    return (1, blocks) if state.many_threads else (blocks, 1)
