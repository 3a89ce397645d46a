"""What the cases found, as plain data and as a table for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from leafwarp.study.verify.case import Case, Check

TITLES = ("case", "quantity", "expected", "got", "error", "tolerance", "pass")


@dataclass(frozen=True)
class Result:
    """What a case found.

    Attributes:
        case: The case.
        checks: Its checks, in order.
        seconds: Wall time [s].
    """

    case: Case
    checks: tuple[Check, ...]
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether every check passed or fails for a known reason; a case without checks has proven nothing."""
        return bool(self.checks) and all(check.passed or check.is_explained for check in self.checks)

    @property
    def explained(self) -> tuple[Check, ...]:
        """The checks that fail for a known reason."""
        return tuple(check for check in self.checks if check.is_explained)


def as_data(results: Sequence[Result]) -> list[dict[str, Any]]:
    """One object a check, for JSON; a number that is not finite is None."""
    return [
        {
            "case": result.case.name,
            "quantity": check.quantity,
            "expected": _finite(check.expected),
            "got": _finite(check.got),
            "error": _finite(check.error),
            "tolerance": _finite(check.tolerance),
            "pass": check.passed,
        }
        for result in results
        for check in result.checks
    ]


def explanations(results: Sequence[Result]) -> list[dict[str, str]]:
    """Why checks fail, where that is known, for JSON."""
    return [
        {"case": result.case.name, "quantity": check.quantity, "explanation": check.explanation}
        for result in results
        for check in result.explained
    ]


def as_text(results: Sequence[Result]) -> str:
    """A table with a row a check, why checks fail where that is known, what the failed cases compare, and the count."""
    rows = [TITLES]
    for result in results:
        for number, check in enumerate(result.checks):
            rows.append(_row(result.case.name if number == 0 else "", check))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(_aligned(cell, width, n) for n, (cell, width) in enumerate(zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]
    lines.insert(1, "  ".join("-" * width for width in widths))
    for result in results:
        for reason in dict.fromkeys(check.explanation for check in result.explained):
            lines += ["", f"{result.case.name}: {reason}"]
    failed = [result for result in results if not result.passed]
    if failed:
        lines += ["", *(f"{result.case.name} failed: {result.case.summary}" for result in failed)]
    checks = [check for result in results for check in result.checks]
    passed = sum(check.passed for check in checks)
    seconds = sum(result.seconds for result in results)
    explained = sum(len(result.explained) for result in results)
    known = f" and {explained} failed for the reason given" if explained else ""
    lines += ["", f"{passed} of {len(checks)} checks of {len(results)} cases passed{known} in {seconds:.0f} s"]
    return "\n".join(lines)


def _row(name: str, check: Check) -> tuple[str, ...]:
    error, tolerance = (_share if check.is_relative else _number for _ in range(2))
    return (
        name,
        check.quantity,
        _number(check.expected),
        _number(check.got),
        error(check.error),
        tolerance(check.tolerance),
        "yes" if check.passed else "NO",
    )


def _aligned(cell: str, width: int, column: int) -> str:
    return cell.rjust(width) if 2 <= column <= 5 else cell.ljust(width)


def _number(value: float) -> str:
    return f"{value:.4g}"


def _share(value: float) -> str:
    return f"{100.0 * value:.2g} %"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
