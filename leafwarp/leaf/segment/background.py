"""The background's colours, as the border of a picture shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LIGHTNESS_WEIGHT = 0.6  # lightness counts less than chromaticity: illumination is uneven
CLUSTERS = 6
LEAST_SIDES = 3  # of the picture: a leaf that runs off it crosses one or two, the background is seen on three or four
LEAST_SHARE = 0.02  # of a side's pixels; thin grid lines have little more
SAME_COLOUR = 2.0  # [Lab units] model colours nearer than this are one
LEAST_COLOUR = 4.0  # [Lab units] spread of a and b below which a picture is grey
WEIGHT = np.array([LIGHTNESS_WEIGHT, 1.0, 1.0], np.float32)


@dataclass(frozen=True)
class Background:
    """Colours of the background.

    Attributes:
        colours: Cluster centres of the border in Lab, shape [count, 3].
        grain: Distance to the nearest of them [Lab units] that 98 % of the border's background stay below.
        share: Share of the border that these colours explain, in [0, 1].
        grey: Whether the whole picture has no colour to speak of.
    """

    colours: np.ndarray
    grain: float
    share: float
    grey: bool

    def shades(self, darkest: float) -> np.ndarray:
        """The colours and darkened copies of them, shape [count, 3]: a shadow keeps paper's chromaticity.

        Where the picture is grey a darker leaf would pass for shadow, so shadows are kept light.

        Args:
            darkest: The least light that a shadow leaves, as a share; 1 for no shadows.
        """
        import cv2

        if darkest >= 1.0:
            return self.colours
        light = np.geomspace(1.08, max(darkest, 0.7) if self.grey else darkest, 12).astype(np.float32)
        linear = cv2.cvtColor(self.colours[None].astype(np.float32), cv2.COLOR_Lab2LRGB)[0]
        shades = np.clip(linear[None] * light[:, None, None], 0.0, 1.0)
        colours = cv2.cvtColor(shades.reshape(1, -1, 3), cv2.COLOR_LRGB2Lab)[0]
        kept = self.colours
        for colour in colours:  # shades of like clusters coincide
            if np.abs(kept - colour).max(axis=1).min() > SAME_COLOUR:
                kept = np.concatenate([kept, colour[None]])
        return kept


def background_of(lab: np.ndarray, sides: int = LEAST_SIDES) -> Background:
    """Background model of a picture from its border.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        sides: Of the picture on which a colour must be seen.
    """
    import cv2

    rows, columns = lab.shape[:2]
    ring = max(2, round(0.015 * min(rows, columns)))
    strips = [strip.reshape(-1, 3) for strip in (lab[:ring], lab[-ring:], lab[:, :ring], lab[:, -ring:])]
    strips = [strip[:: max(1, len(strip) // 1000)] for strip in strips]
    samples = np.ascontiguousarray(np.concatenate(strips))
    side_of = np.repeat(np.arange(4), [len(strip) for strip in strips])
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.3)
    _, labels, centres = cv2.kmeans(samples, CLUSTERS, None, criteria, 2, cv2.KMEANS_PP_CENTERS)
    labels = labels.ravel()
    share = np.zeros((CLUSTERS, 4))
    np.add.at(share, (labels, side_of), 1.0)
    share /= share.sum(axis=0)
    common = (share > LEAST_SHARE).sum(axis=1) >= sides
    if not common.any():
        common[np.argmax(share.sum(axis=1))] = True
    member = common[labels]
    distance = colour_distance(samples[member][None], centres[common])[0]
    grain, share = float(np.quantile(distance, 0.98)), float(member.mean())
    return Background(centres[common].astype(np.float32), grain, share, is_grey(lab))


def is_grey(lab: np.ndarray) -> bool:
    """Whether a picture has no colour to speak of."""
    spreads = [np.ptp(np.quantile(lab[..., channel], (0.005, 0.995))) for channel in (1, 2)]
    return bool(max(spreads) < LEAST_COLOUR)


def colour_distance(lab: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Distance of each pixel to the nearest of the colours [Lab units], shape [height, width], float32."""
    import cv2

    pixels, models = (lab.reshape(-1, 3) * WEIGHT).T, (colours * WEIGHT).astype(np.float32)
    own = np.einsum("ij,ij->i", models, models)[:, None]
    squares = np.empty(pixels.shape[1], np.float32)
    for first in range(0, len(squares), 1 << 14):  # a chunk's rows stay in the processor's cache
        chunk = np.ascontiguousarray(pixels[:, first : first + (1 << 14)])
        # Not NumPy's product: its threads cost more than they bring on so thin matrices.
        nearest = cv2.gemm(models, chunk, -2.0, None, 0.0)
        nearest += own
        nearest = nearest.min(axis=0)
        squares[first : first + chunk.shape[1]] = np.einsum("ij,ij->j", chunk, chunk) + nearest
    return np.sqrt(np.maximum(squares, 0.0)).reshape(lab.shape[:2])
