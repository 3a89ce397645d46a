"""One split step of diffusion at several sizes of the map, beside other ways to do it.

All contenders solve the same lines of the bramble's leaf, each run of leaf cells from its first to its last, and take
turns. Beside them stands the time that a plain copy takes for as many bytes as a step must move at the least: each
content read and written and its two weights read, along rows and along columns.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec

import cv2
import numpy as np
import warp as wp

from benchmarks import fluid_contenders as ways
from benchmarks.fluid_contenders import Problem
from benchmarks.table2 import SCENE
from benchmarks.timing import Timing, round_robin
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene

TITLE = "Fluid: one split step"
SIZES = (128, 256, 512, 1024, 2048)
QUICK_SIZES = (64,)
QUICK = "one small map, few rounds"
ROUNDS = (21, 3)
OPTIONS = {"--sizes": {"type": int, "nargs": "+", "metavar": "CELLS", "help": f"cells across (default: {SIZES})"}}
OURS, STREAM = "leafwarp, 32 lines at a time", "plain copy of the bytes a step must move"


@dataclass(frozen=True)
class Contender:
    """A way to do a step.

    Attributes:
        name: Of it.
        make: Makes it from the problem.
        largest: Cells across of the largest map that it is tried on; beyond, it takes minutes or the memory.
        like: Name of the contender that it should agree with; None for :data:`OURS` in float64.
        module: What has to be installed; None for nothing.
    """

    name: str
    make: Callable[[Problem], object]
    largest: int = 1 << 30
    like: str | None = None
    module: str | None = None


UNSPLIT = "SciPy splu, unsplit, factor reused, float64"
CONTENDERS = (
    Contender(OURS, ways.Lanes),
    Contender("the same, rows alone", lambda p: ways.Lanes(p, "x"), like="rows"),
    Contender("the same, columns alone", lambda p: ways.Lanes(p, "y"), like="columns"),
    Contender("the same, float64", lambda p: ways.Lanes(p, precision="float64")),
    # Launches from two threads at once now and then end the process in Warp's debug mode; the simulation makes none.
    *([] if wp.config.mode == "debug" else [Contender("the same, two host threads", ways.TwoThreads)]),
    Contender("one scalar thread a line", ways.ScalarThreads),
    Contender("one scalar thread a line, float64", lambda p: ways.ScalarThreads(p, precision="float64")),
    Contender("Warp kernel of a tutorial", ways.NaiveWarp),
    Contender("LAPACK sgtsv, a call a line", ways.Lapack),
    Contender("NumPy across lines", ways.AcrossLines),
    Contender("leafwarp, unsplit, float64", ways.Factored, 1024, UNSPLIT),
    Contender(UNSPLIT, ways.SciPySparse, 512, UNSPLIT),
    Contender("FiPy, unsplit, float64", ways.FiPy, 256, UNSPLIT, "fipy"),
)


def resized(leaf: Leaf, cells: int) -> Leaf:
    """The leaf with square maps of this many cells across, area means of finer ones."""
    size = (cells, cells)
    mask = cv2.resize(leaf.mask.astype(np.float64), size, interpolation=cv2.INTER_AREA) > 0.5
    maps = {name: cv2.resize(values, size, interpolation=cv2.INTER_AREA) for name, values in leaf.maps.items()}
    return replace(leaf, mask=mask, maps=maps)


def measure(problem: Problem, rounds: int) -> dict[str, tuple[Timing, float | None]]:
    """Time of a step of every contender that is there, and its largest difference from what it should be."""
    cells = problem.mask.shape[0]
    made = {
        contender.name: contender.make(problem)
        for contender in CONTENDERS
        if cells <= contender.largest and (contender.module is None or find_spec(contender.module))
    }
    differences = first_step_differences(problem, made)
    for directions, name in (("xy", STREAM), ("x", f"{STREAM}, rows alone"), ("y", f"{STREAM}, columns alone")):
        made[name] = ways.Stream(problem.least_bytes(directions, 4))
    timings = round_robin({name: way.step for name, way in made.items()}, rounds)
    return {name: (timing, differences.get(name)) for name, timing in timings.items()}


def first_step_differences(problem: Problem, made: dict[str, object]) -> dict[str, float]:
    """Let everybody do the first step; the largest difference on the leaf from a solve in float64."""
    references = {}
    for name, directions in ((None, "xy"), ("rows", "x"), ("columns", "y")):
        reference = ways.ScalarThreads(problem, directions, "float64")
        reference.step()
        references[name] = reference.content.copy()
    differences = {}
    for contender in CONTENDERS:
        if contender.name in made:
            made[contender.name].step()
    if UNSPLIT in made:
        references[UNSPLIT] = made[UNSPLIT].content.copy()
    for contender in CONTENDERS:
        if contender.name in made and contender.like in references:
            gap = np.abs(made[contender.name].content - references[contender.like])
            differences[contender.name] = float(gap[problem.mask].max())
    return differences


def rows_of(cells: int, measured: dict[str, tuple[Timing, float | None]]) -> list[str]:
    """The table's rows of one size."""
    ours, stream = measured[OURS][0], measured[STREAM][0]
    rows = []
    for name, (timing, difference) in measured.items():
        gap = "" if difference is None else f"{difference:.1e}"
        rows.append(f"| {cells} | {name} | {timing} | {timing.over(ours)} | {timing.over(stream)} | {gap} |")
    return rows


def make_table(scene: Scene, leaf: Leaf, sizes: tuple[int, ...], rounds: int) -> str:
    """All sizes as Markdown."""
    lines = [
        "| map | step | ms | of leafwarp's | of the copy's | largest difference |",
        "|---:|---|---:|---:|---:|---:|",
    ]
    for cells in sizes:
        measured = measure(Problem(scene, resized(leaf, cells), scene.fluid.step), rounds)
        lines += rows_of(cells, measured)
        print(f"{cells} x {cells}: done", file=sys.stderr)
    return "\n".join(lines) + "\n"


def left_out(sizes: tuple[int, ...]) -> str:
    """Who is missing, and why."""
    reasons = []
    for contender in CONTENDERS:
        if contender.module is not None and find_spec(contender.module) is None:
            reasons.append(f"{contender.name}: not installed.")
        elif max(sizes) > contender.largest:
            reasons.append(f"{contender.name}: up to {contender.largest} only, beyond it takes minutes or the memory.")
    return "\n".join(f"- {reason}" for reason in reasons) + "\n"


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    sizes = tuple(options.sizes or (QUICK_SIZES if options.quick else SIZES))
    scene = load_scene(SCENE).with_changes({"maps.size": max(sizes), "output.contact_sheet": False})
    leaf = prepare_scene_leaf(scene, None)
    return (
        f"Milliseconds: median (and middle half) of {options.rounds} measurements, taken in turns; ratios are taken "
        "round by round. float32 on one thread where nothing else is said. The largest difference is that of the "
        "contents (0 to 1) after one step from a split step in float64, one scalar thread a line; for unsplit steps, "
        "which solve rows and columns at once, from SciPy's. `scenes/bramble.toml`, a step of "
        f"{scene.fluid.step:g} s.\n\n{make_table(scene, leaf, sizes, options.rounds)}\n{left_out(sizes)}"
    )
