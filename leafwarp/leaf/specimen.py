"""One leaf of a scene: how it departs from its photo, and where it has its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from leafwarp.leaf.leaf import Leaf

Result = TypeVar("Result")


@dataclass(frozen=True)
class Specimen:
    """A leaf as it departs from its photo; by default not at all.

    Attributes:
        size: Its lengths over those of the photo.
        stiffness: Its stiffness over that of the scene.
        water: Its content at the start over that of the map.
        seed: Seed of its camber; None for the scene's.
        camber: Height of its camber over its length; None for the scene's.
        rotation: Turns the photo's plane to the leaf's in the world, about the petiole base, shape [3, 3]; None for a
            leaf that lies as it was photographed.
        place: Its petiole base in the world [m], (x, y, z).
        corner: Row and column of its first cell in the map.
    """

    size: float = 1.0
    stiffness: float = 1.0
    water: float = 1.0
    seed: int | None = None
    camber: float | None = None
    rotation: np.ndarray | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    corner: tuple[int, int] = (0, 0)


AS_PHOTOGRAPHED = Specimen()


def once_a_photo(function: Callable[[Leaf], Result]) -> Callable[[Leaf, Specimen], Result]:
    """A function of a leaf's photo alone, for :meth:`Leaf.join` and :meth:`Leaf.tile`: computed once for each photo."""
    results: dict[int, Result] = {}

    def of_photo(photo: Leaf, specimen: Specimen) -> Result:
        if id(photo) not in results:
            results[id(photo)] = function(photo)
        return results[id(photo)]

    return of_photo
