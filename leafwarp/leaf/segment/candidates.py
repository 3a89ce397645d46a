"""Guesses at the leaf from several channels, and how good each one looks.

No single channel holds on every background (on 42 photos the best one alone was right on 31), so each gives a
guess. A guess is scored by what a leaf before a background must show: a strong edge along its contour, other
colours inside than outside, an outside that the border's colours explain, little of the picture's border. The
one with the best score, weighed by the others' agreement, is taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.segment.background import WEIGHT, Background, colour_distance
from leafwarp.leaf.segment.pieces import border_contact, leaf_piece

LEAST_THRESHOLD = 6.0  # [Lab units] below this a difference is paper grain
LEAST_SHARE = 0.003  # of the picture
MOST_SHARE = 0.95
STRONG_EDGE = 14.0  # [Lab units] colour step across a contour that leaves no doubt
PLAIN, DEEPEST = 0.2, 0.08
SHADES = (1.0, 0.45, PLAIN, DEEPEST)  # light that the deepest shadow leaves


@dataclass(frozen=True)
class Guess:
    """One guess at the leaf.

    Attributes:
        name: Its channel.
        inside: The leaf's pixels, holes filled, shape [height, width], bool.
        seen: Everything that differs from the background in this channel, of the same shape.
        count: Pieces of like weight that were seen.
        edge: Colour step across the contour, 1 from STRONG_EDGE on, times the share of the contour that has one.
        even: The same against the contour's own median step: low where part of it lies on a soft shadow.
        separation: One less the overlap of the colours inside and outside.
        explained: Share of the outside that has the background's colours.
        contact: Share of the picture's border inside.
        calm: One less the mean colour step outside, in units of the step across the contour.
        shadow: Share of the inside that may be the background in shadow.
    """

    name: str
    inside: np.ndarray
    seen: np.ndarray
    count: int
    edge: float
    even: float
    separation: float
    explained: float
    contact: float
    calm: float
    shadow: float

    @property
    def score(self) -> float:
        """Quality in [0, 1]."""
        free = max(0.0, 1.0 - 1.2 * max(0.0, self.contact - 0.05))
        return float((self.edge * self.separation**2 * self.explained) ** 0.5 * free)

    @property
    def rank(self) -> float:
        """Quality beside other guesses at the same leaf: the one without shadow is the better one."""
        return self.score * self.even * (1.0 - 0.7 * self.shadow)


@dataclass(frozen=True)
class _Scene:
    """What guesses are judged by, each of the picture's shape.

    Attributes:
        step: Colour difference across a few pixels [Lab units].
        bins: Number of the pixel's colour bin.
        plain: Whether it has the background's colour, lit or in shadow.
        shadow: Whether it may be background in the deepest shadow.
    """

    step: np.ndarray
    bins: np.ndarray
    plain: np.ndarray
    shadow: np.ndarray


def guesses(lab: np.ndarray, background: Background) -> list[Guess]:
    """All guesses worth a look, best score first.

    Args:
        lab: The picture in Lab, shape [height, width, 3], a few hundred pixels a side.
        background: Its background.
    """
    import cv2

    chroma = np.hypot(lab[..., 1], lab[..., 2])
    off = {darkest: colour_distance(lab, background.shades(darkest)) for darkest in SHADES}
    plain = off[PLAIN] < max(2.0 * background.grain, LEAST_THRESHOLD)
    deep = off[DEEPEST] < max(background.grain, LEAST_THRESHOLD)
    scene = _Scene(_colour_step(lab), _colour_bins(lab), plain, deep)
    kernel = np.ones((3, 3), np.uint8)
    found: list[Guess] = []
    for name, mask in _masks(lab, background, off):
        opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
        inside, count = leaf_piece(opened, chroma)
        share = inside.mean()
        if LEAST_SHARE < share < MOST_SHARE and border_contact(inside) < 0.9:
            found.append(_judged(name, inside, opened, count, scene))
    return sorted(found, key=lambda guess: -guess.rank)


def agreement(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of two masks."""
    return np.count_nonzero(first & second) / max(np.count_nonzero(first | second), 1)


def choose(found: list[Guess]) -> tuple[Guess, float]:
    """The best guess, and how far the good ones agree with it, in [0, 1]."""
    top = found[: min(len(found), 9)]
    scores = np.array([guess.rank for guess in top])
    weights = scores / max(scores.sum(), 1e-9)
    alike = np.array([[agreement(a.inside, b.inside) for b in top] for a in top])
    support = alike @ weights
    best = int(np.argmax(scores * (0.4 + support)))
    return top[best], float(support[best])


def _masks(lab: np.ndarray, background: Background, off: dict[float, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Masks of what differs from the background, channel by channel.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        background: Its background.
        off: Distance of each pixel to the background with each of SHADES [Lab units], shape [height, width].
    """
    import cv2

    side = 2 * (max(lab.shape) // 128) + 3
    calm = cv2.merge([cv2.medianBlur(channel, 5) for channel in cv2.split(lab)])
    coarse = cv2.GaussianBlur(calm, (0, 0), 0.25 * side)
    for darkest in SHADES:
        if background.grey and darkest < 0.45:
            continue
        for name, distance in (("", off[darkest]), ("calm ", colour_distance(coarse, background.shades(darkest)))):
            split = max(_otsu(distance), LEAST_THRESHOLD)
            yield f"{name}shade {darkest}", distance > split
            least = max(1.3 * background.grain, LEAST_THRESHOLD)
            if least < 0.8 * split:
                yield f"{name}shade {darkest} low", distance > least
                yield f"{name}shade {darkest} mid", distance > 0.5 * (least + split)
    main = background.colours[0] if len(background.colours) == 1 else np.median(background.colours, axis=0)
    channels = {"L": calm[..., 0]} if background.grey else {"L": calm[..., 0], "a": calm[..., 1], "b": calm[..., 2]}
    if not background.grey:
        channels["green"] = calm[..., 2] - 1.5 * calm[..., 1]
        channels["chroma"] = np.hypot(calm[..., 1], calm[..., 2])
        main = np.append(main, (main[2] - 1.5 * main[1], np.hypot(main[1], main[2])))
    for (name, channel), level in zip(channels.items(), main, strict=False):
        distance = np.abs(channel - level)
        yield name, distance > max(_otsu(distance), 0.7 * LEAST_THRESHOLD)


def _judged(name: str, inside: np.ndarray, seen: np.ndarray, count: int, scene: _Scene) -> Guess:
    import cv2

    kernel = np.ones((3, 3), np.uint8)
    bytes_ = inside.astype(np.uint8)
    inner = cv2.erode(bytes_, kernel, iterations=2, borderType=cv2.BORDER_REPLICATE) > 0
    outer = cv2.dilate(bytes_, kernel, iterations=3) == 0
    rim = inside & (cv2.erode(bytes_, kernel, borderType=cv2.BORDER_REPLICATE) == 0)
    steps = scene.step[rim] if rim.any() else np.zeros(1)
    reference = max(STRONG_EDGE, 0.7 * float(np.median(steps)))
    return Guess(
        name,
        inside,
        seen,
        count,
        edge=float(np.minimum(steps / STRONG_EDGE, 1.0).mean()),
        even=float(np.minimum(steps / reference, 1.0).mean()),
        separation=1.0 - _overlap(scene.bins, inner, outer),
        explained=float(scene.plain[outer].mean()) if outer.any() else 0.0,
        contact=border_contact(inside),
        calm=1.0 - float(scene.step[outer].mean() / max(scene.step[rim].mean(), 1.0))
        if outer.any() and rim.any()
        else 0.0,
        shadow=float(scene.shadow[inside].mean()),
    )


def _colour_step(lab: np.ndarray) -> np.ndarray:
    """Greatest colour difference across two to four pixels near each pixel [Lab units], lightness weighed down."""
    import cv2

    calm = cv2.split(cv2.GaussianBlur(lab, (0, 0), 1.0))
    wide = [np.pad(channel * weight, 2, mode="edge") for channel, weight in zip(calm, WEIGHT, strict=True)]
    squares = np.zeros(lab.shape[:2], np.float32)
    for low, high in ((np.s_[:-4, 2:-2], np.s_[4:, 2:-2]), (np.s_[2:-2, :-4], np.s_[2:-2, 4:])):
        light, green, yellow = ((channel[high] - channel[low]) ** 2 for channel in wide)
        squares += light + green + yellow
    return cv2.dilate(np.sqrt(squares), np.ones((3, 3), np.uint8))


def _colour_bins(lab: np.ndarray) -> np.ndarray:
    """Number of each pixel's bin in Lab, bins 8 x 6 x 6 units wide."""
    light, green, yellow = (
        (lab[..., channel] * np.float32(width) + np.float32(start)).astype(np.intp)
        for channel, width, start in ((0, 1.0 / 8.0, 0.0), (1, 1.0 / 6.0, 21.5), (2, 1.0 / 6.0, 21.5))
    )
    return (light * 44 + green) * 44 + yellow


def _overlap(bins: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Bhattacharyya coefficient of the colours of two regions, from the bins of their pixels."""
    counts = [np.bincount(bins[region], minlength=14 * 44 * 44).astype(float) for region in (first, second)]
    if min(count.sum() for count in counts) < 1:
        return 1.0
    return float(np.sqrt(counts[0] / counts[0].sum() * counts[1] / counts[1].sum()).sum())


def _otsu(distance: np.ndarray) -> float:
    import cv2

    top = max(float(np.quantile(distance, 0.998)), 1e-3)
    bytes_ = np.clip(distance * (255.0 / top), 0.0, 255.0).astype(np.uint8)
    threshold, _ = cv2.threshold(bytes_, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return threshold * top / 255.0
