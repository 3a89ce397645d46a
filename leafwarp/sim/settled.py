"""How well a leaf came to rest before its first frame."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settled:
    """How well a leaf came to rest.

    Attributes:
        residual: Largest force left on a free vertex, over the mean weight of a vertex.
        swing: How far it would still swing, as a share of its length; 0 where it was put into equilibrium.
        substeps: Substeps that it took; Newton steps where it was put into equilibrium.
        settled: Whether the swing is as small as was asked.
    """

    residual: float
    swing: float
    substeps: int
    settled: bool
