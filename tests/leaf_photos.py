"""Drawn photos of leaves of known shape before all kinds of backgrounds, and of things that are no leaf."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

FINE = 1600  # [pixels] bound of the side that shapes are supersampled to, by at most 4
BACKGROUNDS = ("white", "grey", "black", "blue", "red", "green", "grid", "wood")
OTHER_THINGS = ("plain", "noise", "slope", "text", "face", "landscape", "checker", "crowd", "green slope", "window")
PLAIN = {
    "white": (242, 241, 236),
    "grey": (150, 149, 153),
    "black": (22, 22, 25),
    "blue": (50, 90, 165),
    "red": (165, 55, 60),
    "green": (150, 190, 165),
}


@dataclass(frozen=True)
class LeafPhoto:
    """A drawn photo with its truth.

    Attributes:
        colour: 8-bit RGB, shape [side, side, 3].
        leaf: The leaf, holes filled, bool, shape [side, side].
        petiole: Its petiole alone, bool.
        hole: Its hole, bool.
    """

    colour: np.ndarray
    leaf: np.ndarray
    petiole: np.ndarray
    hole: np.ndarray


def leaf_photo(
    background: str = "white",
    seed: int = 0,
    *,
    side: int = 400,
    shadow: float = 0.35,
    glare: bool = False,
    spots: int = 4,
    hole: bool = False,
    ruler: bool = False,
    dirt: int = 6,
    colour: tuple[int, int, int] = (70, 120, 45),
    size: float = 0.3,
    leaflets: int = 0,
) -> LeafPhoto:
    """A serrated leaf with a petiole.

    Args:
        background: One of BACKGROUNDS.
        seed: Of its shape, place and grain.
        side: Of the picture [pixels].
        shadow: Light that its cast shadow takes.
        glare: A soft white reflection on the blade.
        spots: Brown spots on the blade.
        hole: A hole through the blade.
        ruler: A black and white scale bar beside it.
        dirt: Dark specks about it.
        colour: Of the blade.
        size: Half its blade's length as a share of the side.
        leaflets: Pairs of leaflets on a stalk (a compound leaf) in place of the one blade.
    """
    random = np.random.default_rng(seed)
    shapes = _shapes(random, side, size, leaflets, hole)
    cover, petiole, gap = (_coverage(polygons, side) for polygons in shapes)
    present = np.maximum(cover - gap, 0.0)
    ground = _ground(background, side, random)
    offset = max(2, side // 60)
    shade = cv2.GaussianBlur(np.roll(present, (offset, offset + 1), (0, 1)), (0, 0), 0.007 * side)[..., None]
    ground = _with_things(ground, cover, side, ruler, dirt, random) * (1.0 - shadow * shade)
    lamina = _lamina(cover, side, colour, spots, glare, random)
    lamina = np.where(petiole[..., None] > 0.5, np.array(colour) * (1.25, 1.05, 1.1), lamina)
    picture = ground * (1.0 - present[..., None]) + lamina * present[..., None]
    picture = cv2.GaussianBlur(picture, (0, 0), 0.6) + random.normal(0.0, 2.0, (side, side, 1))
    return LeafPhoto(
        np.clip(np.rint(picture), 0, 255).astype(np.uint8), _without_gaps(cover > 0.5), petiole > 0.5, gap > 0.5
    )


def other_thing(kind: str, side: int = 320, seed: int = 0) -> np.ndarray:
    """A picture of something else, one of OTHER_THINGS, 8-bit RGB."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] / side
    flat = np.ones((side, side, 3))
    if kind == "plain":
        picture = flat * (120, 150, 100)
    elif kind == "noise":
        picture = random.uniform(0, 255, (side, side, 3))
    elif kind == "slope":
        picture = flat * (60 + 160 * x[..., None])
    elif kind == "green slope":
        picture = flat * (40, 90, 30) * (0.6 + y[..., None]) + random.normal(0, 5, (side, side, 1))
    elif kind == "checker":
        picture = flat * np.where(((x * 8).astype(int) + (y * 8).astype(int)) % 2, 220, 40)[..., None]
    else:
        picture = _drawn_thing(kind, side, random) + random.normal(0, 2, (side, side, 1))
    return np.clip(picture, 0, 255).astype(np.uint8)


def _drawn_thing(kind: str, side: int, random: np.random.Generator) -> np.ndarray:
    picture = np.full((side, side, 3), 245.0)
    if kind == "text":
        page = picture.astype(np.uint8)
        for line in range(24, side - 10, 22):
            cv2.putText(page, "Lorem ipsum dolor sit amet, con", (14, line), 0, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
        picture = page.astype(float)
    elif kind == "face":
        picture[:] = random.uniform(60, 200, (8, 8, 3)).repeat(side // 8, 0).repeat(side // 8, 1)
        cv2.ellipse(picture, (side // 2, side), (side // 2, side // 3), 0, 0, 360, (40.0, 50.0, 120.0), -1)
        cv2.ellipse(picture, (side // 2, side // 2), (side // 5, side // 4), 0, 0, 360, (215.0, 170.0, 145.0), -1)
        for eye in (-1, 1):
            cv2.circle(picture, (side // 2 + eye * side // 12, side // 2 - 20), side // 40, (40.0, 30.0, 30.0), -1)
    elif kind == "landscape":
        picture[:] = (130, 175, 225)
        corners = [
            (0, side),
            *((x, side * (0.55 + 0.1 * np.sin(x / 37.0))) for x in range(0, side + 1, 8)),
            (side, side),
        ]
        cv2.fillPoly(picture, [np.array(corners, np.int32)], (70.0, 120.0, 60.0))
        for _ in range(300):
            spot = (int(random.integers(side)), int(random.integers(int(0.66 * side), side)))
            cv2.circle(picture, spot, 4, [float(value) for value in random.uniform(30, 140, 3)], -1)
    elif kind == "crowd":
        for _ in range(140):
            spot = tuple(int(value) for value in random.integers(0, side, 2))
            cv2.circle(picture, spot, int(random.integers(6, 22)), [float(v) for v in random.uniform(0, 255, 3)], -1)
    elif kind == "window":
        picture[:] = (60, 60, 66)
        third = side // 3
        cv2.rectangle(picture, (third, third), (2 * third, 2 * third), (60.0, 110.0, 240.0), -1)
    return picture


def _shapes(
    random: np.random.Generator, side: int, size: float, leaflets: int, hole: bool
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Polygons of the whole leaf, of its petiole and of its hole [pixels]."""
    turn = random.uniform(0.0, 2.0 * np.pi)
    axis, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    centre = side * (0.5 + random.uniform(-0.05, 0.05, 2)) + 0.05 * side * axis
    half, slim = size * side, random.uniform(0.5, 0.7)
    thick = 0.011 * side

    def stalk(start: float, end: float) -> np.ndarray:
        along = np.linspace(start, end, 20)[:, None]
        middle = centre + along * half * axis + 0.05 * half * np.sin(3.0 * along) * across
        return np.concatenate([middle + thick * across, (middle - thick * across)[::-1]])

    def blade(middle: np.ndarray, long: np.ndarray, length: float, width: float) -> np.ndarray:
        angle = np.linspace(0.0, 2.0 * np.pi, 1500, endpoint=False)
        teeth = 1.0 + 0.05 * np.abs(np.sin(14.0 * angle))
        other = np.array([-long[1], long[0]])
        taper = 1.0 - 0.25 * np.cos(angle)
        return middle + teeth[:, None] * (
            length * np.cos(angle)[:, None] * long + width * (taper * np.sin(angle))[:, None] * other
        )

    petiole = stalk(-1.55, -0.9)
    if leaflets:
        petiole = stalk(-1.3, 0.75)
        whole = [petiole, blade(centre + 0.85 * half * axis, axis, 0.32 * half, 0.17 * half)]
        for place in np.linspace(-0.7, 0.45, leaflets):
            for hand in (-1.0, 1.0):
                long = 0.35 * axis + hand * across
                long /= np.linalg.norm(long)
                foot = centre + place * half * axis
                whole.append(blade(foot + 0.36 * half * long, long, 0.33 * half, 0.14 * half))
        return whole, [petiole], []
    gap = [blade(centre + 0.3 * half * across, axis, 0.13 * half, 0.1 * half)] if hole else []
    return [blade(centre, axis, half, slim * half), petiole], [petiole], gap


def _coverage(polygons: list[np.ndarray], side: int) -> np.ndarray:
    finer = min(4, max(2, FINE // side))
    fine = np.zeros((side * finer, side * finer), np.uint8)
    for polygon in polygons:
        cv2.fillPoly(fine, [np.rint(polygon * finer * 16).astype(np.int32)], 255, shift=4)
    return cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA) / 255.0


def _without_gaps(leaf: np.ndarray) -> np.ndarray:
    """A leaf with the background filled that leaflets enclose."""
    flood = np.pad(leaf, 1).astype(np.uint8)
    cv2.floodFill(flood, None, (0, 0), 2)
    return flood[1:-1, 1:-1] != 2


def _ground(background: str, side: int, random: np.random.Generator) -> np.ndarray:
    """The background, unevenly lit, float RGB."""
    y, x = np.mgrid[:side, :side] / side
    light = (0.93 + 0.1 * x * random.choice((-1, 1)) + 0.05 * y)[..., None]
    if background == "grid":
        ground = np.full((side, side, 3), (244.0, 240.0, 238.0))
        for step, tint in ((side // 50, (240, 200, 195)), (side // 10, (225, 150, 140))):
            ground[::step] = tint
            ground[:, ::step] = tint
        ground = cv2.GaussianBlur(ground, (0, 0), 0.5)
    elif background == "wood":
        grain = cv2.GaussianBlur(random.normal(0.0, 1.0, (side, side)), (0, 0), sigmaX=0.2 * side, sigmaY=1.2)
        grain = grain / grain.std() + 0.8 * np.sin(40.0 * y + 4.0 * np.sin(3.0 * x))
        ground = np.array((168.0, 122.0, 82.0)) * (1.0 + 0.07 * grain[..., None])
    else:
        ground = np.full((side, side, 3), PLAIN[background], float)
    coarse = cv2.GaussianBlur(random.normal(0.0, 1.0, (side, side)), (0, 0), 2.0)
    return ground * light * (1.0 + 0.02 * coarse / coarse.std())[..., None]


def _with_things(
    ground: np.ndarray, cover: np.ndarray, side: int, ruler: bool, dirt: int, random: np.random.Generator
) -> np.ndarray:
    ground = ground.copy()
    if ruler:
        high, left = side // 28, int(0.04 * side)
        top = side - 2 * high if cover[-3 * high :, : side // 2].max() == 0.0 else high
        for block in range(8):
            ground[top : top + high, left + block * high : left + (block + 1) * high] = 20.0 if block % 2 else 245.0
    for _ in range(dirt):
        spot = tuple(int(value) for value in random.integers(0, side, 2))
        cv2.circle(ground, spot, max(1, side // 250), (70.0, 60.0, 50.0), -1, cv2.LINE_AA)
    return ground


def _lamina(
    cover: np.ndarray, side: int, colour: tuple[int, int, int], spots: int, glare: bool, random: np.random.Generator
) -> np.ndarray:
    coarse = cv2.GaussianBlur(random.normal(0.0, 1.0, (side, side)), (0, 0), 0.02 * side)
    lamina = np.array(colour, float) * (1.0 + 0.08 * coarse / coarse.std())[..., None]
    rows, columns = np.nonzero(cover > 0.5)
    for _ in range(spots):
        at = int(random.integers(len(rows)))
        brown = [float(value) for value in np.add((125, 82, 45), random.uniform(-15, 15, 3))]
        cv2.circle(lamina, (int(columns[at]), int(rows[at])), int(random.integers(side // 100, side // 35)), brown, -1)
    if glare:
        y, x = np.mgrid[:side, :side]
        away = np.hypot(x - columns.mean() - 0.03 * side, y - rows.mean()) / (0.05 * side)
        lamina += (255.0 - lamina) * 0.9 * np.exp(-0.5 * away**2)[..., None]
    return lamina
