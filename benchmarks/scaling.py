"""How cost grows: a fluid step with the cells of the map, a substep with the vertices of the mesh.

The leaf is drawn, so that it can be made in any size: an ellipse with a midrib, and a strip of nearly equilateral
triangles.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.results import describe_machine, write_section
from benchmarks.structure import Structure
from benchmarks.timing import Timing, exponent, round_robin
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.study.verify.drawn_fluid import Sample, ellipse, make_sample
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of, strip_triangles

TITLE = "Scaling: cost against size"
MAPS, QUICK_MAPS = (128, 256, 512, 1024, 2048, 4096), (32, 64, 128)
VERTICES, QUICK_VERTICES = (200, 500, 1700, 5000, 20_000, 100_000), (100, 200, 400)
ROUNDS, QUICK_ROUNDS = 11, 3
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
    work = {str(cells): (lambda s=sample: s.stages["split_diffusion"].run()) for cells, sample in samples.items()}
    timings = round_robin(work, rounds)
    rows = ["| map | leaf cells | fluid step [ms] | ns a leaf cell | arrays [MB] |", "|---:|---:|---:|---:|---:|"]
    counts = []
    for cells, sample in samples.items():
        count = int(sample.leaf.mask.sum())
        timing, megabytes = timings[str(cells)], sample.state.byte_count / 1e6
        rows.append(f"| {cells} | {count} | {timing} | {1e6 * timing.median / count:.3g} | {megabytes:.3g} |")
        counts.append(count)
    return [*rows, "", grown("leaf cells", counts, list(timings.values()))]


def structure_rows(sizes: tuple[int, ...], rounds: int) -> list[str]:
    """Table of the substep."""
    made = [structure(vertices) for vertices in sizes]
    substeps = [one.advance() for one, _, _ in made]
    laps = round_robin({str(count): one.advance for one, count, _ in made}, rounds)
    timings = [Timing(tuple(v / n for v in lap.milliseconds)) for lap, n in zip(laps.values(), substeps, strict=True)]
    rows = ["| vertices | springs | substep [ms] | ns a spring | arrays [MB] |", "|---:|---:|---:|---:|---:|"]
    for (one, vertices, springs), timing in zip(made, timings, strict=True):
        each, megabytes = 1e6 * timing.median / springs, one.state.byte_count / 1e6
        rows.append(f"| {vertices} | {springs} | {timing} | {each:.3g} | {megabytes:.3g} |")
    return [*rows, "", grown("springs", [springs for _, _, springs in made], timings)]


def grown(what: str, counts: list[int], timings: list[Timing]) -> str:
    """The exponent fitted to all sizes, and to the larger half of them."""
    medians = [timing.median for timing in timings]
    half = len(counts) // 2
    whole, large = exponent(counts, medians), exponent(counts[half:], medians[half:])
    return f"Time grows with the power {whole:.2f} of the {what}, over the larger half of the sizes {large:.2f}.\n"


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and on ``--write`` keep the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks scaling", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, help=f"measurements of each (default: {ROUNDS})")
    parser.add_argument("--quick", action="store_true", help="small sizes, few rounds")
    parser.add_argument("--write", action="store_true", help="keep the tables in benchmarks/RESULTS.md")
    options = parser.parse_args(arguments)
    rounds = options.rounds or (QUICK_ROUNDS if options.quick else ROUNDS)
    tables = [
        *fluid_rows(QUICK_MAPS if options.quick else MAPS, rounds),
        *structure_rows(QUICK_VERTICES if options.quick else VERTICES, rounds),
    ]
    body = (
        f"Median (and middle half) of {rounds} measurements, all sizes in turns, float32, on a drawn leaf: the split "
        "scheme without transpiration or source; springs, hinges, weight and drag, a frame's checks included.\n\n"
        + "\n".join(tables)
        + f"\nCommand: `python -m benchmarks scaling --write`. Machine: {describe_machine('cpu')}.\n"
    )
    print(body)
    if options.write:
        write_section(TITLE, body)


if __name__ == "__main__":
    main()
