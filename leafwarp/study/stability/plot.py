"""The picture of the envelopes: a panel a sweep, a band a method over the number that is swept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from leafwarp.errors import OutputError
from leafwarp.study.stability.envelope import Envelope, envelopes_of
from leafwarp.study.stability.point import BROKEN, INACCURATE, REFUSED, STABLE, Point
from leafwarp.study.stability.sweeps import SWEEPS, Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Told apart by lightness and hatching, too.
COLORS = {STABLE: "#5aa469", INACCURATE: "#f0b44c", REFUSED: "#c9cecb", BROKEN: "#b3261e"}
HATCHES = {STABLE: None, INACCURATE: "////", REFUSED: "....", BROKEN: "xxxx"}
INK, QUIET = "#26302b", "#8a938d"
COLUMNS = 2
BAND = 0.3  # height of a band [inch]
# A number that stands alone is drawn a decade wide.
ALONE = 10.0


def plot_envelopes(points: Sequence[Point], path: Path) -> None:
    """Draw the envelopes of points and write them as a picture.

    Raises:
        OutputError: It cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    bands = envelopes_of(points)
    sweeps = [sweep for sweep in SWEEPS if any(band.sweep == sweep.name for band in bands)]
    of_sweep = {sweep.name: [band for band in bands if band.sweep == sweep.name] for sweep in sweeps}
    rows = [sweeps[first : first + COLUMNS] for first in range(0, len(sweeps), COLUMNS)]
    heights = [max(len(of_sweep[sweep.name]) for sweep in row) * BAND + 0.95 for row in rows]
    figure = Figure(figsize=(15.0, sum(heights) + 0.6), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(rows), COLUMNS, squeeze=False, height_ratios=heights)
    for axes, sweep in zip(panels.flat, sweeps, strict=False):
        _draw(axes, sweep, of_sweep[sweep.name])
    for axes in panels.flat[len(sweeps) :]:
        axes.set_axis_off()
    present = [outcome for outcome in COLORS if any(point.outcome == outcome for point in points)]
    handles = [
        Patch(facecolor=COLORS[outcome], hatch=HATCHES[outcome], edgecolor="white", label=outcome)
        for outcome in present
    ]
    figure.legend(handles=handles, loc="outside upper left", ncol=len(handles), frameon=False, fontsize=11)
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def _draw(axes: Axes, sweep: Sweep, bands: Sequence[Envelope]) -> None:
    for row, band in enumerate(bands):
        edges = _edges(np.array([point.value for point in band.points]))
        for point, low, high in zip(band.points, edges[:-1], edges[1:], strict=True):
            axes.barh(
                row, high - low, left=low, height=0.82, color=COLORS[point.outcome], hatch=HATCHES[point.outcome],
                edgecolor="white", linewidth=0.4,
            )  # fmt: skip
    axes.set_xscale("log")
    every = np.concatenate([_edges(np.array([point.value for point in band.points])) for band in bands])
    axes.set_xlim(every.min(), every.max())
    axes.set_yticks(range(len(bands)), [f"{band.method}, {band.precision}" for band in bands], fontsize=8.5)
    axes.invert_yaxis()
    axes.set_xlabel(sweep.axis, color=INK, fontsize=9)
    axes.set_title(sweep.name, loc="left", color=INK, fontsize=11, fontweight="bold")
    tolerances = sorted({point.tolerance for band in bands for point in band.points}, reverse=True)
    shown = " or ".join(f"{tolerance:.2g}" for tolerance in tolerances)
    axes.set_title(f"stable: error up to {shown}", loc="right", color=QUIET, fontsize=8.5)
    axes.tick_params(colors=INK, length=3)
    for side in axes.spines.values():
        side.set_visible(False)


def _edges(values: np.ndarray) -> np.ndarray:
    """Where the bars of rising numbers meet: half-way on the logarithmic axis, shape [count + 1]."""
    logs = np.log10(values)
    if len(logs) == 1:
        return values[0] * np.array([ALONE**-0.5, ALONE**0.5])
    middles = 0.5 * (logs[1:] + logs[:-1])
    return 10.0 ** np.concatenate([[2 * logs[0] - middles[0]], middles, [2 * logs[-1] - middles[-1]]])
