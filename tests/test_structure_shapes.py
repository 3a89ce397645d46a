"""Shapes that the structure comes to rest in, and what happens at its extremes."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.sim.material import hinge_span
from meshes import leaf_of, mesh_of, one_triangle, scene_of, strip, two_triangles
from structure_reference import crumpled, rig_of

FRAME = 1.0 / 24.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_strip_curls_to_the_curvature_asked_for(device, precision, sign):
    leaf = strip(length=0.1, width=0.01, columns=20)
    scene = scene_of(
        {"membrane_stiffness": 20.0, "bending_stiffness": 2e-5, "dry_mass": 0.3, "water_mass": 0.0},
        {"clamp": True, "drag": 1.0},
    )
    rig = rig_of(scene, leaf, device, precision)
    motion, kappa = rig.motion(), sign * 10.0
    rig.put(hinge_rest_angle=kappa * hinge_span(leaf.mesh))
    assert motion.settle().settled
    middle = np.flatnonzero(np.abs(leaf.mesh.positions[:, 1]) < 1e-9)
    x, _, z = rig.get("position")[middle[np.argsort(leaf.mesh.positions[middle, 0])]].T
    # Positive curvature bends toward the photographed side.
    assert np.sign(z[-1]) == sign
    slope = np.unwrap(np.arctan2(np.diff(z), np.diff(x)))
    measured = (slope[-2] - slope[3]) / (np.hypot(np.diff(x), np.diff(z))[3:-2].sum())
    # This hinge bends a narrow strip 4 to 6 % more, because its bending Poisson ratio is -1/3.
    assert measured == pytest.approx(1.05 * kappa, rel=0.05)


def test_a_flat_leaf_shrinks_to_the_scaled_shape(device, precision):
    leaf = strip(columns=8, jitter=0.2)
    rig = rig_of(scene_of({"membrane_stiffness": 5.0}, {"pin_radius": 0.0, "drag": 5.0}), leaf, device, precision)
    motion, rest = rig.motion(), rig.get("edge_rest_length")
    # Little by little, as a leaf dries: a sudden pull turns corner triangles over, which costs no energy in
    # the plane.
    for share in np.linspace(0.98, 0.8, 10):
        rig.put(edge_rest_length=share * rest)
        assert motion.settle(tolerance=1e-4).settled
    base = leaf.mesh.positions[np.flatnonzero(rig.get("pinned"))[0]]
    position = rig.get("position")
    np.testing.assert_allclose(position[:, :2], base + 0.8 * (leaf.mesh.positions - base), rtol=0, atol=2e-4 * 0.1)
    assert np.all(position[:, 2] == 0.0)


def finite_or_refused(rig, frames: int = 2) -> bool:
    """Run some frames; whether they were computed. Anything else than a clear refusal is a failure."""
    motion = rig.motion()
    try:
        for frame in range(1, frames + 1):
            motion.advance(FRAME, frame)
    except SimulationError as error:
        assert "motion" in str(error)
        # A refusal leaves the last good frame.
        assert np.isfinite(rig.get("position")).all()
        return False
    assert np.isfinite(rig.get("position")).all() and np.isfinite(rig.get("velocity")).all()
    assert np.abs(rig.get("position")).max() < 10.0
    return True


@pytest.mark.parametrize("bending", ["gradient", "paper"])
@pytest.mark.parametrize("factor", [0.0, 1e-6, 1.0, 1e2, 1e6])
def test_any_stiffness_is_computed_or_refused(device, precision, bending, factor):
    scene = scene_of(
        {"membrane_stiffness": 5.0 * factor, "bending_stiffness": 1e-6 * factor, "bending": bending},
        {"gravity": [0, 0, -9.81], "drag": 2.0},
        solver={"maximum_substeps": 1024},
    )
    rig = rig_of(scene, strip(columns=6, jitter=0.2), device, precision)
    rig.put(position=crumpled(rig.leaf, 0.1))
    # Springs too soft to hold the leaf's own weight let it be torn out, which is refused, too.
    assert finite_or_refused(rig) == (1e-3 < factor < 1e6)


@pytest.mark.parametrize("height", [1e-1, 1e-3, 1e-6, 1e-9])
def test_slivers(device, precision, height):
    mesh = mesh_of([[0, 0], [1e-2, 0], [5e-3, 8e-3], [5e-3, -1e-2 * height]], [[0, 1, 2], [1, 0, 3]])
    scene = scene_of(
        {"bending_stiffness": 1e-7},
        {"gravity": [0, 0, -9.81], "drag": 2.0},
        solver={"maximum_substeps": 1024},
    )
    # A triangle a thousandth as high as it is long still moves; one a millionth as high has no step that is safe.
    assert finite_or_refused(rig_of(scene, leaf_of(mesh), device, precision)) == (height > 1e-5)


@pytest.mark.parametrize("bending", ["gradient", "paper"])
@pytest.mark.parametrize("overshoot", [0.0, 1e-7, -1e-7])
def test_hinges_folded_flat(device, precision, bending, overshoot):
    leaf = two_triangles()
    scene = scene_of({"bending_stiffness": 1e-7, "bending": bending}, {"drag": 2.0}, solver={"maximum_substeps": 1024})
    rig = rig_of(scene, leaf, device, precision)
    folded = np.column_stack((leaf.mesh.positions, np.zeros(4)))
    folded[3] = folded[2] + [0.0, 0.0, overshoot]
    rig.put(position=folded)
    assert finite_or_refused(rig)


@pytest.mark.parametrize("bending", ["gradient", "paper"])
def test_edges_of_no_length_and_triangles_of_no_area(device, precision, bending):
    leaf = strip(columns=4)
    scene = scene_of({"bending_stiffness": 1e-7, "bending": bending}, {"drag": 2.0}, solver={"maximum_substeps": 1024})
    collapsed = np.column_stack((leaf.mesh.positions, np.zeros(leaf.mesh.vertex_count)))
    collapsed[leaf.mesh.edges[5, 0]] = collapsed[leaf.mesh.edges[5, 1]]
    rig = rig_of(scene, leaf, device, precision)
    rig.put(position=collapsed)
    forces = rig.forces("edge_springs", "paper_bending" if bending == "paper" else "angular_springs")
    assert np.isfinite(forces).all()
    finite_or_refused(rig)
    rig.put(position=np.zeros_like(collapsed), velocity=np.zeros_like(collapsed))
    finite_or_refused(rig)


@pytest.mark.parametrize("rest", [3.2, -50.0, 1e6])
def test_rest_angles_past_half_a_turn_close_the_fold_and_no_more(device, precision, rest):
    rig = rig_of(
        scene_of({"bending_stiffness": 1e-7}, {"drag": 20.0}, solver={"maximum_substeps": 2048}),
        two_triangles(),
        device,
        precision,
    )
    rig.put(hinge_rest_angle=[rest])
    if finite_or_refused(rig, frames=12):
        assert abs(rig.get("hinge_angle")[0]) < 2.0 * np.pi


def test_a_single_triangle_swings(device, precision):
    scene = scene_of({"bending_stiffness": 1e-6}, {"gravity": [0, 0, -9.81], "drag": 2.0})
    assert finite_or_refused(rig_of(scene, one_triangle(), device, precision), frames=24)


@pytest.mark.parametrize("wind", [1.0, 100.0, 1e4])
def test_storms(device, precision, wind):
    scene = scene_of(
        {"bending_stiffness": 1e-6},
        {"wind": [wind, 0, wind], "drag": 50.0},
        solver={"maximum_substeps": 1024},
    )
    # A breeze is computed; what tears a membrane of 5 N/m is refused.
    assert finite_or_refused(rig_of(scene, strip(columns=6), device, precision), frames=4) == (wind < 10.0)
