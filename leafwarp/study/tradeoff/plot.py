"""The picture of the trade: seconds against error, for the water and for the shape, and both over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {"split": "#c2571a", "unsplit": "#1f6f8b", None: "#6b5b95"}
MARKERS = {"explicit": "o", "implicit": "s", "quasistatic": "D"}
INK, FRONT, QUIET, NAMED = "#26302b", "#3f8f4f", "#8a938d", "#7a1f5c"
# Settings that equal the reference to the last bit are drawn at this share of the reference's own error.
LOWEST_SHARE = 1e-2
# Fronts of more settings are not named in full.
MOST_NAMES = 12
PANELS = (
    ("water", "relative L2 error of the water", "Water"),
    ("shape", "RMS distance / leaf length", "Shape"),
)


def format_time(seconds: float) -> str:
    """A time as a person writes it: "15 s", "4 min", "1.5 h"."""
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} s"


def plot_tradeoff(result: Mapping[str, Any], path: Path) -> None:
    """Draw the result of :func:`leafwarp.study.tradeoff.study.run_tradeoff` and write it as a picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = [row for row in result["settings"] if row["seconds"] is not None]
    figure = Figure(figsize=(14.0, 9.4), dpi=130, facecolor="white")
    FigureCanvasAgg(figure)
    (left, right), below = figure.subplots(2, 2, height_ratios=(2.6, 1.0))
    figure.subplots_adjust(left=0.065, right=0.985, top=0.88, bottom=0.105, wspace=0.15, hspace=0.28)
    for axes, under, (kind, label, title) in zip((left, right), below, PANELS, strict=True):
        axes.set_title(title, loc="left", color=INK, fontsize=13, fontweight="bold")
        if all(row[f"{kind}_error"] is None for row in rows):
            _say_instead(axes, "several shapes: no error is given")
            under.set_axis_off()
            continue
        _draw_panel(axes, rows, kind, label, result["reference"]["own_errors"][f"{kind}_error"])
        _draw_over_time(under, rows, kind, result["sampled_frames"])
    film, whole = result["playback_seconds"], result["scene_playback_seconds"]
    if film < 0.99 * whole:
        note = f"in a film of {film:.2g} s instead of {whole:.2g} s"
        right.set_title(note, loc="right", color=QUIET, fontsize=9)
    figure.suptitle(_title(result), x=0.06, y=0.975, ha="left", color=INK, fontsize=12)
    _draw_legend(figure, rows)
    figure.savefig(path)


def _title(result: Mapping[str, Any]) -> str:
    reference = result["reference"]
    hours = result["plant_seconds"] / 3600.0
    doubt = "" if reference["converged"] else " (NOT CONVERGED)"
    return (
        f"{result['scene']}: what speed costs in accuracy over {hours:g} h of drying, on {result['device']['name']}\n"
        f"reference: {_short(reference['in_words'])}{doubt}"
    )


def _short(words: str) -> str:
    """How a setting departs from the scene as written, without the names of the tables."""
    for long, short in (("fluid.", ""), ("maps.size = ", "map "), ("mesh.", ""), ("solver.", ""), ("motion.", "")):
        words = words.replace(long, short)
    return words.replace(" = ", " ")


def _draw_panel(axes: Axes, rows: Sequence[Mapping[str, Any]], kind: str, label: str, floor: float) -> None:
    lowest = max(floor * LOWEST_SHARE, 1e-12)
    place = {id(row): (row["seconds"], max(row[f"{kind}_error"], lowest)) for row in rows}
    for row in rows:
        is_double, color = row["precision"] == "float64", COLORS[row["scheme"]]
        axes.scatter(
            *place[id(row)], s=44, marker=MARKERS[row["motion"]], zorder=3, linewidths=1.2, edgecolors=color,
            facecolors="white" if is_double else color,
        )  # fmt: skip
    for row in rows:
        if row["name"]:
            axes.scatter(*place[id(row)], s=240, marker="*", color=NAMED, zorder=4, edgecolors="white")
            axes.annotate(
                row["name"] if row["name"] != "scene" else "as written", place[id(row)], xytext=(9, -13),
                textcoords="offset points", fontsize=9.5, color=NAMED, fontweight="bold", zorder=5,
            )  # fmt: skip
    front = sorted((row for row in rows if row[f"{kind}_pareto"]), key=lambda row: row["seconds"])
    if front:
        xs, ys = zip(*(place[id(row)] for row in front), strict=True)
        axes.plot(xs, ys, color=FRONT, linewidth=5.0, alpha=0.35, zorder=1, solid_capstyle="round")
    axes.set(xscale="log", yscale="log", xlabel="wall seconds of the film", ylabel=label)
    xs, ys = [p[0] for p in place.values()], [*(p[1] for p in place.values()), max(floor, lowest)]
    axes.set_xlim(min(xs) / 1.5, max(xs) * 2.2)
    axes.set_ylim(min(ys) / 1.8, max(ys) * 4.0)
    _name_ticks(axes)
    _name_front(axes, front, place)
    low = axes.get_ylim()[0]
    if floor > low:
        axes.axhspan(low, floor, color=QUIET, alpha=0.13, linewidth=0, zorder=0)
        axes.annotate(
            "below the reference's own error", (0.012, 0.015), xycoords="axes fraction", fontsize=8.5, color=QUIET
        )
    _plain(axes)


def _name_ticks(axes: Axes) -> None:
    """Seconds and percents in plain numbers, at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis, text in ((axes.xaxis, lambda x, _: f"{x:g} s"), (axes.yaxis, lambda y, _: f"{100.0 * y:g} %")):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(text))


def _name_front(axes: Axes, front: Sequence[Mapping[str, Any]], place: Mapping) -> None:
    """Number the points of the front and say in the corner what they are."""
    lines = []
    for number, row in enumerate(front[:MOST_NAMES], start=1):
        axes.annotate(
            str(number), place[id(row)], xytext=(0, 7), textcoords="offset points", fontsize=8, color=INK, zorder=4,
            ha="center",
        )  # fmt: skip
        words = _short(row["varied"])
        lines.append(f"{number}  {words if len(words) < 74 else words[:72] + ' …'}")
    axes.text(
        0.985, 0.985, "\n".join(lines), transform=axes.transAxes, ha="right", va="top", fontsize=7, color=INK,
        linespacing=1.35, zorder=6, bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 2},
    )  # fmt: skip


def _draw_over_time(axes: Axes, rows: Sequence[Mapping[str, Any]], kind: str, frames: Sequence[int]) -> None:
    """Errors of the film, frame by frame: the front's thin, those with a name thick."""
    for row in sorted(rows, key=lambda row: bool(row["name"])):
        errors = row[f"{kind}_over_time"]
        if row["name"]:
            axes.plot(frames, errors, color=NAMED, linewidth=1.8, zorder=3)
            axes.annotate(
                row["name"] if row["name"] != "scene" else "as written", (frames[-1], errors[-1]), fontsize=8,
                color=NAMED, ha="right", va="bottom",
            )  # fmt: skip
        elif row[f"{kind}_pareto"]:
            axes.plot(frames, errors, color=COLORS[row["scheme"]], linewidth=0.8, alpha=0.6)
    axes.set(xlabel="frame", ylabel="error")
    axes.set_yscale("symlog", linthresh=1e-3)
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"{kind} over time", loc="left", color=QUIET, fontsize=9)
    _plain(axes)


def _say_instead(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=QUIET, fontsize=12)
    axes.set_xticks([])
    axes.set_yticks([])
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.grid(True, which="major", color="#e3e7e4", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, which="both")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw_legend(figure: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    from matplotlib.lines import Line2D

    def dot(label: str, marker: str = "o", color: str = INK, face: str | None = None) -> Line2D:
        return Line2D(
            [], [], linestyle="", marker=marker, markersize=7, color=color, markerfacecolor=face or color,
            label=label,
        )  # fmt: skip

    schemes = sorted({row["scheme"] for row in rows if row["scheme"] is not None})
    handles = [dot(scheme, color=COLORS[scheme]) for scheme in schemes]
    handles += [dot(motion, MARKERS[motion], QUIET) for motion in sorted({row["motion"] for row in rows})]
    handles += [dot("float32"), dot("float64", face="white"), dot("as written, presets", "*", NAMED)]
    handles.append(Line2D([], [], color=FRONT, linewidth=5, alpha=0.35, label="Pareto front"))
    figure.legend(
        handles=handles, loc="lower center", ncol=len(handles), frameon=False, fontsize=9, handletextpad=0.4,
        columnspacing=1.4,
    )  # fmt: skip
