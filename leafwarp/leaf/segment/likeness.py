"""How far a thing that stands out from its background looks like a leaf.

What is found may be well cut out and still be a coin, a hand or a lamp. Leaves are green, yellow, red or brown and no
two alike, so nothing is asked for; what is weighed is what speaks against a leaf. Each kind of evidence gives a factor
that falls from 1 as the evidence grows. What no leaf shows (blue, pure white or black, a rectangle, a full disc that is
not green) falls to STRONG and refuses alone; what few leaves show falls to WEAK at most, and refuses only together with
more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STRONG = 0.4
WEAK = 0.6
ROUND_LEAF = 0.7  # some leaves are as round as a disc (pennywort, nasturtium), and green
GREY = 0.75  # without colour much looks like a leaf
COLOURED = 12.0  # [Lab units] chroma from which a hue can be told, after a white balance that is 15 % off
ALIEN_HUES = (205.0, 335.0)  # [degrees of a and b] blue and violet
GREEN_HUES = (95.0, 200.0)  # of live leaves, under a cold light too
MOST_TINT = 0.4  # chroma over lightness that a white balance 15 % off gives to grey
FLESH_HUES = (25.0, 66.0)
FLESH_CHROMA = (12.0, 36.0)  # [Lab units] red and brown leaves as light as skin have more
FLESH_LIGHT = 58.0  # [Lab units] brown leaves are darker
ALIEN_SHARES = (0.12, 0.30)  # of the thing; glare on a leaf mirrors the sky
GREEN_SHARES = (0.1, 0.4)
FLESH_SHARES = (0.4, 0.8)
DISC_SHARES = (0.86, 0.94)  # of the smallest circle about the thing, its bays filled
STRAIGHT_SHARES = (0.88, 0.95)  # of the smallest rectangle about it
CUT_SHARES = (0.04, 0.12)  # of the outline
LIGHT_SPANS = (30.0, 55.0)  # [Lab units] between a thing's dark and light parts: a flat thing is evenly lit
WHITE = (80.0, 9.0)  # [Lab units] least lightness and most chroma of paper, a cup, a lamp
BLACK = (8.0, 4.0)  # [Lab units] most lightness and chroma of ink and deep shade


@dataclass(frozen=True)
class Evidence:
    """What speaks against a leaf, each as the factor that is left of the confidence, in [0, 1], and said in words."""

    factors: tuple[tuple[str, float], ...]

    @property
    def likeness(self) -> float:
        """Product of the factors."""
        return float(np.prod([factor for _, factor in self.factors]))

    @property
    def against(self) -> str:
        """What speaks against a leaf, the strongest first; empty where nothing does."""
        return ", ".join(words for words, factor in sorted(self.factors, key=lambda one: one[1]) if factor < 0.95)


def evidence(lab: np.ndarray, inside: np.ndarray, grey: bool, cut: float, ground: np.ndarray | None = None) -> Evidence:
    """Weighs what speaks against a leaf.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        inside: The thing, holes filled, shape [height, width], bool.
        grey: Whether the picture has no colour.
        cut: Share of the thing's outline on the picture's border; a straight side there is the picture's.
        ground: The background's colours in Lab, shape [count, 3], or None where it is not known.
    """
    disc, straight = _fullness(inside)
    pixels = lab[_core(inside)]
    light = pixels[:, 0]
    median, chroma = np.median(pixels, axis=0), np.hypot(pixels[:, 1], pixels[:, 2])
    middle = (float(median[0]), float(np.hypot(median[1], median[2])))
    factors = [
        ("a rectangle", _falling(straight, STRAIGHT_SHARES, STRONG) if cut <= CUT_SHARES[0] else 1.0),
        ("black", STRONG if middle[0] < BLACK[0] and middle[1] < BLACK[1] else 1.0),
    ]
    if grey:
        round_thing = ("as round as a disc", _falling(disc, DISC_SHARES, STRONG))
        return Evidence((*factors, round_thing, ("without colour", GREY)))
    hue = np.degrees(np.arctan2(pixels[:, 2], pixels[:, 1])) % 360.0
    coloured = chroma > COLOURED
    alien = float((coloured & _between(hue, ALIEN_HUES)).mean())
    green = max(_green_share(pixels), 0.0 if ground is None else _green_share(_balanced(pixels, ground)))
    flesh = _between(hue, FLESH_HUES) & _between(chroma, FLESH_CHROMA) & (light > FLESH_LIGHT)
    # Green speaks for a leaf by itself; without it a leaf should at least lie whole and flat before its background.
    doubt = _rising(green, GREEN_SHARES, 1.0, 0.0)
    span = float(np.subtract(*np.quantile(light, (0.95, 0.05))))
    off = _rising(cut, CUT_SHARES, 0.0, 1.0)
    factors += [
        ("as round as a disc", _falling(disc, DISC_SHARES, ROUND_LEAF + (STRONG - ROUND_LEAF) * doubt)),
        ("of a colour that no leaf has", _falling(alien, ALIEN_SHARES, STRONG)),
        ("white", STRONG if middle[0] > WHITE[0] and middle[1] < WHITE[1] else 1.0),
        ("not green and cut off by the picture", 1.0 - (1.0 - WEAK) * doubt * off),
        ("not green and of strong light and shade", 1.0 - (1.0 - WEAK) * doubt * _rising(span, LIGHT_SPANS, 0.0, 1.0)),
        # A hand comes on an arm, which leaves the picture.
        ("of the colour of skin", 1.0 - (1.0 - WEAK) * _rising(float(flesh.mean()), FLESH_SHARES, 0.0, 1.0)),
    ]
    return Evidence(tuple(factors))


def _green_share(pixels: np.ndarray) -> float:
    hue = np.degrees(np.arctan2(pixels[:, 2], pixels[:, 1])) % 360.0
    return float(((np.hypot(pixels[:, 1], pixels[:, 2]) > COLOURED) & _between(hue, GREEN_HUES)).mean())


def _balanced(pixels: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Colours as they would be if the background were grey, as far as a wrong white balance may have tinted it."""
    light, *tint = np.median(ground, axis=0)
    most = MOST_TINT * float(light) / max(float(np.hypot(*tint)), 1e-6)
    return pixels - min(1.0, most) * np.array((0.0, *tint))


def leafy(lab: np.ndarray, piece: np.ndarray) -> bool:
    """Whether a piece beside the leaf may be another leaf, by its colours: neither blue, nor grey, nor of skin."""
    pixels = lab[_core(piece)]
    chroma, hue = np.hypot(pixels[:, 1], pixels[:, 2]), np.degrees(np.arctan2(pixels[:, 2], pixels[:, 1])) % 360.0
    flesh = _between(hue, FLESH_HUES) & _between(chroma, FLESH_CHROMA) & (pixels[:, 0] > FLESH_LIGHT)
    leaf = (chroma > 0.5 * COLOURED) & ~_between(hue, ALIEN_HUES) & ~flesh
    return bool(leaf.mean() > 0.5)


def _core(inside: np.ndarray) -> np.ndarray:
    """A thing without its blurred rim, or all of it where nothing else is left."""
    import cv2

    core = cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=2) > 0
    return core if np.count_nonzero(core) >= 30 else inside


def _fullness(inside: np.ndarray) -> tuple[float, float]:
    """Shares that a thing's convex hull fills of the smallest circle about it, and the thing of the smallest rectangle.

    The hull, because a disc that was cut out raggedly is still one.
    """
    import cv2

    contour = max(cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0], key=len)
    area = float(np.count_nonzero(inside))
    radius = cv2.minEnclosingCircle(contour)[1] + 0.5  # the contour runs through the centres of pixels
    sides = cv2.minAreaRect(contour)[1]
    hull = cv2.contourArea(cv2.convexHull(contour)) + 0.5 * len(contour)  # half a pixel all around
    return hull / (np.pi * radius**2), area / ((sides[0] + 1.0) * (sides[1] + 1.0))


def _between(values: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    return (values > bounds[0]) & (values < bounds[1])


def _rising(value: float, bounds: tuple[float, float], first: float, last: float) -> float:
    """From the first to the last as a value goes from bound to bound."""
    return float(np.interp(value, bounds, (first, last)))


def _falling(value: float, bounds: tuple[float, float], last: float) -> float:
    return _rising(value, bounds, 1.0, last)
