"""One scene from photo to USD, texture, picture and report."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leafwarp import __version__
from leafwarp.errors import InputError, LeafwarpError, OutputError, SimulationError
from leafwarp.files import check_result, texture_path, write_text
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.progress import Progress
from leafwarp.report import make_report
from leafwarp.scene import Scene
from leafwarp.stopwatch import Stopwatch

if TYPE_CHECKING:
    from leafwarp.leaf.leaf import Leaf
    from leafwarp.sim.simulation import Simulation
    from leafwarp.study.tolerance import Choice, Search, Watcher
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

    @contextmanager
    def replaced_when_whole(self) -> Iterator[OutputPaths]:
        """Results in a folder of their own beside these, which they replace at the end of the block; an exception
        inside leaves these as they are.

        Raises:
            OutputError: The folder cannot be made, or a result cannot be replaced.
        """
        folder = self.usd.with_name(f".{self.usd.name}.finer")
        aside = replace(
            self,
            usd=folder / self.usd.name,
            report=folder / self.report.name,
            contact_sheet=folder / self.contact_sheet.name,
        )
        shutil.rmtree(folder, ignore_errors=True)  # what a run that was killed has left
        try:
            folder.mkdir()
        except OSError as error:
            raise OutputError(f"{folder}: cannot be made: {error.strerror}") from None
        try:
            yield aside
            aside._move_to(self.usd.parent)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _move_to(self, folder: Path) -> None:
        """Replace what is in another folder, the USD after what it refers to, and the report last."""
        last = (self.usd, self.report)
        others = sorted(file for file in self.usd.parent.iterdir() if file not in last)
        for file in (*others, *last):
            try:
                file.replace(folder / file.name)
            except OSError as error:
                raise OutputError(f"{folder / file.name}: cannot be replaced: {error.strerror}") from None


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

    def __init__(self, signal_number: int, moment: str, kept: str = "its frames are kept"):
        super().__init__(f"stopped by {signal.Signals(signal_number).name} {moment}; {kept}")
        self.signal_number = signal_number
        self.exit_code = 128 + signal_number


@dataclass(frozen=True)
class _Run:
    """What is the same for every film of a run, as :func:`run_scene` takes it; ``begin`` is when it began [s]."""

    device: str
    frames: range
    maps: bool
    progress_level: int
    signals: Sequence[int]
    begin: float

    def say(self, text: str) -> None:
        """Tell the user."""
        if self.progress_level >= 0:
            print(text, file=sys.stderr, flush=True)

    def stop_where_asked(self) -> None:
        """End the run at a signal that came while a coarse film is computed, which is not written.

        Raises:
            Interrupted: A signal asked to stop.
        """
        if self.signals:
            raise Interrupted(self.signals[0], "in a coarse film", "there is no film yet")


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
    from leafwarp.sim.launch import check_device

    begin = time.perf_counter()
    device = check_device(device)
    make_output_folder(scene, paths, overwrite, maps)
    frames = frames or range(1, scene.time.frames + 1)
    run = _Run(device, frames, maps, progress_level, signals, begin)
    if scene.tolerance is not None:
        return _run_within_tolerance(scene, paths, run)
    return _run_film(scene, paths, run)


def _run_within_tolerance(scene: Scene, paths: OutputPaths, run: _Run) -> dict[str, Any]:
    """Run a scene as coarsely as its tolerance allows; again, finer, where the film misses it.

    Of several films each replaces the one before it when it is whole. One that cannot be computed leaves that as it is.

    Returns:
        The report, also written beside the USD.

    Raises:
        SimulationError: A coarse film or the first film cannot be computed.
        Interrupted: A signal asked to stop.
    """
    from leafwarp.study.tolerance import Search

    search = Search(scene, paths.cache, run.device, run.say, run.stop_where_asked)
    report = _run_film(scene, paths, run, (search, search.first()))
    try:
        while (finer := search.finer()) is not None:
            with paths.replaced_when_whole() as aside:
                report = _run_film(scene, aside, run, (search, finer))
    except Interrupted as stop:
        raise Interrupted(stop.signal_number, "before a finer film was whole", "the one before it is kept") from None
    except (SimulationError, InputError) as error:
        search.fail(str(error))
    report["tolerance"] = search.report()
    report["seconds"]["total"] = time.perf_counter() - run.begin
    _write_report(report, paths)
    return report


def _run_film(
    scene: Scene, paths: OutputPaths, run: _Run, within: tuple[Search, Choice] | None = None
) -> dict[str, Any]:
    """Compute a film and write its results.

    Args:
        scene: The scene.
        paths: Where the results go.
        run: What is asked for.
        within: What a tolerance made of the scene, and the search that did so.

    Returns:
        The report, also written beside the USD.
    """
    from leafwarp.sim.compilation import Compilation

    watch = Stopwatch()
    if within is not None:
        search, choice = within
        scene = choice.scene
        watch.seconds["tolerance"] = time.perf_counter() - run.begin
    if scene.method_is_open:
        from leafwarp.sim.method import with_fitting_method

        with watch("prepare"):
            scene = with_fitting_method(scene, prepare_scene_leaf(scene, paths.cache), run.say)
    with Compilation(scene, run.device) as compilation:
        with watch("prepare"):
            leaf = prepare_scene_leaf(scene, paths.cache)
            if run.maps:
                save_maps(leaf, paths.usd.parent, paths.usd.stem)
        with watch("compile"):
            _import_what_follows()
            compilation.wait()
        watcher = None if within is None else search.watcher(leaf)
        simulation, frame_seconds, failure = _simulate(scene, leaf, paths, run, watch, watcher)
        sheet = simulation.stage("contact_sheet")
        if sheet is not None:
            with watch("contact_sheet_draw"):
                compilation.finish()
                sheet.save(paths.contact_sheet)
    seconds = watch.seconds | simulation.watch.seconds
    report = make_report(simulation, seconds, frame_seconds, time.perf_counter() - run.begin)
    report["leaf"] = _leaf_report(leaf)
    report["tolerance"] = None
    if within is not None:
        search.take(choice, watcher.film())
        report["tolerance"] = search.report()
    _write_report(report, paths)
    if failure is not None:
        raise failure
    return report


def _write_report(report: dict[str, Any], paths: OutputPaths) -> None:
    write_text(paths.report, json.dumps(report, indent=1) + "\n")


def _import_what_follows() -> None:
    """Import what the first frame needs, which takes less time while kernels are still being compiled than after."""
    import leafwarp.sim.simulation
    import leafwarp.usd.writer  # noqa: F401


def _simulate(
    scene: Scene, leaf: Leaf, paths: OutputPaths, run: _Run, watch: Stopwatch, watcher: Watcher | None
) -> tuple[Simulation, list[float], LeafwarpError | None]:
    """Compute the frames and write the USD; a watcher sees each of them.

    Returns:
        The simulation, the wall time of each frame [s], and why there are no more of them, if there should be.
    """
    from leafwarp.sim.simulation import Simulation
    from leafwarp.usd.writer import UsdWriter

    simulation = Simulation(scene, leaf, run.device)
    sheet = simulation.stage("contact_sheet")
    if sheet is not None:
        sheet.start(run.frames[0], run.frames[-1])
    writer = UsdWriter(
        paths.usd,
        leaf,
        simulation.read_frame(0),
        frames=run.frames,
        fps=scene.time.fps,
        display_color=scene.output.display_color,
        up_axis=scene.output.up_axis,
        metadata={"leafwarp": __version__, "scene": scene.name},
    )
    frame_seconds: list[float] = []
    failure: LeafwarpError | None = None
    try:
        _run_frames(simulation, writer, run, watch, frame_seconds, watcher)
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
    return write_maps(
        leaf.maps,
        leaf.mask,
        folder,
        stem,
        frame=frame,
        photo_size=leaf.findings.photo_size,
        fine_venation=leaf.fine_venation,
    )


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
    run: _Run,
    watch: Stopwatch,
    frame_seconds: list[float],
    watcher: Watcher | None,
) -> None:
    """Compute all frames and write those asked for; the time of each is appended to ``frame_seconds``."""
    progress = Progress(run.frames[-1], run.progress_level)
    sheet = simulation.stage("contact_sheet")
    lap = time.perf_counter()
    try:
        for frame in simulation.frames(run.frames[-1]):
            if frame.index in run.frames:
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
            if run.signals:
                raise Interrupted(run.signals[0], f"after frame {frame.index}")
    finally:
        progress.close()
