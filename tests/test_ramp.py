"""The way of the structure's parameters from one coupling to the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.blocks import BLOCK, blocks, shares
from leafwarp.sim.simulation import Simulation
from meshes import scene_of, strip
from structure_reference import ROUNDING, rig_of

STILL = Path(__file__).parent.parent / "scenes" / "still.toml"


@pytest.mark.parametrize("count", [1, 7, 8, 32, 33, 100, 257])
def test_blocks_and_their_shares_make_up_all_substeps(count: int) -> None:
    assert sum(blocks(count)) == count and set(blocks(count)) <= {2**power for power in range(6)}
    for size in blocks(count):
        done = 0.0
        for substeps, middle in shares(size):
            assert middle == done + 0.5 * substeps
            done += substeps
        assert done == size


def test_parameters_go_straight_from_one_coupling_to_the_next(device, precision) -> None:
    tables = {"shrink": {"curve": [[1.0, 0.0], [0.2, 0.1]]}, "curl": {"mismatch": [[1.0, 0.0], [0.2, 0.01]]}}
    structure = {"bending_stiffness": 1e-6, "stiffness": [[1.0, 1.0], [0.2, 3.0]]}
    rig = rig_of(scene_of(structure, **tables), strip(columns=6), device, precision)
    names = ("edge_rest_length", "hinge_rest_angle", "edge_stiffness", "hinge_stiffness", "mass")
    random = np.random.default_rng(0)
    before, after = ({name: random.uniform(1.0, 2.0, rig.state[name].shape) for name in names} for _ in range(2))
    ramp, substeps = rig.stage("ramp"), 2 * BLOCK + 8 + 2
    rig.put(**before)
    ramp.remember()
    rig.put(**after)
    ramp.aim()
    ramp.begin(substeps)
    passed = 0.0
    for size in blocks(substeps):
        for _, middle in shares(size):
            ramp.ramp_to(middle).run()
            share = (passed + middle) / substeps
            for name in names:
                expected = (1.0 - share) * before[name] + share * after[name]
                np.testing.assert_allclose(rig.get(name), expected, rtol=20 * ROUNDING[precision])
        ramp.passing(size).run()
        passed += size
    ramp.end()
    for name in names:
        kind = rig.state[name].numpy().dtype
        assert rig.get(name).tobytes() == after[name].astype(kind).astype(rig.get(name).dtype).tobytes()


@pytest.mark.parametrize("fps", [24.0, 60.0])
def test_a_leaf_without_air_shrinks_as_it_should_at_any_frame_rate(fps: float, scene_leaf, device) -> None:
    """Alike everywhere: a jump of the rest lengths a frame made it ring by a third of a per cent, near its own tone."""
    scene = load_scene(STILL).with_changes(
        {"mesh.vertices": 150, "time.fps": fps, "time.frames": round(2 * fps), "output.contact_sheet": False}
    )
    leaf = scene_leaf(scene)
    simulation = Simulation(scene, leaf, device)
    flat = leaf.mesh.positions - leaf.mesh.positions.mean(axis=0)
    for frame in simulation.frames():
        points = frame.points[:, :2] - frame.points[:, :2].mean(axis=0)
        # Breathing alone, whatever way the leaf has turned about its stalk.
        scale = np.linalg.svd(flat.T @ points, compute_uv=False).sum() / np.square(flat).sum()
        assert scale == pytest.approx(1.0 - _shrunk(scene, frame.plant_time), abs=5e-4), frame.index


def _shrunk(scene: Scene, plant_time: float) -> float:
    water = np.interp(plant_time, *np.transpose(scene.water.curve))
    return float(np.interp(water, *np.transpose(sorted(scene.shrink.curve))))


def test_frames_end_with_what_the_coupling_made(small_scene: Path, scene_leaf, device) -> None:
    """To the bit, whatever the substeps."""
    scene = load_scene(small_scene)
    simulation = Simulation(scene, scene_leaf(scene), device)
    for index in (2, 3):
        simulation.advance(index)
        reached = {name: simulation.state[name].numpy().copy() for name in ("edge_rest_length", "mass")}
        for stage in simulation.plan.groups["coupling"]:
            if stage.rate == "frame" and stage.name in ("rest_lengths", "mass"):
                stage.run()
        for name, values in reached.items():
            assert simulation.state[name].numpy().tobytes() == values.tobytes(), name


def test_a_frame_is_redone_from_its_own_beginning(device, precision) -> None:
    """A span begun with too few substeps and then redone ends as one begun with as many."""
    results = []
    for begun in (1, 8):
        rig = rig_of(
            scene_of({"membrane_stiffness": 5.0}, shrink={"curve": [[1.0, 0.0], [0.2, 0.1]]}),
            strip(columns=6),
            device,
            precision,
        )
        motion = rig.motion()
        rig.put(edge_rest_length=0.95 * rig.get("edge_rest_length"))
        rig.stage("ramp").aim()
        used = motion._advance_checked(0.01, begun, 64, 1, motion._stages, motion._following)
        assert used == 8 and motion.retries == (3 if begun == 1 else 0)
        results.append(rig.state["position"].numpy().tobytes())
    assert results[0] == results[1]
