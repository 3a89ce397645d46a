"""The picture that the leaf wears."""

from __future__ import annotations

import numpy as np

from .bleed import extend_colours, inner_pixels
from .maps import PixelFrame
from .outline import Outline
from .photo import Photo

LONGEST = 4096  # [pixels] a bound that every viewer loads


def make_texture(photo: Photo, outline: Outline, frame: PixelFrame, softness: float) -> np.ndarray:
    """Colours of the frame at the photo's resolution, those of the leaf carried past its margin.

    Args:
        photo: The picture; the frame may stick out of it.
        outline: The leaf in it.
        frame: The rectangle to cover.
        softness: Width of the band along the margin that mixes with the background [photo pixels].

    Returns:
        8-bit RGB, top row first, shape [height, width, 3], the long side at most 4096.
    """
    import cv2

    width, height = photo.size
    left, top = max(frame.left, 0), max(frame.top, 0)
    right, bottom = min(frame.right, width), min(frame.bottom, height)
    pads = (top - frame.top, frame.bottom - bottom, left - frame.left, frame.right - right)
    picture = cv2.copyMakeBorder(photo.colour[top:bottom, left:right], *pads, cv2.BORDER_REPLICATE)
    scale = min(1.0, LONGEST / max(frame.size))
    if scale < 1.0:
        size = tuple(max(1, round(side * scale)) for side in frame.size)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    inside = np.zeros(picture.shape[:2], np.uint8)
    corners = frame.cells(outline.points, (picture.shape[1], picture.shape[0]))
    cv2.fillPoly(inside, [np.rint(corners * 256 - 128).astype(np.int32)], 1, shift=8)
    inner = inner_pixels(inside > 0, depth=1.0 + softness * scale)
    return extend_colours(picture, inner)
