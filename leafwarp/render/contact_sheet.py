"""The contact sheet: some moments of a run side by side, the water above, the leaf below (as in the paper's Fig. 6)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from leafwarp.errors import OutputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.render.renderer import GROUND_COLOR, VIEW, LeafRenderer, to_srgb
from leafwarp.render.water_picture import map_picture, vertex_picture, water_colors
from leafwarp.sim.frame import Frame

PAPER = tuple(int(c) for c in to_srgb(np.full(3, GROUND_COLOR)))
INK = (52, 50, 48)
FAINT_INK = (125, 121, 116)
SHEET_WIDTH = 2000
MARGIN = 48
GAP = 14
LABEL_HEIGHT = 64
LEGEND_HEIGHT = 84
TALLEST_PANEL = 560
SAMPLES = 2
LONG_ASPECT = 2.5  # height over width beyond which a leaf is drawn lying
SIDE_VIEW = np.array([0.76, -0.26, 0.60])  # shows how a long leaf droops, its base to the left
FEATHER = 0.05  # of a panel's shorter side; the leaf itself keeps clear of it


def choose_frames(first: int, last: int, count: int = 8) -> tuple[int, ...]:
    """At most ``count`` frames from the first to the last, both of them among these, evenly spread, rising."""
    return tuple(sorted({round(f) for f in np.linspace(first, last, max(1, min(count, last - first + 1)))}))


@dataclass(frozen=True)
class _Layout:
    """Where things lie on the sheet [pixel]; a long upright leaf lies on its side, base to the left."""

    columns: int
    rows: int
    panel_width: int
    water_height: int
    leaf_height: int
    lies: bool

    @property
    def block_height(self) -> int:
        return LABEL_HEIGHT + self.water_height + GAP + self.leaf_height

    @property
    def size(self) -> tuple[int, int]:
        width = 2 * MARGIN + self.columns * self.panel_width + (self.columns - 1) * GAP
        return width, 2 * MARGIN + self.rows * (self.block_height + GAP) + LEGEND_HEIGHT

    def corner(self, index: int) -> tuple[int, int]:
        """Upper left corner of a moment."""
        row, column = divmod(index, self.columns)
        return MARGIN + column * (self.panel_width + GAP), MARGIN + row * (self.block_height + GAP)


def _layout(count: int, aspect: float) -> _Layout:
    """Columns and panels for a number of moments of a leaf of this height over width."""
    lies = aspect > LONG_ASPECT
    if lies:
        aspect = 1.0 / aspect
    columns = min(count, 8 if aspect >= 0.9 else 4)
    # A few moments keep the panels that eight would have, up to twice as wide.
    slots = max(columns, 4 if aspect >= 0.9 else 2)
    width = (SHEET_WIDTH - 2 * MARGIN - (slots - 1) * GAP) // slots
    water_height = int(np.clip(width * aspect, 40, TALLEST_PANEL))
    leaf_height = int(np.clip(width * aspect, 0.6 * width, TALLEST_PANEL))
    return _Layout(columns, -(-count // columns), width, water_height, leaf_height, lies)


class ContactSheet:
    """Collects moments while a scene runs, and draws them at the end, when the room that they need is known.

    Args:
        leaf: The leaf.
        frames: Numbers of the frames to show.
        device: Warp device that draws.
    """

    def __init__(self, leaf: Leaf, frames: Sequence[int], device: str = "cpu"):
        self.frames = tuple(frames)
        self._leaf = leaf
        self._device = device
        self._moments: list[tuple[Frame, np.ndarray | None]] = []

    def capture(self, frame: Frame, water_map: np.ndarray | None = None) -> None:
        """Keep a frame.

        Args:
            frame: The frame.
            water_map: Relative water content, row 0 at the bottom, shape [ny, nx]; None where a scene has no map.
        """
        self._moments.append((frame, None if water_map is None else np.array(water_map, np.float32)))

    def draw(self) -> np.ndarray:
        """The sheet of the moments so far, 8-bit sRGB, shape [height, width, 3]."""
        width, height = self._leaf.frame.size
        layout = _layout(max(1, len(self._moments)), height / width)
        sheet = np.full((layout.size[1], layout.size[0], 3), PAPER, np.uint8)
        if self._moments:
            renderer = LeafRenderer(
                self._leaf.mesh.triangles,
                self._leaf.uv,
                self._leaf.texture,
                (layout.panel_width, layout.leaf_height),
                SAMPLES,
                self._device,
            )
            renderer.frame([frame.points for frame, _ in self._moments], view=SIDE_VIEW if layout.lies else VIEW)
        for index, (frame, water_map) in enumerate(self._moments):
            x, y = layout.corner(index)
            self._label(sheet, (x, y), frame)
            y += LABEL_HEIGHT
            self._place(sheet, (x, y), self._water_panel(frame, water_map, layout))
            y += layout.water_height + GAP
            self._place(sheet, (x, y), _feather(renderer.render(frame.points, frame.normals)))
        _draw_legend(sheet)
        return sheet

    def save(self, path: Path) -> None:
        """Write the sheet as PNG, whole or not at all.

        Raises:
            OutputError: It cannot be written.
        """
        data = cv2.imencode(".png", self.draw()[..., ::-1])[1].tobytes()
        temporary = path.with_name(f".{path.name}.tmp")
        try:
            temporary.write_bytes(data)
            os.replace(temporary, path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from None

    def _water_panel(self, frame: Frame, water_map: np.ndarray | None, layout: _Layout) -> np.ndarray:
        width, height = self._leaf.frame.size[:: -1 if layout.lies else 1]
        scale = min(layout.panel_width / width, layout.water_height / height)
        size = (max(1, round(scale * width)), max(1, round(scale * height)))
        drawn_size = size[::-1] if layout.lies else size
        if water_map is None:
            colors, coverage = vertex_picture(self._leaf, frame.water, drawn_size)
        else:
            colors, coverage = map_picture(water_map, self._leaf.mask, drawn_size)
        if layout.lies:
            colors, coverage = np.rot90(colors, -1), np.rot90(coverage, -1)
        picture = coverage[..., None] * colors + (1.0 - coverage[..., None]) * np.array(PAPER)
        panel = np.full((layout.water_height, layout.panel_width, 3), PAPER, np.uint8)
        corner = (layout.panel_width - size[0]) // 2, (layout.water_height - size[1]) // 2
        self._place(panel, corner, np.round(picture).astype(np.uint8))
        return panel

    @staticmethod
    def _place(sheet: np.ndarray, corner: tuple[int, int], picture: np.ndarray) -> None:
        x, y = corner
        sheet[y : y + picture.shape[0], x : x + picture.shape[1]] = picture

    @staticmethod
    def _label(sheet: np.ndarray, corner: tuple[int, int], frame: Frame) -> None:
        x, y = corner
        _write(sheet, (x + 4, y + 24), _duration(frame.plant_time), INK, 22, 600)
        _write(sheet, (x + 4, y + 48), f"water {100.0 * float(frame.water.mean()):.0f} %", FAINT_INK, 17, 400)


def _feather(picture: np.ndarray) -> np.ndarray:
    """A picture that fades into the paper at its edges, where a shadow would be cut."""
    height, width = picture.shape[:2]
    reach = FEATHER * min(width, height)
    fades = [np.clip(np.minimum(np.arange(n) + 0.5, n - 0.5 - np.arange(n)) / reach, 0.0, 1.0) for n in (height, width)]
    share = (fades[0][:, None] * fades[1])[..., None]
    return np.round(share * picture + (1.0 - share) * np.array(PAPER)).astype(np.uint8)


def _duration(seconds: float) -> str:
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * length or (unit == "h" and seconds >= length):
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s" if seconds > 0.0 else "start"


def _write(sheet: np.ndarray, place: tuple[int, int], text: str, color: tuple, size: int, weight: int) -> None:
    """Text whose baseline starts at a place; the sheet is changed."""
    cv2.putText(sheet, text, place, color, cv2.FontFace("sans"), size, weight)


def _draw_legend(sheet: np.ndarray) -> None:
    """The colour bar of the water, below the moments."""
    height, width = sheet.shape[:2]
    length = min(420, width - 2 * MARGIN)
    x, y = MARGIN + 4, height - MARGIN - 34
    sheet[y : y + 14, x : x + length] = np.round(water_colors(np.linspace(0.0, 1.0, length)))
    _write(sheet, (x, y - 10), "relative water content", INK, 17, 400)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        text = f"{100 * share:.0f} %"
        offset = round(share * (length - 1))
        box = cv2.getTextSize((0, 0), text, (0, 0), cv2.FontFace("sans"), 15, 400)
        _write(sheet, (x + offset - round(share * box[2]), y + 34), text, FAINT_INK, 15, 400)
