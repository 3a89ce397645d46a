"""The picture of the trade: seconds against error, for the water and for the shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {"split": "#c2571a", "unsplit": "#1f6f8b"}
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
INK, FRONT, QUIET = "#26302b", "#3f8f4f", "#8a938d"
# Settings that equal the reference to the last bit are drawn at this share of the reference's own error.
LOWEST_SHARE = 1e-2
PANELS = (
    ("water_error", "water_pareto", "relative L2 error of the water", "Water"),
    ("shape_error", "shape_pareto", "RMS distance / leaf length", "Shape"),
)


def plot_tradeoff(result: Mapping[str, Any], path: Path) -> None:
    """Draw the result of :func:`leafwarp.study.tradeoff.run_tradeoff` and write it as a picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = [row for row in result["settings"] if row["water_error"] is not None]
    sizes = sorted({(row["map_width"], row["map_height"]) for row in rows})
    marker_of = {size: MARKERS[i % len(MARKERS)] for i, size in enumerate(sizes)}
    figure = Figure(figsize=(13.0, 6.2), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.065, right=0.985, top=0.84, bottom=0.165, wspace=0.17)
    for axes, (error, pareto, label, title) in zip((left, right), PANELS, strict=True):
        _draw_panel(axes, rows, marker_of, error, pareto, result["reference"]["own_errors"][error])
        axes.set_ylabel(label, color=INK)
        axes.set_title(title, loc="left", color=INK, fontsize=13, fontweight="bold")
    film, whole = result["playback_seconds"], result["scene_playback_seconds"]
    if film < 0.99 * whole:
        note = f"in a film of {film:.2g} s instead of {whole:.2g} s"
        right.set_title(note, loc="right", color=QUIET, fontsize=9)
    figure.suptitle(_title(result), x=0.065, y=0.965, ha="left", color=INK, fontsize=12)
    _draw_legend(figure, marker_of, {row["scheme"] for row in rows})
    figure.savefig(path)


def _title(result: Mapping[str, Any]) -> str:
    reference = result["reference"]
    width, height = reference["map_size"]
    hours = result["plant_seconds"] / 3600.0
    return (
        f"{result['scene']}: what speed costs in accuracy over {hours:g} h of drying, "
        f"on {result['device']['name']}\n"
        f"reference: {width} x {height}, step {format_time(reference['step'])}, unsplit, float64"
        f"{'' if reference['converged'] else ' (NOT CONVERGED: shorter steps move away from it)'}"
    )


def format_time(seconds: float) -> str:
    """A time as a person writes it: "15 s", "4 min", "1.5 h"."""
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} s"


def _draw_panel(
    axes: Axes, rows: Sequence[Mapping[str, Any]], marker_of: Mapping, error: str, pareto: str, floor: float
) -> None:
    lowest = max(floor * LOWEST_SHARE, 1e-12)
    place = {id(row): (row["fluid_seconds"], max(row[error], lowest)) for row in rows}
    families: dict[tuple, list] = {}
    for row in rows:
        family = row["map_width"], row["map_height"], row["scheme"], row["precision"]
        families.setdefault(family, []).append(row)
    for (width, height, scheme, precision), members in families.items():
        members.sort(key=lambda row: row["fluid_step"])
        xs, ys = zip(*(place[id(row)] for row in members), strict=True)
        color = COLORS[scheme]
        axes.plot(xs, ys, color=color, linewidth=0.8, alpha=0.35, zorder=2)
        axes.scatter(
            xs, ys, s=44, marker=marker_of[width, height], zorder=3, linewidths=1.2, edgecolors=color,
            facecolors=color if precision == "float32" else "white",
        )  # fmt: skip
    front = sorted((row for row in rows if row[pareto]), key=lambda row: row["fluid_seconds"])
    if front:
        xs, ys = zip(*(place[id(row)] for row in front), strict=True)
        axes.plot(xs, ys, color=FRONT, linewidth=5.0, alpha=0.35, zorder=1, solid_capstyle="round")
    axes.set(xscale="log", yscale="log", xlabel="wall seconds of the fluid, whole scene")
    _pad(axes, [p[0] for p in place.values()], [*(p[1] for p in place.values()), floor])
    _name_front(axes, front, place)
    low = axes.get_ylim()[0]
    if floor > low:
        axes.axhspan(low, floor, color=QUIET, alpha=0.13, linewidth=0, zorder=0)
        axes.annotate(
            "below the reference's own error", (0.012, 0.015), xycoords="axes fraction", fontsize=8.5,
            color=QUIET,
        )  # fmt: skip
    axes.grid(True, which="major", color="#e3e7e4", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, which="both")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _pad(axes: Axes, xs: Sequence[float], ys: Sequence[float]) -> None:
    """Limits with room for the names of the points."""
    axes.set_xlim(min(xs) / 1.6, max(xs) * 2.2)
    axes.set_ylim(min(y for y in ys if y > 0.0) / 1.8, max(ys) * 2.0)


def _name_front(axes: Axes, front: Sequence[Mapping[str, Any]], place: Mapping) -> None:
    """Write map and step beside the points of the front, leaving out what would cover the name before."""
    last = None
    for row in front:
        at = axes.transAxes.inverted().transform(axes.transData.transform(place[id(row)]))
        if last is not None and abs(at[0] - last[0]) < 0.09 and abs(at[1] - last[1]) < 0.045:
            continue
        last = at
        axes.annotate(
            f"{max(row['map_width'], row['map_height'])}, {format_time(row['fluid_step'])}", place[id(row)],
            xytext=(7, 7), textcoords="offset points", fontsize=8, color=INK, zorder=4,
        )  # fmt: skip


def _draw_legend(figure: Any, marker_of: Mapping, schemes: set[str]) -> None:
    from matplotlib.lines import Line2D

    def dot(label: str, marker: str = "o", color: str = INK, face: str | None = None) -> Line2D:
        return Line2D(
            [], [], linestyle="", marker=marker, markersize=7, color=color, markerfacecolor=face or color,
            label=label,
        )  # fmt: skip

    handles = [dot(scheme, color=COLORS[scheme]) for scheme in sorted(schemes)]
    handles += [dot(f"{width} x {height}", marker, QUIET) for (width, height), marker in marker_of.items()]
    handles += [dot("float32"), dot("float64", face="white")]
    front = "Pareto front (map, fluid step)"
    handles.append(Line2D([], [], color=FRONT, linewidth=5, alpha=0.35, label=front))
    figure.legend(
        handles=handles, loc="lower center", ncol=len(handles), frameon=False, fontsize=9, handletextpad=0.4,
        columnspacing=1.4,
    )  # fmt: skip
