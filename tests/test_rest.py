"""Water and shapes at rest are not computed again, and nobody can tell from the result."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fluid_sample import SCHEMES, ellipse, make_sample
from leafwarp.cli import main
from leafwarp.scene.file import load_scene
from leafwarp.sim import rest
from leafwarp.sim.fluid.controller import Fluid
from leafwarp.sim.fluid.source import Opening
from leafwarp.sim.fluid.steps import FluidSteps
from leafwarp.sim.implicit.motion import Quasistatic
from leafwarp.sim.rest import ShapeRest
from leafwarp.sim.simulation import Simulation

STEP = 60.0
COUNT = 240
LOOKS = 96  # that is 2.5 steps each
ALIKE = {"lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-8}
# Leaves that come to rest: tables, and the steps that are computed at most.
RESTING = {
    "nothing enters or leaves": ({}, 12),
    "bone dry": ({"transpiration": {"rate": 1e-3, "cuticle_rate": 1e-3}}, 40),
    "saturated, fed, with closed stomata": ({"source": {"conductance": 1e-3}}, 12),
    "as much enters as leaves": (
        {
            "fluid": {"lamina_diffusivity": 0.0, "vein_diffusivity": 0.0},
            "transpiration": {"rate": 1e-4, "cuticle_rate": 1e-4},
            "source": {"conductance": 1e-2},
        },
        90,
    ),
    "cut, then fed again": (
        {
            "transpiration": {"rate": 1e-3, "cuticle_rate": 1e-3},
            "source": {"conductance": 1e-2, "cut_at": 30.0 * STEP, "rewatered_at": 150.4 * STEP},
        },
        200,
    ),
}


def history(tables: dict, scheme: str, precision: str, device: str, wakes: bool = False):
    """The water at each look, and the fluid; ``wakes`` keeps it from resting."""
    mask = ellipse(24)
    fluid = {"step": STEP, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6}
    tables = {"time": {"duration": COUNT * STEP}} | tables | {"fluid": fluid | tables.get("fluid", {})}
    if tables["fluid"]["vein_diffusivity"] == 0.0:
        tables["fluid"]["scheme"] = "split"
    sources = mask & (np.indices(mask.shape)[0] < 4)
    if tables["fluid"]["vein_diffusivity"] == 0.0:
        sources = mask
    maps = {"source": sources.astype(float), "venation": mask * 0.5}
    sample = make_sample(tables, mask, maps, device=device, precision=precision)
    found = []
    for look in range(1, LOOKS + 1):
        if wakes:
            sample.fluid.wake()
        sample.fluid.advance(look * COUNT / LOOKS * STEP, look)
        sample.fluid.check(look)
        found.append(sample.state["water_now"].numpy().tobytes())
    return found, sample.fluid


@pytest.mark.parametrize("name", RESTING)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_at_rest_is_not_computed_again_and_stays_what_it_was(name, scheme, precision, device) -> None:
    tables, most = RESTING[name]
    resting, fluid = history(tables, scheme, precision, device)
    computed, awake = history(tables, scheme, precision, device, wakes=True)
    assert resting == computed
    assert awake.steps_skipped == 0 and fluid.steps_done == awake.steps_done == COUNT
    if scheme != "iterated" or name in ("nothing enters or leaves", "saturated, fed, with closed stomata"):
        assert COUNT - fluid.steps_skipped <= most
    for ledger in (fluid.ledger(), awake.ledger()):
        assert abs(ledger.error) < {"float32": 1e-6, "float64": 1e-12}[precision]
    assert fluid.ledger().transpired == pytest.approx(awake.ledger().transpired, rel=1e-9, abs=1e-12)
    assert fluid.ledger().added == pytest.approx(awake.ledger().added, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("scheme", ["split", "unsplit"])
def test_a_steady_flow_comes_to_rest(scheme, device) -> None:
    """What enters at the base leaves everywhere: no content changes any more, and the account goes on."""
    mask = ellipse(24)
    tables = {
        "time": {"duration": 3000 * STEP},
        "fluid": {"step": STEP, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
        "transpiration": {"rate": 1e-5, "cuticle_rate": 1e-5},
        "source": {"conductance": 1e-3},
    }
    maps = {"source": mask & (np.indices(mask.shape)[0] < 4), "venation": mask * 0.5, "water": mask * 0.5}
    found = []
    for rests in (True, False):
        sample = make_sample(tables, mask, maps, device=device)
        for look in range(1, 601):
            if not rests:
                sample.fluid.wake()
            sample.fluid.advance(5 * look * STEP, look)
            sample.fluid.check(look)
        assert (sample.fluid.steps_skipped > 1000) == rests
        found.append((sample.water.tobytes(), sample.fluid.ledger()))
    (resting, ledger), (computed, expected) = found
    assert resting == computed
    assert ledger.transpired == pytest.approx(1e-5 * 3000 * STEP, rel=1e-4)
    for number in ("transpired", "added", "now"):
        assert getattr(ledger, number) == pytest.approx(getattr(expected, number), rel=1e-12)


@pytest.mark.parametrize("per_look", [0.25, 1.0, 2.0])
def test_steps_of_any_length_come_to_rest(per_look, precision, device) -> None:
    """Also where every look, or none, falls on the end of a step."""
    tables = {"time": {"duration": COUNT * STEP}, "fluid": {"step": STEP, **ALIKE}}
    sample = make_sample(tables, ellipse(12), device=device, precision=precision)
    for look in range(1, 41):
        sample.fluid.advance(look * per_look * STEP, look)
        sample.fluid.check(look)
    assert sample.fluid.steps_done == 40 * per_look
    assert sample.fluid.steps_skipped >= 40 * per_look - 6


def test_water_that_something_else_changes_wakes(precision, device) -> None:
    mask = ellipse(16)
    tables = {"time": {"duration": COUNT * STEP}, "fluid": {"step": STEP, **ALIKE}}
    sample = make_sample(tables, mask, device=device, precision=precision)
    for look in range(1, 11):
        sample.fluid.advance(2.5 * look * STEP, look)
        sample.fluid.check(look)
    assert sample.fluid.is_at_rest
    sample.set_water(np.where(mask & (np.indices(mask.shape)[0] < 8), 0.5, sample.water))
    before = sample.water
    for look in (11, 12):
        sample.fluid.advance(2.5 * look * STEP, look)
        sample.fluid.check(look)
    assert not sample.fluid.is_at_rest
    assert sample.leaf_water.std() < before[mask].std()


def test_nobody_looks_nothing_rests(precision, device) -> None:
    sample = make_sample({"fluid": {"step": STEP, **ALIKE}}, ellipse(12), device=device, precision=precision)
    for look in range(1, 9):
        sample.fluid.advance(look * STEP)
    assert sample.fluid.steps_skipped == 0


def test_the_source_changes_in_the_steps_that_it_says(device) -> None:
    for cut, rewatered in ((0.0, 5.0), (3.5, None), (3.0, 3.2), (2.25, 2.5), (7.0, 9.999999999)):
        moments = {"cut_at": cut * STEP} | ({} if rewatered is None else {"rewatered_at": rewatered * STEP})
        tables = {"time": {"duration": 20 * STEP}, "source": {"conductance": 1.0} | moments}
        tables["fluid"] = {"step": STEP, **ALIKE}
        scene = make_sample(tables, ellipse(8), {"source": ellipse(8).astype(float)}, device=device).scene
        opening, steps = Opening(scene), FluidSteps.of(scene)
        changed = [index for index in range(20) if opening.update(steps.interval(index)) and index > 0]
        assert list(opening.changes()) == changed


def run_both(scene, leaf, device, monkeypatch) -> tuple[Simulation, list, Simulation, list]:
    """A simulation, and the same of which neither water nor shape ever rests, with their frames."""
    resting = Simulation(scene, leaf, device)
    frames = list(resting.frames())
    with monkeypatch.context() as patch:
        patch.setattr(Fluid, "_try_rest", lambda fluid, frame, passed: None)
        patch.setattr(ShapeRest, "look", lambda shape, frame, points: False)
        awake = Simulation(scene, leaf, device)
        if isinstance(awake.motion, Quasistatic):
            patch.setattr(awake.motion, "_leave_path", awake.motion._go_off)
        awake_frames = list(awake.frames())
    return resting, frames, awake, awake_frames


def test_a_leaf_that_dries_out_rests_until_it_is_watered(small_scene, scene_leaf, device, monkeypatch) -> None:
    changes = {
        "time.duration": 40.0 * 3600,
        "time.frames": 60,
        "fluid.step": 600.0,
        "transpiration.rate": 1e-4,
        "transpiration.cuticle_rate": 1e-4,
        "source.cut_at": 1800.0,
        "source.rewatered_at": 30.0 * 3600,
        "motion.method": "quasistatic",
        "mesh.vertices": 40,
        "structure.stiffness": [[0.0, 1.0], [1.0, 1.0]],
    }
    scene = load_scene(small_scene).with_changes(changes)
    resting, frames, awake, expected = run_both(scene, scene_leaf(scene), device, monkeypatch)
    for frame, other in zip(frames, expected, strict=True):
        for quantity in ("points", "normals", "velocities", "water", "color"):
            assert getattr(frame, quantity).tobytes() == getattr(other, quantity).tobytes(), (frame.index, quantity)
    assert resting.fluid.steps_skipped > 120 and awake.fluid.steps_skipped == 0
    assert sum(count == 0 for count in resting.substeps) > 30
    assert frames[-1].water.max() > 0.05 and frames[40].water.max() == 0.0
    for simulation in (resting, awake):
        assert abs(simulation.fluid.ledger().error) < 1e-12


STILL = """
[leaf]
image = "drawn.png"
length = "8 cm"
camber = 0.02
[mesh]
vertices = 60
[time]
duration = "6 h"
frames = 280
[water]
curve = [["0 h", 1.0], ["1 h", 0.8], ["5 h", 0.8], ["6 h", 0.7]]
[shrink]
curve = [[1.0, 0.0], [0.2, 0.15]]
[curl]
mismatch = [[1.0, 0.0], [0.2, 0.01]]
[structure]
membrane_stiffness = 10.0
bending_stiffness = 1e-4
dry_mass = 0.05
water_mass = 0.05
[motion]
gravity = [0.0, 0.0, -0.1]
drag = 8.0
clamp = true
settle = true
[output]
contact_sheet = false
"""


@pytest.fixture(scope="module")
def still_scene(photo: Path):
    """A scene whose water stands still for a time."""
    path = photo.with_name("stands.toml")
    path.write_text(STILL)
    return load_scene(path)


@pytest.mark.parametrize("changes", [{"solver.precision": "float32"}, {"solver.precision": "float64"},
                                     {"motion.method": "implicit", "motion.settle": False}])  # fmt: skip
def test_a_shape_at_rest_stays_within_the_tolerance(changes, still_scene, scene_leaf, device, monkeypatch) -> None:
    scene = still_scene.with_changes(changes)
    leaf = scene_leaf(scene)
    resting, frames, awake, expected = run_both(scene, leaf, device, monkeypatch)
    at_rest = [index for index, count in enumerate(resting.substeps) if count == 0]
    assert len(at_rest) > 40 and 0 not in awake.substeps
    # The water has stood still before, and moves on at the end.
    assert min(at_rest) > 48 and max(at_rest) < 240
    off = [np.linalg.norm(a.points - b.points, axis=1).max() for a, b in zip(frames, expected, strict=True)]
    assert max(off) < rest.TOLERANCE * leaf.length
    assert all(not frames[index + 1].velocities.any() for index in at_rest)
    assert np.abs(frames[-1].points - frames[230].points).max() > 1e-3 * leaf.length


def test_a_slow_creep_or_swing_is_no_rest(still_scene, scene_leaf) -> None:
    leaf = scene_leaf(still_scene)
    start = leaf.mesh.positions.astype(np.float32)
    fps, frames = still_scene.time.fps, still_scene.time.frames
    calm = round(rest.CALM * fps)

    def rests_at(path) -> int | None:
        shape = ShapeRest(still_scene, leaf)
        for frame in range(1, frames + 1):
            for _ in range(2):  # a frame that is read twice is one frame
                shape.look(frame, start + np.float32(leaf.length * path(frame / fps)))
            if shape.is_resting:
                return frame
        return None

    assert rests_at(lambda time: 0.0) == calm + 1
    # A creep that would go further than the tolerance until the end; and one that would not.
    assert rests_at(lambda time: 3e-6 * time) is None or rests_at(lambda time: 3e-6 * time) > frames - 4 * calm
    assert rests_at(lambda time: 1e-7 * time) == calm + 1
    # A swing of a thousandth of the length, of a period far longer than the look at it.
    assert rests_at(lambda time: 1e-3 * np.cos(time)) is None
    assert rests_at(lambda time: 1e-4 * np.exp(-time)) is not None


def test_the_report_says_what_was_skipped(small_scene, prepared_folder, device) -> None:
    changes = ["fluid.step=600", "transpiration.rate=1e-3", "transpiration.cuticle_rate=1e-3", "time.frames=12",
               "mesh.vertices=40"]  # fmt: skip
    arguments = [word for change in changes for word in ("--set", change)]
    assert main(["run", str(small_scene), "-q", "--device", device, "-o", str(prepared_folder), *arguments]) == 0
    report = json.loads((prepared_folder / "small.report.json").read_text())
    assert 0 < report["fluid"]["steps_skipped"] < report["fluid"]["steps"] == 48
    assert report["motion"]["frames_at_rest"] == 0
