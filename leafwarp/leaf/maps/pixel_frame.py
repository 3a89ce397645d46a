"""The rectangle of a photo that maps and texture cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.shape.outline import Outline


@dataclass(frozen=True)
class PixelFrame:
    """The maps' rectangle in whole pixels of the photo: ``left``, ``top`` inclusive, ``right``, ``bottom``
    exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.right - self.left, self.bottom - self.top

    @classmethod
    def around(cls, outline: Outline, margin: float = 0.03) -> PixelFrame:
        """The outline's bounding box, wider by a share of its longer side each way, rounded outwards."""
        low, high = outline.points.min(axis=0), outline.points.max(axis=0)
        pad = margin * float((high - low).max())
        return cls(*np.floor(low - pad).astype(int).tolist(), *np.ceil(high + pad).astype(int).tolist())

    @classmethod
    def of(cls, leaf: Leaf) -> PixelFrame:
        """The rectangle that the maps of a leaf made from a photo cover; the leaf must have its findings."""
        found = leaf.findings
        left, bottom = (
            np.rint(np.divide(leaf.frame.origin, found.pixel) * (1.0, -1.0) + found.base).astype(int).tolist()
        )
        width, height = np.rint(np.divide(leaf.frame.size, found.pixel)).astype(int).tolist()
        return cls(left, bottom - height, left + width, bottom)

    def cells(self, points: np.ndarray, map_size: tuple[int, int]) -> np.ndarray:
        """Continuous cell coordinates (column, row from the **top**) of photo points (x, y)."""
        scale = np.divide(map_size, self.size)
        return (points - (self.left, self.top)) * scale
