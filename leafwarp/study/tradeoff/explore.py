"""Which combinations of choices are worth a try, from what each choice does alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from leafwarp.study.tradeoff.errors import pareto_front
from leafwarp.study.tradeoff.setting import Setting

# Choices that go together: what the fluid does with a map depends on its scheme and step.
GROUPS = (
    ("map_size", "fluid_step", "scheme", "order", "step_tolerance"),
    ("vertices",),
    ("angular_springs",),
    ("motion", "force_tolerance", "substep"),
    ("coupling_interval",),
    ("precision",),
)
MOST_COMBINATIONS = 5000


@dataclass(frozen=True)
class Guess:
    """A combination that was not computed yet.

    Attributes:
        setting: The setting.
        seconds: Wall time of its film that is expected [s].
        error: Its error.
    """

    setting: Setting
    seconds: float
    error: float


def combinations(
    base: Setting, measured: Mapping[Setting, float], film_seconds: Callable[[Setting], float]
) -> list[Guess]:
    """Combinations that are expected to lie on the front, the fastest first.

    Errors of different origin are taken to add as squares: what a choice adds to, or takes from, the square of the
    scene's own error it does in every combination.

    Args:
        base: The scene's own setting, among those measured.
        measured: Error of every setting computed so far.
        film_seconds: Expected wall time of a film [s].
    """
    options = [_options(base, group, measured) for group in GROUPS]
    least = min(measured.values())
    while math.prod(map(len, options)) > MOST_COMBINATIONS:
        longest = max(range(len(options)), key=lambda k: len(options[k]))
        options[longest] = _fewer(options[longest], measured, film_seconds, least)
    guesses = []
    for chosen in itertools.product(*options):
        setting = base
        for option, group in zip(chosen, GROUPS, strict=True):
            setting = setting.with_(**{name: getattr(option, name) for name in group})
        squares = [measured[option] ** 2 - measured[base] ** 2 for option in chosen]
        error = math.sqrt(max(measured[base] ** 2 + sum(squares), least**2))
        guesses.append(Guess(setting, film_seconds(setting), error))
    seconds = np.array([guess.seconds for guess in guesses])
    on_front = pareto_front(seconds, np.array([guess.error for guess in guesses]), least)
    front = {guess.setting: guess for guess, is_on in zip(guesses, on_front, strict=True) if is_on}
    return sorted((g for g in front.values() if g.setting not in measured), key=lambda guess: guess.seconds)


def _fewer(
    options: list[Setting], measured: Mapping[Setting, float], film_seconds: Callable[[Setting], float], least: float
) -> list[Setting]:
    """Those of some options that no other beats in time and error; of options that all are so, every other one."""
    ordered = sorted(options, key=film_seconds)
    seconds, errors = (np.array(list(map(value, ordered))) for value in (film_seconds, measured.__getitem__))
    kept = list(itertools.compress(ordered, pareto_front(seconds, errors, least)))
    return kept if 0 < len(kept) < len(options) else ordered[::2]


def _options(base: Setting, group: tuple[str, ...], measured: Mapping[Setting, float]) -> list[Setting]:
    """Measured settings that depart from the scene's own in nothing but a group of choices."""
    others = [field.name for field in fields(Setting) if field.name not in group]
    if "motion" in group:
        others.remove("precision")  # another motion may bring its own
    return [s for s in measured if all(getattr(s, name) == getattr(base, name) for name in others)]
