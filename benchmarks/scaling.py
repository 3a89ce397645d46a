"""How cost grows: a fluid step with the cells of the map, a substep with the vertices of the mesh, a frame with leaves.

One leaf is drawn, so that it can be made in any size: an ellipse with a midrib, and a strip of nearly equilateral
triangles. Many leaves are those of ``scenes/many.toml``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.structure import Structure
from benchmarks.timing import Timing, exponent, round_robin
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from leafwarp.study.verify.drawn_fluid import Sample, ellipse, make_sample
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of, strip_triangles

TITLE = "Scaling: cost against size"
QUICK = "small sizes, few rounds"
MAPS, QUICK_MAPS = (128, 256, 512, 1024, 2048, 4096), (32, 64, 128)
VERTICES, QUICK_VERTICES = (200, 500, 1700, 5000, 20_000, 100_000), (100, 200, 400)
LEAVES, QUICK_LEAVES = (1, 10, 100, 1000), (1, 2, 4)
ROUNDS = (11, 3)
OPTIONS = {
    "--leaves": {"type": int, "nargs": "+", "metavar": "COUNT", "help": f"numbers of leaves (default: {LEAVES})"},
    "--device": {"default": "cpu", "help": "Warp device of the many leaves: cpu (default), cuda:0, ..."},
}
PARTS = ("fluid step", "coupling", "substep", "frame")
MANY = Path(__file__).parent.parent / "scenes" / "many.toml"
LENGTH, WIDTH = 0.1, 0.05  # [m] of the strip
STEP = 15.0  # [s] of plant time


def fluid(cells: int) -> Sample:
    """The split scheme alone on a square map of this many cells across."""
    venation = np.zeros((cells, cells))
    middle = slice(cells // 2 - max(1, cells // 100), cells // 2 + max(1, cells // 100))
    venation[:, middle] = 1.0
    tables = {"fluid": {"step": STEP, "lamina_diffusivity": 4e-10, "vein_diffusivity": 1.5e-5}}
    water = np.random.default_rng(1).random((cells, cells))
    mask = ellipse(cells)
    return make_sample(tables, mask, {"venation": venation, "water": np.where(mask, water, 0.0)})


def structure(vertices: int) -> tuple[Structure, int, int]:
    """The motion of a strip of about this many vertices; and how many vertices and springs it has."""
    columns = max(2, round((vertices * LENGTH / WIDTH * 0.75**0.5) ** 0.5))
    positions, triangles = strip_triangles(LENGTH, WIDTH, columns)
    leaf = leaf_of(mesh_from_triangles(positions, triangles))
    scene = scene_of(
        {"membrane_stiffness": 2.0, "bending_stiffness": 2e-7},
        {"gravity": [0.0, 0.0, -0.004], "drag": 4.0},
        solver={"maximum_substeps": 10**6},
    )
    return Structure(scene, leaf), leaf.mesh.vertex_count, leaf.mesh.edge_count + leaf.mesh.hinge_count


def fluid_rows(sizes: tuple[int, ...], rounds: int) -> list[str]:
    """Table of the fluid step."""
    samples = {cells: fluid(cells) for cells in sizes}
    timings = round_robin({cells: sample.stages["split_diffusion"].run for cells, sample in samples.items()}, rounds)
    rows = ["| map | leaf cells | fluid step [ms] | ns a leaf cell | arrays [MB] |", "|---:|---:|---:|---:|---:|"]
    counts = []
    for cells, sample in samples.items():
        count = int(sample.leaf.mask.sum())
        timing, megabytes = timings[cells], sample.state.byte_count / 1e6
        rows.append(f"| {cells} | {count} | {timing} | {1e6 * timing.median / count:.3g} | {megabytes:.3g} |")
        counts.append(count)
    return [*rows, "", f"A fluid step: {grown('leaf cells', counts, list(timings.values()))}"]


def structure_rows(sizes: tuple[int, ...], rounds: int) -> list[str]:
    """Table of the substep."""
    made = [structure(vertices) for vertices in sizes]
    timings = list(round_robin({count: one.advance for one, count, _ in made}, rounds).values())
    rows = ["| vertices | springs | substep [ms] | ns a spring | arrays [MB] |", "|---:|---:|---:|---:|---:|"]
    for (one, vertices, springs), timing in zip(made, timings, strict=True):
        each, megabytes = 1e6 * timing.median / springs, one.state.byte_count / 1e6
        rows.append(f"| {vertices} | {springs} | {timing} | {each:.3g} | {megabytes:.3g} |")
    return [*rows, "", f"A substep: {grown('springs', [springs for _, _, springs in made], timings)}"]


class Leaves:
    """The frames of many leaves.

    Args:
        scene: The scene; its count is replaced.
        count: Number of leaves.
        device: Warp device.
    """

    def __init__(self, scene: Scene, count: int, device: str):
        scene = scene.with_changes({"leaves.count": count})
        self.simulation = Simulation(scene, prepare_scene_leaf(scene, None), device)
        self._frame = 1

    def advance(self) -> dict[str, float]:
        """Compute the next frame.

        Returns:
            Milliseconds of a fluid step, of the coupling, of a substep and of the whole frame.
        """
        simulation = self.simulation
        self._frame += 1
        before, steps = self._seconds(), simulation.fluid.steps_done
        simulation.advance(self._frame)
        simulation.read_frame(self._frame)
        fluid, coupling, motion, rest = (now - then for now, then in zip(self._seconds(), before, strict=True))
        parts = (
            fluid / (simulation.fluid.steps_done - steps),
            coupling,
            motion / simulation.substeps[-1],
            fluid + coupling + motion + rest,
        )
        return {name: 1e3 * seconds for name, seconds in zip(PARTS, parts, strict=True)}

    def _seconds(self) -> tuple[float, float, float, float]:
        simulation = self.simulation
        groups = (simulation.group_seconds("fluid"), simulation.group_seconds("coupling"))
        return (*groups, *(simulation.watch.seconds.get(name, 0.0) for name in ("motion", "frame")))


def leaves_rows(counts: tuple[int, ...], rounds: int, device: str) -> list[str]:
    """Table of the frames of many leaves; all numbers of them take turns, after a frame that is not timed."""
    # As many frames as are measured, an hour each.
    scene = load_scene(MANY).with_changes({"time.frames": rounds + 2, "time.duration": 3600.0 * (rounds + 1)})
    made = {count: Leaves(scene, count, device) for count in counts}
    laps: dict[int, list[dict[str, float]]] = {count: [] for count in counts}
    for turn in range(rounds + 1):
        for count, one in made.items():
            lap = one.advance()
            if turn > 0:
                laps[count].append(lap)
    rows = [
        "| leaves | fluid step [ms] | coupling [ms] | substep [ms] | one of each, a leaf [µs] | substeps | "
        "frame [ms] | frame, a leaf [ms] | arrays [MB] |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    steps, frames = [], []
    for count, one in made.items():
        parts = [Timing(tuple(lap[name] for lap in laps[count])) for name in PARTS]
        step, frame = parts[0] + parts[1] + parts[2], parts[3]
        substeps, megabytes = one.simulation.substeps[-1], one.simulation.state.byte_count / 1e6
        columns = " | ".join(str(part) for part in parts[:3])
        rows.append(
            f"| {count} | {columns} | {1e3 * step.median / count:.3g} | {substeps} | {frame} | "
            f"{frame.median / count:.3g} | {megabytes:.3g} |"
        )
        steps.append(step)
        frames.append(frame)
    return [*rows, "", f"One of each: {grown('leaves', counts, steps)}", f"A frame: {grown('leaves', counts, frames)}"]


def grown(what: str, counts: Sequence[int], timings: Sequence[Timing]) -> str:
    """The exponent fitted to all sizes, and to the larger half of them."""
    medians = [timing.median for timing in timings]
    half = len(counts) // 2
    fits = [
        f"{exponent(some, times):.2f}"
        for some, times in ((counts, medians), (counts[half:], medians[half:]))
        if len(some) > 1
    ]
    if not fits:
        return "one size shows no growth.\n"
    larger = f", over the larger half of the sizes {fits[1]}" if len(fits) > 1 else ""
    return f"time grows with the power {fits[0]} of the {what}{larger}.\n"


def make_body(options: argparse.Namespace) -> str:
    """The tables, with what they show."""
    tables = [
        *fluid_rows(QUICK_MAPS if options.quick else MAPS, options.rounds),
        *structure_rows(QUICK_VERTICES if options.quick else VERTICES, options.rounds),
        *leaves_rows(
            tuple(options.leaves or (QUICK_LEAVES if options.quick else LEAVES)), options.rounds, options.device
        ),
    ]
    return (
        f"Median (and middle half) of {options.rounds} measurements, all sizes in turns, float32. One leaf is drawn: "
        "the split scheme without transpiration or source; springs, hinges, weight and drag, a frame's checks "
        "included. Many leaves are those of `scenes/many.toml` (200 vertices and 64 x 64 cells each), whole frames of "
        "an hour, 60 fluid steps each; the stiffest leaf decides the substeps.\n\n" + "\n".join(tables)
    )
