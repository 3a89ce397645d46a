"""Veins of a leaf: where they are, and how much of the leaf each one feeds.

Whatever the kind, a map of how likely each pixel is a vein (``venation.likelihood`` from the photo,
``venation.colonisation`` and ``venation.parallel`` from the outline) becomes one connected tree that drains the whole
leaf to the petiole base (``venation.drainage``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.shape.outline import Outline
from leafwarp.leaf.venation.branch import Branch
from leafwarp.leaf.venation.drainage import drainage, vein_tree
from leafwarp.leaf.venation.likelihood import likelihood_of, vein_channel, vein_likelihood
from leafwarp.leaf.venation.shape import LeafShape, is_blade, suits_palmate
from leafwarp.leaf.venation.visibility import LEAST_CONTRAST, shows_stripes, vein_contrast

__all__ = ["KINDS", "Branch", "Venation", "drainage", "find_veins", "find_venation", "vein_likelihood"]

KINDS = ("auto", "photo", "pinnate", "palmate", "parallel")
SIDE, LONGEST = 480, 1600  # [pixels] geometric mean of the sides, and the long side, while seeking veins


@dataclass(frozen=True)
class Venation:
    """The veins of a leaf and how they were come by.

    Attributes:
        branches: The tree, the midrib first, in photo pixels.
        kind: "photo", "pinnate", "palmate" or "parallel".
        contrast: How much the found veins stand out from the lamina beside them, in standard deviations of it; None
            where the picture was not looked at.
    """

    branches: list[Branch]
    kind: str
    contrast: float | None = None


def find_veins(photo: Photo, outline: Outline, kind: str = "auto", seed: int = 0) -> list[Branch]:
    """The leaf's veins, their points in photo pixels (x, y); arguments as for :func:`find_venation`."""
    return find_venation(photo, outline, kind, seed).branches


def find_venation(photo: Photo, outline: Outline, kind: str = "auto", seed: int = 0) -> Venation:
    """The leaf's veins and how they were come by.

    Args:
        photo: The picture.
        outline: The leaf in it.
        kind: "photo": those seen in the picture; "pinnate" or "palmate": made up from the outline; "parallel": along
            the leaf; "auto": parallel for a blade or a striped leaf, else those of the picture where it shows them,
            else made up.
        seed: Of what is made up.

    Raises:
        InputError: The kind is not known.
    """
    if kind not in KINDS:
        raise InputError(f"{photo.path}: maps: venation: {kind!r} is not accepted; accepted: {', '.join(KINDS)}")
    shape, colour, scales, low = _on_raster(photo, outline)
    contrast = None
    channel = vein_channel(colour, shape.inside) if kind in ("auto", "photo") else None
    if kind == "auto" and (is_blade(shape) or shows_stripes(channel, shape)):
        kind = "parallel"
    if kind in ("auto", "photo"):
        branches = vein_tree(likelihood_of(channel, shape.inside), shape.inside, shape.base)
        contrast = vein_contrast(channel, shape, branches)
        if kind == "photo" or contrast >= LEAST_CONTRAST:
            return Venation(_in_photo(branches, scales, low), "photo", contrast)
        kind = "palmate" if suits_palmate(shape) else "pinnate"
    if kind == "parallel":
        from leafwarp.leaf.venation.parallel import parallel_likelihood

        likelihood = parallel_likelihood(shape)
    else:
        from leafwarp.leaf.venation.colonisation import made_up_likelihood

        likelihood = made_up_likelihood(shape, kind, seed)
    return Venation(_in_photo(vein_tree(likelihood, shape.inside, shape.base), scales, low), kind, contrast)


def _on_raster(photo: Photo, outline: Outline) -> tuple[LeafShape, np.ndarray, np.ndarray, np.ndarray]:
    """The leaf on a raster of bounded size, its colours there, raster pixels a photo pixel and its corner."""
    import cv2

    width, height = photo.size
    low = np.floor(outline.points.min(axis=0)).astype(int).clip(0)
    high = np.minimum(np.ceil(outline.points.max(axis=0)).astype(int), (width, height))
    crop = photo.colour[low[1] : high[1], low[0] : high[0]]
    sides = (high - low).astype(float)
    scale = min(SIDE / np.sqrt(sides.prod()), LONGEST / sides.max(), 3.0)
    size = tuple(np.maximum(8, np.rint(sides * scale)).astype(int).tolist())
    scales = np.divide(size, sides)
    inside = np.zeros(size[::-1], np.uint8)
    rings = [(points - low) * scales for points in (outline.points, *getattr(outline, "holes", ()))]
    cv2.fillPoly(inside, [np.rint(ring * 256 - 128).astype(np.int32) for ring in rings], 1, shift=8)
    colour = cv2.resize(crop, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC)
    base, tip = ((point - low) * scales for point in (outline.base, outline.tip))
    return LeafShape.of(inside > 0, rings[0], base, tip), colour, scales, low


def _in_photo(branches: list[Branch], scales: np.ndarray, low: np.ndarray) -> list[Branch]:
    return [Branch(branch.points / scales + low, branch.flow) for branch in branches]
