"""``python -m fuzzing.worker FOLDER``: calls of the command line in one process, each watched.

Reads a line ``SEED INDEX`` for every case and answers it with a line of JSON: how the case was made, exit code, wall
time and everything that is wrong with what came of it. The folder holds the files of the case, its results and its
``call.json`` until the next one, so that they are there if this process does not survive it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from fuzzing.case import OUTPUT, SCENES, Case

INPUT, TEMPORARY, CACHE, CALL = "in", "tmp", "cache", "call.json"
PHOTO_SIDE = 80  # [pixels] of the shipped scenes' pictures, the longer one
# Beyond these a scene is slow, and for good reason: what it asks for is cut down to them.
MOST_VERTICES, MOST_CELLS, MOST_LEAVES, MOST_STEPS, MOST_SUBSTEPS, MOST_FRAMES = 200, 4096, 3, 100, 16, 20
MOST_STORED = 300  # leaves in the cache
WRITING = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod"}


def make_case(seed: int, index: int) -> Case:
    """The case of a number, the same wherever and whenever it is made."""
    from fuzzing.images import image_case
    from fuzzing.scenes import scene_case

    chance = random.Random(f"{seed} {index}")
    return chance.choice((scene_case, scene_case, image_case))(chance)


class Writes:
    """Notes what Python code opens to write, makes, renames or removes outside of a folder.

    Args:
        folders: Where it may.
    """

    def __init__(self, folders: list[Path]):
        self._folders = [os.path.realpath(folder) for folder in folders]
        self.seen: set[str] = set()
        sys.addaudithook(self._note)

    def _note(self, event: str, details: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = details
            if not (set(mode or "") & set("wax+") or (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)):
                return
        elif event in WRITING:
            path = details[0]
        else:
            return
        if isinstance(path, int) or path == os.devnull:
            return
        place = os.path.realpath(os.fsdecode(path))
        if not any(place == folder or place.startswith(folder + os.sep) for folder in self._folders):
            self.seen.add(place)


class Worker:
    """Runs cases in a folder of its own.

    Args:
        folder: An empty folder.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        for name in (INPUT, OUTPUT, TEMPORARY, CACHE):
            (folder / name).mkdir()
        os.chdir(folder / INPUT)
        tempfile.tempdir = str(folder / TEMPORARY)
        self._photos = shrunk_photos()
        self._prepare()
        import warp as wp

        self._writes = Writes([folder, Path(wp.config.kernel_cache_dir)])

    def _prepare(self) -> None:
        """Load all kernels; find what is in a picture once, and let `plan` use prepared leaves again, as `run` does."""
        import pytest
        import warp as wp

        from every_kernel import MODULES, kernels_of
        from leafwarp import plan_report
        from leafwarp.prepare import prepare_scene_leaf
        from shared_analysis import share

        share(pytest.MonkeyPatch())
        wp.config.quiet = True
        for module in dict.fromkeys(kernel.module for name in MODULES for kernel in kernels_of(name)):
            wp.force_load("cpu", [module])
        plan_report.prepare_scene_leaf = lambda scene, _: prepare_scene_leaf(scene, self._folder / CACHE)

    def run(self, seed: int, index: int) -> dict[str, Any]:
        """Run a case, and say what came of it."""
        case = make_case(seed, index)
        self._lay_out(case)
        arguments = [*case.arguments, *self._cut_down(case.arguments)]
        call = {"seed": seed, "index": index, "kind": case.kind, "arguments": arguments}
        (self._folder / CALL).write_text(json.dumps(call))
        before = self._tree()
        self._writes.seen.clear()
        begin = time.perf_counter()
        code, stdout, stderr = self._call(arguments)
        seconds = time.perf_counter() - begin
        faults = faults_of(code, stdout, stderr)
        faults += [f"wrote {path}" for path in sorted(self._writes.seen)]
        after = self._tree()
        faults += [
            f"changed {path}" for path in sorted(before.keys() | after.keys()) if before.get(path) != after.get(path)
        ]
        return {
            "kind": case.kind,
            "code": code,
            "seconds": seconds,
            "faults": faults,
            "stderr": stderr[-4000:],
            "arguments": arguments,
        }

    def _lay_out(self, case: Case) -> None:
        for name in (INPUT, OUTPUT, TEMPORARY):
            for path in (self._folder / name).iterdir():
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        if len(list((self._folder / CACHE).iterdir())) > MOST_STORED:
            shutil.rmtree(self._folder / CACHE)
            (self._folder / CACHE).mkdir()
        (self._folder / OUTPUT / ".leafwarp-cache").symlink_to(self._folder / CACHE)
        for name, content in {**self._photos, **case.files}.items():
            (self._folder / INPUT / name).write_bytes(content)

    def _cut_down(self, arguments: tuple[str, ...]) -> list[str]:
        """Options that make a scene small that asks for much."""
        from leafwarp.scene.file import load_scene

        if arguments[0] not in ("plan", "run"):
            return []
        changes = [value for option, value in pairwise(arguments) if option == "--set"]
        try:
            scene = load_scene(Path(arguments[1]), changes)
        except Exception:  # the call meets it again
            return []
        small: dict[str, object] = {"solver.maximum_substeps": min(scene.solver.maximum_substeps, MOST_SUBSTEPS)}
        if scene.mesh.vertices > MOST_VERTICES:
            small["mesh.vertices"] = 40
        if scene.map_names and math.prod(scene.maps.shape) > MOST_CELLS:
            small["maps.size"] = [12, 16]
        if scene.leaves is not None and scene.leaves.count > MOST_LEAVES:
            small["leaves.count"] = MOST_LEAVES
        if scene.time.frames > MOST_FRAMES:
            small["time.frames"] = MOST_FRAMES
        if scene.fluid is not None and scene.time.duration > MOST_STEPS * scene.fluid.step:
            small["fluid.step"] = scene.time.duration / MOST_STEPS
        interval = scene.solver.coupling_interval
        if interval is not None and scene.time.duration > MOST_FRAMES * interval:
            small["solver.coupling_interval"] = scene.time.duration / MOST_FRAMES
        return [word for key, value in small.items() for word in ("--set", f"{key}={value}")]

    def _tree(self) -> dict[str, tuple[int, int, int]]:
        """Size, time and identity of every file but the results and the cache, whose changes are wanted."""
        own = {self._folder / OUTPUT, self._folder / CACHE}
        found = {}
        for place, folders, files in os.walk(self._folder):
            folders[:] = [name for name in folders if Path(place, name) not in own]
            for name in (*folders, *files):
                status = os.lstat(os.path.join(place, name))
                is_file = name in files
                found[os.path.join(place, name)] = (
                    status.st_size * is_file,
                    status.st_mtime_ns * is_file,
                    status.st_ino,
                )
        return found

    def _call(self, arguments: list[str]) -> tuple[int | None, str, str]:
        """Exit code and all that a call writes to its outputs, native code included."""
        from leafwarp import cli

        with open(self._folder / "stdout", "w+b") as out, open(self._folder / "stderr", "w+b") as err:
            with _as_outputs(out.fileno(), err.fileno()), warnings.catch_warnings():
                warnings.simplefilter("always")
                try:
                    code = cli.main(arguments)
                except BaseException:  # nothing may escape, whatever it is
                    code = None
                    traceback.print_exc()
            texts = []
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode("utf-8", errors="surrogateescape"))
        for name in ("stdout", "stderr"):
            (self._folder / name).unlink()
        return code, *texts


@contextlib.contextmanager
def _as_outputs(stdout: int, stderr: int) -> Iterator[None]:
    """Let this process write to other files in the block."""
    kept = os.dup(1), os.dup(2)
    streams = sys.stdout, sys.stderr
    os.dup2(stdout, 1)
    os.dup2(stderr, 2)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        sys.stdout, sys.stderr = streams
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        os.close(kept[0])
        os.close(kept[1])


def faults_of(code: int | None, stdout: str, stderr: str) -> list[str]:
    """What is wrong with the outcome of a call.

    Args:
        code: Exit code; None where an exception escaped.
        stdout: What it wrote.
        stderr: What it wrote.
    """
    if code is None or "Traceback (most recent call last)" in stderr:
        return ["traceback"]
    faults = []
    if code not in (0, 1, 2):
        faults.append(f"exit code {code}")
    lines = stderr.splitlines()
    own = [line for line in lines if line.startswith("leafwarp: ")]
    if len(own) < len(lines) or not all(line.isprintable() for line in lines):
        faults.append("a line on stderr that is not of leafwarp, or not printable")
    asides = ("leafwarp: warning: ", "leafwarp: note: ", "leafwarp: see in ")
    errors = [line for line in own if not line.startswith(asides)]
    if len(errors) != (0 if code == 0 else 1):
        faults.append(f"{len(errors)} lines of error")
    elif code == 1 and not errors[0].startswith("leafwarp: frame "):
        faults.append("exit code 1 without a frame")
    if code and stdout:
        faults.append("a failure that writes to stdout")
    return faults


def shrunk_photos() -> dict[str, bytes]:
    """The pictures of the shipped scenes, small."""
    import cv2

    photos = {}
    for path in (path for path in SCENES.glob("*.png") if "contact_sheet" not in path.name):
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        across = max(PHOTO_SIDE / max(picture.shape[:2]), 40 / min(picture.shape[:2]))
        small = cv2.resize(picture, None, fx=across, fy=across, interpolation=cv2.INTER_AREA)
        photos[path.name] = cv2.imencode(".png", small)[1].tobytes()
    return photos


def main() -> None:
    """Answer cases until stdin ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.dont_write_bytecode = True  # modules that a case is the first to import
    worker = Worker(Path(sys.argv[1]))
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        seed, index = map(int, line.split())
        print(json.dumps(worker.run(seed, index)), file=answers, flush=True)


if __name__ == "__main__":
    main()
