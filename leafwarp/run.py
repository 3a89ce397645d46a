"""One scene from photo to USD, texture, picture and report."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leafwarp import __version__
from leafwarp.errors import InputError, LeafwarpError, OutputError
from leafwarp.files import check_result, texture_path, write_text
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.progress import Progress
from leafwarp.report import make_report
from leafwarp.scene import Scene
from leafwarp.stopwatch import Stopwatch

if TYPE_CHECKING:
    from leafwarp.leaf.leaf import Leaf
    from leafwarp.sim.simulation import Simulation
    from leafwarp.study.tolerance import Choice, Watcher
    from leafwarp.usd.writer import UsdWriter

CACHE_FOLDER = ".leafwarp-cache"


USD_SUFFIXES = (".usd", ".usda", ".usdc")
# A name that ends so is meant as a file, not as a folder.
OTHER_SUFFIXES = (".usdz", ".abc", ".fbx", ".obj", ".gltf", ".glb", ".png", ".jpg", ".json", ".toml")


@dataclass(frozen=True)
class OutputPaths:
    """Where the results of a run go."""

    usd: Path
    report: Path
    contact_sheet: Path
    cache: Path

    def textures(self, count: int) -> list[Path]:
        """The texture of each photo."""
        return [texture_path(self.usd, index) for index in range(count)]

    def map(self, name: str) -> Path:
        """Picture of a map."""
        return self.usd.with_name(f"{self.usd.stem}.{name}.png")


def output_paths(scene: Scene, output: Path) -> OutputPaths:
    """The result files for ``-o``: a folder, or the USD file itself.

    Raises:
        InputError: The path names another kind of file, or cannot be the name of a USD.
    """
    suffix = output.suffix.lower()
    if suffix in OTHER_SUFFIXES:
        raise InputError(f"-o {output}: accepted: a folder, or a file that ends in {', '.join(USD_SUFFIXES)}")
    if any(character in str(output) for character in "\\\n\r\t\0"):
        raise InputError(f"-o {str(output)!r}: a backslash, tab or line break cannot be part of a USD's path")
    usd = output.with_suffix(suffix) if suffix in USD_SUFFIXES else output / f"{scene.name}.usd"
    return OutputPaths(
        usd=usd,
        report=usd.with_suffix(".report.json"),
        contact_sheet=usd.with_name(f"{usd.stem}_contact_sheet.png"),
        cache=usd.parent / CACHE_FOLDER,
    )


def make_output_folder(scene: Scene, paths: OutputPaths, overwrite: bool, maps: bool = False) -> None:
    """Make the folder of the results, with or without the pictures of the maps, and see that they may be written.

    Raises:
        InputError: A result is there already or is one of the scene's own images, or the folder cannot be written.
    """
    results = [paths.usd, *paths.textures(len(scene.photos)), paths.report]
    results += [paths.contact_sheet] * scene.output.contact_sheet
    results += [paths.map(name) for name in scene.map_names if maps]
    inputs = [path for photo in scene.photos for path in (photo.image, photo.mask)]
    inputs += [*(getattr(scene.maps, name) for name in scene.map_names)]
    images = {Path(path).resolve() for path in inputs if isinstance(path, Path)}
    for path in results:
        if path.resolve() in images:
            raise InputError(
                f"{path}: is an image of the scene, which a result of this name would replace; choose another -o"
            )
        check_result(path, overwrite)
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


def run_scene(
    scene: Scene,
    paths: OutputPaths,
    *,
    device: str = "cpu",
    frames: range | None = None,
    overwrite: bool = False,
    maps: bool = False,
    progress_level: int = 0,
    signals: Sequence[int] = (),
) -> dict[str, Any]:
    """Run a scene and write its results.

    Args:
        scene: The scene.
        paths: Where the results go.
        device: Warp device.
        frames: Frames to write; those before are computed only. Default: all.
        overwrite: Replace results that are there already.
        maps: Also write the maps as pictures beside the USD.
        progress_level: -1 for silence.
        signals: Numbers of signals that have arrived; looked at after every frame, and the first one ends the run.

    Returns:
        The report that is also written beside the USD.

    Raises:
        InputError: Bad photo, device or output folder.
        SimulationError: A frame cannot be computed; those before it are kept.
        OutputError: A result cannot be written; frames written before are kept.
        Interrupted: A signal asked to stop; the frame under way was finished.
    """
    from leafwarp.sim.compilation import Compilation
    from leafwarp.sim.launch import check_device

    begin = time.perf_counter()
    watch = Stopwatch()
    device = check_device(device)
    make_output_folder(scene, paths, overwrite, maps)
    choice = None
    if scene.tolerance is not None:
        with watch("tolerance"):
            choice = _choose_resolution(scene, paths, device, progress_level, signals)
        scene = choice.scene
    with Compilation(scene, device) as compilation:
        with watch("prepare"):
            leaf = prepare_scene_leaf(scene, paths.cache)
            if maps:
                save_maps(leaf, paths.usd.parent, paths.usd.stem)
        with watch("compile"):
            _import_what_follows()
            compilation.wait()
        frames = frames or range(1, scene.time.frames + 1)
        watcher = None if choice is None else choice.watcher(leaf)
        simulation, frame_seconds, failure = _simulate(
            scene, leaf, device, paths, frames, watch, progress_level, signals, watcher
        )
        sheet = simulation.stage("contact_sheet")
        if sheet is not None:
            with watch("contact_sheet_draw"):
                compilation.finish()
                sheet.save(paths.contact_sheet)
    seconds = watch.seconds | simulation.watch.seconds
    report = make_report(simulation, seconds, frame_seconds, time.perf_counter() - begin)
    report["leaf"] = _leaf_report(leaf)
    report["tolerance"] = None if watcher is None else watcher.report()
    write_text(paths.report, json.dumps(report, indent=1) + "\n")
    if failure is not None:
        raise failure
    return report


def _choose_resolution(
    scene: Scene, paths: OutputPaths, device: str, progress_level: int, signals: Sequence[int]
) -> Choice:
    """Find what the scene's tolerance takes, by coarse films.

    Raises:
        SimulationError: A coarse film cannot be computed.
        Interrupted: A signal asked to stop.
    """
    from leafwarp.study.tolerance import choose_resolution

    def say(text: str) -> None:
        if progress_level >= 0:
            print(text, file=sys.stderr, flush=True)
        if signals:
            raise Interrupted(signals[0], 0)

    return choose_resolution(scene, paths.cache, device, say)


def _import_what_follows() -> None:
    """Import what the first frame needs, which takes less time while kernels are still being compiled than after."""
    import leafwarp.sim.simulation
    import leafwarp.usd.writer  # noqa: F401


def _simulate(
    scene: Scene,
    leaf: Leaf,
    device: str,
    paths: OutputPaths,
    frames: range,
    watch: Stopwatch,
    progress_level: int,
    signals: Sequence[int],
    watcher: Watcher | None,
) -> tuple[Simulation, list[float], LeafwarpError | None]:
    """Compute the frames and write the USD; a watcher sees each of them.

    Returns:
        The simulation, the wall time of each frame [s], and why there are no more of them, if there should be.
    """
    from leafwarp.sim.simulation import Simulation
    from leafwarp.usd.writer import UsdWriter

    simulation = Simulation(scene, leaf, device)
    sheet = simulation.stage("contact_sheet")
    if sheet is not None:
        sheet.start(frames[0], frames[-1])
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
    frame_seconds: list[float] = []
    failure: LeafwarpError | None = None
    try:
        progress = Progress(frames[-1], progress_level)
        _run_frames(simulation, writer, frames, watch, frame_seconds, progress, signals, watcher)
    except OutputError:
        raise
    except LeafwarpError as error:
        failure = error
    with watch("usd_close"):
        writer.close()
    return simulation, frame_seconds, failure


def save_maps(leaf: Leaf, folder: Path, stem: str) -> list[Path]:
    """Write the maps of a leaf as pictures ``STEM.NAME.png`` of the whole photo, which a scene can name in their stead.

    Args:
        leaf: The leaf, made from a photo; of many leaves, those maps that they have in common.
        folder: Where to write.
        stem: Start of the files' names.

    Returns:
        The files; none for a leaf without maps.

    Raises:
        OutputError: A file cannot be written.
    """
    from leafwarp.leaf.maps.files import write_maps
    from leafwarp.leaf.maps.pixel_frame import PixelFrame

    if not leaf.maps:
        return []
    leaf = leaf.photos[0]
    frame = PixelFrame.of(leaf)
    return write_maps(leaf.maps, leaf.mask, folder, stem, frame=frame, photo_size=leaf.findings.photo_size)


def _leaf_report(leaf: Leaf) -> dict[str, Any]:
    """What was found in the photo, as plain data."""
    findings = leaf.findings
    return {
        "count": len(leaf.specimens),
        "length": leaf.length,
        "area": float(leaf.mesh.vertex_areas.sum()),
        "confidence": None if findings is None else findings.confidence,
        "base_found": None if findings is None else findings.base_found,
        "vein_kind": None if findings is None else findings.vein_kind,
        "notes": [note for photo in leaf.photos if photo.findings is not None for note in photo.findings.notes],
        "seconds": {} if findings is None else dict(findings.seconds),
    }


def _run_frames(
    simulation: Simulation,
    writer: UsdWriter,
    frames: range,
    watch: Stopwatch,
    frame_seconds: list[float],
    progress: Progress,
    signals: Sequence[int],
    watcher: Watcher | None,
) -> None:
    """Compute all frames and write those asked for; the time of each is appended to ``frame_seconds``."""
    sheet = simulation.stage("contact_sheet")
    lap = time.perf_counter()
    try:
        for frame in simulation.frames(frames[-1]):
            if frame.index in frames:
                with watch("usd"):
                    writer.write(frame)
            if sheet is not None:
                with watch("contact_sheet"):
                    sheet.capture(frame)
            if watcher is not None:
                watcher.look(simulation, frame)
            now = time.perf_counter()
            frame_seconds.append(now - lap)
            progress.step(frame.index, now - lap)
            lap = now
            if signals:
                raise Interrupted(signals[0], frame.index)
    finally:
        progress.close()
