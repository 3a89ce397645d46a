"""What a verification case is, and what it finds."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass

from leafwarp.errors import LeafwarpError


@dataclass(frozen=True)
class Check:
    """One quantity of a case, compared with what it should be.

    Attributes:
        quantity: What it is, with its unit.
        expected: What it should be.
        got: What it is.
        error: How far apart the two are: in the quantity's unit, or relative to what is expected.
        tolerance: The largest error that passes, in the same unit.
        is_relative: Whether error and tolerance are relative to what is expected.
        explanation: Why the check is known to fail, where it is; it is reported as failed all the same.
    """

    quantity: str
    expected: float
    got: float
    error: float
    tolerance: float
    is_relative: bool = False
    explanation: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; one that is not a number is not."""
        return bool(self.error <= self.tolerance)

    @property
    def is_explained(self) -> bool:
        """Whether the check fails for a known reason."""
        return not self.passed and self.explanation != ""


def near(quantity: str, expected: float, got: float, tolerance: float) -> Check:
    """A check that a quantity is what is expected, up to a tolerance in its unit."""
    return Check(quantity, float(expected), float(got), abs(float(got) - float(expected)), tolerance)


def near_share(quantity: str, expected: float, got: float, tolerance: float) -> Check:
    """A check that a quantity is what is expected, up to a share of that."""
    error = abs(float(got) - float(expected)) / abs(float(expected))
    return Check(quantity, float(expected), float(got), error, tolerance, is_relative=True)


def at_most(quantity: str, limit: float, got: float) -> Check:
    """A check that a quantity is no larger than a limit; the error is what it is beyond."""
    excess = float(got) - float(limit)
    return Check(f"{quantity} (at most)", float(limit), float(got), excess if not excess <= 0.0 else 0.0, 0.0)


@dataclass(frozen=True)
class Case:
    """A verification case.

    Attributes:
        name: Its name on the command line.
        summary: What is compared with what, in a sentence.
        place: Module within this package, and function in it, which takes the name of a Warp device and returns its
            checks.
    """

    name: str
    summary: str
    place: str

    @property
    def function(self) -> Callable[[str], list[Check]]:
        """The case itself; its module is imported now."""
        module, _, name = self.place.partition(":")
        return getattr(importlib.import_module(f"{__package__}.{module}"), name)

    def run(self, device: str) -> list[Check]:
        """Run the case. One that cannot be computed has a single check, which fails and says why."""
        try:
            return self.function(device)
        except LeafwarpError as error:
            return [Check(f"not computed: {error}", 0.0, math.nan, math.nan, 0.0)]
