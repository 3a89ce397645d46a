"""The converged computation that all settings are held against, and how far it is from the truth itself."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from leafwarp.study.metrics import relative_water_error
from leafwarp.study.trial import Setting, Trial

# Time of its two checks, over that of the reference: half the map costs an eighth of it, twice the step 0.7.
CHECK_SHARE = 0.9


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


def probe_settings(coarse: Setting, steps: Sequence[float]) -> tuple[Setting, Setting, Setting]:
    """Three cheap computations that show how the error depends on step and map.

    Args:
        coarse: A map that is coarse enough to be cheap.
        steps: The steps at hand, rising [s].

    Returns:
        One with the longest step, one with a shorter step, one with half the map.
    """
    base = replace(coarse, step=steps[-1])
    return base, replace(base, step=steps[-2] if len(steps) > 1 else steps[-1] / 2.0), base.coarsened(2)


def fit_error_model(base: Trial, shorter: Trial, half: Trial, *, areas: np.ndarray) -> ErrorModel:
    """The error model that the trials of :func:`probe_settings` show.

    Args:
        base: The first of them.
        shorter: The one with a shorter step.
        half: The one with half the map.
        areas: Area of each vertex [m^2].
    """
    by_step = relative_water_error(base.water, shorter.water, areas) / (base.fluid_step - shorter.fluid_step)
    by_map = relative_water_error(half.water, base.water, areas) * base.setting.cells_across
    return ErrorModel(by_step, by_map)


def check_settings(reference: Setting) -> tuple[Setting, Setting]:
    """Half the map, and twice the step.

    They are two, because both at once may hide each other: a smaller cell fills faster, a shorter step fills
    it less.
    """
    return reference.coarsened(2), reference.coarsened(1, 2.0)


def choose_reference(
    candidates: Sequence[Setting], model: ErrorModel, cost: Callable[[Setting], float], affordable: float
) -> Setting:
    """The most accurate candidate that can be paid; the cheapest if none can.

    Args:
        candidates: From :func:`unsplit_settings`.
        model: What error to expect of them.
        cost: Predicted wall time of one [s].
        affordable: Wall time at hand, for the reference and its check [s].
    """
    paid = [c for c in candidates if cost(c) * (1.0 + CHECK_SHARE) <= affordable]
    return min(paid, key=lambda c: (model.error(c), cost(c)), default=min(candidates, key=cost))
