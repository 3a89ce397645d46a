"""Under --debug-kernels an index out of bounds ends the process, where it would corrupt memory unseen.

And --launching leaves out what launches no kernel, and nothing else.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
# No module of the project is compiled for it.
LAUNCH = """
import os

import pytest
import warp as wp


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels():
    pass


lanes = wp.types.vector(16, float)


@wp.kernel(enable_backward=False)
def element(i: int, values: wp.array[float], grid: wp.array2d[float], packs: wp.array[lanes]):
    values[i] = 1.0


@wp.kernel(enable_backward=False)
def read(i: int, values: wp.array[float], grid: wp.array2d[float], packs: wp.array[lanes]):
    values[0] = values[i]


@wp.kernel(enable_backward=False)
def column(i: int, values: wp.array[float], grid: wp.array2d[float], packs: wp.array[lanes]):
    grid[0, i] = 1.0


@wp.kernel(enable_backward=False)
def lane(i: int, values: wp.array[float], grid: wp.array2d[float], packs: wp.array[lanes]):
    pack = packs[0]
    pack[i] = 1.0
    packs[0] = pack


def launch(**options):
    kernel = globals()[os.environ["KERNEL"]]
    arrays = [wp.zeros(16, dtype=float), wp.zeros((2, 16), dtype=float), wp.zeros(1, dtype=lanes)]
    return wp.launch(kernel, 1, inputs=[int(os.environ["INDEX"]), *arrays], device="cpu", **options)


@pytest.fixture(scope="module")
def command():
    return launch(record_cmd=True)


def test_launch():
    launch()


def test_a_recorded_launch(command):
    command.launch()


def test_only_recorded(command):
    assert command is not None


def test_nothing():
    pass


def test_failing():
    assert "INDEX" not in os.environ
"""


def session(folder: Path, kernel: str, index: int, *options: str) -> subprocess.CompletedProcess:
    """A session of its own, with this suite's options, of tests that launch the kernel on arrays of 16."""
    (folder / "test_launch.py").write_text(LAUNCH)
    command = [sys.executable, "-m", "pytest", "-p", "conftest", "-p", "no:xdist", "-s", "-v", *options]
    paths = os.pathsep.join(str(path) for path in (TESTS, TESTS.parent, TESTS.parent / "kernels"))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    environment |= {"PYTHONPATH": paths, "KERNEL": kernel, "INDEX": str(index)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(("kernel", "index"), [("element", 16), ("read", -17), ("column", 16), ("lane", -17)])
def test_an_index_out_of_bounds_ends_the_process(kernel: str, index: int, tmp_path: Path) -> None:
    ended = session(tmp_path, kernel, index, "test_launch.py::test_launch", "--debug-kernels")
    assert ended.returncode < 0, ended.stdout
    # Where in Warp's headers the check is that failed.
    assert "/warp/native/" in ended.stdout + ended.stderr, ended.stderr


def test_what_passed_and_launched_nothing_is_left_out(tmp_path: Path) -> None:
    everything = session(tmp_path, "element", 15)
    assert "4 passed" in everything.stdout and "1 failed" in everything.stdout, everything.stdout
    checked = session(tmp_path, "element", 15, "--debug-kernels", "--launching")
    assert "2 passed" in checked.stdout and "2 deselected" in checked.stdout, checked.stdout
    ran = re.findall(r"::test_(\w+)(?= )", checked.stdout.partition("= FAILURES =")[0])
    assert ran == ["launch", "a_recorded_launch", "failing"]
