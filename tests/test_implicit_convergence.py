"""What implicit motion leaves of the forces, by formulas in NumPy; and that what it refuses leaves no trace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.scene.file import load_scene
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit import motion as implicit_motion
from leafwarp.sim.motion import make_motion
from leafwarp.sim.simulation import Simulation
from meshes import scene_of, strip
from structure_reference import hinge_gradient, rig_of, spring_gradient

SCENES = Path(__file__).parent.parent / "scenes"
FPS = 24
GRAVITY = 9.81
# Largest force left on a vertex, over the mean weight of one. A step is found when a thousandth of load, inertia and a
# hundredth of bending is left, which together are at most some weights here; an equilibrium ten times better.
LEFT = {"implicit": 5e-3, "quasistatic": 5e-4}
STIFFNESS = [1e3, 1e4, 1e5]


def real(membrane, **structure):
    """A leaf of 0.2 mm with the membrane stiffness E h, without damping."""
    return {"membrane_stiffness": membrane, "bending_stiffness": membrane * 2e-4**2 / 12.0, "damping": 0.0} | structure


def moving(method, structure, motion, leaf, device):
    rig = rig_of(scene_of(structure, {"method": method} | motion), leaf, device, "float64")
    return rig, make_motion(rig.scene, leaf, rig.state, rig.stages)


def left_over(state, mesh, scene, velocity):
    """Largest force on a vertex that is left, over the mean weight: of backward Euler, or of rest.

    Args:
        state: The state after the step.
        mesh: The mesh.
        scene: The scene, without wind and damping.
        velocity: Velocities before the step [m/s]; None: of rest.
    """

    def get(name):
        return state[name].numpy()

    mass, position = get("mass")[:, None], get("position")
    total = spring_gradient(position, mesh.edges, get("edge_stiffness"), get("edge_rest_length"))
    total += hinge_gradient(position, mesh.hinges, get("hinge_stiffness"), get("hinge_rest_angle"))
    total -= mass * np.array(scene.motion.gravity)
    if velocity is not None:
        now = get("velocity")
        total += mass * ((now - velocity) * FPS + scene.motion.drag * now)
    return np.linalg.norm(total[~get("pinned")], axis=1).max() / (GRAVITY * mass.mean())


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("membrane", STIFFNESS)
def test_the_forces_on_a_strip_balance(device, method, membrane):
    leaf = strip(columns=14, jitter=0.1)
    load = {"gravity": [0.0, 0.0, -GRAVITY], "drag": 2.0, "clamp": True}
    rig, motion = moving(method, real(membrane), load, leaf, device)
    for frame in range(1, 7):
        before = rig.get("velocity")
        motion.advance(1.0 / FPS, frame)
        left = left_over(rig.state, leaf.mesh, rig.scene, before if method == "implicit" else None)
        assert left < LEFT[method]
    assert motion.retries == 0


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("membrane", STIFFNESS)
def test_the_forces_on_a_real_leaf_balance(device, method, membrane, scene_leaf):
    """The bramble with veins, of 500 vertices, with a real leaf's stiffness and weight, while it dries and curls."""
    structure = {f"structure.{name}": value for name, value in real(membrane).items()}
    scene = load_scene(SCENES / "bramble.toml").with_changes(
        structure
        | {
            "mesh.vertices": 500,
            "maps.size": [64, 64],
            "fluid.step": 600.0,
            "motion.method": method,
            "motion.gravity": [0.0, 0.0, -GRAVITY],
            "motion.clamp": True,
            "solver.precision": "float64",
        }
    )
    leaf = scene_leaf(scene)
    simulation = Simulation(scene, leaf, device)
    state = simulation.state
    simulation.settle()
    for frame in range(2, 8):
        before = state["velocity"].numpy().copy()
        simulation.advance(frame)
        left = left_over(state, leaf.mesh, scene, before if method == "implicit" else None)
        assert left < LEFT[method]
        assert np.isfinite(state["position"].numpy()).all()
    assert simulation.motion.retries == 0 and simulation.substeps == [1] * 6
    assert state["position"].numpy()[:, 2].min() < -0.01 * leaf.length


@pytest.mark.parametrize("membrane", STIFFNESS)
def test_the_forces_of_a_curl_without_any_load_balance(device, membrane):
    """There is no weight to judge by: what is left is compared with the forces of bending."""
    leaf = strip(columns=10, jitter=0.2)
    rig, motion = moving("quasistatic", real(membrane), {"clamp": True}, leaf, device)
    mesh = leaf.mesh
    rig.put(hinge_rest_angle=0.05 + 0.05 * np.random.default_rng(2).normal(size=mesh.hinge_count))
    motion.advance(1.0 / FPS, 1)
    position = rig.get("position")
    bending = hinge_gradient(position, mesh.hinges, rig.get("hinge_stiffness"), rig.get("hinge_rest_angle"))
    total = bending + spring_gradient(position, mesh.edges, rig.get("edge_stiffness"), rig.get("edge_rest_length"))
    free = ~rig.get("pinned")
    size = np.linalg.norm(bending[free], axis=1).mean()
    assert size > 0.0 and np.ptp(position[:, 2]) > 0.05 * leaf.length
    assert np.linalg.norm(total[free], axis=1).max() < 1e-5 * size


def shape(rig):
    return b"".join(rig.get(name).tobytes() for name in ("position", "velocity", "hinge_angle", "edge_tension"))


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_a_refused_frame_leaves_no_trace(device, method, monkeypatch):
    """The frame after it has the bits that it would have had without."""
    results = []
    for refused in (False, True):
        rig, motion = moving(method, real(1e4), {"gravity": [0.0, 0.0, -GRAVITY]}, strip(columns=8), device)
        for frame in range(1, 5):
            rig.put(edge_rest_length=0.99 * rig.get("edge_rest_length"))
            if refused:
                before = shape(rig)
                with monkeypatch.context() as patched:
                    patched.setattr("leafwarp.sim.implicit.newton.MOST_ITERATIONS", 2)
                    patched.setattr("leafwarp.sim.implicit.relaxation.MOST_STEPS", 1)
                    with pytest.raises(SimulationError):
                        motion.advance(1.0 / FPS, frame)
                assert shape(rig) == before
            motion.advance(1.0 / FPS, frame)
        results.append(shape(rig))
    assert results[0] == results[1]


def test_a_step_that_is_retried_leaves_no_trace(device, monkeypatch):
    """Two halves after a whole step that failed late have the bits of two halves at once."""
    results = []
    for late in (False, True):
        rig, motion = moving("implicit", real(1e4), {"gravity": [0.0, 0.0, -GRAVITY]}, strip(columns=8), device)
        motion.advance(1.0 / FPS, 1)
        minimise = motion.newton.minimise

        def stubborn(start, accuracy, rig=rig, late=late, minimise=minimise):
            whole = rig.get("time_step")[0] > 0.75 / FPS
            found = minimise(start, accuracy) if late or not whole else None
            if whole:
                raise NotConverged("too far")
            return found

        monkeypatch.setattr(motion.newton, "minimise", stubborn)
        assert motion.advance(1.0 / FPS, 2) == 2
        results.append(shape(rig))
    assert results[0] == results[1]


def test_a_vertex_that_is_thrown_is_refused(device, monkeypatch):
    monkeypatch.setattr(implicit_motion, "FARTHEST_TRAVEL", 0.01)
    rig, motion = moving("implicit", real(1e4), {"gravity": [0.0, 0.0, -GRAVITY]}, strip(columns=8), device)
    before = rig.get("position")
    with pytest.raises(SimulationError, match=r"a vertex moved .* m, on a leaf of 0.1 m; raise time.fps"):
        motion.advance(1.0 / FPS, 1)
    np.testing.assert_array_equal(rig.get("position"), before)
