"""What a start costs: the modules that are imported and the kernels that are compiled, counted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from leafwarp.scene.file import load_scene
from leafwarp.sim import compilation, launch
from leafwarp.sim.compilation import Compilation, required_modules
from leafwarp.sim.simulation import Simulation
from leafwarp_kernels import raycast as raycast_kernels

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "kernels")])}
SLOW = {"warp", "numpy", "scipy", "cv2", "pxr", "netgen", "pydantic", "matplotlib", "trimesh"}
SCENES = ("still", "bramble", "blade", "cut", "tree")

IMPORTED = """
import json, sys
from leafwarp.cli import main
code = main(sys.argv[1:])
print(json.dumps([code, sorted({name.partition(".")[0] for name in sys.modules} & set(SLOW))]), file=sys.stderr)
"""


def imported(*arguments: str, **options) -> set[str]:
    """The slow libraries that a fresh process loads for a command."""
    command = [sys.executable, "-c", f"SLOW = {sorted(SLOW)}\n{IMPORTED}", *arguments]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True, **options)
    code, names = json.loads(done.stderr.splitlines()[-1])
    assert code == 0, done.stderr
    return set(names)


INITIALISED = """
import sys, threading, time
from pathlib import Path
import warp as wp
from warp._src import context
from leafwarp.scene.file import load_scene
from leafwarp.sim.compilation import Compilation

found = []

class Runtime(context.Runtime):
    def __init__(self):
        found.append(threading.current_thread().name)
        time.sleep(0.2)
        super().__init__()

context.Runtime = Runtime
wp.config.quiet = True
with Compilation(load_scene(Path(sys.argv[1])), "cpu") as compilation:
    compilation.wait()
print(*found)
"""


def test_warp_is_initialised_once_before_anything_is_compiled() -> None:
    """By two threads at a time it would change modules that one of them is compiling."""
    command = [sys.executable, "-c", INITIALISED, str(ROOT / "scenes" / "still.toml")]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["MainThread"]


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["verify", "--help"]])
def test_help_loads_no_library(arguments: list[str]) -> None:
    assert imported(*arguments) == set()


def test_the_schema_loads_neither_kernels_nor_photos() -> None:
    assert imported("schema") <= {"pydantic", "numpy"}


def test_a_leaf_prepared_before_needs_neither_mesher_nor_scipy(small_scene: Path, tmp_path: Path) -> None:
    run = [
        "run",
        str(small_scene),
        "-f",
        "1:1",
        "-o",
        str(tmp_path),
        "--overwrite",
        "--set",
        "output.contact_sheet=false",
    ]
    assert "netgen" in imported(*run)
    assert not {"netgen", "scipy", "trimesh", "matplotlib"} & imported(*run)


@pytest.mark.parametrize("name", SCENES)
def test_the_kernels_found_ahead_are_those_of_the_run(name: str, device: str, scene_leaf, monkeypatch) -> None:
    """No module is asked for a kernel that was not found ahead: it would be compiled again."""
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_changes({"output.contact_sheet": False})
    specialise, asked = launch.specialise, set()

    def noting(kernel: wp.Kernel, precision: str) -> wp.Kernel:
        concrete = specialise(kernel, precision)
        asked.add((concrete.module.name, concrete.get_mangled_name()))
        return concrete

    monkeypatch.setattr(launch, "specialise", noting)
    monkeypatch.setattr(compilation, "specialise", noting)
    modules = {module.name for module in required_modules(scene, device)}
    ahead = asked.copy()
    assert modules == {module for module, _ in ahead}
    asked.clear()
    simulation = Simulation(scene, scene_leaf(scene), device)
    for _ in simulation.frames(2):
        pass
    assert asked == ahead


@pytest.mark.parametrize(
    ("changes", "more", "less"),
    [
        ({"motion.method": "implicit"}, {"hinge_hessian", "implicit_step"}, {"integration"}),
        ({"motion.method": "quasistatic"}, {"hinge_hessian"}, {"integration"}),
        ({"structure.bending": "paper"}, {"paper_bending"}, set()),
        ({"fluid.scheme": "unsplit"}, {"unsplit", "multigrid"}, {"tridiagonal"}),
        ({"fluid.scheme": "unsplit", "fluid.solver": "factor"}, set(), {"tridiagonal"}),
        ({"motion.pin_radius": 0.05, "motion.clamp": True}, set(), set()),
        ({"motion.clamp": False, "motion.wind": [1.0, 0.0, 0.0], "solver.precision": "float64"}, set(), set()),
    ],
    ids=["implicit", "quasistatic", "paper", "unsplit", "factor", "held", "windy"],
)
def test_kernels_are_found_ahead_for_any_scene(small_scene: Path, changes, more, less, device: str) -> None:
    """The leaf that they are found with suits every stage."""
    scene = load_scene(small_scene)
    usual, found = (
        {module.name.rpartition(".")[2] for module in required_modules(one, device)}
        for one in (scene, scene.with_changes(changes))
    )
    assert more <= found - usual and less <= usual - found
    assert {"response", "normals", "sampling"} <= found


def test_kernels_are_loaded_before_the_simulation_starts(small_scene: Path, device: str) -> None:
    scene = load_scene(small_scene).with_changes({"output.contact_sheet": True})
    modules, raycast = required_modules(scene, device), wp.get_module(raycast_kernels.__name__)
    for module in (*modules, raycast):
        module.unload()
    with Compilation(scene, device) as compiling:
        compiling.wait()
        assert modules and all(module.execs for module in modules)
        compiling.finish()
        assert raycast.execs


def test_what_the_compiler_raises_arrives(small_scene: Path, device: str, monkeypatch) -> None:
    def broken(*arguments):
        raise RuntimeError("no compiler")

    monkeypatch.setattr(wp, "force_load", broken)
    with Compilation(load_scene(small_scene), device) as compiling, pytest.raises(RuntimeError, match="no compiler"):
        compiling.wait()


def test_leaves_of_any_scene_are_simulated_alike(small_scene: Path, device: str, scene_leaf) -> None:
    """Finding the kernels ahead leaves no trace in what is simulated."""
    scene = load_scene(small_scene)
    leaf = scene_leaf(scene)
    before = [frame.points.tobytes() for frame in Simulation(scene, leaf, device).frames(3)]
    required_modules(scene, device)
    assert [frame.points.tobytes() for frame in Simulation(scene, leaf, device).frames(3)] == before
