"""Where the moments lie on a contact sheet: the arrangement in which the leaf is largest."""

from __future__ import annotations

from dataclasses import dataclass

WIDEST, TALLEST = 2000, 1400  # of a sheet [pixel]
LARGEST_LEAF = 760  # longer side of a leaf [pixel]
MARGIN = 56
GAP = 26  # between moments
PANEL_GAP = 14  # between a moment's two pictures
HEADER = 52  # height of a moment's label
FOOTER = 96  # height of the legend
NARROWEST_BLOCK = 128  # room for a moment's label
NARROWEST_SHEET = 640  # room for the legend


@dataclass(frozen=True)
class Layout:
    """Places and sizes [pixel].

    Attributes:
        columns: Moments in a row.
        rows: Rows of moments.
        beside: The leaf stands right of its water, not below it.
        scale: Pixels per metre, of the water and, nearly, of the leaf.
        water: Width and height of the picture of the water.
        leaf: Width and height of the picture of the leaf.
    """

    columns: int
    rows: int
    beside: bool
    scale: float
    water: tuple[int, int]
    leaf: tuple[int, int]

    @property
    def block(self) -> tuple[int, int]:
        """Width and height of a moment."""
        if self.beside:
            width, height = self.water[0] + PANEL_GAP + self.leaf[0], max(self.water[1], self.leaf[1])
        else:
            width, height = max(self.water[0], self.leaf[0]), self.water[1] + PANEL_GAP + self.leaf[1]
        return max(width, NARROWEST_BLOCK), HEADER + height

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sheet."""
        width = self.columns * self.block[0] + (self.columns - 1) * GAP
        height = self.rows * self.block[1] + (self.rows - 1) * GAP
        return max(width + 2 * MARGIN, NARROWEST_SHEET), height + 2 * MARGIN + FOOTER

    def block_corner(self, index: int) -> tuple[int, int]:
        """Upper left corner of a moment; the moments stand in the middle of the sheet."""
        row, column = divmod(index, self.columns)
        used = self.columns * (self.block[0] + GAP) - GAP
        return (self.size[0] - used) // 2 + column * (self.block[0] + GAP), MARGIN + row * (self.block[1] + GAP)

    def water_corner(self, index: int) -> tuple[int, int]:
        """Upper left corner of a moment's water."""
        x, y = self.block_corner(index)
        if self.beside:
            used = self.water[0] + PANEL_GAP + self.leaf[0]
            return x + (self.block[0] - used) // 2, y + HEADER + (self.block[1] - HEADER - self.water[1]) // 2
        return x + (self.block[0] - self.water[0]) // 2, y + HEADER

    def leaf_corner(self, index: int) -> tuple[int, int]:
        """Upper left corner of a moment's leaf."""
        x, y = self.block_corner(index)
        if self.beside:
            left = self.water_corner(index)[0] + self.water[0] + PANEL_GAP
            return left, y + HEADER + (self.block[1] - HEADER - self.leaf[1]) // 2
        return x + (self.block[0] - self.leaf[0]) // 2, y + HEADER + self.water[1] + PANEL_GAP


def arrange(count: int, water: tuple[float, float], leaf: tuple[float, float]) -> Layout:
    """The layout of a number of moments.

    Args:
        count: Moments, at least 1.
        water: Width and height of the map frame [m].
        leaf: Width and height of all that the pictures of the leaf show [m].
    """
    even = [columns for columns in range(count, 0, -1) if count % columns == 0]
    choices = even if len(even) > 2 else range(count, 0, -1)
    layouts = [
        _scaled(columns, -(-count // columns), beside, water, leaf) for columns in choices for beside in (False, True)
    ]
    # Water above leaf unless side by side is clearly larger.
    return max(layouts, key=lambda layout: layout.scale * (1.0 if layout.beside else 1.25))


def _scaled(columns: int, rows: int, beside: bool, water: tuple[float, float], leaf: tuple[float, float]) -> Layout:
    """The largest layout of a kind."""
    room_across = (WIDEST - 2 * MARGIN - (columns - 1) * GAP) / columns - (PANEL_GAP if beside else 0)
    room_down = (TALLEST - 2 * MARGIN - FOOTER - (rows - 1) * GAP) / rows - HEADER - (0 if beside else PANEL_GAP)
    across = water[0] + leaf[0] if beside else max(water[0], leaf[0])
    down = max(water[1], leaf[1]) if beside else water[1] + leaf[1]
    scale = min(room_across / across, max(room_down, 1.0) / down, LARGEST_LEAF / max(*water, *leaf))
    pictures = [(max(1, int(scale * width)), max(1, int(scale * height))) for width, height in (water, leaf)]
    return Layout(columns, rows, beside, scale, *pictures)
