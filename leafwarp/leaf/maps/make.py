"""The maps of a leaf: which cells are leaf, and venation, stomata, water and source on them.

Everything here is laid out as the simulation reads it: shape [ny, nx], row 0 at the bottom, values averaged
over each cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.maps.cells import block_means, leaf_cells, leaf_coverage
from leafwarp.leaf.maps.files import read_map
from leafwarp.leaf.maps.pixel_frame import PixelFrame
from leafwarp.leaf.shape.outline import Outline
from leafwarp.leaf.venation.capacity import draw_capacity, stalk_cells
from leafwarp.leaf.venation.veins import Branch, find_veins

__all__ = ["PixelFrame", "fine_venation", "make_maps"]

VEIN_STOMATA = 0.8  # share of the stomata that a main vein takes away
NEAR_VEIN_STOMATA = 0.8  # density next to a vein, relative to the middle of an areole
AREOLE = 0.02  # distance from a vein from which the density no longer grows, as a share of the leaf's length
STOMATA_VARIATION = 0.08  # standard deviation of the density
PATCHES = 96  # of the variation along the map's longer side
# What veins carry is drawn on so many cells for one of the map, each way; the finest that is drawn so.
FINEST_VENATION = ((4, 1024), (2, 2048))


def fine_venation(
    photo: Photo,
    outline: Outline,
    frame: PixelFrame,
    map_size: tuple[int, int],
    value: str | Path,
    branches: list[Branch] | None = None,
    seed: int = 0,
) -> np.ndarray:
    """What veins carry, on a whole number of cells for one of the map each way, shape [refinement * ny, ...].

    Veins are thinner than the cells of most maps. Drawn on finer ones they lie where they are, and what two cells of
    the map exchange is told by what lies between their centres. A picture is read no finer than its pixels are.
    Arguments as for :func:`make_maps`; the value is that of the venation, not a number.
    """
    refinements = [times for times, most in FINEST_VENATION if times * max(map_size) <= most]
    if isinstance(value, Path):
        return read_map(value, "venation", photo, frame, map_size, refinements)
    if branches is None:
        branches = find_veins(photo, outline, value, seed)
    refinement = next(iter(refinements), 1)
    return draw_capacity(branches, outline, frame, (refinement * map_size[0], refinement * map_size[1]))


def make_maps(
    photo: Photo,
    outline: Outline,
    frame: PixelFrame,
    map_size: tuple[int, int],
    maps: Mapping[str, str | float | Path],
    branches: list[Branch] | None = None,
    seed: int = 0,
    venation: np.ndarray | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Mask and named maps.

    Args:
        photo: The picture.
        outline: The leaf in it.
        frame: The rectangle to cover.
        map_size: Cells across and up (nx, ny).
        maps: The maps wanted: "auto", a number in [0, 1], or a picture of the same frame as the photo. The venation
            may also be "photo", "pinnate", "palmate" or "parallel".
        branches: The leaf's veins in photo pixels, where they were found before.
        seed: Of what is made up: veins that the picture does not show, and the stomata's variation.
        venation: As :func:`fine_venation` draws it, where that was done before.

    Returns:
        Mask of shape [ny, nx], bool, and the maps, zero off the leaf.

    Raises:
        InputError: A picture cannot be used as the map that it is given for.
    """
    base_cell, tip_cell = (_cell(frame, point, map_size) for point in (outline.base, outline.tip))
    mask = leaf_cells(leaf_coverage(outline, frame, map_size), base_cell, tip_cell)
    mask |= _joined(stalk_cells(outline, frame, map_size), mask)
    value = maps.get("venation", "auto" if maps.get("stomata") == "auto" else 0.0)
    if venation is None and not isinstance(value, float | int):
        venation = fine_venation(photo, outline, frame, map_size, value, branches, seed)
    veins = None if venation is None else block_means(venation, mask.shape)
    made: dict[str, np.ndarray] = {}
    for name, value in maps.items():
        if name == "venation" and veins is not None:
            made[name] = veins
        elif isinstance(value, Path):
            made[name] = read_map(value, name, photo, frame, map_size)
        elif isinstance(value, float | int):
            made[name] = np.full(mask.shape, float(value))
        elif name == "source":
            made[name] = _source(outline, frame, map_size, mask)
        elif name == "water":
            made[name] = np.ones(mask.shape)
    if maps.get("stomata") == "auto":
        made["stomata"] = _stomata(made.get("venation", veins), outline, frame, map_size, seed)
    made = {name: np.where(mask, made[name], 0.0) for name in maps}
    if "source" in made:
        made["source"] = _shares(made["source"], maps["source"])
    return mask, made


def _shares(source: np.ndarray, given: str | float | Path) -> np.ndarray:
    """A source map scaled to the sum 1."""
    total = source.sum()
    if total <= 0.0:
        raise InputError(f"{given}: maps: source: it is black on the leaf; accepted: light where water enters")
    return source / total


def _cell(frame: PixelFrame, point: np.ndarray, map_size: tuple[int, int]) -> tuple[int, int]:
    """Row (from the bottom) and column of the cell that holds a photo point."""
    column, down = np.minimum(np.maximum(np.floor(frame.cells(point, map_size)), 0), np.subtract(map_size, 1))
    return map_size[1] - 1 - int(down), int(column)


def _joined(extra: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Extra cells that are connected to the mask."""
    import cv2

    labels = cv2.connectedComponents((extra | mask).astype(np.uint8), connectivity=4)[1]
    return extra & (labels == labels[mask][0])


def _stomata(
    veins: np.ndarray, outline: Outline, frame: PixelFrame, map_size: tuple[int, int], seed: int
) -> np.ndarray:
    """Density of stomata in [0, 1]: even on the lamina but for a fine variation, fewer on veins and next to them.

    Only ratios count, for what transpires refers to the mean. The variation belongs to the place on the leaf, not to
    the map's cells.
    """
    import cv2
    from scipy.ndimage import distance_transform_edt

    cell = np.divide(frame.size, map_size)
    free = veins < 0.02
    distance = distance_transform_edt(free, sampling=cell[::-1]) if not free.all() else np.full(veins.shape, np.inf)
    away = np.minimum(distance / (AREOLE * outline.length), 1.0)
    patches = np.maximum(2, np.rint(PATCHES * np.divide(frame.size, max(frame.size)))).astype(int)
    noise = np.random.default_rng(seed).standard_normal(patches[::-1])
    way = cv2.INTER_AREA if (patches > map_size).any() else cv2.INTER_CUBIC
    noise = np.clip(cv2.resize(noise, map_size, interpolation=way), -3.0, 3.0)
    density = (1.0 - VEIN_STOMATA * veins) * (NEAR_VEIN_STOMATA + (1.0 - NEAR_VEIN_STOMATA) * away)
    return density * (1.0 + STOMATA_VARIATION * noise) / (1.0 + 3.0 * STOMATA_VARIATION)


def _source(outline: Outline, frame: PixelFrame, map_size: tuple[int, int], mask: np.ndarray) -> np.ndarray:
    """Cells within half a petiole's width of the base, those at the rim in part; at least the base's own cell."""
    radius = float(np.clip(0.5 * outline.petiole_width, 0.005 * outline.length, 0.03 * outline.length))
    cell = np.divide(frame.size, map_size)
    x = frame.left + (np.arange(map_size[0]) + 0.5) * cell[0] - outline.base[0]
    y = frame.bottom - (np.arange(map_size[1]) + 0.5) * cell[1] - outline.base[1]
    distance = np.hypot(x[None], y[:, None])
    weights = np.where(mask, np.clip((radius - distance) / cell.max() + 0.5, 0.0, 1.0), 0.0)
    row, column = _cell(frame, outline.base, map_size)
    weights[row, column] = max(weights[row, column], 0.01)
    return weights
