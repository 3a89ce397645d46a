"""Wall times of contenders, measured in turns: other work on the machine then slows all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

LEAST_LAP = 4e-3  # [s] a contender repeats its work until a reading takes this long
MOST_REPEATS = 1000


@dataclass(frozen=True)
class Timing:
    """Repeated measurements of one thing [ms], or their ratios."""

    milliseconds: tuple[float, ...]

    @property
    def median(self) -> float:
        return statistics.median(self.milliseconds)

    def __add__(self, other: Timing) -> Timing:
        return Timing(tuple(a + b for a, b in zip(self.milliseconds, other.milliseconds, strict=True)))

    def over(self, other: Timing) -> Timing:
        """The ratio to another contender, round by round."""
        return Timing(tuple(a / b for a, b in zip(self.milliseconds, other.milliseconds, strict=True)))

    def __str__(self) -> str:
        """Median, and the range of the middle half of the measurements."""
        if len(self.milliseconds) < 2:
            return f"{self.median:.3g}"
        low, _, high = statistics.quantiles(self.milliseconds, n=4)
        return f"{self.median:.3g} ({low:.3g}-{high:.3g})"


def round_robin(
    contenders: Mapping[str, Callable[[], object]], rounds: int, least_lap: float = LEAST_LAP
) -> dict[str, Timing]:
    """Time every contender once a round, beginning with another one each round.

    Each measurement follows on an untimed piece of the same work, as steps follow on steps: what the others have left
    in the caches does not count.

    Args:
        contenders: What each of them does, by name; done once before anything is timed.
        rounds: Measurements of each.
        least_lap: A contender's work is repeated until a measurement takes this long [s].

    Returns:
        Time of one piece of work.
    """
    names = list(contenders)
    repeats = {}
    for name in names:
        contenders[name]()
        once = _lap(contenders[name], 1)
        repeats[name] = min(max(1, round(least_lap / max(once, 1e-9))), MOST_REPEATS)
    laps: dict[str, list[float]] = {name: [] for name in names}
    for round_number in range(rounds):
        first = round_number % len(names)
        for name in names[first:] + names[:first]:
            contenders[name]()
            laps[name].append(1e3 * _lap(contenders[name], repeats[name]))
    return {name: Timing(tuple(values)) for name, values in laps.items()}


def _lap(work: Callable[[], object], repeats: int) -> float:
    begin = time.perf_counter()
    for _ in range(repeats):
        work()
    return (time.perf_counter() - begin) / repeats


def exponent(sizes: list[float], times: list[float]) -> float:
    """The power of the size that the times grow with: slope of the straight line through their logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
