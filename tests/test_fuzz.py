"""A short run of ``python -m benchmarks fuzz``, and what its long ones have found."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from benchmarks.fuzz import Process, run_cases
from fuzzing.worker import faults_of, make_case
from leafwarp.cli import main, one_line
from leafwarp.leaf.image.photo import read_grey
from leafwarp.leaf.maps.cells import half_widths
from leafwarp.leaf.maps.pixel_frame import PixelFrame
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from test_cli import ENVIRONMENT, refused

CASES = 40


def test_damaged_and_extreme_input_ends_as_it_should(tmp_path: Path) -> None:
    outcomes = list(run_cases(range(CASES), seed=0, workers=1, findings=tmp_path))
    assert [outcome for outcome in outcomes if outcome.faults] == []
    assert [outcome.index for outcome in outcomes] == list(range(CASES))
    assert {outcome.code for outcome in outcomes} >= {0, 2}
    assert list(tmp_path.iterdir()) == []


def test_a_case_is_the_same_in_every_process() -> None:
    code = "from fuzzing.worker import make_case; print(repr([make_case(3, index) for index in range(20)]))"
    paths = os.pathsep.join([str(Path(__file__).parent), ENVIRONMENT["PYTHONPATH"]])
    environment = {**ENVIRONMENT, "PYTHONPATH": paths, "PYTHONHASHSEED": "7"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout.strip() == repr([make_case(3, index) for index in range(20)])


@pytest.mark.parametrize(
    ("code", "stdout", "stderr", "fault"),
    [
        (None, "", "Traceback (most recent call last):\n", "traceback"),
        (3, "", "leafwarp: a\n", "exit code 3"),
        (2, "", "leafwarp: a\nleafwarp: b\n", "2 lines of error"),
        (2, "", "", "0 lines of error"),
        (2, "", "leafwarp: a\x1b[2J\n", "not printable"),
        (0, "", "x.py:3: RuntimeWarning: overflow\n", "not of leafwarp"),
        (1, "", "leafwarp: a\n", "without a frame"),
        (2, "a", "leafwarp: a\n", "writes to stdout"),
        (2, "", "leafwarp: warning: a\nleafwarp: b\n", None),
        (1, "", "leafwarp: frame 3: motion: a; b\n", None),
    ],
)
def test_what_counts_as_a_finding(code: int | None, stdout: str, stderr: str, fault: str | None) -> None:
    faults = faults_of(code, stdout, stderr)
    assert faults == [] if fault is None else fault in faults[0]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_case_that_kills_or_stops_its_process_is_a_finding(
    tmp_path: Path, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.fuzz.LIMIT", 1.0)
    process = Process(0, tmp_path, [sys.executable, "-c", STUB.format(number=int(number))])
    process.begin(5)
    outcome = process.end()
    process.close()
    expected = "no end after 1 s" if number == signal.SIGSTOP else "the process died with exit code -9"
    assert outcome.faults == (expected,)
    assert json.loads((tmp_path / "0-5" / "finding.json").read_text())["index"] == 5


STUB = "import os, sys; print('ready', flush=True); sys.stdin.readline(); os.kill(os.getpid(), {number})"


# What long runs have found, mended.


@pytest.mark.parametrize("text", ["a = " + "[" * 20_000, "a = " + "{a = " * 20_000])
def test_scenes_nested_too_deeply(tmp_path: Path, capsys: pytest.CaptureFixture, text: str) -> None:
    (tmp_path / "deep.toml").write_text(text)
    assert "not valid TOML" in refused(capsys, "plan", tmp_path / "deep.toml")


@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 5000])
def test_numbers_of_thousands_of_digits(small_scene: Path, capsys: pytest.CaptureFixture, number: str) -> None:
    path = small_scene.with_name("digits.toml")
    path.write_text(small_scene.read_text().replace("vertices = 120", f"vertices = {number}"))
    assert "digits" in refused(capsys, "plan", path)
    for key in ("mesh.vertices", "leaf.base"):
        assert key in refused(capsys, "plan", small_scene, "--set", f"{key}={number}")
    assert "mesh.vertices" in refused(capsys, "plan", small_scene, "--set", "mesh.vertices=" + "[" * 20_000)


@pytest.mark.parametrize("name", ["x" * 300, "\udcff"])
@pytest.mark.parametrize("verb", ["run", "new"])
def test_results_of_names_that_no_file_can_have(
    small_scene: Path, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture, verb: str, name: str
) -> None:
    refusal = refused(capsys, verb, small_scene if verb == "run" else photo, "-o", tmp_path / f"{name}.usd")
    assert "choose another -o" in refusal
    assert list(tmp_path.iterdir()) == []


def test_messages_command_no_terminal(small_scene: Path, capsys: pytest.CaptureFixture) -> None:
    assert one_line("a\nb\r\x1b[2Jc\u2028\udcffä") == "a b\\r\\x1b[2Jc\\u2028\\udcffä"
    path = small_scene.with_name("key.toml")
    path.write_text(small_scene.read_text() + '\n"a\\rb\\u001b[2J" = 1')
    assert refused(capsys, "plan", path).isprintable()


def test_a_cuda_device_that_is_not_there_is_refused_by_us_alone(
    small_scene: Path, capfd: pytest.CaptureFixture
) -> None:
    import warp as wp

    if not wp.is_cuda_available():
        assert main(["plan", str(small_scene), "--device", "cuda"]) == 2
        assert capfd.readouterr().err == "leafwarp: --device cuda: no such device; accepted here: cpu\n"


def test_grey_of_a_colour_picture(tmp_path: Path) -> None:
    pixels = np.random.default_rng(4).integers(0, 256, (40, 50, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "map.png"), pixels)
    expected = pixels.astype(float) @ [0.114, 0.587, 0.299] / 255.0
    np.testing.assert_allclose(read_grey(tmp_path / "map.png"), expected, rtol=0.0, atol=1e-15)


def test_the_width_of_a_leaf_on_a_map_of_one_row() -> None:
    """By a window as wide as the raster, and by one of a few pixels."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    points = 100.0 + 90.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    outline = SimpleNamespace(points=points, holes=[])
    frame = PixelFrame.around(outline)
    centres = np.array([[100.0, 100.0], [100.0, 20.0]])
    for reach in (1.0, 60.0):
        found = half_widths(centres, outline, frame, (400, 1), reach)
        np.testing.assert_allclose(found, [90.0, 9.0 + reach], rtol=0.0, atol=2.0)


@pytest.mark.parametrize("size", ["1", "[1, 24]", "[24, 1]", "[1, 2]"])
def test_shrinking_along_veins_on_maps_one_cell_wide(small_scene: Path, scene_leaf, size: str) -> None:
    scene = load_scene(small_scene, [f"maps.size={size}", "shrink.along_veins=0.5", "time.frames=3"])
    frames = list(Simulation(scene, scene_leaf(scene)).frames())
    assert len(frames) == 3 and all(np.isfinite(frame.points).all() for frame in frames)


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_water_that_no_factor_exists_for(
    small_scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    def singular(*_: object, **__: object) -> None:
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr("leafwarp.sim.fluid.exchange.splu", singular)
    changes = ["fluid.scheme='unsplit'", "fluid.solver='factor'", "time.frames=2"]
    options = [word for change in changes for word in ("--set", change)]
    output = ["-q", "-o", str(tmp_path)] if verb == "run" else []
    assert main([verb, str(small_scene), *output, *options]) == 1
    line = capsys.readouterr().err
    assert line.startswith("leafwarp: frame 2: factored_diffusion: ") and line.count("\n") == 1
    assert "fluid.step" in line


def test_new_names_its_picture_in_one_line(photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["new", str(photo), "-o", str(tmp_path / "a\nb.toml")]) == 0
    assert capsys.readouterr().err.count("\n") == 1
