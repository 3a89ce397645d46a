"""The table of the trade: CSV that grows while settings finish, JSON, Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from leafwarp.errors import OutputError
from leafwarp.files import write_text


@dataclass
class Row:
    """A setting and what it cost and gained. Absent (None) where it was not computed.

    Attributes:
        map_width: Cells of the map.
        map_height: Cells of the map.
        fluid_step: [s] of plant time.
        scheme: "split" or "unsplit".
        precision: "float32" or "float64".
        status: "done", "reference", "skipped: budget", "stopped: budget" or "failed: REASON".
        predicted_seconds: Wall time expected before it was computed [s].
        seconds: Wall time of all groups of stages [s].
        fluid_seconds: Wall time of the fluid [s].
        fluid_seconds_per_plant_hour: The same for each hour of plant time [s/h].
        motion_substeps: Substeps of the motion in all.
        ledger_error: Water that the ledger misses, in contents of the saturated leaf.
        water_error: Relative L2 distance of the water from the reference.
        largest_water_error: Largest difference of the water content at a vertex.
        shape_error: Root mean square distance from the reference, as a share of the leaf's length.
        water_within_reference: The water error is below the reference's own.
        shape_within_reference: The shape error is below the reference's own.
        water_pareto: No setting has a faster fluid and no larger water error.
        shape_pareto: The same for the shape error.
    """

    map_width: int
    map_height: int
    fluid_step: float
    scheme: str
    precision: str
    status: str
    predicted_seconds: float
    seconds: float | None = None
    fluid_seconds: float | None = None
    fluid_seconds_per_plant_hour: float | None = None
    motion_substeps: int | None = None
    ledger_error: float | None = None
    water_error: float | None = None
    largest_water_error: float | None = None
    shape_error: float | None = None
    water_within_reference: bool | None = None
    shape_within_reference: bool | None = None
    water_pareto: bool | None = None
    shape_pareto: bool | None = None

    @property
    def measured(self) -> bool:
        """Whether the setting was computed to the end."""
        return self.water_error is not None


COLUMNS = tuple(field.name for field in fields(Row))


def _csv_lines(rows: Sequence[Row], header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    if header:
        writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in asdict(row).items()})
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    return value


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write the whole table.

    Raises:
        OutputError: It cannot be written.
    """
    write_text(path, _csv_lines(rows, header=True))


def append_row(path: Path, row: Row) -> None:
    """Add a row to the table, so that nothing is lost if the study is interrupted.

    Raises:
        OutputError: It cannot be written.
    """
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(_csv_lines([row], header=False))
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def markdown(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table; an error below the reference's own is starred."""
    lines = [
        "| map | fluid step | scheme | precision | fluid s per plant hour | s in all | water error | largest "
        "| shape error |",
        "|---|---:|---|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        size = f"{row.map_width} x {row.map_height}"
        name = f"| {size} | {row.fluid_step:g} s | {row.scheme} | {row.precision} "
        if not row.measured:
            lines.append(f"{name}| | {row.predicted_seconds:.0f} predicted | {row.status} | | |")
            continue
        water = "*" if row.water_within_reference else ""
        shape = "*" if row.shape_within_reference else ""
        lines.append(
            f"{name}| {row.fluid_seconds_per_plant_hour:.3g} | {row.seconds:.3g} "
            f"| {row.water_error:.2g}{water} | {row.largest_water_error:.2g} | {row.shape_error:.2g}{shape} |"
        )
    return "\n".join(lines) + "\n"
