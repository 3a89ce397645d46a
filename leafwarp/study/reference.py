"""The converged computation that all settings are held against, and how far it is from the truth itself."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from leafwarp.study.metrics import relative_water_error
from leafwarp.study.trial import Setting, Trial

# Share of the time of a reference that its check, with half the map and twice the step, takes at most.
CHECK_SHARE = 0.25


@dataclass(frozen=True)
class ErrorModel:
    """Error of the water to first order in the step and the size of a cell.

    Attributes:
        per_second: Error for each second of the fluid step.
        per_cell: Error times the cells across.
    """

    per_second: float
    per_cell: float

    def error(self, setting: Setting) -> float:
        """What to expect of a setting, unsplit and in float64."""
        return self.per_second * setting.step + self.per_cell / setting.cells_across


def unsplit_settings(maps: Sequence[tuple[int, int]], steps: Sequence[float]) -> list[Setting]:
    """Every candidate for a reference: all maps and steps, unsplit, in float64."""
    return [Setting(size, step, "unsplit", "float64") for size, step in itertools.product(maps, steps)]


def fit_error_model(
    coarsest: Setting, long_step: float, run: Callable[[Setting], Trial], areas: np.ndarray
) -> ErrorModel:
    """Measure how the error depends on step and map by three cheap computations.

    Args:
        coarsest: The coarsest candidate map, with a step shorter than ``long_step``.
        long_step: A longer step [s].
        run: Computes a setting.
        areas: Area of each vertex [m^2].
    """
    base = run(coarsest)
    long = run(replace(coarsest, step=long_step))
    half = run(coarsest.coarsened(2))
    return ErrorModel(
        per_second=relative_water_error(long.water, base.water, areas) / (long_step - coarsest.step),
        per_cell=relative_water_error(half.water, base.water, areas) * coarsest.cells_across,
    )


def rank(
    candidates: Sequence[Setting], model: ErrorModel, cost: Callable[[Setting], float], affordable: float
) -> list[Setting]:
    """The candidates that can be paid, the most accurate first; the cheapest alone if none can.

    Args:
        candidates: From :func:`unsplit_settings`.
        model: What error to expect of them.
        cost: Predicted wall time of one [s].
        affordable: Wall time at hand [s].
    """
    paid = [c for c in candidates if cost(c) * (1.0 + CHECK_SHARE) <= affordable]
    return sorted(paid, key=lambda c: (model.error(c), cost(c))) or [min(candidates, key=cost)]
