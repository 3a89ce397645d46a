"""The lamina's margin: a smooth half outline, toothed at the ends of the veins, and the petiole."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .curves import arc_length, smooth_curve, tangents_of
from .raster import smoothstep

Run = tuple[tuple[float, float], ...]

STEP = 0.0008  # sampling of the margin, in leaf lengths: below one pixel


@dataclass(frozen=True)
class Teeth:
    """Serration: teeth at the ends of the secondary veins, with smaller ones between them.

    Depths are shares of the distance between neighbouring teeth of the same kind.
    """

    depth: float
    small_depth: float
    small_spacing: float  # leaf lengths between all teeth
    slant: float = 0.7  # lean of a tooth toward its lobe's tip
    plain_tip: float = 0.05  # leaf lengths beside a lobe's tip where teeth fade out


@dataclass(frozen=True)
class Petiole:
    """A stalk from the lamina's base down through `points`, in leaf coordinates."""

    points: tuple[tuple[float, float], ...]
    width: float
    base_width: float

    def curve(self) -> np.ndarray:
        """Sampled from the lamina to the stalk's end."""
        return smooth_curve(self.points, 0.004)

    def widths(self) -> np.ndarray:
        """Width at each point of `curve`, flaring at the stalk's end."""
        share = np.linspace(0.0, 1.0, len(self.curve()))
        return self.width + (self.base_width - self.width) * share**3


def inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether each point, shape [n, 2], lies inside the closed polygon."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (start[:, 1] <= y) != (end[:, 1] <= y)
    rise = np.where(start[:, 1] == end[:, 1], 1.0, end[:, 1] - start[:, 1])
    left = x < start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    return np.count_nonzero(spans & left, axis=1) % 2 == 1


class Margin:
    """One half of a lamina's margin, from the base to the tip, before and after toothing.

    `runs` are smooth stretches of the right half that meet in corners, `side` is 1 for the right half and -1
    for the left one, and `stretch` widens this half alone.
    """

    def __init__(self, runs: tuple[Run, ...], side: int, stretch: float = 1.0):
        """Samples the smooth margin; `cut_teeth` adds the teeth."""
        pieces = [smooth_curve(run, STEP) for run in runs]
        self.smooth = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
        self.smooth = self.smooth * (side * stretch, 1.0)
        self.side = side
        self.length = arc_length(self.smooth)
        self.corners = self.length[np.cumsum([len(piece) - 1 for piece in pieces])[:-1]]
        self.toothed = self.smooth
        self.tips = np.array([])

    def nearest(self, point: np.ndarray) -> tuple[float, float]:
        """Distance from the point to the smooth margin, and the arc length there."""
        distances = np.linalg.norm(self.smooth - point, axis=1)
        index = int(np.argmin(distances))
        return float(distances[index]), float(self.length[index])

    def at(self, position: float | np.ndarray) -> np.ndarray:
        """Points of the toothed margin at arc lengths of the smooth one."""
        columns = [np.interp(position, self.length, self.toothed[:, axis]) for axis in (0, 1)]
        return np.stack(columns, axis=-1)

    def cut_teeth(self, teeth: Teeth, anchors: np.ndarray, rng: np.random.Generator) -> None:
        """Cuts teeth with tips at the `anchors` (arc lengths) and smaller ones between."""
        total = self.length[-1]
        anchors = np.unique(np.concatenate([[0.0], anchors, [total]]))
        anchors = anchors[np.concatenate([[True], np.diff(anchors) > 0.6 * teeth.small_spacing])]
        self.tips = self._subdivide(anchors, teeth.small_spacing, rng)
        forward = self._forward()
        corners = np.array([*self.corners, total])
        to_corner = np.min(np.abs(self.length[:, None] - corners), axis=1)
        fade = smoothstep(0.0, 0.10, self.length) * smoothstep(0.0, teeth.plain_tip, to_corner)
        fade *= smoothstep(0.4, 0.95, np.abs(forward))  # none down in a sinus
        longest = 3.0 * teeth.small_spacing
        height = fade * (
            self._teeth_height(anchors, forward, longest, rng) * teeth.depth
            + self._teeth_height(self.tips, forward, longest, rng) * teeth.small_depth
        )
        tangents = tangents_of(self.smooth)
        normals = self.side * np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
        lean = forward * teeth.slant * height
        self.toothed = self.smooth + normals * height[:, None] + tangents * lean[:, None]

    def _subdivide(self, anchors: np.ndarray, spacing: float, rng: np.random.Generator) -> np.ndarray:
        """The anchors with more positions between them, about `spacing` apart."""
        tips = [anchors[:1]]
        for low, high in pairwise(anchors):
            count = max(1, round((high - low) / spacing))
            uneven = np.append(rng.uniform(-0.12, 0.12, count - 1), 0.0)
            tips.append(low + (high - low) * (np.arange(1, count + 1) + uneven) / count)
        return np.concatenate(tips)

    def _forward(self) -> np.ndarray:
        """Which way along the margin a lobe's tip lies: 1 where away from the base, -1 where back."""
        outward = np.gradient(np.linalg.norm(self.smooth, axis=1), self.length)
        smoothed = np.convolve(np.pad(outward, 50, mode="edge"), np.full(101, 1 / 101), mode="valid")
        return np.clip(1.6 * smoothed, -1.0, 1.0)

    def _teeth_height(
        self, tips: np.ndarray, forward: np.ndarray, longest: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Height of asymmetric teeth, each as high as the shorter gap beside its tip, at most `longest`."""
        gaps = np.diff(tips)
        lean = np.interp(0.5 * (tips[1:] + tips[:-1]), self.length, forward)
        notches = tips[:-1] + gaps * (0.5 - 0.36 * lean)
        index = np.clip(np.searchsorted(tips, self.length, side="right") - 1, 0, len(gaps) - 1)
        notch = notches[index]
        rising = self.length >= notch
        reach = np.where(rising, tips[index + 1] - notch, notch - tips[index])
        share = np.clip(np.abs(self.length - notch) / np.maximum(reach, 1e-9), 0.0, 1.0)
        size = np.minimum(np.minimum(gaps[:-1], gaps[1:]), longest) * rng.uniform(0.85, 1.15, len(gaps) - 1)
        size = np.concatenate([[0.0], size, [0.0]])
        return size[index + rising] * np.sin(0.5 * np.pi * share) ** 1.15
