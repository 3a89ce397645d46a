"""One stretch of a vein tree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Branch:
    """One unbranched stretch of the vein tree, from where it leaves its parent (or the base) outwards.

    Attributes:
        points: Pixel coordinates (x, y), pixel (0, 0) covering [0, 1] x [0, 1], shape [count, 2].
        flow: Share of the leaf drained through each point, in (0, 1], shape [count].
    """

    points: np.ndarray
    flow: np.ndarray
