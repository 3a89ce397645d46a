"""The contact sheet: some moments of a run, each with its water and its leaf (as in the paper's Fig. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from leafwarp.files import write_bytes
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.specimen import Specimen
from leafwarp.render.camera import checked_points, seen_size
from leafwarp.render.layout import FOOTER, MARGIN, Layout, arrange
from leafwarp.render.renderer import PAPER, VIEW, LeafRenderer, ground_height, shadow_points
from leafwarp.render.water_picture import WaterPicture, water_colors

INK = (44, 42, 40)
FAINT_INK = (120, 116, 110)
RULE = (222, 219, 212)
SAMPLES = 4
LEAF_MARGIN = 0.03  # of the pictures of the leaf
RISING_VIEW = (0.82, -0.28, 0.50)  # from the side: the face of a leaf that curls up is turned to the base
DROOPING_VIEW = (0.70, 0.42, 0.58)  # from beyond the tip, which the face of a drooping leaf is turned to
SIDE_VIEW_HEIGHT = 0.3  # of the leaf's length
FULL_TINT = 0.20  # change of the display colour, linear RGB, at which the leaf has it wholly
SCALE_BAR_LENGTHS = tuple(factor * 10.0**power for power in range(-5, 3) for factor in (1, 2, 5))  # [m]


def choose_frames(first: int, last: int, count: int = 8) -> tuple[int, ...]:
    """At most ``count`` frames from the first to the last, both of them among these, evenly spread, rising."""
    count = max(1, min(count, last - first + 1))
    return tuple(sorted({int(np.floor(frame + 0.5)) for frame in np.linspace(first, last, count)}))


class ContactSheet:
    """Collects moments while a scene runs, and draws them at the end, when the room that they need is known.

    Args:
        leaf: The leaf, or the leaves: all are shown at their places, and the map of their water.
        frames: Numbers of the frames to show.
        device: Warp device that draws.
    """

    def __init__(self, leaf: Leaf, frames: Sequence[int], device: str = "cpu"):
        self.frames = tuple(frames)
        self._places, self._uv, self._texture = None, leaf.uv, leaf.texture
        if leaf.is_many:
            self._uv, self._texture = stacked_textures(leaf)
            self._places = leaf.places.astype(np.float32)
            leaf = leaf.laid_out()
        self._leaf = leaf
        self._device = device
        self._moments: list[tuple[Frame, np.ndarray | None]] = []

    def capture(self, frame: Frame, water_map: np.ndarray | None = None) -> None:
        """Keep a frame.

        Args:
            frame: The frame.
            water_map: Relative water content, row 0 at the bottom, shape [ny, nx]; None where a scene has no map.
        """
        if self._places is not None:
            frame = replace(frame, points=frame.points + self._places)
        self._moments.append((frame, None if water_map is None else np.array(water_map, np.float32)))

    def draw(self) -> np.ndarray:
        """The sheet of the moments so far, 8-bit sRGB, shape [height, width, 3].

        Raises:
            InputError: A position is not finite.
        """
        poses = [frame.points for frame, _ in self._moments] or [np.pad(self._leaf.mesh.positions, ((0, 0), (0, 1)))]
        view = _view(self._leaf, poses)
        layout = arrange(max(1, len(self._moments)), self._leaf.frame.size, _room(poses, view))
        sheet = np.full((layout.size[1], layout.size[0], 3), PAPER, np.uint8)
        lowest = _lowest(self._leaf, self._moments)
        self._draw_water(sheet, layout, lowest)
        self._draw_leaves(sheet, layout, poses, view)
        times = _time_labels([frame.plant_time for frame, _ in self._moments])
        for index, ((frame, water_map), time) in enumerate(zip(self._moments, times, strict=True)):
            # Rounding may leave a dry leaf a trace below nothing.
            percent = max(100.0 * _mean_water(self._leaf, frame, water_map), 0.0)
            _draw_label(sheet, layout, index, time, f"{percent:.0f} %")
        left = layout.block_corner(0)[0]
        _draw_colour_bar(sheet, left, lowest)
        _draw_scale_bar(sheet, sheet.shape[1] - left, layout.scale)
        return sheet

    def save(self, path: Path) -> None:
        """Write the sheet as PNG, whole or not at all.

        Raises:
            OutputError: It cannot be written.
        """
        data = cv2.imencode(".png", self.draw()[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
        write_bytes(path, data)

    def _draw_water(self, sheet: np.ndarray, layout: Layout, lowest: float) -> None:
        picture = WaterPicture(self._leaf, layout.water, PAPER)
        for index, (frame, water_map) in enumerate(self._moments):
            if water_map is None:
                panel = picture.from_vertices(frame.water, lowest)
            else:
                panel = picture.from_map(water_map, lowest)
            _place(sheet, layout.water_corner(index), panel)

    def _draw_leaves(self, sheet: np.ndarray, layout: Layout, poses: list[np.ndarray], view: tuple) -> None:
        width, height = layout.leaf
        mesh = self._leaf.mesh
        renderer = LeafRenderer(mesh.triangles, self._uv, self._texture, self._device, width, height, SAMPLES)
        renderer.fit_camera(poses, view, LEAF_MARGIN)
        fade = _border_fade(height, width)
        for index, (frame, _) in enumerate(self._moments):
            picture = renderer.render(frame.points, frame.normals, self._tint(frame))
            panel = np.rint(fade * picture + (1.0 - fade) * np.array(PAPER)).astype(np.uint8)
            _place(sheet, layout.leaf_corner(index), panel)

    def _tint(self, frame: Frame) -> np.ndarray | None:
        """The display colour, as far as it has left that of the first moment: the photo itself shows the start."""
        first = self._moments[0][0].color
        if frame.color is None or first is None:
            return None
        share = np.clip(np.linalg.norm(frame.color - first, axis=1) / FULL_TINT, 0.0, 1.0)
        return np.column_stack([frame.color, share])


def stacked_textures(leaf: Leaf) -> tuple[np.ndarray, np.ndarray]:
    """The textures of all photos in one, the first at the top, and where the vertices lie in it.

    Returns:
        Texture coordinates, shape [vertex_count, 2], and the texture, 8-bit, shape [height, width, 3], or 4 with an
        opacity.
    """
    textures = [photo.texture for photo in leaf.photos]
    height = sum(texture.shape[0] for texture in textures)
    width, channels = (max(texture.shape[axis] for texture in textures) for axis in (1, 2))
    whole = np.full((height, width, channels), 255, np.uint8)
    tops = np.cumsum([0, *(texture.shape[0] for texture in textures)])
    for top, texture in zip(tops, textures, strict=False):
        whole[top : top + texture.shape[0], : texture.shape[1], : texture.shape[2]] = texture
    top_of = {id(photo): top for photo, top in zip(leaf.photos, tops, strict=False)}

    def in_whole(photo: Leaf, specimen: Specimen) -> np.ndarray:
        rows, columns = photo.texture.shape[:2]
        from_top = top_of[id(photo)] + (1.0 - photo.uv[:, 1]) * rows
        return np.column_stack((photo.uv[:, 0] * columns / width, 1.0 - from_top / height))

    return leaf.join(in_whole), whole


def _view(leaf: Leaf, poses: list[np.ndarray]) -> tuple[float, float, float]:
    """Direction from the leaf to the camera: from the side where the leaf rises or droops by a good part of its length,
    which from above would only look like a shorter leaf."""
    heights = np.concatenate([pose[:, 2] for pose in poses])
    if np.ptp(heights) <= SIDE_VIEW_HEIGHT * leaf.length:
        return VIEW
    tip = int(np.argmax(np.linalg.norm(leaf.mesh.positions, axis=1)))
    return RISING_VIEW if max(pose[tip, 2] for pose in poses) > poses[0][tip, 2] else DROOPING_VIEW


def _room(poses: list[np.ndarray], view: tuple[float, float, float]) -> tuple[float, float]:
    """Width and height of all poses and their shadows as the camera sees them, with the margin [m]."""
    points = checked_points(np.concatenate(poses))
    seen = np.concatenate([points, shadow_points(points, ground_height(points))])
    width, height = seen_size(seen, view)
    # A leaf seen edge-on still gets a picture.
    longest = max(width, height, 1e-9)
    scale = 1.0 / (1.0 - 2.0 * LEAF_MARGIN)
    return scale * max(width, 0.1 * longest), scale * max(height, 0.1 * longest)


def _border_fade(height: int, width: int) -> np.ndarray:
    """1 inside a picture, falling to 0 at its border, where a faint shade must not end in a line."""
    down = np.minimum(np.arange(height), np.arange(height)[::-1])[:, None]
    across = np.minimum(np.arange(width), np.arange(width)[::-1])[None]
    reach = max(1.0, LEAF_MARGIN * min(height, width))
    return np.clip(np.minimum(down, across) / reach, 0.0, 1.0)[..., None]


def _leaf_water(leaf: Leaf, frame: Frame, water_map: np.ndarray | None) -> np.ndarray:
    """Contents of all leaf cells, or of all vertices."""
    if water_map is None:
        return frame.water
    return water_map[leaf.mask] if leaf.mask is not None else water_map


def _mean_water(leaf: Leaf, frame: Frame, water_map: np.ndarray | None) -> float:
    """Mean content of the leaf, by area."""
    if water_map is None:
        return float(np.average(frame.water, weights=leaf.mesh.vertex_areas))
    return float(_leaf_water(leaf, frame, water_map).mean())


def _lowest(leaf: Leaf, moments: list[tuple[Frame, np.ndarray | None]]) -> float:
    """Content at the dry end of the colours: 0; nearer to 1 where a scene stays so wet that all would look alike."""
    driest = min((float(_leaf_water(leaf, *moment).min()) for moment in moments), default=0.0)
    return 0.0 if not driest > 0.5 else min(np.floor(10.0 * driest) / 10.0, 0.9)


def _time_labels(seconds: list[float]) -> list[str]:
    """Plant times in the one unit that suits the longest."""
    longest = max(seconds, default=0.0)
    units = (("d", 86400.0, 3.0), ("h", 3600.0, 2.0), ("min", 60.0, 2.0), ("s", 1.0, 0.0))
    name, length = next((name, length) for name, length, least in units if longest >= least * length)
    digits = 1 if longest / length < 99.95 else 0
    return [f"{second / length:.{digits}f} {name}" for second in seconds]


def _place(sheet: np.ndarray, corner: tuple[int, int], picture: np.ndarray) -> None:
    """Put a picture on the sheet; the darker one stays where pictures of soft shadows meet."""
    x, y = corner
    part = sheet[y : y + picture.shape[0], x : x + picture.shape[1]]
    np.minimum(part, picture[: part.shape[0], : part.shape[1]], out=part)


def _text_width(text: str, size: int, weight: int) -> int:
    return cv2.getTextSize((0, 0), text, (0, 0), cv2.FontFace("sans"), size, weight)[2]


def _write(
    sheet: np.ndarray, place: tuple[int, int], text: str, color: tuple, size: int, weight: int, align: float = 0.0
) -> None:
    """Text on a baseline; ``align`` is the part of its width that lies left of the place."""
    x = place[0] - round(align * _text_width(text, size, weight))
    cv2.putText(sheet, text, (x, place[1]), color, cv2.FontFace("sans"), size, weight)


def _draw_label(sheet: np.ndarray, layout: Layout, index: int, time: str, water: str) -> None:
    """Time and water over a moment, on a thin rule."""
    x, y = layout.block_corner(index)
    right = x + layout.block[0]
    _write(sheet, (x, y + 20), time, INK, 23, 600)
    _write(sheet, (right, y + 20), water, FAINT_INK, 20, 400, align=1.0)
    sheet[y + 31 : y + 33, x:right] = RULE


def _draw_colour_bar(sheet: np.ndarray, left: int, lowest: float) -> None:
    """The colours of the water, lower left."""
    length, top = 300, sheet.shape[0] - MARGIN - FOOTER + 58
    _write(sheet, (left, top - 12), "relative water content", INK, 17, 400)
    sheet[top : top + 12, left : left + length] = water_colors(np.linspace(lowest, 1.0, length), lowest)
    for share in (0.0, 0.5, 1.0):
        text = f"{100.0 * (lowest + share * (1.0 - lowest)):.0f} %"
        _write(sheet, (left + round(share * length), top + 32), text, FAINT_INK, 15, 400, align=share)


def _draw_scale_bar(sheet: np.ndarray, right: int, scale: float) -> None:
    """A round length at the scale of the water, lower right."""
    length = max((length for length in SCALE_BAR_LENGTHS if length * scale <= 160.0), default=SCALE_BAR_LENGTHS[0])
    unit, metre = next(
        (u, m) for u, m in (("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("µm", 1e-6)) if length >= 0.999 * m
    )
    top, left = sheet.shape[0] - MARGIN - FOOTER + 63, right - max(1, round(length * scale))
    sheet[top : top + 3, left:right] = INK
    sheet[top - 4 : top + 7, [left, left + 1, right - 2, right - 1]] = INK
    _write(sheet, ((left + right) // 2, top - 14), f"{length / metre:.0f} {unit}", INK, 17, 400, align=0.5)
