"""Under --debug-kernels an index out of bounds ends the process, where it would corrupt memory unseen."""

from __future__ import annotations

import os
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


def test_launch():
    kernel = globals()[os.environ["KERNEL"]]
    arrays = [wp.zeros(16, dtype=float), wp.zeros((2, 16), dtype=float), wp.zeros(1, dtype=lanes)]
    wp.launch(kernel, 1, inputs=[int(os.environ["INDEX"]), *arrays], device="cpu")
"""


def launch(kernel: str, index: int, folder: Path) -> subprocess.CompletedProcess:
    """A session of its own, with this suite's options, of one test that launches the kernel on arrays of 16."""
    (folder / "test_launch.py").write_text(LAUNCH)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "conftest",
        "-p",
        "no:xdist",
        "-s",
        "--debug-kernels",
        "test_launch.py",
    ]
    paths = os.pathsep.join(str(path) for path in (TESTS, TESTS.parent, TESTS.parent / "kernels"))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    environment |= {"PYTHONPATH": paths, "KERNEL": kernel, "INDEX": str(index)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(("kernel", "index"), [("element", 16), ("read", -17), ("column", 16), ("lane", -17)])
def test_an_index_out_of_bounds_ends_the_process(kernel: str, index: int, tmp_path: Path) -> None:
    ended = launch(kernel, index, tmp_path)
    assert ended.returncode < 0, ended.stdout
    # Where in Warp's headers the check is that failed.
    assert "/warp/native/" in ended.stdout + ended.stderr, ended.stderr


def test_an_index_within_bounds_passes(tmp_path: Path) -> None:
    ended = launch("element", 15, tmp_path)
    assert ended.returncode == 0, ended.stdout
