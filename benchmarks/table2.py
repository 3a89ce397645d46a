"""The paper's Table II: one complete update step of fluid and structure, at four sizes of the map.

A complete step is one fluid step (transpiration, source, diffusion), the coupling and one substep of the
motion, as :class:`leafwarp.sim.simulation.Simulation` runs them on the bramble scene, in float32 with the
paper's split scheme.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import warp as wp

from benchmarks.timing import Timing, round_robin
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from leafwarp.sim.stage import Interval

SCENE = Path(__file__).parent.parent / "scenes" / "bramble.toml"
TITLE = "Table II: one complete update step"
QUICK = "the smallest map, few rounds"
ROUNDS = (15, 3)
OPTIONS = {"--device": {"default": "cpu", "help": "Warp device: cpu (default), cuda:0, ..."}}
# Milliseconds that the paper gives for each map.
PAPER = {128: 11.0, 256: 17.0, 512: 40.0, 1024: 145.0}
FLUID_STEPS = 4
PARTS = ("fluid", "coupling", "structure")


def step_parts(scene: Scene, device: str) -> dict[str, Callable[[], int]]:
    """The parts of an update step of a scene; each returns how many of its steps it did.

    Args:
        scene: The scene.
        device: Warp device.
    """
    simulation = Simulation(scene, prepare_scene_leaf(scene, None), device)
    coupling = [stage for stage in simulation.plan.groups["coupling"] if stage.rate == "frame"]

    def fluid() -> int:
        fluid = simulation.fluid
        if fluid.steps_done + FLUID_STEPS > fluid.steps.count:
            fluid.restart()  # the scene's time is over
        count = fluid.advance((fluid.steps_done + FLUID_STEPS) * fluid.steps.length)
        wp.synchronize_device(device)
        return count

    def couple() -> int:
        for stage in coupling:
            stage.run(Interval(0.0, 0.0))
        wp.synchronize_device(device)
        return 1

    def structure() -> int:
        substeps = simulation.motion.advance(1.0 / scene.time.fps, 1)
        wp.synchronize_device(device)
        return substeps

    return dict(zip(PARTS, (fluid, couple, structure), strict=True))


def measure(scene: Scene, sizes: tuple[int, ...], device: str, rounds: int) -> dict[tuple[int, str], Timing]:
    """Time the parts of a step at all sizes, in turns.

    Args:
        scene: The scene.
        sizes: Cells of the map in each direction.
        device: Warp device.
        rounds: How often everything is measured.

    Returns:
        By size and part [ms].
    """
    work = {}
    for cells in sizes:
        changes = {
            "maps.size": cells,
            "fluid.scheme": "split",
            "solver.precision": "float32",
            "output.contact_sheet": False,
            "output.display_color": False,
        }
        for part, step in step_parts(scene.with_changes(changes), device).items():
            work[cells, part] = step
    return round_robin(work, rounds)


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    sizes = tuple(PAPER)[: 1 if options.quick else None]
    timings = measure(load_scene(SCENE), sizes, options.device, options.rounds)
    rows = [
        "| map | fluid step | coupling | structure substep | complete step | paper |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for cells in sizes:
        fluid, coupling, structure = (timings[cells, part] for part in PARTS)
        columns = " | ".join(str(timing) for timing in (fluid, coupling, structure, fluid + coupling + structure))
        rows.append(f"| {cells} x {cells} | {columns} | {PAPER[cells]:g} |")
    return (
        f"Milliseconds: median (and middle half) of {options.rounds} measurements, all sizes in turns, float32, split "
        "scheme, the mesh of `scenes/bramble.toml`. The paper's figures are its own machine's.\n\n" + "\n".join(rows)
    )
