"""What a run was and did: versions, sizes, substeps, the water ledger, time and memory."""

from __future__ import annotations

import os
import platform
import sys
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leafwarp import __version__

if TYPE_CHECKING:
    from leafwarp.sim.simulation import Simulation

PACKAGES = ("warp-lang", "numpy", "scipy", "opencv-python-headless", "netgen-mesher", "usd-core")
# Done once a run, however many frames it has.
ONCE = ("tolerance", "prepare", "compile", "start", "settle", "usd_close", "contact_sheet_draw")


def package_versions() -> dict[str, str]:
    """Versions of leafwarp, Python and the packages that results depend on."""
    versions = {"leafwarp": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "unknown"
    return versions


def peak_memory() -> int | None:
    """Largest memory of this process so far [byte]; None where the system does not tell."""
    # On Linux getrusage begins with what the process held that started this one.
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def mesh_report(simulation: Simulation) -> dict[str, int]:
    """Counts of the leaves, of their mesh and its springs."""
    mesh = simulation.leaf.mesh
    return {
        "leaves": len(simulation.leaf.specimens),
        "vertices": mesh.vertex_count,
        "triangles": mesh.triangle_count,
        "edge_springs": mesh.edge_count,
        "angular_springs": mesh.hinge_count if simulation.scene.has_angular_springs else 0,
    }


def map_report(simulation: Simulation) -> list[int] | None:
    """Width and height of the map of all leaves [cell]; None where there are no maps."""
    mask = simulation.leaf.mask
    return None if mask is None else [mask.shape[1], mask.shape[0]]


def make_report(
    simulation: Simulation, seconds: dict[str, float], frame_seconds: list[float], total: float
) -> dict[str, Any]:
    """The report of a run, as plain data.

    Args:
        simulation: The simulation after its last frame.
        seconds: Wall time by stage [s]; that of "motion" is shared out among its stages.
        frame_seconds: Wall time of each frame [s].
        total: Wall time of everything [s].
    """
    scene, substeps, device = simulation.scene, simulation.substeps, simulation.state.device
    count = max(len(frame_seconds), 1)
    motion = seconds.get("motion", 0.0)
    seconds = seconds | {name: share * motion for name, share in simulation.motion.stage_shares().items()}
    return {
        "scene": scene.name,
        "versions": package_versions(),
        "device": {"name": device.name, "alias": device.alias},
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "precision": scene.solver.precision,
        "warnings": list(scene.warnings),
        "mesh": mesh_report(simulation),
        "map": map_report(simulation),
        "fluid": _fluid_report(simulation) if simulation.fluid is not None else None,
        "substeps": {"least": min(substeps, default=0), "most": max(substeps, default=0), "total": sum(substeps)},
        "motion": {
            "method": scene.motion.method,
            "frames_at_rest": sum(count == 0 for count in substeps),
            "retries": simulation.motion.retries,
            "settled": asdict(simulation.settled) if simulation.settled is not None else None,
            "unbalanced_torque": simulation.motion.unbalanced_torque,
            "newton": _newton_report(simulation),
        },
        "frames": len(frame_seconds),
        "milliseconds_per_frame": {
            name: 1e3 * value / count for name, value in sorted(seconds.items()) if name not in ONCE
        },
        "seconds": {
            "total": total,
            "longest_frame": max(frame_seconds, default=0.0),
            "median_frame": sorted(frame_seconds)[len(frame_seconds) // 2] if frame_seconds else 0.0,
            **{name: seconds[name] for name in ONCE if name in seconds},
        },
        "memory": {"arrays_bytes": simulation.state.byte_count, "peak_bytes": peak_memory()},
        "launches": simulation.state.launch_count,
        "arrays": len(simulation.state.names),
    }


def _newton_report(simulation: Simulation) -> dict[str, Any] | None:
    """What Newton's method did in implicit or quasistatic motion."""
    newton = simulation.motion.newton
    if newton is None:
        return None
    effort = newton.effort
    return {
        "iterations": effort.iterations,
        "linear_iterations": effort.linear_iterations,
        "factorisations": effort.factorisations,
        "seconds": dict(effort.watch.seconds),
        "factor_bytes": newton.byte_count,
    }


def _fluid_report(simulation: Simulation) -> dict[str, Any]:
    fluid = simulation.fluid
    ledger = fluid.ledger()
    report = {
        "steps": fluid.steps_done,
        "steps_skipped": fluid.steps_skipped,
        "steps_repeated": fluid.steps_repeated,
        "steps_over_tolerance": fluid.steps_over_tolerance,
        "step_seconds": fluid.steps.length,
        "shortest_step_seconds": fluid.shortest_step,
        "ledger": {**asdict(ledger), "error": ledger.error},
    }
    halves = simulation.stage("half_steps")
    stages = [*simulation.plan.groups["fluid"], *(halves.stages if halves is not None else ())]
    iterative = [stage for stage in stages if stage.name == "unsplit_diffusion"]
    if iterative:
        most, total = max(s.most_iterations for s in iterative), sum(s.iterations for s in iterative)
        report["solver_iterations"] = {"most": most, "total": total}
    systems = [s.system for s in stages if s.name in ("unsplit_diffusion", "factored_diffusion") and s.system]
    if systems:
        report["solves"] = {"most": max(s.most_solves for s in systems), "total": sum(s.solves for s in systems)}
    return report
