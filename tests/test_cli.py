"""The command line: results, exit codes, one-line errors, signals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import zlib
from itertools import pairwise
from pathlib import Path

import pytest

from leafwarp.cli import main

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "kernels")])}


def refused(capsys: pytest.CaptureFixture, *arguments: object) -> str:
    """The one line that a bad call prints."""
    assert main([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    line = err.strip().splitlines()[-1]
    assert "Traceback" not in err
    assert len(err.strip().splitlines()) == 1
    return line


@pytest.fixture(scope="module")
def finished(small_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of a whole run of the small scene."""
    folder = tmp_path_factory.mktemp("finished")
    assert main(["run", str(small_scene), "-o", str(folder), "-q"]) == 0
    return folder


def test_run_writes_usd_texture_and_report(finished: Path) -> None:
    report = json.loads((finished / "small.report.json").read_text())
    assert {p.name for p in finished.iterdir()} == {
        "small.usd", "small_texture.png", "small.report.json", ".leafwarp-cache",
    }  # fmt: skip
    assert report["frames"] == 9
    assert report["mesh"]["vertices"] == pytest.approx(120, rel=0.02)
    assert report["map"] == [24, 32]
    ledger = report["fluid"]["ledger"]
    assert ledger["now"] < ledger["start"] == 1.0
    assert abs(ledger["error"]) < 1e-6
    for stage in ("transpiration", "split_diffusion", "sample_water", "rest_lengths", "mass", "motion", "frame", "usd"):
        assert report["milliseconds_per_frame"][stage] > 0.0
    substep = ("edge_springs", "angular_springs", "gravity", "air", "integration")
    shares = [report["milliseconds_per_frame"][stage] for stage in substep]
    assert min(shares) > 0.0
    assert sum(shares) == pytest.approx(report["milliseconds_per_frame"]["motion"])
    assert report["seconds"]["total"] > report["seconds"]["prepare"] > 0.0
    assert report["memory"]["peak_bytes"] > report["memory"]["arrays_bytes"] > 0
    assert report["substeps"]["most"] >= report["substeps"]["least"] >= 1


def test_usd_holds_every_frame_and_the_water_falls(finished: Path) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(finished / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    assert mesh.GetPointsAttr().GetTimeSamples() == [float(f) for f in range(1, 10)]
    water = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("water")
    means = [sum(water.Get(f)) / len(water.Get(f)) for f in range(1, 10)]
    assert all(b < a for a, b in pairwise(means))


def test_an_existing_result_is_kept_unless_overwritten(finished: Path, small_scene: Path, capsys) -> None:
    before = (finished / "small.usd").read_bytes()
    assert "--overwrite" in refused(capsys, "run", small_scene, "-o", finished, "-q")
    assert (finished / "small.usd").read_bytes() == before
    assert main(["run", str(small_scene), "-o", str(finished), "-q", "--overwrite"]) == 0
    assert capsys.readouterr().out.strip() == str(finished / "small.usd")
    assert (finished / "small.usd").read_bytes() == before  # the same run gives the same bytes


def test_frames_picks_what_is_written(small_scene: Path, prepared_folder: Path, finished: Path, capsys) -> None:
    from pxr import Usd, UsdGeom

    target = prepared_folder / "part.usda"
    assert main(["run", str(small_scene), "-o", str(target), "--frames", "3:5", "--json", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 5
    points = {}
    for path in (target, finished / "small.usd"):
        stage = Usd.Stage.Open(str(path))
        mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
        points[path] = [mesh.GetPointsAttr().Get(f) for f in (3, 4, 5)]
        if path == target:
            assert mesh.GetPointsAttr().GetTimeSamples() == [3.0, 4.0, 5.0]
    assert points[target] == points[finished / "small.usd"]


def test_bad_calls_are_one_line_each(small_scene: Path, tmp_path: Path, capsys) -> None:
    assert "no such scene file" in refused(capsys, "run", tmp_path / "none.toml", "-o", tmp_path)
    assert "did you mean 'step'" in refused(capsys, "run", small_scene, "-o", tmp_path, "--set", "fluid.stp=3")
    assert "accepted here: cpu" in refused(capsys, "run", small_scene, "-o", tmp_path, "--device", "cuda:9")
    assert "the scene has 9 frames" in refused(capsys, "run", small_scene, "-o", tmp_path, "--frames", "1:10")
    assert "no such file" in refused(capsys, "run", small_scene, "-o", tmp_path, "--set", "leaf.image='none.png'")
    assert "no such file" in refused(capsys, "new", tmp_path / "none.png")
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert "cannot be made" in refused(capsys, "run", small_scene, "-o", blocked / "sub")


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", "a.toml", "--frames", "5:2"], ["run", "a", "--wrong"]])
def test_bad_arguments_exit_with_2(arguments: list[str], capsys) -> None:
    assert main(arguments) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused(small_scene: Path, tmp_path: Path, capsys) -> None:
    tmp_path.chmod(0o500)
    assert "cannot be written" in refused(capsys, "run", small_scene, "-o", tmp_path)


def test_plan_json_lists_stages_and_what_is_left_out(small_scene: Path, capsys) -> None:
    assert main(["plan", str(small_scene), "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    names = [stage["name"] for stage in plan["stages"]]
    assert names.index("transpiration") < names.index("split_diffusion") < names.index("edge_springs")
    for stage in plan["stages"]:
        assert {"reads", "writes", "kernels", "bytes", "launches_per_frame", "purpose"} <= set(stage)
    assert "contact_sheet" in {entry["name"] for entry in plan["left_out"]}
    assert plan["substeps_per_frame"] >= 1


def test_a_frame_that_cannot_be_computed_is_named_and_those_before_are_kept(
    small_scene: Path, prepared_folder: Path, capsys
) -> None:
    from pxr import Usd, UsdGeom

    limit = ["--set", "solver.maximum_substeps=2"]
    assert main(["run", str(small_scene), "-o", str(prepared_folder), "-q", *limit]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("leafwarp: frame 2: motion: needs ") and "solver.maximum_substeps = 2" in err
    assert len(err.splitlines()) == 1
    stage = Usd.Stage.Open(str(prepared_folder / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    assert mesh.GetPointsAttr().GetTimeSamples() == [1.0]


def test_results_never_replace_the_scenes_own_images(small_scene: Path, tmp_path: Path, capsys) -> None:
    import shutil

    shutil.copy(small_scene.with_name("drawn.png"), tmp_path / "small_texture.png")
    before = (tmp_path / "small_texture.png").read_bytes()
    image = ["--set", f"leaf.image='{tmp_path / 'small_texture.png'}'", "--overwrite"]
    assert "is an image of the scene" in refused(capsys, "run", small_scene, "-o", tmp_path, *image)
    assert (tmp_path / "small_texture.png").read_bytes() == before


@pytest.mark.parametrize("name", ["leaf.usdz", "leaf.abc", "back\\slash.usd"])
def test_names_that_no_usd_can_have_are_refused(name: str, small_scene: Path, tmp_path: Path, capsys) -> None:
    assert "-o " in refused(capsys, "run", small_scene, "-o", f"{tmp_path}/{name}")
    assert list(tmp_path.iterdir()) == []


def test_the_usd_holds_what_the_simulation_computed(finished: Path, small_scene: Path, scene_leaf) -> None:
    import numpy as np
    from pxr import Usd, UsdGeom

    from leafwarp.scene.file import load_scene
    from leafwarp.sim.simulation import Simulation
    from leafwarp.usd.check import check_usd

    assert check_usd(finished / "small.usd") == []
    stage = Usd.Stage.Open(str(finished / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    scene = load_scene(small_scene)
    for frame in Simulation(scene, scene_leaf(scene)).frames():
        for attribute, expected in (
            (mesh.GetPointsAttr(), frame.points),
            (mesh.GetNormalsAttr(), frame.normals),
            (mesh.GetVelocitiesAttr(), frame.velocities),
            (primvars.GetPrimvar("water"), frame.water),
            (primvars.GetPrimvar("displayColor"), frame.color),
        ):
            np.testing.assert_array_equal(np.array(attribute.Get(frame.index)), expected)


def test_new_writes_a_scene_that_runs_at_once(photo: Path, tmp_path: Path, capsys) -> None:
    scene = tmp_path / "mine.toml"
    assert main(["new", str(photo), "-o", str(scene), "--length", "7 cm"]) == 0
    assert capsys.readouterr().out.strip() == str(scene)
    assert "exists already" in refused(capsys, "new", photo, "-o", scene)
    few = ["--set", "mesh.vertices=100", "--set", "maps.size=24", "--set", "time.frames=3"]
    assert main(["run", str(scene), "-o", str(tmp_path), "-q", *few, "--set", "output.contact_sheet=false"]) == 0


def test_new_refuses_a_bad_length(photo: Path, tmp_path: Path, capsys) -> None:
    line = refused(capsys, "new", photo, "-o", tmp_path / "mine.toml", "--length", "7 feet")
    assert "leaf.length = '7 feet'" in line
    assert not (tmp_path / "mine.toml").exists()


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from leafwarp.cli import main; main(['--help']); "
        "print([m for m in ('warp', 'numpy', 'cv2', 'pxr', 'trimesh', 'scipy', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_after_its_frame(
    small_scene: Path, prepared_folder: Path, number: signal.Signals
) -> None:
    from pxr import Usd, UsdGeom

    command = [
        sys.executable,
        "-m",
        "leafwarp",
        "run",
        str(small_scene),
        "-o",
        str(prepared_folder),
        "--set",
        "time.frames=5000",
    ]
    process = subprocess.Popen(command, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    for line in process.stderr:
        if line.startswith("frame 3/"):
            process.send_signal(number)
            break
    rest = process.stderr.read()
    assert process.wait(timeout=60) == 128 + number
    assert "Traceback" not in rest
    stage = Usd.Stage.Open(str(prepared_folder / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    samples = mesh.GetPointsAttr().GetTimeSamples()
    assert len(samples) >= 3
    assert samples == [float(f) for f in range(1, len(samples) + 1)]
    assert json.loads((prepared_folder / "small.report.json").read_text())["frames"] == len(samples)


@pytest.mark.parametrize("last_line", ["frame 1/", "frame 7/"])
def test_kill_9_leaves_every_finished_frame(small_scene: Path, prepared_folder: Path, last_line: str) -> None:
    from pxr import Usd, UsdGeom

    from leafwarp.usd.check import check_usd

    command = [sys.executable, "-m", "leafwarp", "run", str(small_scene), "-o", str(prepared_folder)]
    process = subprocess.Popen(
        [*command, "--set", "time.frames=5000"], env=ENVIRONMENT, stderr=subprocess.PIPE, text=True
    )
    done = 0
    for line in process.stderr:
        done += line.startswith("frame ")
        if line.startswith(last_line):
            process.kill()
            break
    done += sum(line.startswith("frame ") and line.endswith("s\n") for line in process.stderr)
    process.wait()
    assert check_usd(prepared_folder / "small.usd", unfinished=True) == []
    stage = Usd.Stage.Open(str(prepared_folder / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    assert len(mesh.GetPointsAttr().GetTimeSamples()) >= done
    # The next run replaces what was left.
    assert main(["run", str(small_scene), "-o", str(prepared_folder), "--overwrite", "-q"]) == 0
    assert check_usd(prepared_folder / "small.usd") == []
    assert not list(prepared_folder.glob("*.frames"))


def test_a_full_disk_in_mid_run_keeps_the_frames(small_scene: Path, prepared_folder: Path) -> None:
    """Files may not grow past 6 kB from the third frame on: what is on disk stays, and one line says what happened."""
    code = (
        "import resource, signal, sys\n"
        "from leafwarp.cli import main\n"
        "from leafwarp.usd.writer import UsdWriter\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "write = UsdWriter.write\n"
        "def limited(self, frame):\n"
        "    if frame.index == 4:\n"
        "        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))\n"
        "    write(self, frame)\n"
        "UsdWriter.write = limited\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", code, "run", str(small_scene), "-o", str(prepared_folder), "-q"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if line.startswith("leafwarp: ")]
    assert len(lines) == 1 and "cannot be written" in lines[0]
    assert "Traceback" not in done.stderr
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(prepared_folder / "small.usd"))
    mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
    assert mesh.GetPointsAttr().GetTimeSamples() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"", "is empty"),
        (b"this is no picture", "leaf.png"),
        ("truncated", "leaf.png"),
        ("one pixel", "leaf.png"),
        ("huge", "leaf.png"),
        ("blank", "leaf.png"),
    ],
)
def test_bad_photos_are_one_line_each(
    content, words: str, photo: Path, small_scene: Path, tmp_path: Path, capsys
) -> None:
    import cv2
    import numpy as np

    image = tmp_path / "leaf.png"
    if content == "truncated":
        image.write_bytes(photo.read_bytes()[:-200])
    elif content == "huge":
        # The header declares 20,000 x 20,000 pixels; the data are those of a small picture.
        data = bytearray(photo.read_bytes())
        data[16:24] = (20_000).to_bytes(4, "big") * 2
        data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
        image.write_bytes(data)
    elif isinstance(content, str):
        size = (1, 1) if content == "one pixel" else (200, 300)
        cv2.imwrite(str(image), np.full((*size, 3), 240, np.uint8))
    elif content is not None:
        image.write_bytes(content)
    line = refused(capsys, "run", small_scene, "-o", tmp_path, "-q", "--set", f"leaf.image='{image}'")
    assert words in line
    assert not (tmp_path / "small.usd").exists()


@pytest.mark.parametrize("depth", ["grey", "16-bit", "alpha"])
def test_grey_16_bit_and_alpha_photos_are_accepted(depth: str, photo: Path, small_scene: Path, tmp_path: Path) -> None:
    import cv2
    import numpy as np

    picture = cv2.imread(str(photo))
    if depth == "grey":
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    elif depth == "16-bit":
        picture = picture.astype(np.uint16) * 257
    else:
        opaque = (cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) < 200).astype(np.uint8) * 255
        picture = np.dstack([picture, opaque])
    image = tmp_path / "leaf.png"
    cv2.imwrite(str(image), picture)
    changes = ["--set", f"leaf.image='{image}'", "--frames", "1:2"]
    assert main(["run", str(small_scene), "-o", str(tmp_path), "-q", *changes]) == 0


def test_progress_is_a_line_a_frame_when_not_on_a_terminal(small_scene: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "leafwarp", "run", str(small_scene), "-o", str(tmp_path), "--frames", "1:2"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert done.stdout == f"{tmp_path / 'small.usd'}\n"
    lines = [line for line in done.stderr.splitlines() if line.startswith("frame ")]
    assert [line.split()[1:3] for line in lines] == [["1/2", "50%"], ["2/2", "100%"]]
