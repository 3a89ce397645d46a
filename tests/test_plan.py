"""Only what a scene requires: modules loaded, arrays allocated and launches, counted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from leafwarp.plan_report import plan_report
from leafwarp.scene.file import load_scene
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.plan import CANDIDATES
from leafwarp.sim.simulation import Simulation

ROOT = Path(__file__).parent.parent
PYTHONPATH = os.pathsep.join(str(ROOT / folder) for folder in (".", "kernels", "tests"))

# What a fresh process loads, allocates and launches for a scene; two frames are run.
CENSUS = """
import json, sys
from pathlib import Path
import warp as wp
from every_kernel import specialise_whole_modules
specialise_whole_modules()
allocated = []
empty = wp.array.__init__
def counted(self, *arguments, **options):
    empty(self, *arguments, **options)
    if getattr(self, "deleter", None) is not None and options.get("ptr") is None:
        allocated.append(self.capacity)
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.plan_report import plan_report
from leafwarp.scene.file import load_scene
scene = load_scene(Path(sys.argv[1])).with_changes({"output.contact_sheet": False})
leaf = prepare_scene_leaf(scene, Path(sys.argv[2]))
wp.init()
wp.array.__init__ = counted
from leafwarp.sim.simulation import Simulation
simulation = Simulation(scene, leaf, "cpu")
at_start = len(allocated)
before = simulation.state.launch_count
frames = [frame.index for frame in simulation.frames(2)]
from warp._src.context import user_modules
print(json.dumps({
    "kernels": sorted(name for name, module in user_modules.items() if module.execs and "leafwarp" in name),
    "modules": sorted(name for name in sys.modules if name.startswith("leafwarp")),
    "arrays": list(simulation.state.names),
    "allocated": at_start,
    "allocated_in_frames": len(allocated) - at_start,
    "bytes": simulation.state.byte_count,
    "planned_bytes": simulation.plan.byte_count,
    "launches": simulation.state.launch_count - before,
    "substeps": simulation.substeps,
    "fluid_steps": simulation.fluid.steps_done if simulation.fluid else 0,
    "maps": sorted(leaf.maps),
}))
"""


@pytest.fixture(scope="module")
def census(leaf_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    def count(name: str, cache: Path) -> dict:
        command = [sys.executable, "-c", CENSUS, str(ROOT / "scenes" / f"{name}.toml"), str(cache)]
        environment = os.environ | {"PYTHONPATH": PYTHONPATH}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])

    # The smallest scene prepares its leaf itself, so that what this imports is seen.
    return {"still": count("still", tmp_path_factory.mktemp("leaf")), "bramble": count("bramble", leaf_cache)}


def test_the_smallest_scene_compiles_only_its_kernels(census) -> None:
    still, bramble = census["still"]["kernels"], census["bramble"]["kernels"]
    assert still == [
        f"leafwarp_kernels.{name}"
        for name in ("hold", "integration", "normals", "ramp", "response", "spring_lanes", "stable_step")
    ]
    assert set(still) < set(bramble)
    assert {f"leafwarp_kernels.{name}" for name in ("tridiagonal", "transpiration", "sampling")} <= set(bramble)
    assert "leafwarp_kernels.unsplit" not in bramble


def test_the_smallest_scene_does_not_even_import_the_fluid(census) -> None:
    assert not [name for name in census["still"]["modules"] if "fluid" in name or "tridiagonal" in name]
    assert "leafwarp.sim.fluid" in census["bramble"]["modules"]


def test_the_smallest_scene_has_no_maps_and_few_arrays(census) -> None:
    still, bramble = census["still"], census["bramble"]
    assert still["maps"] == []
    assert not [name for name in still["arrays"] if "hinge" in name or "map" in name or "venation" in name]
    assert len(still["arrays"]) < 0.5 * len(bramble["arrays"])
    assert still["bytes"] < 0.1 * bramble["bytes"]


@pytest.mark.parametrize("name", ["still", "bramble"])
def test_what_is_allocated_is_what_was_planned(census, name: str) -> None:
    assert census[name]["bytes"] == census[name]["planned_bytes"]
    assert census[name]["allocated_in_frames"] == 0


def test_launches_are_those_of_the_plan(census) -> None:
    still = census["still"]
    substeps = sum(still["substeps"])
    # Every eight substeps the ramp of rest lengths and masses, and the hold; the ramp's clock every block; the ramp's
    # beginning, its end and what comes next; the hold at the end, and its velocity.
    blocks = [32] * (substeps // 32) + [2**power for power in range(5) if substeps % 32 >> power & 1]
    ramps = sum(max(1, size // 8) for size in blocks)
    # Two readings of normals and, for the second frame: rest lengths, mass, five for the stable step (bound and stretch
    # before and after, and the way gone), and edge springs, their sum and integration a substep.
    assert still["launches"] == 2 + 2 + 5 + 2 * ramps + len(blocks) + 3 + 2 + 3 * substeps
    per_substep = 6  # edge springs of the margin, hinges with the others, the sum, gravity, air, integration
    bramble = census["bramble"]
    assert bramble["launches"] > per_substep * sum(bramble["substeps"])
    assert still["launches"] / sum(still["substeps"]) < bramble["launches"] / sum(bramble["substeps"])


VARIANTS = {
    "bramble, paper": ("bramble", {"structure.bending": "paper"}),
    "bramble, unsplit": ("bramble", {"fluid.scheme": "unsplit"}),
    **{path.stem: (path.stem, {}) for path in sorted((ROOT / "scenes").glob("*.toml"))},
    "many": ("many", {"leaves.count": 4}),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_what_a_stage_reads_comes_from_somewhere(variant: str, scene_leaf) -> None:
    """Every array that crosses from stage to stage is written by one of them."""
    name, changes = VARIANTS[variant]
    scene = load_scene(ROOT / "scenes" / f"{name}.toml").with_changes(changes)
    plan = Simulation(scene, scene_leaf(scene)).plan
    runs = {"start": 0.0, "fluid step": 1.0, "frame": 1.0, "substep": 1.0, "output": 1.0}
    stages = plan.describe(runs)
    declared = {array for stage in stages for array in stage["arrays"]}
    written = {array for stage in stages for array in stage["writes"]}
    for stage in stages:
        assert set(stage["reads"]) | set(stage["writes"]) <= declared
        # What is read and nobody writes is a table, filled once and shared.
        tables = set(stage["reads"]) - written
        owners = {other["name"] for other in stages if tables & set(other["arrays"])}
        assert owners <= {*TABLES, "unsplit_diffusion"}, tables
    assert {"water_now", "position", "edge_rest_length"} & written
    assert {s.name for s in plan.stages} | set(plan.left_out) == {c.name for c in CANDIDATES}
    assert not {s.name for s in plan.stages} & set(plan.left_out)


TABLES = (
    "stencils",
    "implicit_motion",
    "quasistatic_motion",
    "edge_springs",
    "angular_springs",
    "paper_bending",
    "integration",
    "split_diffusion",
    "water",
)


def test_every_package_is_shipped() -> None:
    """A plain install from elsewhere has every folder of modules that the checkout has."""
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = {
        ".".join(path.parent.relative_to(root).parts)
        for root, pattern in ((ROOT, "leafwarp/**/__init__.py"), (ROOT / "kernels", "*/__init__.py"))
        for path in root.glob(pattern)
    }
    assert set(packages) == folders


def test_an_array_declared_twice_is_an_error() -> None:
    spec = ArraySpec("water", (2,), "real", "")
    with pytest.raises(ValueError, match="'water' is declared twice"):
        State([spec, spec], "cpu", "float32")


@pytest.mark.parametrize("frames", [2, 13, 25, 38])
@pytest.mark.parametrize("plastic_set", [0.0, 0.5])
def test_couplings_and_equilibria_are_as_many_as_planned(
    frames, plastic_set, small_scene, scene_leaf, monkeypatch
) -> None:
    monkeypatch.setattr("leafwarp.plan_report.prepare_scene_leaf", lambda scene, cache: scene_leaf(scene))
    changes = {"motion.method": "quasistatic", "time.frames": frames, "shrink.plastic_set": plastic_set}
    scene = load_scene(small_scene).with_changes({**changes, "mesh.vertices": 40})
    simulation = Simulation(scene, scene_leaf(scene))
    counted = dict.fromkeys(("_couple", "follow", "advance"), 0)

    def counting(owner, name):
        function = getattr(owner, name)

        def count(*arguments):
            counted[name] += 1
            return function(*arguments)

        setattr(owner, name, count)

    counting(simulation, "_couple")
    counting(simulation.motion, "follow")
    counting(simulation.motion, "advance")
    for _ in simulation.frames():
        pass
    planned = {stage["name"]: stage["launches_per_frame"] for stage in plan_report(scene, "cpu")["stages"]}
    each = {stage.name: stage.launches for stage in simulation.plan.stages}
    runs = {
        name: round(planned[name] / each[name] * (frames - 1), 6) for name in ("rest_lengths", "quasistatic_motion")
    }
    assert runs == {"rest_lengths": counted["_couple"], "quasistatic_motion": counted["follow"] + counted["advance"]}
    assert counted["follow"] == 24 and counted["advance"] == frames - 1


@pytest.mark.parametrize("interval", [None, 120.0, 1800.0])
def test_what_follows_the_water_is_launched_as_planned(interval: float | None, scene_leaf, leaf_cache) -> None:
    """By ramp and hold, however often a frame is divided."""
    scene = load_scene(ROOT / "scenes" / "still.toml").with_changes(
        {"mesh.vertices": 150, "time.frames": 5, "time.duration": 1440.0, "solver.coupling_interval": interval}
    )
    simulation = Simulation(scene, scene_leaf(scene))
    stages = [simulation.stage(name) for name in ("ramp", "hold")]
    planned = {stage["name"]: stage["launches_per_frame"] for stage in plan_report(scene, "cpu")["stages"]}
    motion, taken = simulation.motion, []
    run = motion._run_substeps
    motion._run_substeps = lambda count, *rest: (taken.append(count), run(count, *rest))
    list(simulation.frames())
    for stage in stages:
        counted = sum(stage.launches_in(count) for count in taken) / (scene.time.frames - 1)
        assert planned[stage.name] == pytest.approx(counted, rel=0.15), stage.name


def test_more_substeps_than_any_run_takes_are_planned(small_scene: Path) -> None:
    """What a run refuses, ``plan`` still tells: with how many substeps it would be."""
    stiff = load_scene(small_scene).with_changes({"solver.substep": 1e-12, "solver.maximum_substeps": 16})
    report = plan_report(stiff, "cpu")
    assert report["substeps_per_frame"] > 1e10
    assert next(s for s in report["stages"] if s["name"] == "ramp")["launches_per_frame"] > 1e9
