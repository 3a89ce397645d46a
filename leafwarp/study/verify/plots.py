"""Pictures of what some cases compare: convergence, the cantilever's droop, a drying leaf."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leafwarp.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, QUIET, GRID = "#26302b", "#8a938d", "#e3e7e4"
SCHEME_COLORS = {"split": "#c2571a", "unsplit": "#1f6f8b", "iterated": "#7a5ea8"}
MESH_COLORS = {"hexagonal": "#1f6f8b", "irregular": "#c2571a"}
MARKERS = ("o", "s", "^")


def write_plots(names: Sequence[str], device: str, folder: Path) -> None:
    """Draw what there is to draw of some cases.

    Args:
        names: Names of the cases; they have run, so that what they computed is at hand.
        device: Warp device on which they ran.
        folder: Where the pictures go; it exists.

    Raises:
        OutputError: A picture cannot be written.
    """
    for name, draw in PLOTS.items():
        if name not in names:
            continue
        path = folder / f"{name}.png"
        try:
            draw(device).savefig(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def _figure(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    panels = list(np.atleast_1d(figure.subplots(1, columns)))
    for axes in panels:
        axes.grid(True, which="major", color=GRID, linewidth=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(colors=INK, which="both")
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    return figure, panels


def _labels(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left", color=INK, fontsize=12, fontweight="bold")
    axes.set_xlabel(x, color=INK)
    axes.set_ylabel(y, color=INK)
    axes.legend(frameon=False, fontsize=9)


def _convergence(device: str) -> Any:
    """Errors of each scheme on the manufactured solution, and the slopes of its orders."""
    from leafwarp.study.verify.convergence import errors_in_the_cell, errors_in_the_step
    from leafwarp.study.verify.drawn_fluid import STAGES

    figure, panels = _figure(11.0, 4.6, 2)
    for axes, errors_of, order, what in (
        (panels[0], errors_in_the_step, 1, "fluid step [s]"),
        (panels[1], errors_in_the_cell, 2, "width of a cell, of the map"),
    ):
        for number, scheme in enumerate(STAGES):
            sizes, errors = errors_of(scheme, device)
            style = {"color": SCHEME_COLORS[scheme], "marker": MARKERS[number], "markersize": 9 - 2 * number}
            axes.loglog(sizes, errors, label=scheme, linewidth=1.2, **style)
        slope = 0.5 * np.array(errors)[-1] * (np.array(sizes) / sizes[-1]) ** order
        axes.loglog(sizes, slope, color=QUIET, linestyle="--", linewidth=1.0, label=f"order {order}")
        _labels(axes, f"Order in the {what.split(' [')[0].split(',')[0]}", what, "root mean square error")
    return figure


def _cantilever(device: str) -> Any:
    """Droop of sheets under their own weight beside the elastica, and how far off it is."""
    from leafwarp.study.verify.beams import CELLS, WEIGHTS, droops, expected_droop

    figure, panels = _figure(11.0, 4.6, 2)
    weights = np.geomspace(WEIGHTS[0] / 1.5, WEIGHTS[-1] * 1.3, 30)
    panels[0].semilogx(
        weights, [expected_droop(w) for w in weights], color=INK, linewidth=1.2, label="elastica, 0.95 D"
    )
    for kind, color in MESH_COLORS.items():
        for number, cells in enumerate(CELLS):
            drops = droops(kind, cells, device).mean(axis=0)
            errors = drops / np.array([expected_droop(w) for w in WEIGHTS]) - 1.0
            style = {"color": color, "marker": MARKERS[number], "markersize": 6, "label": f"{kind}, h = L/{cells}"}
            panels[0].semilogx(WEIGHTS, drops, linestyle="", markerfacecolor="none", **style)
            panels[1].semilogx(WEIGHTS, 100.0 * errors, linewidth=1.0, **style)
    panels[1].axhspan(-3.0, 3.0, color=QUIET, alpha=0.13, linewidth=0)
    panels[1].axhline(0.0, color=INK, linewidth=0.8)
    weight = "weight number, sigma g L^3 / D"
    _labels(panels[0], "A cantilever under its own weight", weight, "droop / length")
    _labels(panels[1], "Difference from the elastica", weight, "per cent of the droop")
    return figure


def _drying(device: str) -> Any:
    """The measured contents of the kohlrabi leaf and the simulation's."""
    from leafwarp.study.verify.drying import FIRST_INTERVAL, KOHLRABI, MEASURED, TOLERANCE, drying_curve

    figure, (axes,) = _figure(6.6, 4.6)
    hours, measured = np.array(MEASURED).T
    fine = np.linspace(0.0, hours[-1], 100)
    axes.fill_between(
        hours[1:], measured[1:] - TOLERANCE, measured[1:] + TOLERANCE, color=QUIET, alpha=0.15, linewidth=0
    )
    axes.plot(hours, measured, "o", color=INK, label="measured")
    axes.plot(fine, drying_curve(KOHLRABI, fine, device=device), color="#1f6f8b", label="from saturation")
    later = fine[fine >= FIRST_INTERVAL]
    rest = drying_curve(KOHLRABI, later - FIRST_INTERVAL, start=measured[1], device=device)
    axes.plot(later, rest, color="#c2571a", label=f"from {FIRST_INTERVAL:g} h on")
    _labels(axes, "A severed kohlrabi leaf", "hours", "relative water content")
    return figure


PLOTS = {
    "manufactured_solution": _convergence,
    "own_weight": _cantilever,
    "kohlrabi_drying": _drying,
}
