"""The picture that the leaf wears."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.bleed import extend_colours, inner_pixels, near_margin
from leafwarp.leaf.maps import PixelFrame
from leafwarp.leaf.outline import Outline
from leafwarp.leaf.photo import Photo
from leafwarp.leaf.segment import Silhouette

LONGEST = 4096  # [pixels] a bound that every viewer loads
CERTAIN = 0.4  # value of the silhouette's field from which a pixel near the margin shows the leaf alone


def make_texture(photo: Photo, shape: Silhouette, outline: Outline, frame: PixelFrame) -> np.ndarray:
    """Colours of the frame at the photo's resolution, those of the leaf carried past its margin.

    Args:
        photo: The picture; the frame may stick out of it.
        shape: The leaf in it; a pixel of its field wide, the margin mixes with the background.
        outline: Its boundary.
        frame: The rectangle to cover.

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
    depth = 1.0 + max(shape.scale) * scale
    inner = inner_pixels(inside > 0, depth)
    # The outline rounds off what is sharper than a pixel of the field: in a notch it lies on the background.
    to_field = np.array([[1.0 / shape.scale[0], 0.0], [0.0, 1.0 / shape.scale[1]]]) / scale
    offset = to_field @ np.array([0.5, 0.5]) - 0.5 + np.divide((frame.left, frame.top), shape.scale)
    size = (picture.shape[1], picture.shape[0])
    field = cv2.warpAffine(
        shape.field, np.column_stack([to_field, offset]), size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    certain = inner & ((field > CERTAIN) | ~near_margin(inside > 0, 3.0 * depth))
    return extend_colours(picture, certain if certain.any() else inner)
