"""Where the cells of a map's lines begin and end."""

from __future__ import annotations

import numpy as np


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
