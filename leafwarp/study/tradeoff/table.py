"""The table of the trade: CSV that grows while settings finish, JSON, Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from leafwarp.errors import OutputError
from leafwarp.files import write_text
from leafwarp.study.tradeoff.setting import Setting


@dataclass
class Row:
    """A setting and what it cost and gained. Absent (None) where it was not computed, or this scene has no such thing.

    Attributes:
        setting: What was chosen.
        name: "scene" for the scene as written, the name of a preset, "reference", or empty.
        varied: How it departs from the scene as written.
        status: "done", "skipped: budget", "stopped: budget" or "failed: REASON".
        predicted_seconds: Wall time expected of it from start to end [s].
        mesh_vertices: Vertices that the mesh came to have.
        seconds: Wall time of the film [s].
        seconds_per_second: The same for each second of playback.
        start_seconds: Wall time before the first frame [s].
        fluid_seconds: Wall time of fluid and coupling [s].
        motion_seconds: Wall time of the motion [s].
        peak_memory: Of the process that computed it [byte].
        fluid_steps: Of the fluid.
        motion_substeps: Of the motion.
        ledger_error: Water that the ledger misses, in contents of the saturated leaf.
        water_error: Relative L2 distance of the water from the reference.
        largest_water_error: Largest difference of the water content, anywhere at any time.
        shape_error: Root mean square distance of the leaf's points from the reference, as a share of its length.
        largest_shape_error: Largest distance of a point at any time, as a share of the leaf's length.
        water_within_reference: The water error is below the reference's own.
        shape_within_reference: The shape error is below the reference's own.
        water_pareto: No setting is faster with no larger water error.
        shape_pareto: The same for the shape error.
        water_over_time: Water error of each sampled frame (JSON only).
        shape_over_time: Shape error of each sampled frame (JSON only).
    """

    setting: Setting
    name: str
    varied: str
    status: str
    predicted_seconds: float
    mesh_vertices: int | None = None
    seconds: float | None = None
    seconds_per_second: float | None = None
    start_seconds: float | None = None
    fluid_seconds: float | None = None
    motion_seconds: float | None = None
    peak_memory: int | None = None
    fluid_steps: int | None = None
    motion_substeps: int | None = None
    ledger_error: float | None = None
    water_error: float | None = None
    largest_water_error: float | None = None
    shape_error: float | None = None
    largest_shape_error: float | None = None
    water_within_reference: bool | None = None
    shape_within_reference: bool | None = None
    water_pareto: bool | None = None
    shape_pareto: bool | None = None
    water_over_time: list[float] | None = None
    shape_over_time: list[float] | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain data without any nesting: the choices stand beside the rest, the map's width and height apart."""
        data = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "setting"}
        choices = self.setting.as_dict()
        width, height = choices.pop("map_size") or (None, None)
        head = {name: data.pop(name) for name in ("name", "varied", "status")}
        return {**head, "map_width": width, "map_height": height, **choices, **data}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Row:
        """The row that :meth:`as_dict` gave."""
        size = None if data["map_width"] is None else (data["map_width"], data["map_height"])
        choices = {field.name: data[field.name] for field in fields(Setting) if field.name != "map_size"}
        own = {field.name: data[field.name] for field in fields(cls) if field.name != "setting"}
        return cls(Setting(map_size=size, **choices), **own)

    @property
    def measured(self) -> bool:
        """Whether the setting was computed to the end."""
        return self.seconds is not None


OVER_TIME = ("water_over_time", "shape_over_time")
SETTING_COLUMNS = (
    "map_width", "map_height", *(field.name for field in fields(Setting) if field.name != "map_size"),
)  # fmt: skip
COLUMNS = (
    "name", "varied", "status", *SETTING_COLUMNS,
    *(field.name for field in fields(Row)[4:] if field.name not in OVER_TIME),
)  # fmt: skip


def _csv_lines(rows: Sequence[Row], header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    if header:
        writer.writeheader()
    for row in rows:
        data = row.as_dict()
        writer.writerow({name: _cell(data[name]) for name in COLUMNS})
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
    """The measured rows as a Markdown table; an error below the reference's own is starred."""
    lines = [
        "| setting | s | fluid s | motion s | MB | water error | largest | shape error | largest |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        if not row.measured:
            continue
        name = " ".join(filter(None, [f"**{row.name}**" if row.name else "", f"`{row.varied}`"]))
        megabytes = f"{row.peak_memory / 1e6:.0f}" if row.peak_memory else ""
        lines.append(
            f"| {name} | {row.seconds:.3g} | {row.fluid_seconds:.3g} | {row.motion_seconds:.3g} | {megabytes} "
            f"| {_share(row.water_error, row.water_within_reference)} | {_share(row.largest_water_error)} "
            f"| {_share(row.shape_error, row.shape_within_reference)} | {_share(row.largest_shape_error)} |"
        )
    return "\n".join(lines) + "\n"


def _share(value: float | None, starred: bool | None = False) -> str:
    return "" if value is None else f"{100.0 * value:.2g} %{'*' if starred else ''}"
