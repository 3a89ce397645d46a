"""The paper's Table II: one complete update step of fluid and structure, at four sizes of the map.

A complete step is one fluid step (transpiration, source, diffusion), the coupling and one substep of the
motion, as :class:`leafwarp.sim.simulation.Simulation` runs them on the bramble scene, in float32 with the
paper's split scheme.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import warp as wp

from benchmarks.results import describe_machine, write_section
from benchmarks.timing import Timing
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.launch import check_device
from leafwarp.sim.simulation import Simulation
from leafwarp.sim.stage import Interval

SCENE = Path(__file__).parent.parent / "scenes" / "bramble.toml"
TITLE = "Table II: one complete update step"
# Milliseconds that the paper gives for each map.
PAPER = {128: 11.0, 256: 17.0, 512: 40.0, 1024: 145.0}
REPEATS, QUICK_REPEATS = 15, 3
FLUID_STEPS = 4


def measure(scene: Scene, cells: int, device: str, repeats: int = REPEATS) -> dict[str, Timing]:
    """Time the parts of a step.

    Args:
        scene: The scene.
        cells: Cells of the map in each direction.
        device: Warp device.
        repeats: How often everything is measured, after one untimed round.
    """
    scene = scene.with_changes(
        {
            "maps.size": cells,
            "fluid.scheme": "split",
            "solver.precision": "float32",
            "output.contact_sheet": False,
            "output.display_color": False,
        }
    )
    simulation = Simulation(scene, prepare_scene_leaf(scene, None), device)
    coupling = [stage for stage in simulation.plan.groups["coupling"] if stage.rate == "frame"]
    step = simulation.fluid.steps.length
    frame_duration = 1.0 / scene.time.fps

    def fluid() -> int:
        simulation.fluid.advance((simulation.fluid.steps_done + FLUID_STEPS) * step)
        return FLUID_STEPS

    def couple() -> int:
        for stage in coupling:
            stage.run(Interval(0.0, 0.0))
        return 1

    def structure() -> int:
        return simulation.motion.advance(frame_duration, 1)

    parts = {"fluid": fluid, "coupling": couple, "structure": structure}
    rounds = [{name: _time(part, device) for name, part in parts.items()} for _ in range(repeats + 1)][1:]
    return {name: Timing(tuple(one[name] for one in rounds)) for name in parts}


def _time(work: Callable[[], int], device: str) -> float:
    """Milliseconds of each of the steps that the work says it has done."""
    wp.synchronize_device(device)
    begin = time.perf_counter()
    count = work()
    wp.synchronize_device(device)
    return 1e3 * (time.perf_counter() - begin) / count


def make_table(scene: Scene, device: str, repeats: int = REPEATS, sizes: tuple[int, ...] = tuple(PAPER)) -> str:
    """Table II as Markdown, of some sizes of the map."""
    lines = [
        "| map | fluid step | coupling | structure substep | complete step | paper |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for cells in sizes:
        parts = measure(scene, cells, device, repeats)
        total = parts["fluid"] + parts["coupling"] + parts["structure"]
        columns = " | ".join(str(timing) for timing in (*parts.values(), total))
        lines.append(f"| {cells} x {cells} | {columns} | {PAPER[cells]:g} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and on ``--write`` keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks table2", description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the smallest map, few rounds")
    parser.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    parser.add_argument("--repeats", type=int, help=f"rounds (default: {REPEATS})")
    parser.add_argument("--write", action="store_true", help="write the table to benchmarks/RESULTS.md")
    options = parser.parse_args(arguments)
    repeats = options.repeats or (QUICK_REPEATS if options.quick else REPEATS)
    device = check_device(options.device)
    scene = load_scene(SCENE)
    body = (
        "Milliseconds: median (and middle half) of "
        f"{repeats} measurements, float32, split scheme, the mesh of `scenes/bramble.toml`. The "
        "paper's figures are its own machine's.\n\n"
        f"{make_table(scene, device, repeats, tuple(PAPER)[: 1 if options.quick else None])}\n"
        f"Command: `python -m benchmarks --write`. Machine: {describe_machine(device)}.\n"
    )
    print(body)
    if options.write:
        write_section(TITLE, body)


if __name__ == "__main__":
    main()
