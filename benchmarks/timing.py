"""Wall times of contenders, measured in turns: other work on the machine then slows all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

LEAST_LAP = 4e-3  # [s] a contender repeats its work until a reading takes this long
MOST_REPEATS = 1000
Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class Timing:
    """Repeated measurements of one thing, or their ratios."""

    values: tuple[float, ...]

    @property
    def median(self) -> float:
        return statistics.median(self.values)

    def __add__(self, other: Timing) -> Timing:
        return Timing(tuple(a + b for a, b in zip(self.values, other.values, strict=True)))

    def over(self, other: Timing) -> Timing:
        """The ratio to another contender, round by round."""
        return Timing(tuple(a / b for a, b in zip(self.values, other.values, strict=True)))

    def __str__(self) -> str:
        """Median, and the range of the middle half of the measurements."""
        if len(self.values) < 2:
            return f"{self.median:.3g}"
        low, _, high = statistics.quantiles(self.values, n=4)
        return f"{self.median:.3g} ({low:.3g}-{high:.3g})"


def round_robin(
    contenders: Mapping[Name, Callable[[], object]], rounds: int, least_lap: float = LEAST_LAP
) -> dict[Name, Timing]:
    """Time every contender once a round, beginning with another one each round.

    Each measurement follows on an untimed piece of the same work, as steps follow on steps: what the others have left
    in the caches does not count.

    Args:
        contenders: What each of them does, by name; done once before anything is timed. Where it returns a whole
            number, it has done as many pieces of work at once.
        rounds: Measurements of each.
        least_lap: A contender's work is repeated until a measurement takes this long [s].

    Returns:
        Time of one piece of work [ms].
    """
    names = list(contenders)
    repeats = {}
    for name in names:
        contenders[name]()
        begin = time.perf_counter()
        contenders[name]()
        once = time.perf_counter() - begin
        repeats[name] = min(max(1, round(least_lap / max(once, 1e-9))), MOST_REPEATS)
    laps: dict[Name, list[float]] = {name: [] for name in names}
    for round_number in range(rounds):
        first = round_number % len(names)
        for name in names[first:] + names[:first]:
            contenders[name]()
            laps[name].append(1e3 * _lap(contenders[name], repeats[name]))
    return {name: Timing(tuple(values)) for name, values in laps.items()}


def _lap(work: Callable[[], object], repeats: int) -> float:
    done = 0
    begin = time.perf_counter()
    for _ in range(repeats):
        count = work()
        done += count if isinstance(count, int) else 1
    return (time.perf_counter() - begin) / done


def exponent(sizes: list[float], times: list[float]) -> float:
    """The power of the size that the times grow with: slope of the straight line through their logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
