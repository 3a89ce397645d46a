"""The picture that the leaf wears."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.bleed import extend_colours, inner_pixels, near_margin
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.maps.make import PixelFrame
from leafwarp.leaf.segment.silhouette import Silhouette
from leafwarp.leaf.shape.outline import Outline

CERTAIN = 0.4  # value of the silhouette's field from which a pixel near the margin shows the leaf alone
MARGIN_PIXELS = 3.0  # of the raster on which the margin is sought, across what is blurred
FINE = 4  # samples of a pixel's side where a hole covers part of it


def make_texture(
    photo: Photo,
    shape: Silhouette,
    outline: Outline,
    frame: PixelFrame,
    limit: int | None = None,
    cut_holes: bool = True,
) -> np.ndarray:
    """Colours of the frame at the photo's resolution, those of the leaf carried past its margin and into its holes.

    Args:
        photo: The picture; the frame may stick out of it.
        shape: The leaf in it; a pixel of its field wide, the margin mixes with the background.
        outline: Its boundary and its holes.
        frame: The rectangle to cover.
        limit: Longest side of the texture [pixels], a finer photo being averaged; None keeps the photo's.
        cut_holes: Whether holes are to be seen through, which the mesh then need not have.

    Returns:
        8-bit RGB, top row first, shape [height, width, 3]; with holes cut, shape [height, width, 4]: the opacity is
        255 on the leaf and past its margin, 0 in the holes, and in between where a hole covers part of a pixel.
    """
    picture = _framed(photo, frame)
    scale = 1.0 if limit is None else min(1.0, limit / max(frame.size))
    if scale < 1.0:
        import cv2

        size = tuple(max(1, round(side * scale)) for side in frame.size)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    size = (picture.shape[1], picture.shape[0])
    holes = [frame.cells(hole, size) for hole in outline.holes]
    colour = extend_colours(picture, _certain(shape, outline, frame, size))
    if not (holes and cut_holes):
        return colour
    return np.dstack([colour, 255 - _covered(holes, size)])


def _certain(shape: Silhouette, outline: Outline, frame: PixelFrame, size: tuple[int, int]) -> np.ndarray:
    """The texture's pixels that show the leaf and nothing else, bool, shape [height, width].

    Found on a raster no finer than it takes: the margin is as blurred as a pixel of the silhouette is wide.
    """
    import cv2

    depth = 1.0 + max(shape.scale) * size[0] / frame.size[0]
    coarse = max(1, int(depth / MARGIN_PIXELS))
    small = (-(-size[0] // coarse), -(-size[1] // coarse))
    depth /= coarse
    inside = _fill([frame.cells(outline.points, small)], small) > 0
    if outline.holes:
        inside &= _fill([frame.cells(hole, small) for hole in outline.holes], small) == 0
    inner = inner_pixels(inside, depth)
    # The outline rounds off what is sharper than a pixel of the field: in a notch it lies on the background.
    certain = inner & ((_field_at(shape, frame, small) > CERTAIN) | ~near_margin(inside, 3.0 * depth))
    chosen = (certain if certain.any() else inner).astype(np.uint8)
    return cv2.resize(chosen, size, interpolation=cv2.INTER_NEAREST) > 0


def _framed(photo: Photo, frame: PixelFrame) -> np.ndarray:
    """The photo's pixels in a frame; where it sticks out of the photo, those of the nearest border."""
    import cv2

    width, height = photo.size
    left, top = max(frame.left, 0), max(frame.top, 0)
    right, bottom = min(frame.right, width), min(frame.bottom, height)
    pads = (top - frame.top, frame.bottom - bottom, left - frame.left, frame.right - right)
    return cv2.copyMakeBorder(photo.colour[top:bottom, left:right], *pads, cv2.BORDER_REPLICATE)


def _fill(polygons: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """255 where a pixel lies within polygons of pixel coordinates, 0 elsewhere, 8-bit, shape [height, width]."""
    import cv2

    filled = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(filled, [np.rint(polygon * 256 - 128).astype(np.int32) for polygon in polygons], 255, shift=8)
    return filled


def _covered(polygons: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """The part of each pixel that lies within polygons, 0 to 255, 8-bit, shape [height, width]."""
    import cv2

    cover = np.zeros((size[1], size[0]), np.uint8)
    for polygon in polygons:
        low = np.clip(np.floor(polygon.min(axis=0)).astype(int) - 1, 0, size)
        high = np.clip(np.ceil(polygon.max(axis=0)).astype(int) + 1, 0, size)
        box = (high - low).tolist()
        if min(box) > 0:
            fine = _fill([(polygon - low) * FINE], (box[0] * FINE, box[1] * FINE))
            part = cover[low[1] : high[1], low[0] : high[0]]
            np.maximum(part, cv2.resize(fine, box, interpolation=cv2.INTER_AREA), out=part)
    return cover


def _field_at(shape: Silhouette, frame: PixelFrame, size: tuple[int, int]) -> np.ndarray:
    """The silhouette's field on a raster of the frame, shape [height, width]."""
    import cv2

    to_field = np.diag(np.divide(frame.size, size) / shape.scale)
    offset = to_field @ np.array([0.5, 0.5]) - 0.5 + np.divide((frame.left, frame.top), shape.scale)
    return cv2.warpAffine(
        shape.field, np.column_stack([to_field, offset]), size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
