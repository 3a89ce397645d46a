"""How a shrinking leaf is held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from meshes import scene_of, strip
from structure_reference import ROUNDING, rig_of

STILL = Path(__file__).parent.parent / "scenes" / "still.toml"
SHRINK = {"curve": [[1.0, 0.0], [0.2, 0.1]]}


def test_held_tissue_shrinks_as_the_springs_around_it(device, precision) -> None:
    rig = rig_of(scene_of(motion={"clamp": True}, shrink=SHRINK), strip(columns=8, jitter=0.2), device, precision)
    start, pinned, edges = rig.get("position"), rig.get("pinned"), rig.leaf.mesh.edges
    rig.stage("hold").run()
    assert rig.get("position").tobytes() == start.tobytes()
    shares = np.random.default_rng(0).uniform(0.7, 1.0, len(edges))
    rig.put(edge_rest_length=shares * rig.get("edge_rest_length"))
    rig.stage("hold").run()
    scale = shares[pinned[edges].any(axis=1)].mean()
    np.testing.assert_allclose(rig.get("position")[pinned], scale * start[pinned], rtol=20 * ROUNDING[precision])
    assert (rig.get("position")[~pinned] == start[~pinned]).all()


def test_a_vertex_that_was_let_go_is_left_alone(device, precision) -> None:
    rig = rig_of(scene_of(motion={"clamp": True}, shrink=SHRINK), strip(columns=8), device, precision)
    start = rig.get("position")
    rig.put(pinned=np.zeros(len(start), bool), edge_rest_length=0.9 * rig.get("edge_rest_length"))
    rig.stage("hold").run()
    assert (rig.get("position") == start).all()


@pytest.mark.parametrize("method", ["explicit", "implicit", "quasistatic"])
def test_held_vertices_have_the_velocity_that_they_move_by(method: str, scene_leaf, device) -> None:
    """And are where the springs around them want them."""
    scene = load_scene(STILL).with_changes({"motion.method": method, "motion.clamp": True, "time.frames": 12})
    leaf = scene_leaf(scene)
    simulation = Simulation(scene, leaf, device)
    start, lengths = (simulation.state[name].numpy().astype(float) for name in ("position", "edge_rest_length"))
    pinned = simulation.state["pinned"].numpy()
    touching = pinned[leaf.mesh.edges].any(axis=1)
    before = start
    for frame in simulation.frames():
        scale = (simulation.state["edge_rest_length"].numpy() / lengths)[touching].mean()
        np.testing.assert_allclose(frame.points[pinned], scale * start[pinned], atol=1e-6 * leaf.length)
        if frame.index > 4:  # water falls as steeply from there on
            moved = (frame.points - before)[pinned] * scene.time.fps
            np.testing.assert_allclose(frame.velocities[pinned], moved, atol=1e-5)
        before = frame.points
    assert scale < 0.9 and np.abs(moved).max() > 1e-4
    # Equilibria bring velocities of their own.
    assert ("held_duration" in simulation.state) == (method != "quasistatic")


@pytest.mark.parametrize("method", ["explicit", "implicit", "quasistatic"])
def test_a_leaf_that_shrinks_alike_everywhere_neither_turns_nor_strains(method: str, scene_leaf, device) -> None:
    """Held at three vertices that stayed apart, it turned by 2.4 degrees."""
    scene = load_scene(STILL).with_changes(
        {"motion.method": method, "motion.clamp": True, "time.frames": 13, "time.fps": 6.0}
    )
    leaf = scene_leaf(scene)
    simulation = Simulation(scene, leaf, device)
    frames = list(simulation.frames())
    assert simulation.state["pinned"].numpy().sum() > 3
    # Least water: 0.2, at which it has shrunk by 15 %.
    assert np.abs(frames[-1].points - 0.85 * frames[0].points).max() < 1e-3 * leaf.length


def test_every_leaf_of_many_is_held_by_its_own(small_scene: Path, scene_leaf, device) -> None:
    """Where only one of them shrinks, only that one's held vertices move."""
    scene = load_scene(small_scene).with_changes({"leaves.count": 3, "motion.clamp": True})
    leaf = scene_leaf(scene)
    simulation = Simulation(scene, leaf, device)
    state, own = simulation.state, leaf.vertex_slices[1]
    start, lengths = state["position"].numpy().copy(), state["edge_rest_length"].numpy().copy()
    of_second = (leaf.mesh.edges[:, 0] >= own.start) & (leaf.mesh.edges[:, 0] < own.stop)
    lengths[of_second] *= 0.5
    state.upload("edge_rest_length", lengths)
    simulation.stage("hold").run()
    moved, pinned = state["position"].numpy(), state["pinned"].numpy()
    second = np.zeros(len(start), bool)
    second[own] = True
    assert (moved[~(pinned & second)] == start[~(pinned & second)]).all()
    np.testing.assert_allclose(moved[pinned & second], 0.5 * start[pinned & second], rtol=1e-5)
