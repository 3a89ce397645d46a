"""What a scene needs, as plain data and as text (``python -m leafwarp plan``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from leafwarp.errors import SimulationError
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.report import map_report, mesh_report
from leafwarp.scene import Scene
from leafwarp.scene.warnings import MANY_SUBSTEPS

if TYPE_CHECKING:
    from leafwarp.sim.simulation import Simulation
    from leafwarp.sim.stage import Stage

# Up to this conductance times step, a row-column step carries water along a diagonal vein nearly as it should.
SPLIT_BETA = 5.0


def plan_report(scene: Scene, device: str) -> dict[str, Any]:
    """The plan of a scene on its leaf, with the substeps that its first frame takes.

    Raises:
        InputError: Bad photo or device.
    """
    leaf = prepare_scene_leaf(scene, None)

    from leafwarp.sim.launch import check_device
    from leafwarp.sim.method import with_fitting_method
    from leafwarp.sim.simulation import Simulation

    chosen = scene.method_is_open
    scene = with_fitting_method(scene, leaf)
    simulation = Simulation(scene, leaf, check_device(device))
    intervals = max(scene.time.frames - 1, 1)
    moments = [moment for frame in range(2, scene.time.frames + 1) for moment in simulation.moments(frame)]
    moves = max(1.0, sum(moment.share > 0.0 for moment in moments) / intervals)
    at_a_time = simulation.motion.required_substeps(1.0 / (scene.time.fps * moves))
    substeps = round(moves * at_a_time) if math.isfinite(at_a_time) else at_a_time
    couplings = sum(len(moment.looks) for moment in moments) / intervals
    motions = sum(moment.on_path + (moment.share > 0.0) for moment in moments) / intervals
    fluid_steps = simulation.fluid.steps.count if simulation.fluid is not None and scene.time.frames > 1 else 0
    runs = {
        "start": 0.0,
        "fluid step": fluid_steps / intervals,
        "frame": couplings,
        "substep": float(substeps),
        "output": 1.0,
    }
    plan = simulation.plan
    return {
        "scene": scene.name,
        "device": simulation.state.device.alias,
        "precision": scene.solver.precision,
        "mesh": mesh_report(simulation),
        "map": map_report(simulation),
        "fluid_steps": fluid_steps,
        "largest_beta": _largest_beta(simulation),
        "substeps_per_frame": substeps,
        "substep_seconds": 1.0 / (scene.time.fps * substeps),
        "motion": scene.motion.method,
        "motion_chosen": chosen,
        "steps_adapt": simulation.fluid is not None and scene.fluid.step_tolerance is not None,
        "path_equilibria": len(simulation.path_times),
        "only_explicit": scene.leaves is not None or scene.structure.bending == "paper",
        "warnings": list(scene.warnings),
        "bytes": plan.byte_count,
        "host_bytes": sum(map(_host_bytes, plan.stages)),
        "stages": plan.describe(runs, motions, at_a_time),
        "left_out": [{"name": name, "reason": reason} for name, reason in plan.left_out.items()],
    }


def _host_bytes(stage: Stage) -> int:
    """What a stage holds beside the arrays [byte].

    Raises:
        SimulationError: What it holds cannot be made; a run meets that in its first fluid step.
    """
    if stage.rate != "fluid step":
        return stage.host_bytes
    from leafwarp.sim.fluid.steps import NotConverged  # a scene without water that flows does not load this

    try:
        return stage.host_bytes
    except NotConverged as error:
        raise SimulationError(2, stage.name, str(error)) from None


def _largest_beta(simulation: Simulation) -> float | None:
    """Largest conductance times fluid step of two neighbouring cells, which the splitting error grows with."""
    if simulation.fluid is None:
        return None
    from leafwarp.sim.fluid.conductance import leaf_conductance

    step = simulation.fluid.steps.length
    conductance = leaf_conductance(simulation.scene, simulation.leaf, step)
    return step * float(max(conductance.x.max(), conductance.y.max()))


def print_plan(report: dict[str, Any]) -> None:
    """Print a plan for people."""
    mesh = report["mesh"]
    many = f"{mesh['leaves']} leaves batched in the same launches, " if mesh["leaves"] > 1 else ""
    print(
        f"{report['scene']}: {many}{mesh['vertices']} vertices, {mesh['triangles']} triangles, "
        f"{mesh['edge_springs']} edge springs, {mesh['angular_springs']} angular springs"
    )
    cells = f"map of {report['map'][0]} x {report['map'][1]} cells, " if report["map"] else "no maps, "
    print(
        f"{cells}{report['fluid_steps']} fluid steps{' or more, as they adapt' if report['steps_adapt'] else ''}, "
        f"{report['substeps_per_frame']} motion substeps of "
        f"{report['substep_seconds']:.3g} s in the first frame, {report['precision']} on {report['device']}, "
        f"{report['bytes'] / 1e6:.2f} MB of arrays"
        + (f", {report['host_bytes'] / 1e6:.2f} MB beside them" if report["host_bytes"] else "")
    )
    beta = report["largest_beta"]
    if beta is not None and beta > SPLIT_BETA and any(s["name"] == "split_diffusion" for s in report["stages"]):
        print(
            f"the split scheme throttles diagonal veins where beta is above about {SPLIT_BETA:g}: here it reaches "
            f"{beta:.3g}; a shorter fluid.step or fluid.scheme = 'unsplit' helps, and tradeoff measures how much"
        )
    if report["motion_chosen"]:
        print(f"motion.method = '{report['motion']}': what takes the least time, as the scene leaves that open")
    if report["path_equilibria"]:
        print(f"the leaf is in equilibrium at {report['path_equilibria']} moments, and off that path at every frame")
    if report["motion"] == "explicit" and not report["only_explicit"] and report["substeps_per_frame"] > MANY_SUBSTEPS:
        print("explicit motion wants a soft membrane: motion.method = 'quasistatic' or 'implicit' takes a real leaf's")
    print(f"\n{'stage':<18} {'runs once a':<11} {'launches/frame':>14} {'kB':>8}  what it does")
    for stage in report["stages"]:
        print(
            f"{stage['name']:<18} {stage['rate']:<11} {stage['launches_per_frame']:>14.1f} "
            f"{(stage['bytes'] + stage['host_bytes']) / 1e3:>8.1f}  {stage['purpose']}"
        )
        for label in ("reads", "writes", "kernels"):
            if stage[label]:
                names = (name.removeprefix("leafwarp_kernels.") for name in stage[label])
                print(f"{'':<18} {label}: {', '.join(names)}")
    print("\nat most so many launches: water and shapes that have come to rest are not computed again")
    print("\nleft out")
    for entry in report["left_out"]:
        print(f"{entry['name']:<18} {entry['reason']}")
