"""What a sweep is made of, and how one of its points is judged."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from leafwarp.errors import LeafwarpError

# Finite, bounded and conserving, with an error within the tolerance; the same with an error beyond it; refused in one
# line that says why; and what must never happen.
STABLE, INACCURATE, REFUSED, BROKEN = OUTCOMES = ("stable", "inaccurate", "refused", "broken")


@dataclass(frozen=True)
class Finding:
    """What a computation that ended came to.

    Attributes:
        error: How far it is off a reference.
        faults: What of it no computation may be (not finite, out of bounds, not conserving), in words.
        note: What else there is to say, such as why no error is known.
    """

    error: float
    faults: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Trial:
    """One number of a sweep, by one method in one precision.

    Attributes:
        method: The scheme or method: a band of the picture.
        precision: "float32" or "float64".
        value: The number that is swept.
        tolerance: The largest error that counts as stable.
        compute: Computes it; a :class:`~leafwarp.errors.LeafwarpError` refuses it.
    """

    method: str
    precision: str
    value: float
    tolerance: float
    compute: Callable[[], Finding]


@dataclass(frozen=True)
class Sweep:
    """A family of computations that differ in one number.

    Attributes:
        name: Its name on the command line.
        axis: The number that is swept, with its unit.
        summary: What is computed, in a sentence.
        against: What the error is measured against, and in what.
        place: Module within this package, and function in it, which takes the name of a Warp device and returns its
            trials.
    """

    name: str
    axis: str
    summary: str
    against: str
    place: str

    def trials(self, device: str) -> Iterable[Trial]:
        """The trials, method by method, with rising numbers; the sweep's module is imported now."""
        module, _, name = self.place.partition(":")
        return getattr(importlib.import_module(f"{__package__}.{module}"), name)(device)


@dataclass(frozen=True)
class Point:
    """A trial and its outcome.

    Attributes:
        sweep: Name of the sweep.
        method: As of the trial; so are ``precision``, ``value`` and ``tolerance``.
        outcome: One of :data:`OUTCOMES`.
        error: Against the sweep's reference; None where nothing was computed.
        against: What the error is measured against, and in what.
        seconds: Wall time.
        message: The line of a refusal, or what is broken.
    """

    sweep: str
    method: str
    precision: str
    value: float
    outcome: str
    error: float | None
    tolerance: float
    against: str
    seconds: float
    message: str


def decades(exponents: Iterable[int]) -> tuple[float, ...]:
    """Powers of ten as they are written: 1e-5, not the nearest below."""
    return tuple(float(f"1e{exponent}") for exponent in exponents)


def judge(sweep: Sweep, trial: Trial) -> Point:
    """Compute a trial and judge what comes out."""
    begin = time.perf_counter()
    error, message = None, ""
    try:
        finding = trial.compute()
    except LeafwarpError as refusal:
        outcome, message = REFUSED, str(refusal)
    # A traceback is what the study looks for: it is reported with the number that leads to it.
    except Exception as fault:
        outcome, message = BROKEN, f"{type(fault).__name__}: {fault}"
    else:
        outcome, message, error = *_verdict(finding, trial.tolerance), finding.error
    seconds = time.perf_counter() - begin
    message = " ".join(message.split())
    return Point(
        sweep.name, trial.method, trial.precision, trial.value, outcome, error, trial.tolerance, sweep.against,
        seconds, message,
    )  # fmt: skip


def _verdict(finding: Finding, tolerance: float) -> tuple[str, str]:
    """Outcome and message of what was computed."""
    faults = finding.faults
    if math.isnan(finding.error):
        faults = (*faults, "the error is not a number")
    if faults:
        return BROKEN, "; ".join(faults)
    return STABLE if finding.error <= tolerance else INACCURATE, finding.note
