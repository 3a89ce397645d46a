"""One scene from photo to USD, texture, picture and report."""

from __future__ import annotations

import json
import os
import platform
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leafwarp import __version__
from leafwarp.errors import InputError, LeafwarpError, OutputError
from leafwarp.leaf import prepare_leaf
from leafwarp.leaf.leaf import Leaf
from leafwarp.progress import Progress
from leafwarp.scene import Scene

if TYPE_CHECKING:
    from leafwarp.sim.simulation import Simulation

CACHE_FOLDER = ".leafwarp-cache"


@dataclass(frozen=True)
class OutputPaths:
    """Where the results of a run go."""

    usd: Path
    report: Path
    contact_sheet: Path
    cache: Path


def output_paths(scene: Scene, output: Path) -> OutputPaths:
    """The result files for ``-o``: a folder, or the USD file itself."""
    usd = output if output.suffix in (".usd", ".usda", ".usdc") else output / f"{scene.name}.usd"
    return OutputPaths(
        usd=usd,
        report=usd.with_suffix(".report.json"),
        contact_sheet=usd.with_name(f"{usd.stem}_contact_sheet.png"),
        cache=usd.parent / CACHE_FOLDER,
    )


def prepare_scene_leaf(scene: Scene, cache: Path | None) -> Leaf:
    """The leaf that a scene asks for, from the cache where it was prepared before.

    Raises:
        InputError: The photo or a map cannot be used.
    """
    return prepare_leaf(
        scene.leaf.image,
        length=scene.leaf.length,
        pixels_per_metre=scene.leaf.pixels_per_metre,
        mask=scene.leaf.mask,
        base=scene.leaf.base,
        vertices=scene.mesh.vertices,
        map_size=scene.maps.shape if scene.map_names else None,
        maps={name: getattr(scene.maps, name) for name in scene.map_names},
        cache=cache,
    )


def make_output_folder(paths: OutputPaths, overwrite: bool) -> None:
    """Make the folder of the results and see that they may be written.

    Raises:
        InputError: A result is there already, or the folder cannot be written.
    """
    if paths.usd.exists() and not overwrite:
        raise InputError(f"{paths.usd}: exists already; --overwrite replaces it")
    try:
        paths.usd.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{paths.usd.parent}: cannot be made: {error.strerror}") from None
    if not os.access(paths.usd.parent, os.W_OK | os.X_OK):
        raise InputError(f"{paths.usd.parent}: cannot be written")


class Interrupted(LeafwarpError):
    """The user or the system asked to stop; the frame under way was finished first."""

    def __init__(self, signal_number: int, frame: int):
        super().__init__(f"stopped by {signal.Signals(signal_number).name} after frame {frame}; its frames are kept")
        self.exit_code = 128 + signal_number


@contextmanager
def _stop_requests() -> Iterator[list[int]]:
    """Signals that arrived, instead of an exception in the middle of a frame."""
    arrived: list[int] = []
    handlers = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        handlers[number] = signal.signal(number, lambda received, _: arrived.append(received))
    try:
        yield arrived
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def run_scene(
    scene: Scene,
    paths: OutputPaths,
    *,
    device: str = "cpu",
    frames: range | None = None,
    overwrite: bool = False,
    progress_level: int = 0,
) -> dict[str, Any]:
    """Run a scene and write its results.

    Args:
        scene: The scene.
        paths: Where the results go.
        device: Warp device.
        frames: Frames to write; those before are computed only. Default: all.
        overwrite: Replace results that are there already.
        progress_level: -1 for silence.

    Returns:
        The report that is also written beside the USD.

    Raises:
        InputError: Bad photo, device or output folder.
        SimulationError: A frame cannot be computed; those before it are kept.
        OutputError: A result cannot be written; frames written before are kept.
        Interrupted: A signal asked to stop; the frame under way was finished.
    """
    begin = time.perf_counter()
    make_output_folder(paths, overwrite)
    leaf = prepare_scene_leaf(scene, paths.cache)
    prepared = time.perf_counter()

    from leafwarp.sim.launch import check_device
    from leafwarp.sim.simulation import Simulation
    from leafwarp.usd.writer import UsdWriter

    frames = frames or range(1, scene.time.frames + 1)
    simulation = Simulation(scene, leaf, check_device(device))
    sheet = simulation.stage("contact_sheet")
    if sheet is not None:
        sheet.start(frames[0], frames[-1])
    seconds = {"prepare": prepared - begin, "usd": 0.0, "contact_sheet": 0.0}
    frame_seconds: list[float] = []
    failure: LeafwarpError | None = None
    writer = UsdWriter(
        paths.usd,
        leaf,
        simulation.read_frame(0),
        frames=frames,
        fps=scene.time.fps,
        display_color=scene.output.display_color,
        up_axis=scene.output.up_axis,
        metadata={"leafwarp": __version__, "scene": scene.name},
    )
    progress = Progress(frames[-1], progress_level)
    with _stop_requests() as stop:
        try:
            lap = time.perf_counter()
            for frame in simulation.frames(frames[-1]):
                if frame.index in frames:
                    written = time.perf_counter()
                    writer.write(frame)
                    seconds["usd"] += time.perf_counter() - written
                if sheet is not None:
                    sheet.capture(frame)
                now = time.perf_counter()
                frame_seconds.append(now - lap)
                progress.step(frame.index, now - lap)
                lap = now
                if stop:
                    raise Interrupted(stop[0], frame.index)
        except OutputError:
            raise
        except LeafwarpError as error:
            failure = error
        finally:
            progress.close()
    closing = time.perf_counter()
    writer.close()
    seconds["usd"] += time.perf_counter() - closing
    if sheet is not None:
        drawing = time.perf_counter()
        sheet.save(paths.contact_sheet)
        seconds["contact_sheet"] = time.perf_counter() - drawing
    report = make_report(simulation, {**seconds, **simulation.seconds}, frame_seconds, time.perf_counter() - begin)
    write_text(paths.report, json.dumps(report, indent=1) + "\n")
    if failure is not None:
        raise failure
    return report


def make_report(
    simulation: Simulation, seconds: dict[str, float], frame_seconds: list[float], total: float
) -> dict[str, Any]:
    """What a run was and did, as plain data."""
    import warp as wp

    scene, mesh, substeps = simulation.scene, simulation.leaf.mesh, simulation.substeps
    count = max(len(frame_seconds), 1)
    packages = ("warp-lang", "numpy", "opencv-python-headless", "usd-core")
    return {
        "scene": scene.name,
        "versions": {
            "leafwarp": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in packages},
        },
        "device": {"name": wp.get_device(simulation.state.device).name, "alias": simulation.state.device.alias},
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "precision": scene.solver.precision,
        "mesh": {
            "vertices": mesh.vertex_count,
            "triangles": mesh.triangle_count,
            "edge_springs": mesh.edge_count,
            "angular_springs": mesh.hinge_count if scene.has_angular_springs else 0,
        },
        "map": list(scene.maps.shape) if scene.map_names else None,
        "fluid": _fluid_report(simulation) if simulation.fluid is not None else None,
        "substeps": {"least": min(substeps, default=0), "most": max(substeps, default=0), "total": sum(substeps)},
        "motion": {
            "retries": simulation.motion.retries,
            "settled": asdict(simulation.settled) if simulation.settled is not None else None,
            "unbalanced_torque": simulation.motion.unbalanced_torque,
        },
        "frames": len(frame_seconds),
        "milliseconds_per_frame": {name: 1e3 * value / count for name, value in sorted(seconds.items())},
        "seconds": {
            "total": total,
            "longest_frame": max(frame_seconds, default=0.0),
            "median_frame": sorted(frame_seconds)[len(frame_seconds) // 2] if frame_seconds else 0.0,
        },
        "memory": {
            "arrays_bytes": simulation.state.byte_count,
            "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            * (1 if sys.platform == "darwin" else 1024),
        },
        "launches": simulation.state.launch_count,
        "arrays": len(simulation.state.names),
    }


def _fluid_report(simulation: Simulation) -> dict[str, Any]:
    fluid = simulation.fluid
    ledger = fluid.ledger()
    report = {
        "steps": fluid.steps_done,
        "step_seconds": fluid.steps.length,
        "ledger": {**asdict(ledger), "error": ledger.error},
    }
    solver = simulation.stage("unsplit_diffusion")
    if solver is not None:
        report["solver_iterations"] = {"most": solver.most_iterations, "total": solver.iterations}
    return report


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises:
        OutputError: It cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
