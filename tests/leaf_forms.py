"""Drawn leaves of many forms, in any attitude, with the petiole's end known: for tests of the outline and its base.

A form is drawn in its own frame (base of the blade at the origin, tip along +y, length about 1) and then turned,
mirrored and scaled into the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

LAMINA, VEIN, PAPER = (70, 122, 52), (150, 180, 112), (232, 230, 224)
FINE = 3  # supersampling


@dataclass
class Form:
    """Parts of a leaf in its own frame.

    Attributes:
        blades: Closed polygons.
        veins: Polylines with their width at the start; they taper to 0.4 of it.
        stalks: Polylines with a constant width.
        base: The petiole's end, or the point where it was.
        holes: Closed polygons cut out of the blade.
    """

    blades: list[np.ndarray]
    veins: list[tuple[np.ndarray, float]]
    base: np.ndarray
    stalks: list[tuple[np.ndarray, float]] = field(default_factory=list)
    holes: list[np.ndarray] = field(default_factory=list)


def simple(
    widest: float = 0.4, width: float = 0.6, teeth: int = 0, heart: float = 0.0, pairs: int = 6, slant: float = 50.0
) -> Form:
    """A blade with pinnate veins.

    Args:
        widest: Where along the length it is widest.
        width: Greatest width.
        teeth: Teeth on each side, pointing to the tip.
        heart: Depth of the notch at the base.
        pairs: Side veins on each side.
        slant: Angle between side veins and midrib [degrees].
    """
    along = np.linspace(0.0, 1.0, 400)
    power = np.log(0.5) / np.log(widest)
    half = 0.5 * width * np.sin(np.pi * along**power) ** 0.8
    if teeth:
        half = half * (1.0 + 0.14 * ((along * teeth) % 1.0)) * (1.0 - 0.05 * along)
    dip = heart * np.exp(-(((half - 0.35 * width) / (0.2 * width)) ** 2)) * (along < widest)
    right = np.column_stack([half, along - dip * (1.0 - along / widest)])
    blade = np.concatenate([right, (right * (-1.0, 1.0))[::-1]])
    veins = [(np.array([[0.0, 0.0], [0.0, 0.97]]), 0.022)]
    toward = np.array([np.sin(np.deg2rad(slant)), np.cos(np.deg2rad(slant))])
    for foot in np.linspace(0.06, 0.8, pairs):
        reach = 0.0
        while reach < 1.0 and reach * toward[0] < 0.88 * np.interp(foot + reach * toward[1], along, half):
            reach += 0.01
        veins += [
            (np.array([[0.0, foot], [side * reach * toward[0], foot + reach * toward[1]]]), 0.01) for side in (1, -1)
        ]
    return Form([blade], veins, np.zeros(2))


def lobed(lobes: int = 5, sinus: float = 0.35) -> Form:
    """A blade with palmate veins that meet at the bottom of a notch."""
    angle = np.linspace(-0.5 * np.pi, 1.5 * np.pi, 1200)
    spread = np.deg2rad(130.0 if lobes == 3 else 250.0)
    turn = angle - 0.5 * np.pi
    ripple = 0.5 + 0.5 * np.cos(turn * (lobes - 1) * 2.0 * np.pi / spread)
    radius = (0.62 - 0.2 * np.abs(turn) / np.pi) * (1.0 - sinus * (1.0 - ripple))
    radius = radius * np.clip((np.pi - np.abs(turn)) / 0.8, 0.06, 1.0)
    blade = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    veins = []
    for lobe in np.linspace(-0.5 * spread, 0.5 * spread, lobes) + 0.5 * np.pi:
        length = 0.92 * np.interp(lobe, angle, radius)
        toward = np.array([np.cos(lobe), np.sin(lobe)])
        veins.append((np.array([0.0 * toward, length * toward]), 0.018))
        for share in (0.35, 0.6):
            for side in (0.8, -0.8):
                way = np.array([np.cos(lobe + side), np.sin(lobe + side)])
                veins.append((np.array([share * length * toward, share * length * toward + 0.2 * length * way]), 0.008))
    return Form([blade], veins, np.array([0.0, -0.03]))


def grass() -> Form:
    """A long blade with parallel veins, cut at its base."""
    along = np.linspace(0.0, 1.0, 200)
    half = 0.05 * np.sqrt(np.clip(1.0 - along**3, 0.0, 1.0))
    right = np.column_stack([half, along])
    lines = [np.column_stack([share * half[:-8], along[:-8]]) for share in np.linspace(-0.8, 0.8, 9)]
    return Form([np.concatenate([right, (right * (-1.0, 1.0))[::-1]])], [(line, 0.005) for line in lines], np.zeros(2))


def compound(pairs: int = 3) -> Form:
    """Leaflets along a stalk."""
    leaflet = simple(widest=0.45, width=0.55, pairs=5)
    form = Form([], [], np.array([0.0, -0.25]), [(np.array([[0.0, -0.25], [0.0, 0.75]]), 0.022)])
    feet = [(0.0, height, side * 1.1) for height in np.linspace(0.12, 0.6, pairs) for side in (1, -1)]
    for x, y, turn in [*feet, (0.0, 0.72, 0.0)]:
        turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]).T * 0.3
        shift = np.array([x, y]) + 0.06 * np.array([np.sin(turn), np.cos(turn)])
        form.blades += [points @ turned.T @ np.diag([1.0, 1.0]) + shift for points in leaflet.blades]
        form.veins += [(points @ turned.T + shift, 0.3 * width) for points, width in leaflet.veins]
        form.stalks.append((np.array([[x, y], shift + 0.02 * np.array([np.sin(turn), np.cos(turn)])]), 0.014))
    return form


def with_stalk(form: Form, length: float = 0.25, width: float = 0.03, bend: float = 0.0) -> Form:
    """The form with a petiole, bent to a circle's arc of so many radians."""
    along = np.linspace(-0.04, 1.0, 40)
    angle = bend * np.clip(along, 0.0, 1.0)
    steps = np.column_stack([np.sin(angle), -np.cos(angle)]) * (length * np.diff(along, prepend=along[0])[:, None])
    line = np.array([0.0, 0.04 * length]) + form.base + np.cumsum(steps, axis=0)
    return Form(form.blades, form.veins, line[-1], [*form.stalks, (line, width)], form.holes)


@dataclass(frozen=True)
class Drawn:
    """A picture, 8-bit RGB, the leaf's coverage in [0, 1], and in pixels its petiole's end and the leaf's length."""

    picture: np.ndarray
    cover: np.ndarray
    base: np.ndarray
    length: float


def draw(
    form: Form, turn: float = 0.0, mirror: bool = False, pixels: float = 360.0, veins: bool = True, stalk_colour=None
) -> Drawn:
    """A photo of a form.

    Args:
        form: What to draw.
        turn: Anticlockwise turn [degrees].
        mirror: Whether to mirror it first.
        pixels: Size of the form's unit in the photo.
        veins: Whether to draw its veins.
        stalk_colour: RGB of the petiole; the lamina's if None.
    """
    angle = np.deg2rad(turn)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * pixels
    matrix = np.diag([1.0, -1.0]) @ matrix @ np.diag([-1.0 if mirror else 1.0, 1.0])
    everything = np.concatenate(form.blades + [line for line, _ in form.stalks]) @ matrix.T
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.12 * (high - low).max()
    width, height = np.ceil(high - low + 2.0 * margin).astype(int).tolist()
    place = lambda points: points @ matrix.T + margin - low  # noqa: E731
    fine = np.zeros((height * FINE, width * FINE), np.uint8)
    for blade in form.blades:
        cv2.fillPoly(fine, [_fixed(place(blade) * FINE)], 255, shift=6)
    stalk = np.zeros_like(fine)
    for line, thickness in form.stalks:
        cv2.polylines(
            stalk, [_fixed(place(line) * FINE)], False, 255, max(1, round(thickness * pixels * FINE)), shift=6
        )
        _cut_cap(stalk, place(line) * FINE, thickness * pixels * FINE)
    for hole in form.holes:
        cv2.fillPoly(fine, [_fixed(place(hole) * FINE)], 0, shift=6)
    cover = cv2.resize(np.maximum(fine, stalk), (width, height), interpolation=cv2.INTER_AREA)[..., None] / 255.0
    stalk_cover = cv2.resize(stalk & ~fine, (width, height), interpolation=cv2.INTER_AREA)[..., None] / 255.0
    leaf = np.broadcast_to(np.array(LAMINA, float), (height, width, 3))
    if veins:
        leaf = leaf + _veins(form, place, pixels, (height, width))[..., None] * np.subtract(VEIN, LAMINA)
    leaf = leaf * (1.0 - stalk_cover) + stalk_cover * np.array(LAMINA if stalk_colour is None else stalk_colour)
    grain = np.random.default_rng(5).normal(0.0, 1.5, (height, width, 1))
    paper = np.array(PAPER) * np.linspace(1.0, 0.95, width)[None, :, None]
    picture = np.clip(np.rint(paper * (1.0 - cover) + leaf * cover + grain), 0, 255).astype(np.uint8)
    base = place(form.base[None])[0]
    return Drawn(picture, cover[..., 0], base, float(np.linalg.norm(everything + margin - low - base, axis=1).max()))


def _fixed(points: np.ndarray) -> np.ndarray:
    return np.rint((points - 0.5) * 64).astype(np.int32)


def _cut_cap(stalk: np.ndarray, line: np.ndarray, thickness: float) -> None:
    """Take away the round cap past a stalk's last point, so that it ends where it is said to."""
    way = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    side = np.array([-way[1], way[0]]) * thickness
    square = np.array(
        [line[-1] - side, line[-1] + side, line[-1] + side + way * thickness, line[-1] - side + way * thickness]
    )
    cv2.fillPoly(stalk, [_fixed(square)], 0, shift=6)


def _veins(form: Form, place, pixels: float, shape: tuple[int, int]) -> np.ndarray:
    """Share of the vein's colour at each pixel, shape [height, width]."""
    fine = np.zeros((shape[0] * FINE, shape[1] * FINE), np.uint8)
    for line, width in form.veins:
        count = 12
        arc = np.linspace(0.0, len(line) - 1.0, count + 1)
        points = place(np.column_stack([np.interp(arc, np.arange(len(line)), line[:, axis]) for axis in (0, 1)])) * FINE
        for index in range(count):
            thickness = max(1, round(width * (1.0 - 0.6 * index / count) * pixels * FINE))
            cv2.line(fine, *_fixed(points[index : index + 2]).tolist(), 255, thickness, shift=6)
    cover = cv2.resize(fine, shape[::-1], interpolation=cv2.INTER_AREA) / 255.0
    return cv2.GaussianBlur(cover, (0, 0), 0.8)
