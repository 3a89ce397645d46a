"""A picture of what was found in a photo: outline, petiole base, veins and mesh over it, for a person to judge.

Every line is a light one on a darker, wider one, so that it shows on any photo; the words stand below the picture,
where they hide nothing.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.leaf import Findings, Leaf
from leafwarp.leaf.mesh.topology import boundary_edges

LONGEST = 1600  # [pixels] bound of the overlay's long side
PICTURE_SIDE = 1400  # [pixels] long side of the photo in it
MOST_ENLARGED = 6.0  # a tiny photo is enlarged so that lines and words do not bury it
LEAST_WIDTH = 560  # [pixels] room for the words
AROUND = 0.25  # of the leaf's longer side: what is shown of the photo beyond the leaf
EDGE = 18  # [pixels] room beyond the photo for what lies on its border
SHIFT = 4  # fractional bits of a drawn coordinate

CLEAR = (225, 225, 225)  # where the photo is transparent
LIGHT, DARK = (255, 255, 255), (20, 20, 20)
OUTLINE, VEIN, BASE = (255, 215, 40), (90, 225, 255), (255, 60, 60)
MESH_OPACITY = 0.38
WIDEST_VEIN = 5.0  # [pixels] where the whole leaf drains through it; by Murray's law the width goes as the cube root
PANEL, INK, FAINT_INK = (30, 32, 34), (240, 240, 240), (178, 180, 182)
PETIOLE_BASE = "petiole base"
BASE_FOUND = {"stalk": "found by its stalk", "veins": "found by the veins", "given": "as given"}
TEXT_SIZE, LINE_HEIGHT, MARGIN = 19, 29, 20  # [pixels]


def draw_overlay(photo: Photo, leaf: Leaf, legend: bool = True, side: int = PICTURE_SIDE) -> np.ndarray:
    """Draw what was found over the photo.

    Args:
        photo: The photo that the leaf was made from.
        leaf: The leaf, with its findings.
        legend: Whether to say below what the signs mean and what was found.
        side: Long side of the photo in the picture [pixels], at most 1400.

    Returns:
        8-bit RGB, top row first, shape [height, width, 3], the long side at most 1600.
    """
    if leaf.findings is None:
        raise ValueError("leaf: has no findings: it was not made from a photo")
    words = _words(leaf)
    low, high = _window(photo, leaf)
    width, height = (high - low).tolist()
    panel = 2 * EDGE + MARGIN + LINE_HEIGHT * (2 + 2 * len(words))  # room enough for notes that run over two lines
    scale = min(min(side, PICTURE_SIDE) / max(width, height), (LONGEST - panel) / height, MOST_ENLARGED)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    shown = np.s_[low[1] : high[1], low[0] : high[0]]
    picture = cv2.resize(photo.colour[shown], size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC)
    if photo.alpha is not None:
        share = cv2.resize(photo.alpha[shown], size, interpolation=cv2.INTER_AREA)[..., None] / np.float32(255.0)
        picture = np.rint(share * picture + (1.0 - share) * np.float32(CLEAR)).astype(np.uint8)
    picture = cv2.copyMakeBorder(picture, EDGE, EDGE, EDGE, EDGE, cv2.BORDER_CONSTANT, value=PANEL)
    view = _View(low, np.divide(size, (width, height)))
    _draw_mesh(picture, leaf, view)
    _draw_veins(picture, leaf, view)
    _draw_outline(picture, leaf, view)
    return _with_words(picture, words, leaf.findings.base_found) if legend else picture


def _window(photo: Photo, leaf: Leaf) -> tuple[np.ndarray, np.ndarray]:
    """First and last (exclusive) pixel (x, y) of the part of the photo to show: the leaf and what is around it."""
    outline = leaf.findings.outline
    low, high = outline.min(axis=0), outline.max(axis=0)
    around = AROUND * (high - low).max()
    return (
        np.clip(np.floor(low - around), 0, np.subtract(photo.size, 1)).astype(int),
        np.clip(np.ceil(high + around), 1, photo.size).astype(int),
    )


@dataclass(frozen=True)
class _View:
    """Where the photo's pixels lie in the picture."""

    low: np.ndarray
    scale: np.ndarray

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Photo points (x, y), pixel (0, 0) covering [0, 1] x [0, 1], as the drawing functions take them."""
        return _fixed((points - self.low) * self.scale + EDGE)


def _draw_mesh(picture: np.ndarray, leaf: Leaf, view: _View) -> None:
    """The mesh's edges, light on a dark leaf and dark on a light one."""
    findings = leaf.findings
    points = view(_in_photo(leaf.mesh.positions, findings))
    inside = np.zeros(picture.shape[:2], np.uint8)
    cv2.fillPoly(inside, [view(findings.outline)], 255, shift=SHIFT)
    lightness = cv2.mean(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), inside)[0]
    lines = np.zeros(picture.shape[:2], np.uint8)
    cv2.polylines(lines, list(points[leaf.mesh.edges]), False, 255, 1, cv2.LINE_AA, SHIFT)
    share = lines[..., None] * np.float32(MESH_OPACITY / 255.0)
    colour = np.float32(LIGHT if lightness < 140.0 else DARK)
    np.copyto(picture, np.rint(picture + share * (colour - picture)).astype(np.uint8))


def _draw_veins(picture: np.ndarray, leaf: Leaf, view: _View) -> None:
    """The veins, each stretch as wide as the part of the leaf that it drains says."""
    stretches: list[tuple[np.ndarray, int]] = []
    for points, flow in leaf.findings.veins:
        corners = view(points)
        widths = np.clip(np.rint(WIDEST_VEIN * np.cbrt(flow)), 1, WIDEST_VEIN).astype(int)
        cuts = [0, *(np.nonzero(np.diff(widths))[0] + 1).tolist(), len(widths)]
        stretches += [(corners[max(0, first - 1) : last], int(widths[first])) for first, last in pairwise(cuts)]
    for corners, width in stretches:
        if width > 1:  # about the finest veins, which are many, it would hide the leaf
            cv2.polylines(picture, [corners], False, DARK, width + 2, cv2.LINE_AA, SHIFT)
    for corners, width in stretches:
        cv2.polylines(picture, [corners], False, VEIN, width, cv2.LINE_AA, SHIFT)


def _draw_outline(picture: np.ndarray, leaf: Leaf, view: _View) -> None:
    """The outline with its holes, and the petiole base."""
    findings = leaf.findings
    loops = [view(points) for points in (findings.outline, *_cut_out(leaf), *_left_open(leaf))]
    for width, colour in ((4, DARK), (2, OUTLINE)):
        cv2.polylines(picture, loops, True, colour, width, cv2.LINE_AA, SHIFT)
    _draw_base(picture, view(np.asarray(findings.base)))


def _left_open(leaf: Leaf) -> list[np.ndarray]:
    """Edges along the boundary of a mesh with holes, in photo pixels; none for a disc."""
    mesh, findings = leaf.mesh, leaf.findings
    if mesh.vertex_count - mesh.edge_count + mesh.triangle_count >= 1:
        return []
    return list(_in_photo(leaf.mesh.positions, findings)[boundary_edges(mesh)])


def _cut_out(leaf: Leaf) -> list[np.ndarray]:
    """Outlines of what is cut out of the texture, in photo pixels."""
    if leaf.texture.shape[2] < 4:
        return []
    clear = (leaf.texture[..., 3] < 128).astype(np.uint8)
    contours, _ = cv2.findContours(clear, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    height, width = clear.shape
    holes = []
    for contour in contours:
        uv = (contour[:, 0] + 0.5) / (width, height)
        place = np.array(leaf.frame.origin) + np.column_stack([uv[:, 0], 1.0 - uv[:, 1]]) * leaf.frame.size
        holes.append(_in_photo(place, leaf.findings))
    return holes


def _in_photo(positions: np.ndarray, findings: Findings) -> np.ndarray:
    """Photo pixels of positions [m], shape [count, 2]."""
    return np.asarray(findings.base) + positions * (1.0, -1.0) / findings.pixel


def _draw_base(picture: np.ndarray, place: np.ndarray) -> None:
    """A ring about a point in fixed coordinates, open in the middle."""
    x, y = place.tolist()
    for width, colour in ((7, DARK), (5, LIGHT), (3, BASE)):
        cv2.circle(picture, (x, y), 13 << SHIFT, colour, width, cv2.LINE_AA, SHIFT)
    cv2.circle(picture, (x, y), 3 << SHIFT, DARK, -1, cv2.LINE_AA, SHIFT)
    cv2.circle(picture, (x, y), 2 << SHIFT, BASE, -1, cv2.LINE_AA, SHIFT)


def _fixed(points: np.ndarray) -> np.ndarray:
    """Picture coordinates with fractional bits, the middle of the first pixel being 0."""
    return np.rint((points - 0.5) * (1 << SHIFT)).astype(np.int32)


def _words(leaf: Leaf) -> list[str]:
    """What the legend says beside the signs: confidence and sizes, then the notes."""
    findings = leaf.findings
    area = float(leaf.mesh.vertex_areas.sum())
    return [
        f"confidence {findings.confidence:.2f}; leaf {100.0 * leaf.length:.3g} cm long, {1e4 * area:.3g} cm²; "
        f"{leaf.mesh.vertex_count} vertices",
        *findings.notes,
    ]


def _with_words(picture: np.ndarray, words: list[str], base_found: str) -> np.ndarray:
    """The picture with the legend below it."""
    face = cv2.FontFace("sans")
    width = max(picture.shape[1], LEAST_WIDTH)
    # A letter is about half as wide as high.
    lines = [line for text in words for line in textwrap.wrap(text, max(20, int((width - 2 * MARGIN) / 9.8)))]
    legend = _legend_rows(width, BASE_FOUND.get(base_found, base_found))
    rows = legend[-1][1] + 1 + len(lines)
    sheet = np.full((picture.shape[0] + MARGIN + LINE_HEIGHT * rows, width, 3), PANEL, np.uint8)
    left = (width - picture.shape[1]) // 2
    sheet[: picture.shape[0], left : left + picture.shape[1]] = picture
    top = picture.shape[0]
    for name, row, x in legend:
        baseline = top + LINE_HEIGHT * row + 22
        _draw_sign(sheet, name, x, baseline - 7)
        cv2.putText(sheet, name, (x + 44, baseline), INK, face, TEXT_SIZE, 400)
    for number, line in enumerate(lines):
        baseline = top + LINE_HEIGHT * (legend[-1][1] + 1 + number) + 22
        cv2.putText(sheet, line, (MARGIN, baseline), INK if number == 0 else FAINT_INK, face, TEXT_SIZE, 400)
    return sheet


def _legend_rows(width: int, base_found: str) -> list[tuple[str, int, int]]:
    """The legend's entries in as many rows as they need: name, row, left edge."""
    face, entries, row, x = cv2.FontFace("sans"), [], 0, MARGIN
    for name in ("outline", f"{PETIOLE_BASE}, {base_found}", "veins, by what they drain", "mesh"):
        reach = 44 + cv2.getTextSize((0, 0), name, (0, 0), face, TEXT_SIZE, 400)[2]
        if x > MARGIN and x + reach > width - MARGIN:
            row, x = row + 1, MARGIN
        entries.append((name, row, x))
        x += reach + 28
    return entries


def _draw_sign(sheet: np.ndarray, name: str, x: int, y: int) -> None:
    """The sign of a legend's entry, as it stands in the picture."""
    if name.startswith(PETIOLE_BASE):
        _draw_base(sheet, np.array([x + 20, y]) << SHIFT)
        return
    colour, width = {"outline": (OUTLINE, 2), "mesh": (FAINT_INK, 1)}.get(name, (VEIN, 4))
    cv2.line(sheet, (x, y), (x + 34, y), colour, width, cv2.LINE_AA)
