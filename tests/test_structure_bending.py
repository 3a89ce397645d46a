"""The dihedral angle and the two kinds of bending."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.sim import material
from meshes import scene_of, strip, two_triangles
from structure_reference import ROUNDING, angle_of, crumpled, rig_of, total_torque

STRUCTURE = {"bending_stiffness": 1e-6, "damping": 0.0}


def folded(leaf, angle: float) -> np.ndarray:
    """The two triangles of ``two_triangles``, each turned up by half the angle about their edge."""
    positions = np.column_stack((leaf.mesh.positions, np.zeros(4)))
    for vertex in (2, 3):
        y = leaf.mesh.positions[vertex, 1]
        positions[vertex, 1:] = y * np.cos(angle / 2), abs(y) * np.sin(angle / 2)
    return positions


def printed_angle(a, b, c, d) -> float:
    """The angle of the paper's Alg. 2 as printed: arccos of the normals, plus pi on the far side."""
    first, second = np.cross(b - a, c - a), np.cross(d - a, b - a)
    cosine = np.dot(first, second) / (np.linalg.norm(first) * np.linalg.norm(second))
    # Between the triangles' sides, pi where flat.
    theta = np.pi - np.arccos(np.clip(cosine, -1.0, 1.0))
    return theta if np.dot(first, d - a) >= 0.0 else theta + np.pi


def completed_angle(a, b, c, d) -> float:
    """The same with the continuous completion 2 pi - theta."""
    theta = printed_angle(a, b, c, d)
    return theta if theta <= np.pi and np.dot(np.cross(b - a, c - a), d - a) >= 0.0 else 2 * np.pi - (theta - np.pi)


def measured(rig, positions) -> float:
    rig.put(position=positions, hinge_angle=[0.0])
    rig.stage("angular_springs").run()
    return float(rig.get("hinge_angle")[0])


def test_the_angle_is_signed_toward_the_photographed_side(device, precision):
    leaf = two_triangles()
    rig = rig_of(scene_of(STRUCTURE), leaf, device, precision)
    for angle in np.linspace(-3.14, 3.14, 41):
        positions = folded(leaf, angle)
        assert angle_of(*positions[leaf.mesh.hinges[0]]) == pytest.approx(angle, abs=1e-12)
        assert material.dihedral_angles(leaf.mesh, positions)[0] == pytest.approx(angle, abs=1e-12)
        assert measured(rig, positions) == pytest.approx(angle, abs=10 * ROUNDING[precision] * 1e-2)


def test_the_printed_angle_jumps_at_the_flat_state_and_its_completion_does_not():
    leaf = two_triangles()
    hinge = leaf.mesh.hinges[0]
    near, far = (folded(leaf, angle)[hinge] for angle in (1e-6, -1e-6))
    assert printed_angle(*far) - printed_angle(*near) == pytest.approx(np.pi, abs=1e-5)
    assert completed_angle(*far) - completed_angle(*near) == pytest.approx(0.0, abs=1e-5)
    for angle in (-2.5, -1.0, -0.1, 0.1, 1.0, 2.5):
        assert completed_angle(*folded(leaf, angle)[hinge]) == pytest.approx(np.pi - angle, abs=1e-9)


def test_a_fold_that_passes_half_a_turn_is_pulled_back_the_way_it_came(device, precision):
    leaf = two_triangles()
    rig = rig_of(scene_of(STRUCTURE), leaf, device, precision)
    pushes = []
    for angle in (3.0, 3.1, 3.2, 3.3):
        rig.put(position=folded(leaf, angle), force=np.zeros((4, 3)))
        rig.stage("angular_springs").run()
        assert rig.get("hinge_angle")[0] == pytest.approx(angle, abs=1e-4)
        positions = rig.get("position")
        lift = np.cross([1.0, 0.0, 0.0], positions[2] - positions[0])
        pushes.append(np.dot(rig.get("force")[leaf.mesh.hinges[0, 2]], lift / np.linalg.norm(lift)))
    # Toward opening the fold, growing smoothly with it.
    assert np.all(np.diff(np.abs(pushes)) > 0) and np.all(np.sign(pushes) == np.sign(pushes[0]))
    assert np.ptp(pushes) < 0.15 * abs(pushes[0])


def test_positive_rest_angles_lift_the_opposite_vertices(device, precision):
    rig = rig_of(scene_of(STRUCTURE), two_triangles(), device, precision)
    rig.put(hinge_rest_angle=[0.1])
    forces = rig.forces("angular_springs")
    assert np.all(forces[2:, 2] > 0.0) and np.all(forces[:2, 2] < 0.0)


def test_a_triangle_that_collapses_is_let_go_gently(device, precision):
    """As the height of a triangle goes to nothing so does the force, instead of growing like its inverse."""
    leaf, edge = two_triangles(), 1e-2
    rig = rig_of(scene_of(STRUCTURE), leaf, device, precision)
    rig.put(hinge_rest_angle=[0.2])
    moment = 0.2 * rig.get("hinge_stiffness")[0]
    lifts = {}
    for share in (0.8, 0.2, 0.11, 0.1, 0.05, 0.01, 1e-4):
        positions = folded(leaf, 0.0)
        positions[2, 1] = share * edge
        rig.put(position=positions, hinge_angle=[0.0])
        forces = rig.forces("angular_springs")
        largest = np.abs(forces).max()
        assert np.abs(forces.sum(axis=0)).max() < 10 * ROUNDING[precision] * largest
        assert np.abs(total_torque(positions, forces)).max() < 10 * ROUNDING[precision] * largest * edge
        lifts[share] = forces[2, 2]
    whole = {share: moment / (share * edge) for share in lifts}
    for share in (0.8, 0.2, 0.11):
        assert lifts[share] == pytest.approx(whole[share], rel=1e-4)
    for share in (0.1, 0.05, 0.01, 1e-4):
        assert lifts[share] == pytest.approx(whole[0.1] * share / 0.1, rel=1e-4)


def test_the_paper_force_is_along_the_normals_and_conserves_linear_momentum(device, precision):
    leaf = strip(columns=6, jitter=0.15)
    rig = rig_of(scene_of(STRUCTURE | {"bending": "paper"}), leaf, device, precision)
    rig.put(position=crumpled(leaf, 0.3))
    positions, mesh = rig.get("position"), leaf.mesh
    forces = rig.forces("paper_bending")
    expected = np.zeros_like(positions)
    for h, hinge in enumerate(mesh.hinges):
        a, b, c, d = positions[hinge]
        base, along = mesh.positions[hinge[0]], mesh.positions[hinge[1]] - mesh.positions[hinge[0]]
        sides = mesh.positions[hinge[2:]] - base
        arms = np.abs(along[0] * sides[:, 1] - along[1] * sides[:, 0]) / np.linalg.norm(along)
        size = -rig.get("hinge_stiffness")[h] * (angle_of(a, b, c, d) - rig.get("hinge_rest_angle")[h]) / np.mean(arms)
        first, second = np.cross(b - a, c - a), np.cross(d - a, b - a)
        push_c, push_d = size * first / np.linalg.norm(first), size * second / np.linalg.norm(second)
        for vertex, push in zip(hinge, (-(push_c + push_d) / 2, -(push_c + push_d) / 2, push_c, push_d), strict=True):
            expected[vertex] += push
    np.testing.assert_allclose(forces, expected, rtol=0, atol=ROUNDING[precision] * np.abs(expected).max())
    assert np.linalg.norm(forces.sum(axis=0)) < 1e-2 * ROUNDING[precision] * np.abs(forces).sum()


def test_the_paper_force_equals_the_gradient_on_a_symmetric_hinge(device, precision):
    leaf = two_triangles()
    results = []
    for bending in ("gradient", "paper"):
        rig = rig_of(scene_of(STRUCTURE | {"bending": bending}), leaf, device, precision)
        rig.put(position=folded(leaf, 0.7))
        results.append(rig.forces("angular_springs" if bending == "gradient" else "paper_bending"))
    np.testing.assert_allclose(results[1], results[0], rtol=0, atol=ROUNDING[precision] * np.abs(results[0]).max())


def test_the_paper_force_loses_angular_momentum_and_says_how_much(device, precision):
    leaf = strip(columns=6, jitter=0.2)
    shape = crumpled(leaf, 0.3)
    paper = rig_of(scene_of(STRUCTURE | {"bending": "paper"}), leaf, device, precision)
    exact = rig_of(scene_of(STRUCTURE), leaf, device, precision)
    for rig in (paper, exact):
        rig.put(position=shape)
    lost = total_torque(paper.get("position"), paper.forces("paper_bending"))
    kept = total_torque(exact.get("position"), exact.forces("angular_springs"))
    assert np.linalg.norm(lost) > 100 * np.linalg.norm(kept)
    reported = paper.stage("paper_bending").net_torque()
    np.testing.assert_allclose(reported, lost, rtol=0, atol=10 * ROUNDING[precision] * np.linalg.norm(lost))
