"""Veins: ribs with their secondaries and branches, and the coordinates of the fine network between them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .curves import arc_length, ribbon, smooth_curve, tangents_of
from .outline import Margin, inside


@dataclass(frozen=True)
class Rib:
    """A main vein from the lamina's base with secondaries on both sides.

    Rib coordinates (a, b): a along the rib, b >= 0 away from it. The secondary that leaves the rib at a = t
    runs along a = t + b cot(angle(t)) + curve b^2, with the angle falling from `angles[0]` to `angles[1]`.
    """

    length: float
    direction: float = 0.0  # degrees clockwise from the leaf's axis
    pairs: int = 8
    insertion: tuple[float, float] = (0.02, 0.86)  # of the first and the last pair, as shares of the length
    angles: tuple[float, float] = (62.0, 38.0)  # degrees between rib and secondary
    curve: float = 0.25
    width: float = 0.011
    secondary_width: float = 0.0055

    def to_leaf(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Leaf coordinates, shape [n, 2], of rib coordinates with b signed (positive right)."""
        cosine, sine = np.cos(np.radians(self.direction)), np.sin(np.radians(self.direction))
        return np.stack([a * sine + b * cosine, a * cosine - b * sine], axis=-1)

    def from_leaf(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rib coordinates (a, signed b) of leaf coordinates."""
        cosine, sine = np.cos(np.radians(self.direction)), np.sin(np.radians(self.direction))
        return x * sine + y * cosine, x * cosine - y * sine

    def cotangent(self, t: np.ndarray) -> np.ndarray:
        """Slope of the secondary that leaves the rib at t."""
        share = np.sqrt(np.clip(t / self.length, 0.0, 1.0))
        return 1.0 / np.tan(np.radians(self.angles[0] + (self.angles[1] - self.angles[0]) * share))

    def insertions(self, side: int, rng: np.random.Generator) -> np.ndarray:
        """Positions along the rib where the secondaries of one side leave it, denser toward the tip."""
        share = np.linspace(0.0, 1.0, self.pairs) + (0.14 / self.pairs if side > 0 else -0.14 / self.pairs)
        share = np.clip(share + rng.uniform(-0.1, 0.1, self.pairs) / self.pairs, 0.0, 1.0)
        low, high = self.insertion
        return self.length * (low + (high - low) * share**0.93)

    def secondary(self, t: float, side: int) -> np.ndarray:
        """The secondary that leaves the rib at t, far past any margin, in leaf coordinates."""
        b = np.linspace(0.0, 1.2, 1200)
        return self.to_leaf(t + b * self.cotangent(np.asarray(t)) + self.curve * b**2, side * b)

    def network_coordinates(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of the fine network in about leaf lengths: u along the secondaries, v across them."""
        a, b = self.from_leaf(x, y)
        distance = np.abs(b)
        t = a
        for _ in range(6):
            t = a - distance * self.cotangent(t) - self.curve * distance**2
        slope = self.cotangent(t)
        sine = 1.0 / np.sqrt(1.0 + slope**2)
        along = distance / sine + 0.7 * t * slope * sine  # the ladder meets the secondaries nearly squarely
        return np.where(b < 0, -1.0, 1.0) * (along + 0.28), t * sine


@dataclass
class Vein:
    """A vein's centre line [n, 2] and widths [n] in leaf lengths, and its order (0 is a main vein)."""

    points: np.ndarray
    widths: np.ndarray
    order: int


@dataclass
class Venation:
    """All drawn veins of a leaf."""

    rng: np.random.Generator
    wobble: float  # sideways, in leaf lengths
    veins: list[Vein] = field(default_factory=list)

    def add(self, points: np.ndarray, order: int, start: float, end: float, power: float = 0.8) -> None:
        """Adds a vein that tapers from `start` to `end`, a little unsteady in course and width."""
        length = arc_length(points)
        share = length / length[-1]
        knots = max(4, int(length[-1] / 0.028))
        sway, swell = (self._unsteady(share, knots) for _ in range(2))
        tangents = tangents_of(points)
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
        steady = np.minimum(1.0, 8.0 * np.minimum(share, 1.0 - share))
        points = points + normals * (self.wobble * sway * steady)[:, None]
        widths = (end + (start - end) * (1.0 - share) ** power) * (1.0 + 0.07 * swell)
        self.veins.append(Vein(points, widths, order))

    def _unsteady(self, share: np.ndarray, knots: int) -> np.ndarray:
        """Smooth random deviations along a vein."""
        curve = smooth_curve(list(enumerate(self.rng.standard_normal(knots))), 0.1)
        return np.interp(share * (knots - 1), curve[:, 0], curve[:, 1])

    def polygons(self, order: int) -> list[np.ndarray]:
        """Ribbons of one order, in leaf coordinates."""
        return [ribbon(vein.points, vein.widths) for vein in self.veins if vein.order == order]


@dataclass(frozen=True)
class Secondary:
    """A side vein of a rib: its curve [n, 2], the half of the margin it runs to and the arc length there.

    The place is None for one that ends inside the lamina.
    """

    curve: np.ndarray
    half: int
    place: float | None


def rib_secondaries(rib: Rib, margins: dict[int, Margin], rng: np.random.Generator) -> list[Secondary]:
    """Secondaries of one rib, each up to the smooth margin."""
    polygon = np.concatenate([margins[1].smooth[::4], margins[-1].smooth[::-4]])
    found = []
    for side in (-1, 1):
        for t in rib.insertions(side, rng):
            curve = rib.secondary(t, side)
            curve = curve[: 4 * max(1, int(np.argmin(inside(polygon, curve[4::4])))) + 4]
            (_, place), half = min((margins[half].nearest(curve[-1]), half) for half in margins)
            found.append(Secondary(curve, half, place))
    return found


def to_tip(curve: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """The curve with its outer part drawn over to end just inside `tip`."""
    share = (arc_length(curve) / arc_length(curve)[-1])[:, None]
    return curve + share**3 * 0.93 * (tip - curve[-1])


def branches(curve: np.ndarray, place: float, margin: Margin, limit: float) -> list[tuple[float, np.ndarray]]:
    """Branches of a secondary to the teeth between its place on the margin and `limit`.

    Each is (share of the secondary's length where it forks, the branch's curve).
    """
    length = arc_length(curve)
    found = []
    low, high = sorted((place, limit))
    for tip in margin.tips[(margin.tips > low) & (margin.tips < high)]:
        away = abs(place - tip)
        fork = length[-1] - 1.35 * away - 0.012
        if away < 0.012 or fork < 0.12 * length[-1]:
            continue
        index = int(np.searchsorted(length, fork))
        start, end = curve[index], margin.at(tip)
        heading = tangents_of(curve)[index]
        middle = 0.5 * (start + end) - 0.05 * np.linalg.norm(end - start) * heading
        found.append((fork / length[-1], smooth_curve([start, middle, start + 0.93 * (end - start)], 0.004)))
    return found
