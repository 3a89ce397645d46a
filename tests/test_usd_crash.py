"""A run that dies at any moment, or fills the disk, leaves a USD that opens with every finished frame."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdUtils

import leafwarp.errors
import usd_sample
from leafwarp.errors import OutputError
from leafwarp.usd.check import check_usd
from leafwarp.usd.writer import UsdWriter
from usd_sample import open_afresh, sample_frame, sample_leaf, write_sample

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")

COUNT = 8
PUBLISHED_BEFORE_FRAMES = 4  # renames of a run's start: texture, rest, manifest, root


def command(path: Path, *options: object) -> list[str]:
    return [sys.executable, usd_sample.__file__, str(path), *map(str, options)]


def environment() -> dict[str, str]:
    source = Path(leafwarp.errors.__file__).parents[1]
    return os.environ | {"PYTHONPATH": os.pathsep.join((str(source), os.environ.get("PYTHONPATH", "")))}


def run_child(path: Path, *options: object) -> tuple[int, list[str]]:
    """Run the sample writer to its end: exit code and the lines it said."""
    child = subprocess.run(command(path, *options), env=environment(), capture_output=True, text=True, timeout=60)
    assert "Traceback" not in child.stderr, child.stderr
    return child.returncode, child.stdout.splitlines()


def run_and_kill(path: Path, after: str, delay: float, *options: object) -> list[str]:
    """Kill the sample writer ``delay`` seconds after it said ``after``: the lines it had said by then."""
    child = subprocess.Popen(command(path, *options), env=environment(), stdout=subprocess.PIPE, text=True)
    lines: list[str] = []
    for line in child.stdout:
        lines.append(line.strip())
        if lines[-1] == after:
            time.sleep(delay)
            child.kill()
            break
    lines += [line.strip() for line in child.stdout]
    child.stdout.close()
    child.wait(timeout=60)
    assert after in lines
    return lines


def finished_frames(lines: list[str]) -> list[int]:
    return [int(line.split()[1]) for line in lines if line.startswith("frame ")]


def assert_readable(path: Path, frames: list[int], count: int, columns: int = 5, rows: int = 8) -> None:
    """The USD opens without a complaint; rest pose and the given frames are there bit for bit."""
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    stage = open_afresh(path)
    assert [item.commentary for item in diagnostics.TakeUncoalescedDiagnostics()] == []
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Leaf/geo/leaf"))
    leaf = sample_leaf(columns, rows)
    assert set(mesh.GetPointsAttr().GetTimeSamples()) >= set(frames)
    for index in [0, *frames]:
        time_code = index or Usd.TimeCode.Default()
        frame = sample_frame(leaf, index, count)
        assert np.array_equal(mesh.GetPointsAttr().Get(time_code), frame.points)
        assert np.array_equal(mesh.GetNormalsAttr().Get(time_code), frame.normals)
        assert np.array_equal(mesh.GetVelocitiesAttr().Get(time_code), frame.velocities)
        assert np.array_equal(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("water").Get(time_code), frame.water)
        assert np.array_equal(mesh.GetExtentAttr().Get(time_code), [frame.points.min(0), frame.points.max(0)])
    assert check_usd(path, unfinished=True) == []


@pytest.mark.parametrize("seed", range(4))
def test_kill_while_frames_are_written(tmp_path, seed):
    moment = random.Random(seed)
    path, count = tmp_path / "leaf.usd", 400
    after = "ready" if seed == 0 else f"frame {moment.randrange(1, 300)}"
    lines = run_and_kill(path, after, moment.uniform(0.0, 0.005), "--count", count)
    assert "merging" not in lines
    frames = finished_frames(lines)
    assert_readable(path, frames, count)
    if len(frames) > 1:
        problems = check_usd(path)
        assert len(problems) == 1 and "do not cover the time range 1 to 400" in problems[0]


@pytest.mark.parametrize("seed", range(3))
def test_kill_while_frames_are_merged(tmp_path, seed):
    path, size = tmp_path / "leaf.usda", ("--columns", 31, "--rows", 55, "--count", 60)  # text: a slow merge
    lines = run_and_kill(path, "merging", random.Random(seed).uniform(0.0, 0.25), *size)
    assert finished_frames(lines) == list(range(1, 61))
    assert_readable(path, finished_frames(lines), 60, columns=31, rows=55)


@pytest.mark.parametrize(
    "moment",
    (
        f"os.rename:{PUBLISHED_BEFORE_FRAMES + COUNT}",  # the last frame is written, not yet in its place
        f"os.rename:{PUBLISHED_BEFORE_FRAMES + COUNT + 1}",  # merged, not yet in the root's place
        "os.remove:1",  # in the root's place, all frame files still there
        f"os.remove:{COUNT // 2}",  # half of the frame files gone
        f"os.remove:{COUNT + 2}",  # all but the manifest gone
    ),
)
def test_kill_at_every_stage_of_the_end(tmp_path, moment):
    path = tmp_path / "leaf.usd"
    code, lines = run_child(path, "--count", COUNT, "--kill-at", moment)
    assert code == -signal.SIGKILL
    frames = finished_frames(lines)
    assert len(frames) == (COUNT - 1 if moment.endswith(f":{PUBLISHED_BEFORE_FRAMES + COUNT}") else COUNT)
    assert_readable(path, frames, COUNT)
    # The next run clears what is left and ends as if nothing had been.
    write_sample(path, COUNT)
    assert_readable(path, list(range(1, COUNT + 1)), COUNT)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["leaf.usd", "leaf_texture.png"]
    assert path.read_bytes() == write_sample(tmp_path / "other" / "leaf.usd", COUNT).read_bytes()


@pytest.fixture(scope="module")
def killed_run(tmp_path_factory) -> Path:
    """The folder of a run that was killed after all its frames, before the merge was in place."""
    folder = tmp_path_factory.mktemp("killed")
    last = PUBLISHED_BEFORE_FRAMES + COUNT + 1
    assert run_child(folder / "leaf.usd", "--count", COUNT, "--kill-at", f"os.rename:{last}")[0] == -signal.SIGKILL
    return folder


@pytest.mark.parametrize(
    "moment, old_frames_left",
    (
        ("os.rename:1", True),  # texture
        ("os.rename:2", True),  # a root that needs no frames
        ("os.remove:1", False),  # the old frames go
        ("os.remove:5", False),
        ("os.rename:3", False),  # rest
        ("os.rename:5", False),  # the new root
        ("os.rename:6", False),  # the first frame
    ),
)
def test_kill_while_a_run_takes_the_place_of_a_killed_one(tmp_path, killed_run, moment, old_frames_left):
    shutil.copytree(killed_run, tmp_path, dirs_exist_ok=True)
    code, lines = run_child(tmp_path / "leaf.usd", "--count", COUNT, "--kill-at", moment)
    assert code == -signal.SIGKILL and finished_frames(lines) == []
    assert_readable(tmp_path / "leaf.usd", list(range(1, COUNT + 1)) if old_frames_left else [], COUNT)


def test_frames_of_a_killed_run_do_not_come_back(tmp_path, killed_run):
    shutil.copytree(killed_run, tmp_path, dirs_exist_ok=True)
    path, leaf = tmp_path / "leaf.usd", sample_leaf()
    writer = UsdWriter(path, leaf, sample_frame(leaf, 0, COUNT), frames=range(1, COUNT + 1), fps=30.0)
    writer.write(sample_frame(leaf, 1, COUNT))
    stage = open_afresh(path)
    assert UsdGeom.Mesh(stage.GetPrimAtPath("/Leaf/geo/leaf")).GetPointsAttr().GetTimeSamples() == [1.0]


def test_files_of_others_in_the_frame_folder_stay(tmp_path):
    (tmp_path / "leaf.usd.frames").mkdir()
    note = tmp_path / "leaf.usd.frames" / "note.txt"
    note.write_text("mine")
    write_sample(tmp_path / "leaf.usd", 2)
    assert [file.name for file in (tmp_path / "leaf.usd.frames").iterdir()] == ["note.txt"]
    assert note.read_text() == "mine"


def test_a_failed_start_keeps_the_frames_of_a_killed_run(tmp_path, killed_run):
    shutil.copytree(killed_run, tmp_path, dirs_exist_ok=True)
    (tmp_path / "leaf_texture.png").unlink()
    (tmp_path / "leaf_texture.png").mkdir()
    with pytest.raises(OutputError, match=r"leaf_texture\.png: cannot be written: Is a directory"):
        write_sample(tmp_path / "leaf.usd", COUNT)
    assert len(list((tmp_path / "leaf.usd.frames").glob("frame.*.usdc"))) == COUNT


needs_file_limit = pytest.mark.skipif(not hasattr(signal, "SIGXFSZ"), reason="this system has no file size limit")


def assert_no_litter(folder: Path) -> None:
    stray = [file.name for file in folder.rglob("*") if file.name.startswith(("writing", "."))]
    assert stray == []


@needs_file_limit
def test_disk_full_at_a_frame_keeps_the_frames_before(tmp_path):
    path = tmp_path / "leaf.usd"
    code, lines = run_child(path, "--count", COUNT, "--limit-after", 3, "--limit", 1000)
    frame_file = tmp_path / "leaf.usd.frames" / "frame.0004.usdc"
    assert code == 1
    assert lines[-1] == f"failed {frame_file}: cannot be written: File too large"
    assert finished_frames(lines) == [1, 2, 3]
    assert_readable(path, [1, 2, 3], COUNT)
    assert_no_litter(tmp_path)


@needs_file_limit
@pytest.mark.parametrize("suffix", ("usd", "usda"))
def test_disk_full_at_the_merge_keeps_every_frame(tmp_path, suffix):
    path = tmp_path / f"leaf.{suffix}"
    code, lines = run_child(path, "--count", COUNT, "--limit-after", COUNT, "--limit", 8000)
    assert code == 1
    assert lines[-1] == f"failed {path}: cannot be written: File too large"
    assert_readable(path, list(range(1, COUNT + 1)), COUNT)
    assert_no_litter(tmp_path)


READ_BACK = """
import sys
from pathlib import Path
from test_usd_crash import assert_no_litter, assert_readable
path, last = Path(sys.argv[1]), int(sys.argv[2])
assert_readable(path, list(range(1, last + 1)), 400)
assert_no_litter(path.parent)
"""


@pytest.fixture
def run_on_small_disk(tmp_path) -> Callable[[str], subprocess.CompletedProcess]:
    """Runs a shell script with ``$DISK`` a file system of 512 KiB that is gone when the script ends."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = f"export DISK='{disk}'; mount -t tmpfs -o size=512k tmpfs \"$DISK\" || exit 77; "

    def run(script: str) -> subprocess.CompletedProcess:
        unshare = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", mount + script]
        tests = str(Path(__file__).parent)
        paths = os.pathsep.join((tests, environment()["PYTHONPATH"]))
        try:
            done = subprocess.run(
                unshare, env=environment() | {"PYTHONPATH": paths}, capture_output=True, text=True, timeout=60
            )
        except FileNotFoundError:
            pytest.skip("this system has no unshare")
        if done.returncode == 77 or "unshare" in done.stderr:
            pytest.skip(f"this system does not let us mount a small disk: {done.stderr.strip()}")
        return done

    return run


def test_a_disk_that_is_really_full(tmp_path, run_on_small_disk):
    (tmp_path / "read_back.py").write_text(READ_BACK)
    done = run_on_small_disk(
        f"'{sys.executable}' '{usd_sample.__file__}' \"$DISK/leaf.usd\" --count 400 > '{tmp_path}/said'; "
        f"test $? = 1 || exit 3; last=$(grep -c ^frame '{tmp_path}/said'); "
        f"'{sys.executable}' '{tmp_path}/read_back.py' \"$DISK/leaf.usd\" $last"
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    said = (tmp_path / "said").read_text().splitlines()
    assert said[-1].endswith("cannot be written: No space left on device")
    assert "frame 1" in said
