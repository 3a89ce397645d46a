"""Damping and outside forces against NumPy; the springs' own forces are cases of ``leafwarp verify``."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import scene_of, strip, two_triangles
from structure_reference import ROUNDING, angle_of, crumpled, gradient, rig_of

BENDING = {"bending_stiffness": 1e-6, "damping": 0.1}


def shaken(device, precision, structure=BENDING, amount=0.25, leaf=None, **tables):
    """A rig with a crumpled leaf; the positions are those that the precision can hold."""
    rig = rig_of(scene_of(structure, **tables), leaf or strip(columns=6, jitter=0.15), device, precision)
    rig.put(position=crumpled(rig.leaf, amount))
    rig.put(velocity=np.random.default_rng(1).normal(size=(rig.leaf.mesh.vertex_count, 3)))
    return rig, rig.get("position")


def assert_close(actual, expected, precision, factor=1.0):
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=factor * ROUNDING[precision] * np.abs(expected).max())


def test_damping_forces_follow_the_rates_of_lengths_and_angles(device, precision):
    rig, positions = shaken(device, precision, amount=0.2)
    speed, mesh, tau = rig.get("velocity"), rig.leaf.mesh, 3e-3
    still = {name: rig.forces(name) for name in ("edge_springs", "angular_springs")}
    rig.put(damping_time=[tau])
    tau = float(rig.get("damping_time")[0])
    along = positions[mesh.edges[:, 0]] - positions[mesh.edges[:, 1]]
    unit = along / np.linalg.norm(along, axis=1)[:, None]
    rate = np.einsum("ij,ij->i", speed[mesh.edges[:, 0]] - speed[mesh.edges[:, 1]], unit)
    push = -(tau * rig.get("edge_stiffness") * rate)[:, None] * unit
    expected = np.zeros_like(positions)
    np.add.at(expected, mesh.edges[:, 0], push)
    np.add.at(expected, mesh.edges[:, 1], -push)
    assert_close(rig.forces("edge_springs") - still["edge_springs"], expected, precision)

    # The moment of a hinge acts along the gradient of its angle.
    stiffness = rig.get("hinge_stiffness")
    angle_gradients = np.array(
        [gradient(lambda x, hinge=hinge: angle_of(*x[hinge]), positions, 2e-6) for hinge in mesh.hinges]
    )
    rates = np.einsum("hij,ij->h", angle_gradients, speed)
    expected = -np.einsum("h,hij->ij", tau * stiffness * rates, angle_gradients)
    assert_close(
        rig.forces("angular_springs") - still["angular_springs"],
        expected,
        precision,
        factor=1000 if precision == "float64" else 1,
    )


@pytest.mark.parametrize("name", ["edge_springs", "angular_springs"])
def test_damping_takes_energy_out(device, precision, name):
    rig, _ = shaken(device, precision)
    without = rig.forces(name)
    rig.put(damping_time=[1e-2])
    power = np.sum((rig.forces(name) - without) * rig.get("velocity"))
    assert power < -1e-3 * np.abs(rig.get("velocity")).max() * np.abs(without).max() * 1e-2


def test_gravity_and_air_are_their_formulas(device, precision):
    motion = {"gravity": [0.3, -1.0, -9.0], "drag": 4.0, "wind": [2.0, 0.5, -1.0]}
    rig, _ = shaken(device, precision, motion=motion)
    mass = rig.get("mass")[:, None]
    assert_close(rig.forces("gravity"), mass * np.array(motion["gravity"]), precision)
    assert_close(rig.forces("air"), -4.0 * mass * (rig.get("velocity") - np.array(motion["wind"])), precision)


def test_edge_springs_overwrite_and_the_others_add(device, precision):
    motion = {"gravity": [0.0, 0.0, -9.81], "drag": 4.0}
    rig, _ = shaken(device, precision, motion=motion)
    names = ["edge_springs", "angular_springs", "gravity", "air"]
    parts = sum(rig.forces(name) for name in names)
    rig.put(force=np.full((rig.leaf.mesh.vertex_count, 3), 1e9))
    for name in names:
        rig.stage(name).run()
    assert_close(rig.get("force"), parts, precision)


def test_sums_are_the_same_bits_in_every_run(device, precision):
    first, _ = shaken(device, precision)
    second, _ = shaken(device, precision)
    a, b = (rig.forces("edge_springs", "angular_springs").tobytes() for rig in (first, second))
    assert a == b == first.forces("edge_springs", "angular_springs").tobytes()


def test_stages_follow_the_scene(device, precision):
    def names(structure=None, motion=None, leaf=None):
        rig = rig_of(scene_of(structure, motion), leaf or two_triangles(), device, precision)
        return [stage.name for stage in rig.stages], set(rig.state.names)

    plain, arrays = names({"water_mass": 0.0})
    assert plain == ["stable_step", "edge_springs", "integration"]
    assert not any(name.startswith("ramp") or name.endswith(("_before", "_after")) for name in arrays)
    lighter, arrays = names()
    assert lighter == ["stable_step", "ramp", "edge_springs", "integration"]
    assert {name for name in arrays if name.endswith("_before")} == {"mass_before"}
    assert not any(name.startswith(("hinge", "vertex_hinge", "saved_hinge")) for name in arrays)
    full, _ = names(BENDING, {"gravity": [0, 0, -9.81], "drag": 2.0})
    assert full == ["stable_step", "ramp", "edge_springs", "angular_springs", "gravity", "air", "integration"]
    assert "paper_bending" in names(BENDING | {"bending": "paper"})[0]
