"""Maps as pictures: read for the cells that they cover, and written so that reading them gives the same map.

Either way a picture covers the whole photo, at any size in the photo's proportion, top row first. The borders of a
map's cells run through its pixels, then. Such a pixel is written with the mean of the cells on it, from which, beside
pixels that lie in one cell alone, the border's place is read again: a written map reads back to the picture's rounding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.files import write_bytes
from leafwarp.leaf.image.photo import Photo, read_grey
from leafwarp.leaf.maps.cells import block_means
from leafwarp.leaf.maps.pixel_frame import PixelFrame

ASPECT_TOLERANCE = 0.02  # by which a picture's proportion may differ from the photo's, rounding aside
PIXELS_A_CELL = 12.0  # of a written picture, where its size allows
LARGEST_SIDE = 4096  # [pixels] of a written picture, but where its cells would have too few
LEAST_PIXELS_A_CELL = 3.0  # at least two of them in a row lie in one cell alone, whatever its place
LARGEST_SIDE_OF_ALL = 8192  # [pixels] for those
WHITE = 65535  # of a written picture
ROUNDING = 1.5 / WHITE  # of a pixel, and of the two beside it that its mean is compared with
FLAT = 0.01  # two pixels that differ by less than this share of a step beside them are one ground
BAND = 512  # rows of a written picture that are made at a time
FAST = (16, 1)  # OpenCV's IMWRITE_PNG_COMPRESSION at its fastest: the pictures are all runs of one value
SPILL = 3  # cells past the leaf that a written map keeps its values


def read_map(
    path: Path,
    name: str,
    photo: Photo,
    frame: PixelFrame,
    map_size: tuple[int, int],
    refinements: Sequence[int] = (),
) -> np.ndarray:
    """Cell averages of a picture that covers the same frame as the photo, shape [ny, nx], bottom row first.

    Args:
        path: The picture.
        name: The map that it is for.
        photo: The photo.
        frame: The rectangle of the photo that the map covers.
        map_size: Cells across and up (nx, ny).
        refinements: Numbers of parts of each cell, each way, to take the averages of instead: the first of them whose
            parts are no smaller than the picture's pixels.

    Raises:
        InputError: The picture cannot be read, or its proportion is not the photo's.
    """
    grey = read_grey(path)
    size = grey.shape[::-1]
    stretch = size[0] * photo.size[1] / (size[1] * photo.size[0])
    if abs(np.log(stretch)) > ASPECT_TOLERANCE + 0.5 / size[0] + 0.5 / size[1]:
        raise InputError(
            f"{path}: maps: {name}: is {size[0]} x {size[1]} pixels, not in proportion to the photo's "
            f"{photo.size[0]} x {photo.size[1]}; accepted: a picture of the whole photo, at any size"
        )
    ratio = np.divide(size, photo.size)
    fits = (times for times in refinements if (np.multiply(times, map_size) <= ratio * frame.size).all())
    map_size = np.multiply(next(fits, 1), map_size)
    x = np.linspace(frame.left, frame.right, map_size[0] + 1) * ratio[0]
    y = np.linspace(frame.top, frame.bottom, map_size[1] + 1) * ratio[1]
    return interval_means(interval_means(grey, y).T, x).T[::-1]


def interval_means(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Means over intervals, along axis 0, of what samples at pixel centres stand for.

    Exact for a linear ramp at any ratio of interval to pixel. Where intervals are finer than pixels, the samples are
    joined by straight lines. Else each sample is the mean of its pixel, with a slope within the pixel that does not
    pass its neighbours' values (the smaller of the differences to them, 0 at an extreme): steps stay sharp, and what
    whole pixels hold is kept. A pixel between two flat grounds holds a step from the one to the other, where its mean
    puts it (subcell resolution; Harten 1989).

    Args:
        values: Samples; sample k stands at k + 0.5, shape [count, ...].
        bounds: Rising interval bounds, shape [intervals + 1]; what is beyond the samples has the value of the last.
    """
    bounds = np.asarray(bounds, float)
    finer = bounds[-1] - bounds[0] < len(bounds) - 1
    integral = _integral_of_lines(values, bounds) if finer else _integral_of_pixels(values, bounds)
    return np.diff(integral, axis=0) / np.diff(bounds)[:, None]


def _integral_of_lines(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Integral from the first sample to each bound of the straight lines through the samples."""
    at = bounds - 0.5
    last = len(values) - 1
    pairs = 0.5 * (values[1:] + values[:-1])
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(pairs, axis=0)])
    within = np.clip(at, 0.0, last)
    index = np.minimum(within.astype(int), max(last - 1, 0))
    part = (within - index)[:, None]
    ahead = values[np.minimum(index + 1, last)]
    integral = total[index] + values[index] * part + (ahead - values[index]) * (0.5 * part**2)
    return integral + values[:1] * np.minimum(at, 0.0)[:, None] + values[-1:] * np.maximum(at - last, 0.0)[:, None]


def _integral_of_pixels(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Integral from the first pixel's edge to each bound of pixels with limited slopes, or a step."""
    count = len(values)
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    within = np.clip(bounds, 0.0, count)
    index = np.minimum(within.astype(int), count - 1)
    part = (within - index)[:, None]
    behind = values[index] - values[np.maximum(index - 1, 0)]
    ahead = values[np.minimum(index + 1, count - 1)] - values[index]
    behind = np.where((index == 0)[:, None], ahead, behind)  # a ramp goes on to the picture's edge
    ahead = np.where((index == count - 1)[:, None], behind, ahead)
    slope = np.where(behind * ahead > 0.0, np.where(np.abs(behind) < np.abs(ahead), behind, ahead), 0.0)
    first_part, lacking = _parts_of_steps(values, index, part, behind, ahead)
    whole = total[index] + np.cumsum(lacking, axis=0) - lacking
    integral = whole + np.where(
        np.isnan(first_part), values[index] * part + 0.5 * slope * part * (part - 1.0), first_part
    )
    beyond = bounds - within
    return (
        integral
        + np.where(beyond < 0.0, beyond, 0.0)[:, None] * values[:1]
        + np.maximum(beyond, 0.0)[:, None] * values[-1:]
    )


def _parts_of_steps(
    values: np.ndarray, index: np.ndarray, part: np.ndarray, behind: np.ndarray, ahead: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Integrals over the first part of pixels with a step between two flat grounds, not a number of other pixels.

    A step that the picture's rounding cannot tell from one at the part's end is there: the pixel's mean is off by the
    rounding then, and what it lacks is the second result (0 for other pixels).

    Args:
        values: Samples, shape [count, ...].
        index: The pixels, shape [pixels].
        part: Share of each that is its first part, shape [pixels, 1].
        behind, ahead: Its difference from the sample before it, and that to the sample after it.
    """
    last = len(values) - 1
    rise = behind + ahead
    flat = FLAT * np.abs(rise)
    grounds = np.broadcast_to(((index > 0) & (index < last) & (last > 2))[:, None], rise.shape)
    for near, far in ((index - 1, index - 2), (index + 1, index + 2)):
        near, far = np.clip(near, 0, last), np.clip(far, 0, last)
        grounds = grounds & (np.abs(values[near] - values[far]) <= flat)
    lacking = (1.0 - part) * rise - behind  # of what a step at the part's end has
    there = grounds & (np.abs(lacking) <= ROUNDING)
    step = there | (grounds & (behind * ahead > 0.0))
    at = np.where(there, part, ahead / np.where(step & (rise != 0.0), rise, 1.0))
    first_part = (values[index] - behind) * part + rise * np.maximum(part - at, 0.0)
    return np.where(step, first_part, np.nan), np.where(there, lacking, 0.0)


def write_maps(
    maps: Mapping[str, np.ndarray],
    mask: np.ndarray,
    folder: Path,
    stem: str,
    *,
    frame: PixelFrame | None = None,
    photo_size: tuple[int, int] | None = None,
    fine_venation: np.ndarray | None = None,
) -> list[Path]:
    """Write maps as 16-bit grey pictures ``STEM.NAME.png`` that a scene can name in their stead.

    Reading them gives the values rounded to 16 bits, but for a map so fine on a photo so large that no picture of
    bounded size has pixels enough. The source, whose weights have the sum 1, is written with 1 as its largest.

    Args:
        maps: Named maps in [0, 1], bottom row first, shape [ny, nx] each.
        mask: Cells that are leaf, shape [ny, nx], bool.
        folder: Where to write.
        stem: Start of the files' names.
        frame: The rectangle of the photo that the maps cover.
        photo_size: Width and height of the photo in pixels, which the pictures cover. Without a frame and a photo
            size they cover the maps' own rectangle, and read back right only beside a photo cropped to it.
        fine_venation: What the venation is the average of, as :class:`leafwarp.leaf.Leaf` has it: written in its stead,
            as finely as the picture has pixels for.

    Returns:
        The files written, in the order of the maps.

    Raises:
        OutputError: A file cannot be written.
    """
    import cv2

    if frame is None or photo_size is None:
        frame, photo_size = PixelFrame(0, 0, *mask.shape[::-1]), mask.shape[::-1]
    files = []
    for name, values in maps.items():
        shown, inside = values / max(float(values.max()), 1e-300) if name == "source" else values, mask
        if name == "venation" and fine_venation is not None:
            shown = _finest_shown(fine_venation, mask.shape, frame, photo_size)
            inside = np.kron(mask, np.ones(np.floor_divide(shown.shape, mask.shape), bool))
        path = Path(folder) / f"{stem}.{name}.png"
        data = cv2.imencode(".png", _picture(np.clip(shown, 0.0, 1.0), inside, frame, photo_size), FAST)[1]
        write_bytes(path, data.tobytes())
        files.append(path)
    return files


def _finest_shown(
    fine: np.ndarray, shape: tuple[int, int], frame: PixelFrame, photo_size: tuple[int, int]
) -> np.ndarray:
    """What is drawn on parts of the map's cells, averaged over as few parts as a picture of the photo can show."""
    parts = len(fine) // shape[0]
    finest = LARGEST_SIDE_OF_ALL / max(photo_size) * min(np.divide(frame.size, shape[::-1])) / LEAST_PIXELS_A_CELL
    while parts > 1 and parts > finest:
        parts //= 2
    return block_means(fine, (parts * shape[0], parts * shape[1]))


def _picture(values: np.ndarray, mask: np.ndarray, frame: PixelFrame, photo_size: tuple[int, int]) -> np.ndarray:
    """A 16-bit picture of the photo's frame, top row first: of each pixel, the mean of the map's cells on it."""
    from scipy.sparse import csr_array

    rows, columns = values.shape
    cell = min(frame.size[0] / columns, frame.size[1] / rows)
    side = max(photo_size)
    scale = min(PIXELS_A_CELL / cell, LARGEST_SIDE / side)
    scale = max(scale, min(LEAST_PIXELS_A_CELL / cell, LARGEST_SIDE_OF_ALL / side))
    width, height = (max(1, round(length * scale)) for length in photo_size)
    down = csr_array(_overlap(rows, frame.top, frame.bottom, photo_size[1], height))
    across = csr_array(_overlap(columns, frame.left, frame.right, photo_size[0], width).T)
    # The cells are rounded before their means are: what lies in one cell has one value. Halves all go up.
    cells = down @ np.rint(_spilled(values, mask) * WHITE)[::-1]
    picture = np.empty((height, width), np.uint16)
    for top in range(0, height, BAND):
        picture[top : top + BAND] = np.rint(cells[top : top + BAND] @ across + 1e-6)
    return picture


def _overlap(cells: int, first: float, last: float, photo_side: int, pixels: int) -> np.ndarray:
    """Share of each pixel of a line that each cell covers, shape [pixels, cells]."""
    bounds = np.arange(pixels + 1) * (photo_side / pixels)  # in photo pixels
    at = (bounds - first) / (last - first) * cells
    ahead, beyond = np.zeros(cells), np.ones(cells)
    ahead[0], beyond[-1] = -SPILL, 1.0 + SPILL  # the outer cells go on for as much as the leaf's do
    filled = np.clip(at[:, None] - np.arange(cells), ahead, beyond)
    return np.diff(filled, axis=0) * ((last - first) / cells * pixels / photo_side)


def _spilled(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The map with the nearest leaf cell's value in the few cells around the leaf, so that its margin stays sharp."""
    from scipy.ndimage import distance_transform_edt

    distance, (rows, columns) = distance_transform_edt(~mask, return_indices=True)
    return np.where(distance <= SPILL, values[rows, columns], 0.0)
