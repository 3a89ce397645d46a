"""From a leaf's fields to linear-light colour: relief, light from the upper left, pigments, veins, margin."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .leaves import LeafFields
from .outline import Petiole
from .raster import blur, linear, noise, smoothstep

LIGHT = np.array([-0.46, -0.52, 0.72], np.float32)  # towards the light; picture axes, z to the viewer


@dataclass(frozen=True)
class Palette:
    """Colours as "#rrggbb" and the strength of relief and veins."""

    lamina: str
    shade: str  # where the lamina is darkest
    fresh: str  # where it is most yellow
    vein: str
    petiole: str
    margin: str
    blemish: str = "#6f5a33"
    quilting: float = 1.0  # height of the domes between the veins
    network: float = 1.0  # contrast of the finest veins
    fold: float = 0.10  # slope of the two halves up from the midrib
    waves: float = 1.0  # height of the lamina's slow undulation
    gloss: float = 0.10
    blemishes: int = 14
    vein_strength: float = 0.9


def mix(under: np.ndarray, over: np.ndarray, share: np.ndarray | float) -> np.ndarray:
    """Linear blend, with `share` of the second colour."""
    share = share[..., None] if isinstance(share, np.ndarray) else share
    return under + (over - under) * share


def inner_distance(inside: np.ndarray) -> np.ndarray:
    """Distance in pixels from each inside pixel to the nearest outside pixel."""
    return cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def relief(
    fields: LeafFields, veins: list[np.ndarray], ladder: np.ndarray, mesh: np.ndarray, palette: Palette
) -> np.ndarray:
    """Height of the surface in pixels: domes between sunken veins, on two scales, and a wavy lamina."""
    scale = fields.shape.placement.scale
    main = inner_distance(np.maximum(veins[0], veins[1]) < 0.35)
    dome = 1.0 - np.exp(-main / (0.020 * scale))
    small = 1.0 - np.exp(-inner_distance(veins[2] < 0.35) / (0.008 * scale))
    areole = np.minimum(ladder / (0.0065 * scale), 1.0) ** 0.6
    finest = np.minimum(mesh / (0.0028 * scale), 1.0) ** 0.7
    waves = noise(fields.size, 0.16 * scale, fields.rng) + 0.5 * noise(fields.size, 0.06 * scale, fields.rng)
    between = 1.0 - blur(np.max(veins, axis=0), 0.8)
    height = palette.quilting * (
        0.0085 * scale * blur(dome, 0.004 * scale)
        + 0.0016 * scale * small
        + between * scale * (0.0016 * blur(areole, 0.9) + 0.00045 * finest)
    )
    ridge = blur(veins[0], 0.0022 * scale) * 0.0040 * scale + blur(veins[1], 0.0012 * scale) * 0.0011 * scale
    x, y = fields.coordinates
    fold = palette.fold * scale * np.hypot(x, 0.02)
    if fields.shape.parallel is not None:  # below the collar the leaf is rolled into a sheath
        fold += smoothstep(0.012, -0.012, y) * (-27.0 * scale * x**2 - fold)
    return height + ridge + fold + palette.waves * 0.0030 * scale * waves


def shade(height: np.ndarray, gloss: float) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse light (about 1 on level ground) and highlights of a height field."""
    slope_y, slope_x = np.gradient(blur(height, 0.8))
    norm = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    light = LIGHT / np.linalg.norm(LIGHT)
    diffuse = np.clip((-slope_x * light[0] - slope_y * light[1] + light[2]) / norm, 0.0, None)
    half = light + np.array([0.0, 0.0, 1.0], np.float32)
    half /= np.linalg.norm(half)
    facing = np.clip((-slope_x * half[0] - slope_y * half[1] + half[2]) / norm, 0.0, 1.0)
    return 0.30 + 0.70 * diffuse / light[2], gloss * facing**22


def lamina_colour(fields: LeafFields, palette: Palette, veins: list[np.ndarray], edge: np.ndarray) -> np.ndarray:
    """Pigment of the lamina: green that varies slowly, deeper between veins, fresher beside them."""
    scale = fields.shape.placement.scale
    slow = noise(fields.size, 0.22 * scale, fields.rng) + 0.7 * noise(fields.size, 0.07 * scale, fields.rng)
    speckle = noise(fields.size, 0.007 * scale, fields.rng)
    near = blur(np.maximum(veins[0], veins[1]), 0.012 * scale)
    base = np.broadcast_to(linear(palette.lamina), (*fields.size, 3))
    deep = np.clip(0.30 + 0.22 * slow + 0.05 * speckle - 1.1 * near, 0.0, 0.8)
    base = mix(base, linear(palette.shade), deep)
    fresh = np.clip(0.06 - 0.16 * slow + 0.9 * near + 0.04 * speckle, 0.0, 0.75)
    base = mix(base, linear(palette.fresh), fresh)
    rim = np.exp(-edge / (0.0030 * scale))
    base = mix(base, linear(palette.margin), 0.75 * rim)
    if fields.shape.parallel is None:
        return base
    y = fields.coordinates[1]
    base = mix(base, linear(palette.petiole), 0.55 * smoothstep(0.02, -0.02, y))
    return mix(base, linear(palette.vein), 0.75 * np.exp(-((y / 0.0045) ** 2)))  # the collar


def vein_presence(veins: list[np.ndarray], edge: np.ndarray, scale: float) -> np.ndarray:
    """How much of the veins' own colour shows: soft-edged, and less toward the margin."""
    outward = 0.60 + 0.40 * smoothstep(0.0, 0.16 * scale, edge)
    soft = [0.75 * vein + 0.25 * blur(vein, 0.0014 * scale) for vein in veins]
    return np.maximum(soft[0], outward * np.maximum(0.94 * soft[1], 0.72 * soft[2]))


def blemishes(fields: LeafFields, palette: Palette, colour: np.ndarray) -> np.ndarray:
    """The colour with brown specks, each with a yellow halo, and pale blotches."""
    scale = fields.shape.placement.scale
    candidates = np.argwhere(fields.lamina > 0.99)
    wobble = 1.0 + 0.25 * noise(fields.size, 0.008 * scale, fields.rng)
    # A share of the list rather than an index: one pixel more or less does not move every blemish.
    chosen = (fields.rng.random(palette.blemishes) * len(candidates)).astype(int)
    for row, column in candidates[chosen]:
        size = 0.0022 * scale * (1.0 + 2.2 * fields.rng.random() ** 3)
        reach = int(8 * size)
        window = np.s_[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        rows, columns = np.ogrid[window]
        away = np.hypot(rows - row, columns - column) / size * wobble[window]
        halo = mix(colour[window], linear(palette.fresh), 0.35 * np.exp(-((away / 2.6) ** 2)))
        colour[window] = mix(halo, linear(palette.blemish), 0.75 * smoothstep(1.35, 0.6, away))
    blotch = noise(fields.size, 0.045 * scale, fields.rng)
    return mix(colour, linear(palette.fresh), 0.22 * smoothstep(1.3, 2.3, blotch))


def paint_petiole(fields: LeafFields, petiole: Petiole, palette: Palette, colour: np.ndarray) -> np.ndarray:
    """The colour with a round stalk laid over it, greener toward the lamina and brown where it was cut."""
    x, y = fields.coordinates
    curve, widths = petiole.curve()[::-1], petiole.widths()[::-1]
    across = (x - np.interp(y, curve[:, 1], curve[:, 0])) / (0.5 * np.interp(y, curve[:, 1], widths))
    across = np.clip(across, -1.0, 1.0)
    light = LIGHT / np.linalg.norm(LIGHT)
    facing = np.clip(across * light[0] + np.sqrt(1.0 - across**2) * light[2], 0.0, None)
    diffuse = 0.42 + 0.58 * facing / light[2]
    shine = 0.10 * np.exp(-(((across + 0.38) / 0.16) ** 2))
    end = float(curve[0, 1])
    streaks = 1.0 + 0.04 * noise(fields.size, 0.006 * fields.shape.placement.scale, fields.rng)
    share = np.clip(y / end, 0.0, 1.0)
    pale = np.broadcast_to(linear(palette.vein), colour.shape)
    stalk = mix(pale, linear(palette.petiole), 0.35 + 0.65 * share**0.6)
    stalk = mix(stalk, linear(palette.blemish), 0.8 * smoothstep(end + 0.012, end + 0.002, y))
    stalk = stalk * (diffuse * streaks)[..., None] + shine[..., None]
    over = fields.petiole * smoothstep(0.020, 0.002, y)
    return mix(colour, stalk, np.maximum(over, fields.petiole * (1.0 - fields.lamina)))


def paint_leaf(fields: LeafFields, palette: Palette) -> np.ndarray:
    """Linear-light RGB of the leaf, defined on every pixel of the picture."""
    scale = fields.shape.placement.scale
    ladder, mesh = fields.network(fields.shape.network.ladder), fields.network(fields.shape.network.mesh)
    veins = [fields.veins(order) for order in range(3)]
    edge = inner_distance(fields.lamina > 0.5)
    colour = lamina_colour(fields, palette, veins, edge)
    colour = blemishes(fields, palette, colour)
    vein = linear(palette.vein)
    calm = smoothstep(0.0, 0.012 * scale, edge) * 0.6 + 0.4
    colour = mix(colour, vein, 0.13 * palette.network * calm * np.exp(-((mesh / 0.55) ** 2)))
    colour = mix(colour, vein, 0.36 * palette.network * calm * np.exp(-((ladder / (0.0009 * scale)) ** 2)))
    colour = mix(colour, vein, palette.vein_strength * vein_presence(veins, edge, scale))
    diffuse, gloss = shade(relief(fields, veins, ladder, mesh, palette), palette.gloss)
    sheen = gloss * (0.7 + 0.3 * np.clip(noise(fields.size, 0.12 * scale, fields.rng), -1, 2))
    colour = colour * diffuse[..., None] + sheen[..., None] * np.array([0.86, 1.0, 0.92], np.float32)
    petiole = fields.shape.petiole
    return colour if petiole is None else paint_petiole(fields, petiole, palette, colour)
