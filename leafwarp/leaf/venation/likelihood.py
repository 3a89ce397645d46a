"""How much each pixel of a leaf's picture looks like a vein.

Veins are paler and less green than the lamina, so they are bright ridges of ``Lab a - 100 G/(R+G+B) + L/2``. A
directional top-hat and a bank of elongated ridge filters are multiplied (geometric mean).
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.bleed import extend_colours, inner_pixels

DIRECTIONS = 12
MARGIN = 0.008  # share of the long side along which the margin mixes with the background
THIN = 0.04  # width of a part that is all vein, as a share of the long side


def vein_likelihood(colour: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """How much each pixel looks like a vein, in [0, 1], shape [height, width], float32; 0 outside the leaf.

    Args:
        colour: 8-bit RGB, shape [height, width, 3]; some 300 to 800 pixels on the long side.
        inside: The leaf's pixels, bool.
    """
    return likelihood_of(vein_channel(colour, inside), inside)


def likelihood_of(channel: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The same from the quantity in which veins are bright, as :func:`vein_channel` gives it."""
    hat, ridge = _directional_top_hat(channel), _ridge_bank(channel)
    hat, ridge = (_by_quantile(response, inside) for response in (hat, ridge))
    likelihood = np.maximum(np.sqrt(hat * ridge), stalk_middle(inside))
    return np.where(inside, likelihood, 0.0).astype(np.float32)


def vein_channel(colour: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The quantity in which veins are bright [Lab units], float32; the leaf's colours carried past its margin.

    Arguments as for :func:`vein_likelihood`.
    """
    import cv2

    inner = inner_pixels(inside, depth=max(2.0, MARGIN * max(inside.shape)))
    filled = extend_colours(colour, inner).astype(np.float32) / 255.0
    # The extended colours are streaks across the margin, which would pass for veins: blur them.
    filled = np.where(inner[..., None], filled, cv2.GaussianBlur(filled, (0, 0), 5.0))
    lab = cv2.cvtColor(filled, cv2.COLOR_RGB2Lab)
    greenness = 100.0 * filled[..., 1] / (filled.sum(axis=2) + 1e-3)
    return cv2.GaussianBlur(lab[..., 1] - greenness + 0.5 * lab[..., 0], (0, 0), 0.8)


def stalk_middle(inside: np.ndarray) -> np.ndarray:
    """1 along the middle of parts too thin to show a vein (the petiole), falling to 0 at their margin; 0 elsewhere."""
    import cv2

    margin = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    reach = 2 * int(np.ceil(THIN * max(inside.shape))) + 1
    deepest = cv2.dilate(margin, np.ones((reach, reach), np.uint8))
    thin = deepest < 0.5 * THIN * max(inside.shape)
    return np.where(thin, (margin / np.maximum(deepest, 1.0)) ** 2, 0.0)


def _by_quantile(response: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Scaled so that the strongest 3 % reach 1; a flat picture stays at 0."""
    top = max(float(np.quantile(response[inside], 0.97)), 0.5)
    return np.clip(response, 0.0, top) / top  # past the picture's rim an opening may be as good as infinite


def _directional_top_hat(channel: np.ndarray) -> np.ndarray:
    """Best directional opening less the worst: what a line fits into along one direction only."""
    import cv2

    length = max(7, round(0.028 * max(channel.shape)) | 1)
    best = np.full_like(channel, -np.inf)
    worst = np.full_like(channel, np.inf)
    for angle in np.arange(DIRECTIONS) * (np.pi / DIRECTIONS):
        kernel = np.zeros((length, length), np.uint8)
        middle, reach = length // 2, (length // 2) * np.array([np.cos(angle), np.sin(angle)])
        ends = [tuple(np.rint(middle + sign * reach).astype(int).tolist()) for sign in (-1, 1)]
        cv2.line(kernel, *ends, 1)
        opened = cv2.morphologyEx(channel, cv2.MORPH_OPEN, kernel)
        np.maximum(best, opened, out=best)
        np.minimum(worst, opened, out=worst)
    return best - worst


def _ridge_bank(channel: np.ndarray) -> np.ndarray:
    """Largest response of second-derivative Gaussians, long along the ridge, over directions and two widths."""
    import cv2

    best = np.zeros_like(channel)
    unit = max(channel.shape) / 512.0
    for across in (1.2 * unit, 2.4 * unit):
        along = 3.0 * across
        half = int(np.ceil(2.5 * along))
        y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
        for angle in np.arange(DIRECTIONS) * (np.pi / DIRECTIONS):
            u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
            kernel = (1.0 - (v / across) ** 2) * np.exp(-0.5 * ((u / along) ** 2 + (v / across) ** 2))
            kernel -= kernel.mean()
            kernel /= np.abs(kernel).sum()
            np.maximum(best, cv2.filter2D(channel, -1, kernel.astype(np.float32)), out=best)
    return best
