"""What the points of a method come to: the spans of the swept number in which it is stable, inaccurate or refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from leafwarp.study.stability.point import BROKEN, REFUSED, STABLE, Point


@dataclass(frozen=True)
class Span:
    """Neighbouring numbers with the same outcome.

    Attributes:
        outcome: The outcome.
        low: The least of the numbers.
        high: The largest.
    """

    outcome: str
    low: float
    high: float


@dataclass(frozen=True)
class Envelope:
    """All points of a sweep by one method in one precision.

    Attributes:
        sweep: Name of the sweep.
        method: The method.
        precision: "float32" or "float64".
        points: With rising numbers.
    """

    sweep: str
    method: str
    precision: str
    points: tuple[Point, ...]

    @property
    def spans(self) -> tuple[Span, ...]:
        """The spans, from the least number to the largest."""
        groups = ((outcome, list(group)) for outcome, group in groupby(self.points, lambda point: point.outcome))
        return tuple(Span(outcome, group[0].value, group[-1].value) for outcome, group in groups)

    @property
    def worst(self) -> float | None:
        """The largest error of the stable points; None where there is none."""
        return max((point.error for point in self.points if point.outcome == STABLE), default=None)

    @property
    def messages(self) -> tuple[Point, ...]:
        """The first point of each span that is refused or broken: what it says stands for the span."""
        groups = (list(group) for _, group in groupby(self.points, lambda point: point.outcome))
        return tuple(group[0] for group in groups if group[0].outcome in (REFUSED, BROKEN))


def envelopes_of(points: Sequence[Point]) -> tuple[Envelope, ...]:
    """The envelopes of points, in their order."""
    bands: dict[tuple[str, str, str], list[Point]] = {}
    for point in points:
        bands.setdefault((point.sweep, point.method, point.precision), []).append(point)
    return tuple(Envelope(*key, tuple(band)) for key, band in bands.items())
