"""What a leaf costs alone, and in a scene of up to a thousand: leaves of 200 vertices on maps of 64 x 64 cells.

``python -m benchmarks.leaves_count`` times the parts of an update step of ``scenes/many.toml`` with more and more
leaves: a fluid step, the coupling and a substep of the motion. All numbers of leaves are timed in turn, round by round,
so that whatever else the machine does weighs on all of them alike.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import warp as wp

from benchmarks.results import describe_machine, write_section
from benchmarks.table2 import Timing
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.launch import check_device
from leafwarp.sim.simulation import Simulation
from leafwarp.sim.stage import Interval

SCENE = Path(__file__).parent.parent / "scenes" / "many.toml"
TITLE = "Leaves: what one costs among many"
COUNTS = (1, 10, 100, 1000)
REPEATS = 9
FLUID_STEPS = 4
Work = Callable[[], int]


def step_parts(scene: Scene, device: str) -> dict[str, Work]:
    """The parts of an update step of a scene; each returns how often it did its work."""
    simulation = Simulation(scene, prepare_scene_leaf(scene, None), device)
    coupling = [stage for stage in simulation.plan.groups["coupling"] if stage.rate == "frame"]

    def fluid() -> int:
        simulation.fluid.advance((simulation.fluid.steps_done + FLUID_STEPS) * simulation.fluid.steps.length)
        return FLUID_STEPS

    def couple() -> int:
        for stage in coupling:
            stage.run(Interval(0.0, 0.0))
        return 1

    return {
        "fluid": fluid,
        "coupling": couple,
        "structure": lambda: simulation.motion.advance(1.0 / scene.time.fps, 1),
    }


def measure(scene: Scene, counts: Sequence[int], device: str, repeats: int) -> dict[int, dict[str, Timing]]:
    """Time the parts for each number of leaves, after one untimed round."""
    parts = {count: step_parts(scene.with_changes({"leaves.count": count}), device) for count in counts}
    rounds = [
        {count: {name: _milliseconds(work, device) for name, work in works.items()} for count, works in parts.items()}
        for _ in range(repeats + 1)
    ][1:]
    return {
        count: {name: Timing(tuple(one[count][name] for one in rounds)) for name in works}
        for count, works in parts.items()
    }


def _milliseconds(work: Work, device: str) -> float:
    """Wall time of the work, each time that it says it was done [ms]."""
    wp.synchronize_device(device)
    begin = time.perf_counter()
    count = work()
    wp.synchronize_device(device)
    return 1e3 * (time.perf_counter() - begin) / count


def fitted_exponent(counts: Sequence[int], milliseconds: Sequence[float]) -> float:
    """The ``p`` of ``time = c count^p``, by least squares of the logarithms; not a number for a single count."""
    x, y = ([math.log(value) for value in values] for values in (counts, milliseconds))
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    spread = sum((a - mean_x) ** 2 for a in x)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / spread if spread > 0.0 else math.nan


def make_table(timings: dict[int, dict[str, Timing]]) -> str:
    """The table as Markdown."""
    lines = [
        "| leaves | fluid step | coupling | structure substep | all three | of it a leaf [µs] |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    totals = {count: parts["fluid"] + parts["coupling"] + parts["structure"] for count, parts in timings.items()}
    for count, parts in timings.items():
        columns = " | ".join(str(timing) for timing in (*parts.values(), totals[count]))
        lines.append(f"| {count} | {columns} | {1e3 * totals[count].median / count:.3g} |")
    exponent = fitted_exponent(list(totals), [total.median for total in totals.values()])
    return "\n".join(lines) + f"\n\nTime of all three over leaves: fitted exponent {exponent:.2f}.\n"


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and on ``--write`` keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.leaves_count", description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="numbers of leaves, rising")
    parser.add_argument("--repeats", type=int, default=REPEATS, help=f"rounds (default: {REPEATS})")
    parser.add_argument("--write", action="store_true", help="write the table to benchmarks/RESULTS.md")
    options = parser.parse_args(arguments)
    device = check_device(options.device)
    table = make_table(measure(load_scene(SCENE), options.counts, device, options.repeats))
    body = (
        f"Milliseconds: median (and middle half) of {options.repeats} measurements, float32, split scheme, "
        f"`scenes/many.toml` (200 vertices and 64 x 64 cells a leaf).\n\n{table}\n"
        f"Command: `python -m benchmarks.leaves_count --write`. Machine: {describe_machine(device)}.\n"
    )
    print(body)
    if options.write:
        write_section(TITLE, body)


if __name__ == "__main__":
    main()
