"""The points as CSV, as plain data and as text."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from leafwarp.study.stability.envelope import Envelope, envelopes_of
from leafwarp.study.stability.point import OUTCOMES, Point
from leafwarp.study.stability.sweeps import SWEEPS

COLUMNS = tuple(field.name for field in fields(Point))
TITLES = ("sweep", "method", "precision", "outcome by the number that is swept", "worst stable error")


def as_csv(points: Sequence[Point]) -> str:
    """A row a point; an error that is not known is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for point in points:
        writer.writerow("" if value is None else value for value in _row(point).values())
    return text.getvalue()


def as_data(points: Sequence[Point], device: str) -> dict[str, Any]:
    """Points and envelopes, for programs."""
    named = {point.sweep for point in points}
    return {
        "device": device,
        "counts": counts(points),
        "sweeps": [
            {"name": s.name, "axis": s.axis, "summary": s.summary, "against": s.against}
            for s in SWEEPS
            if s.name in named
        ],
        "envelopes": [
            {
                "sweep": envelope.sweep,
                "method": envelope.method,
                "precision": envelope.precision,
                "spans": [asdict(span) for span in envelope.spans],
                "worst_stable_error": envelope.worst,
            }
            for envelope in envelopes_of(points)
        ],
        "points": [_row(point) for point in points],
    }


def counts(points: Sequence[Point]) -> dict[str, int]:
    """How many points there are of each outcome."""
    return {outcome: sum(point.outcome == outcome for point in points) for outcome in OUTCOMES}


def as_text(points: Sequence[Point]) -> str:
    """A table with a row a method, what each sweep is, and the count."""
    envelopes = envelopes_of(points)
    rows = [TITLES, *(_cells(envelope) for envelope in envelopes)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths))
    named = {envelope.sweep for envelope in envelopes}
    lines.append("")
    lines += [f"{s.name}: {s.axis}. {s.summary} Error against {s.against}." for s in SWEEPS if s.name in named]
    broken = [point for point in points if point.outcome == "broken"]
    if broken:
        lines += ["", *(f"BROKEN: {where(point)}: {point.message}" for point in broken)]
    found = ", ".join(f"{count} {outcome}" for outcome, count in counts(points).items())
    lines += ["", f"{len(points)} points in {sum(point.seconds for point in points):.0f} s: {found}"]
    return "\n".join(lines)


def where(point: Point) -> str:
    """What a point is, in words."""
    return f"{point.sweep} = {point.value:g}, {point.method}, {point.precision}"


def _row(point: Point) -> dict[str, Any]:
    row = asdict(point)
    row["seconds"] = round(point.seconds, 4)
    if point.error is not None and not math.isfinite(point.error):
        row["error"] = None
    return row


def _cells(envelope: Envelope) -> tuple[str, ...]:
    spans = (f"{span.outcome} {_range(span.low, span.high)}" for span in envelope.spans)
    worst = "" if envelope.worst is None else f"{envelope.worst:.2g}"
    return envelope.sweep, envelope.method, envelope.precision, ", ".join(spans), worst


def _range(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
