"""Which part of the picture is the leaf.

The border of the picture shows the background: its colours, clustered in Lab, and darkened copies of them (a
shadow changes the lightness of paper far more than its chromaticity) form the background model. The distance
of every pixel to the nearest model colour is split by Otsu's threshold; the largest piece is the leaf.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.photo import Photo

WORK_SIDE = 1024  # [pixels] bound of the picture's long side while segmenting
LIGHTNESS_WEIGHT = 0.6  # lightness counts less than chromaticity: illumination is uneven
SHADES = np.linspace(1.08, 0.28, 14)  # a shadow may take 72 % of the light
SHADES_OF_GREY = np.linspace(1.08, 0.7, 6)  # without colour a darker leaf would pass for shadow
LEAST_COLOUR = 4.0  # [Lab units] spread of a and b below which a picture is grey
SAME_COLOUR = 1.0  # [Lab units] model colours nearer than this are one
LEAST_THRESHOLD = 6.0  # [Lab units] below this a difference is paper grain
LEAST_CONTRAST = 9.0  # [Lab units] between the medians of leaf and background
LEAST_SHARE = 0.003  # of the picture
MOST_BORDER = 0.6  # of the picture's border that a leaf with a background may touch


@dataclass(frozen=True)
class Silhouette:
    """The leaf's shape as a smooth field.

    Attributes:
        field: Positive on the leaf, negative off it, in [-1, 1], top row first, shape [height, width],
            float32.
        scale: Photo pixels per pixel of the field, (x, y).
    """

    field: np.ndarray
    scale: tuple[float, float]

    @property
    def inside(self) -> np.ndarray:
        """The leaf's pixels, shape [height, width], bool."""
        return self.field > 0.0


def silhouette(photo: Photo, mask: np.ndarray | None = None, mask_path: Path | None = None) -> Silhouette:
    """The leaf of a photo.

    Args:
        photo: The picture; where it has an opacity and no mask is given, the opacity is the mask.
        mask: Optional grey picture in [0, 1] of the same frame (any size), above 0.5 on the leaf.
        mask_path: Where the mask came from, for messages.

    Raises:
        InputError: Nothing stands out from the background, or no background is left.
    """
    import cv2

    width, height = photo.size
    shrink = min(1.0, WORK_SIDE / max(width, height))
    size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
    scale = (width / size[0], height / size[1])
    if mask is None and photo.alpha is not None:
        mask = photo.alpha / np.float32(255.0)
    if mask is not None:
        field = 2.0 * cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) - 1.0
        inside = _largest_piece(field > 0.0)
        if np.count_nonzero(inside) < 16:
            raise InputError(
                f"{mask_path or photo.path}: mask: no leaf in it; accepted: a mask that is light on the leaf"
            )
    else:
        colour = cv2.resize(photo.colour, size, interpolation=cv2.INTER_AREA)
        field, inside = _against_background(photo, colour)
    inside = _filled(inside)
    # The sign follows the cleaned shape, the magnitude keeps the sub-pixel position of the margin.
    field = np.where(inside, np.maximum(field, 0.25), np.minimum(field, -0.25))
    return Silhouette(np.clip(field, -1.0, 1.0).astype(np.float32), scale)


def _against_background(photo: Photo, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Field and shape of what differs from the border's colours."""
    import cv2

    lab = cv2.cvtColor(cv2.GaussianBlur(colour, (0, 0), 0.8).astype(np.float32) / 255.0, cv2.COLOR_RGB2Lab)
    distance = _distance(lab, _background_colours(lab))
    threshold = max(_otsu(distance), LEAST_THRESHOLD)
    certain = distance > threshold
    # A thin petiole differs less than the blade (blur mixes it with paper): follow it from the blade
    # outwards.
    likely = distance > max(0.55 * threshold, LEAST_THRESHOLD)
    likely = cv2.morphologyEx(likely.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
    blade = _largest_piece(certain)
    inside = _largest_piece(certain | (likely & _near(blade, likely)), seed=blade)
    _refuse_no_leaf(photo, distance, inside)
    return (distance - threshold) / threshold, inside


def _near(blade: np.ndarray, likely: np.ndarray) -> np.ndarray:
    """Thin stretches of the likely pixels: what an opening removes. A broad faint patch is a shadow, not a petiole."""
    import cv2

    radius = max(2, round(0.012 * max(blade.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    faint = (likely & ~blade).astype(np.uint8)
    return (faint > 0) & (cv2.morphologyEx(faint, cv2.MORPH_OPEN, disc) == 0)


def _background_colours(lab: np.ndarray) -> np.ndarray:
    """Lab colours of the background model, shape [count, 3]: border clusters and their darkened copies."""
    import cv2

    rows, columns = lab.shape[:2]
    ring = max(2, round(0.015 * min(rows, columns)))
    sides = [side.reshape(-1, 3) for side in (lab[:ring], lab[-ring:], lab[:, :ring], lab[:, -ring:])]
    sides = [side[:: max(1, len(side) // 1500)] for side in sides]
    samples = np.ascontiguousarray(np.concatenate(sides))
    side_of = np.repeat(np.arange(4), [len(side) for side in sides])
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.2)
    _, labels, centres = cv2.kmeans(samples, 5, None, criteria, 2, cv2.KMEANS_PP_CENTERS)
    share = np.zeros((5, 4))
    np.add.at(share, (labels.ravel(), side_of), 1.0)
    share /= share.sum(axis=0)
    # A leaf that runs off the picture crosses one or two sides; the background is seen on three or four.
    common = (share > 0.04).sum(axis=1) >= 3
    centres = centres[common] if common.any() else centres[[np.argmax(share.sum(axis=1))]]
    linear = cv2.cvtColor(centres[None].astype(np.float32), cv2.COLOR_Lab2LRGB)[0]
    coloured = np.ptp(np.quantile(lab[..., 1:], (0.01, 0.99), axis=(0, 1)), axis=0).max() > LEAST_COLOUR
    light = (SHADES if coloured else SHADES_OF_GREY).astype(np.float32)
    shades = np.clip(linear[None] * light[:, None, None], 0.0, 1.0)
    colours = cv2.cvtColor(shades.reshape(1, -1, 3), cv2.COLOR_LRGB2Lab)[0]
    kept = colours[:1]
    for colour in colours[1:]:  # shades of like clusters coincide
        if np.abs(kept - colour).max(axis=1).min() > SAME_COLOUR:
            kept = np.concatenate([kept, colour[None]])
    return kept


def _distance(lab: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Distance of each pixel to the nearest of the colours, shape [height, width], float32."""
    weight = np.array([LIGHTNESS_WEIGHT, 1.0, 1.0], np.float32)
    pixels, models = lab.reshape(-1, 3) * weight, (colours * weight).astype(np.float32)
    squares = np.empty(len(pixels), np.float32)
    for first in range(0, len(pixels), 1 << 15):
        chunk = pixels[first : first + (1 << 15)]
        nearest = (np.einsum("ij,ij->i", models, models)[None] - 2.0 * chunk @ models.T).min(axis=1)
        squares[first : first + len(chunk)] = np.einsum("ij,ij->i", chunk, chunk) + nearest
    return np.sqrt(np.maximum(squares, 0.0)).reshape(lab.shape[:2])


def _otsu(distance: np.ndarray) -> float:
    import cv2

    top = max(float(np.quantile(distance, 0.995)), 1e-3)
    bytes_ = np.clip(distance * (255.0 / top), 0.0, 255.0).astype(np.uint8)
    threshold, _ = cv2.threshold(bytes_, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return threshold * top / 255.0


def _refuse_no_leaf(photo: Photo, distance: np.ndarray, inside: np.ndarray) -> None:
    """Raise InputError where what was found is no leaf before a background."""
    hint = "accepted: one leaf before a plain background, or a mask"
    share = inside.mean()
    border = np.concatenate([inside[0], inside[-1], inside[:, 0], inside[:, -1]])
    if share < LEAST_SHARE:
        raise InputError(f"{photo.path}: no leaf found (nothing stands out from the background); {hint}")
    if border.mean() > MOST_BORDER or share > 0.95:
        raise InputError(f"{photo.path}: no background found (the leaf fills the picture); {hint}")
    contrast = np.median(distance[inside]) - np.median(distance[~inside])
    spread = np.quantile(distance[~inside], 0.9) - np.median(distance[~inside])
    if contrast < max(LEAST_CONTRAST, 1.5 * spread):
        raise InputError(
            f"{photo.path}: no leaf found (it differs from the background by {contrast:.1f} Lab units; "
            f"needed: {max(LEAST_CONTRAST, 1.5 * spread):.1f}); {hint}"
        )


def _largest_piece(mask: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
    """The largest connected piece of a mask, or the one that shares most pixels with a seed."""
    import cv2

    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return np.zeros_like(mask, bool)
    sizes = np.bincount(labels[mask if seed is None else mask & seed], minlength=count)
    sizes[0] = 0
    return labels == np.argmax(sizes)


def _filled(inside: np.ndarray) -> np.ndarray:
    """A shape without holes: whatever a flood from outside the picture does not reach."""
    import cv2

    outside = np.pad(~inside, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(outside, connectivity=4)
    return (labels != labels[0, 0])[1:-1, 1:-1]
