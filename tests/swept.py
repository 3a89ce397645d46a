"""Points of the sweeps of ``python -m leafwarp stability``, for tests of the extremes."""

from __future__ import annotations

from collections.abc import Collection

from leafwarp.study.stability.point import Point, judge
from leafwarp.study.stability.sweeps import sweeps_named


def points_of(
    name: str, values: Collection[float], device: str, methods: Collection[str] = ()
) -> dict[tuple[str, str, float], Point]:
    """Points of a sweep at some of its numbers, by method, precision and number; all methods where none is named."""
    (sweep,) = sweeps_named([name])
    points = {}
    for trial in sweep.trials(device):
        if trial.value in values and (not methods or trial.method in methods):
            points[trial.method, trial.precision, trial.value] = judge(sweep, trial)
    assert {value for *_, value in points} == set(values)
    return points


def outcomes(points: dict[tuple[str, str, float], Point]) -> dict[tuple[str, str, float], str]:
    return {key: point.outcome for key, point in points.items()}
