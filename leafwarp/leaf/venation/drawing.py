"""Lines drawn on a map of cells so that what they conduct depends neither on their direction nor on the map.

A line of width w is the set of points within w/2 of its axis. The average of that set over a cell whose extent along
the line's normal is f is the trapezoid ``clip((w/2 - distance)/f + 1/2, 0, 1)``. A line thinner than two cells would
conduct by how it happens to lie between the cell centres, so it is drawn two cells wide and paler by as much: the
product of width and value, which is what it conducts, stays. With face values that are arithmetic means of cells,
lines from half a cell to four cells wide so conduct the same at any angle within 3 %.
"""

from __future__ import annotations

import numpy as np

LEAST_CELLS = 2.0  # least width of a line as drawn
CHUNK = 2_000_000  # cells looked at at a time


def draw_lines(
    starts: np.ndarray,
    ends: np.ndarray,
    widths: np.ndarray,
    values: np.ndarray,
    cell: tuple[float, float],
    map_size: tuple[int, int],
    widest: float = np.inf,
) -> np.ndarray:
    """The largest value of all the lines in each cell, 0 where there is none, shape [ny, nx].

    Args:
        starts: Where each straight line starts, (x, y) in any unit of length from the map's first corner, the middle
            of cell (0, 0) being half a cell away from it, shape [count, 2].
        ends: Where each one ends, with round caps, shape [count, 2].
        widths: Their widths in that unit, shape [count].
        values: Their values in [0, 1], shape [count].
        cell: Width and height of a cell in that unit.
        map_size: Cells across and down (nx, ny).
        widest: No line is widened past this to reach two cells; on a map of a few cells it would fill the leaf.
    """
    drawn = np.zeros(map_size[0] * map_size[1])
    length, unit = _length_and_direction(starts, ends)
    footprint = np.abs(unit[:, ::-1]) @ cell  # extent of a cell across the line
    shown = shown_widths(starts, ends, widths, cell, widest)
    pale = values * widths / shown
    reach = 0.5 * (shown + footprint)
    first, last = _cells_reached(starts, ends, reach, cell, map_size)
    across = last[:, 0] - first[:, 0]
    counts = across * (last[:, 1] - first[:, 1])
    ahead = np.concatenate([[0], np.cumsum(counts)])
    for begin, stop in _chunks(ahead):
        line = np.repeat(np.arange(begin, stop), counts[begin:stop])
        offset = np.arange(len(line)) - (ahead[line] - ahead[begin])
        row, column = first[line, 1] + offset // across[line], first[line, 0] + offset % across[line]
        apart_x = (column + 0.5) * cell[0] - starts[line, 0]
        apart_y = (row + 0.5) * cell[1] - starts[line, 1]
        travelled = np.clip(apart_x * unit[line, 0] + apart_y * unit[line, 1], 0.0, length[line])
        distance = np.hypot(apart_x - travelled * unit[line, 0], apart_y - travelled * unit[line, 1])
        share = np.clip((0.5 * shown[line] - distance) / footprint[line] + 0.5, 0.0, 1.0)
        np.maximum.at(drawn, row * map_size[0] + column, share * pale[line])
    return drawn.reshape(map_size[::-1])


def shown_widths(
    starts: np.ndarray, ends: np.ndarray, widths: np.ndarray, cell: tuple[float, float], widest: float = np.inf
) -> np.ndarray:
    """Widths that lines are drawn with: at least two cells across the line; arguments as for :func:`draw_lines`."""
    unit = _length_and_direction(starts, ends)[1]
    least = LEAST_CELLS * np.hypot(unit[:, 1] * cell[0], unit[:, 0] * cell[1])
    return np.maximum(widths, np.minimum(least, widest))


def _length_and_direction(starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    along = ends - starts
    length = np.hypot(along[:, 0], along[:, 1])
    return length, np.where(length[:, None] > 0.0, along / np.maximum(length, 1e-300)[:, None], (1.0, 0.0))


def _cells_reached(
    starts: np.ndarray, ends: np.ndarray, reach: np.ndarray, cell: tuple[float, float], map_size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """First and last (exclusive) column and row that each line touches, shape [count, 2] each."""
    low = (np.minimum(starts, ends) - reach[:, None]) / cell
    high = (np.maximum(starts, ends) + reach[:, None]) / cell
    first = np.clip(np.floor(low), 0, map_size).astype(np.int64)
    return first, np.maximum(first, np.clip(np.ceil(high), 0, map_size).astype(np.int64))


def _chunks(ahead: np.ndarray) -> list[tuple[int, int]]:
    """Ranges of lines that touch a bounded number of cells together; ``ahead`` counts the cells before each line."""
    bounds, begin = [], 0
    while begin < len(ahead) - 1:
        stop = max(begin + 1, int(np.searchsorted(ahead, ahead[begin] + CHUNK, side="right")) - 1)
        bounds.append((begin, stop))
        begin = stop
    return bounds
