"""The potential of implicit motion: gradient and Hessian against differences, its positive part, its factors."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from leafwarp.sim.implicit.factor import Factor
from leafwarp_kernels.hinge_hessian import side_of
from meshes import leaf_of, mesh_of, scene_of, strip
from structure_reference import crumpled, gradient, rig_of

BENDING = {"bending_stiffness": 1e-6, "membrane_stiffness": 5.0}


class Bowl:
    """A potential with springs that are neither at rest nor alike."""

    def __init__(self, leaf, device, seed=0, hinged=True, strength=1.0, fold=1.0):
        structure = BENDING if hinged else {"membrane_stiffness": 5.0}
        rig = rig_of(scene_of(structure, {"method": "implicit"}), leaf, device, "float64")
        random, mesh = np.random.default_rng(seed), leaf.mesh
        self.potential, self.free = rig.stage("implicit_motion").potential, ~rig.get("pinned")
        rig.put(
            edge_target_length=rig.get("edge_rest_length") * random.uniform(0.9, 1.1, mesh.edge_count),
            edge_strength=strength * rig.get("edge_stiffness"),
            inertia=random.uniform(0.0, 1.0, mesh.vertex_count),
            goal=crumpled(leaf, 0.2, seed + 1),
            load=1e-3 * random.normal(size=(mesh.vertex_count, 3)),
        )
        if hinged:
            rig.put(
                hinge_target_angle=fold * random.uniform(-1.0, 1.0, mesh.hinge_count),
                hinge_strength=rig.get("hinge_stiffness"),
            )
        self.rig = rig

    def base(self, positions):
        """Take the Hessian at positions, with the tensions that are there."""
        self.potential.evaluate(positions)
        self.potential.accept()
        self.potential.expect_tensions(np.zeros_like(positions))

    def matrix(self, convex):
        """The Hessian of all vertices, held ones too, from its blocks."""
        pattern, blocks = self.potential.pattern, self.potential.blocks(convex).copy()
        count = self.potential.vertex_count
        full = np.zeros((count, count, 3, 3))
        full[pattern.rows, pattern.columns] = blocks
        full[pattern.columns, pattern.rows] = blocks.transpose(0, 2, 1)
        return full.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count)


def folded(angle):
    """Two triangles of different shape, one foot beyond the edge's end, folded by an angle."""
    leaf = leaf_of(mesh_of([[0, 0], [1e-2, 0], [1.4e-2, 9e-3], [3e-3, -6e-3]], [[0, 1, 2], [1, 0, 3]]))
    positions = np.column_stack((leaf.mesh.positions, np.zeros(4)))
    height = leaf.mesh.positions[2, 1]
    positions[2, 1:] = height * np.cos(angle), height * np.sin(angle)
    return leaf, positions


CASES = {
    "crumpled": lambda: (strip(columns=5, jitter=0.2), crumpled(strip(columns=5, jitter=0.2), 0.3)),
    **{f"folded by {angle}": (lambda angle=angle: folded(angle)) for angle in (-2.8, -1.6, 0.0, 0.4, 2.8)},
}


@pytest.mark.parametrize("hinged", [True, False], ids=["sheet", "membrane"])
@pytest.mark.parametrize("case", CASES)
def test_the_gradient_is_that_of_the_energy(device, case, hinged):
    leaf, positions = CASES[case]()
    bowl = Bowl(leaf, device, hinged=hinged)
    expected = gradient(lambda x: bowl.potential.evaluate(x).energy, positions, 1e-6)
    got = bowl.potential.evaluate(positions).gradient
    assert not got[~bowl.free].any()
    np.testing.assert_allclose(got[bowl.free], expected[bowl.free], rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("hinged", [True, False], ids=["sheet", "membrane"])
@pytest.mark.parametrize("case", CASES)
def test_the_hessian_is_the_derivative_of_the_gradient(device, case, hinged):
    leaf, positions = CASES[case]()
    # Soft edges, so that what the hinges add is not lost beside them.
    bowl = Bowl(leaf, device, hinged=hinged, strength=1e-3)
    direction = np.random.default_rng(3).normal(size=positions.shape) * bowl.free[:, None]
    ends = [bowl.potential.evaluate(positions + sign * 1e-8 * direction).gradient for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / 2e-8
    bowl.base(positions)
    got = bowl.potential.product(direction)
    np.testing.assert_allclose(got, expected, rtol=0, atol=3e-6 * np.abs(expected).max())
    assembled = (bowl.matrix(convex=False) @ direction.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(got[bowl.free], assembled[bowl.free], rtol=0, atol=1e-12 * np.abs(got).max())


@pytest.mark.parametrize("case", CASES)
def test_the_positive_part_is_positive_and_covers_the_whole(device, case):
    leaf, positions = CASES[case]()
    bowl = Bowl(leaf, device, strength=1e-3)
    bowl.rig.put(inertia=np.zeros(len(positions)))
    bowl.base(positions)
    whole, positive = bowl.matrix(convex=False), bowl.matrix(convex=True)
    size = np.abs(np.linalg.eigvalsh(whole)).max()
    assert np.abs(whole - whole.T).max() < 1e-13 * size and np.abs(positive - positive.T).max() < 1e-13 * size
    if case == "crumpled":
        assert np.linalg.eigvalsh(whole)[0] < -1e-4 * size
    assert np.linalg.eigvalsh(positive)[0] > -1e-10 * size
    # What was added for each spring is positive, too.
    assert np.linalg.eigvalsh(positive - whole)[0] > -1e-10 * size


def test_a_hinge_at_rest_and_a_stretched_edge_are_positive_as_they_are(device):
    leaf = strip(columns=4, jitter=0.1)
    bowl = Bowl(leaf, device)
    positions = crumpled(leaf, 0.1)
    bowl.rig.put(edge_target_length=0.5 * bowl.rig.get("edge_rest_length"))
    bowl.potential.evaluate(positions)
    bowl.rig.put(hinge_target_angle=bowl.rig.get("hinge_trial_angle"))
    bowl.base(positions)
    whole, positive = bowl.matrix(convex=False), bowl.matrix(convex=True)
    np.testing.assert_allclose(positive, whole, rtol=0, atol=1e-13 * np.abs(whole).max())


@wp.kernel
def evaluate_side(
    # inputs:
    corners: wp.array[wp.vec3d],
    moment: wp.float64,
    convex: wp.bool,
    # outputs:
    matrix_out: wp.array2d[wp.mat33d],
    foot_out: wp.array[wp.float64],
):
    edge = corners[1] - corners[0]
    opposite = corners[2] - corners[0]
    side = side_of(edge, opposite, wp.cross(edge, opposite), moment, convex)
    matrix_out[0, 0] = side.edge_edge
    matrix_out[0, 1] = side.edge_rise
    matrix_out[1, 0] = wp.transpose(side.edge_rise)
    matrix_out[1, 1] = side.rise_rise
    foot_out[0] = side.foot


@pytest.mark.parametrize("moment", [1.0, -0.3])
def test_the_positive_part_of_a_side_is_the_nearest(device, moment):
    corners = 1e-2 * np.random.default_rng(5).normal(size=(3, 3))
    results = []
    for convex in (False, True):
        matrices = wp.zeros((2, 2), dtype=wp.mat33d, device=device)
        foot = wp.zeros(1, dtype=wp.float64, device=device)
        points = wp.array(corners, dtype=wp.vec3d, device=device)
        wp.launch(evaluate_side, 1, inputs=[points, moment, convex], outputs=[matrices, foot], device=device)
        s = float(foot.numpy()[0])
        # What u_e and u_q are of the three corners.
        forms = np.kron([[-1.0, 1.0, 0.0], [s - 1.0, -s, 1.0]], np.eye(3))
        results.append(forms.T @ matrices.numpy().transpose(0, 2, 1, 3).reshape(6, 6) @ forms)
    whole, positive = results
    values, vectors = np.linalg.eigh(whole)
    # Out of the plane against in it: the eigenvalues come in pairs.
    np.testing.assert_allclose(values, -values[::-1], rtol=0, atol=1e-12 * values[-1])
    nearest = vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T
    np.testing.assert_allclose(positive, nearest, rtol=0, atol=1e-12 * values[-1])


def test_the_hinges_do_not_see_a_motion_as_a_whole(device):
    leaf, positions = folded(1.1)
    bowl = Bowl(leaf, device)
    bowl.rig.put(edge_strength=np.zeros(leaf.mesh.edge_count), inertia=np.zeros(4), pinned=np.zeros(4, bool))
    bowl.base(positions)
    matrix = bowl.matrix(convex=False)
    shift = np.tile(np.eye(3), (4, 1))
    assert np.abs(matrix @ shift).max() < 1e-12 * np.abs(matrix).max()


def test_expected_tensions_take_their_place_in_the_hessian(device):
    leaf = strip(columns=4)
    bowl = Bowl(leaf, device, hinged=False)
    positions = crumpled(leaf, 0.1)
    step = 1e-4 * np.random.default_rng(1).normal(size=positions.shape)
    bowl.base(positions)
    bowl.potential.expect_tensions(step)
    ends = positions[leaf.mesh.edges]
    along = ends[:, 0] - ends[:, 1]
    length = np.linalg.norm(along, axis=1)
    apart = step[leaf.mesh.edges[:, 0]] - step[leaf.mesh.edges[:, 1]]
    stretch = length + np.einsum("ij,ij->i", along, apart) / length - bowl.rig.get("edge_target_length")
    expected = bowl.rig.get("edge_strength") * stretch
    np.testing.assert_allclose(bowl.rig.get("edge_tension"), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("largest_band", [10**9, 0], ids=["banded", "SuperLU"])
def test_a_factor_solves_and_tells_what_is_not_positive(device, largest_band):
    leaf = strip(columns=6, jitter=0.2)
    bowl = Bowl(leaf, device)
    bowl.base(crumpled(leaf, 0.2))
    free = np.flatnonzero(bowl.free)
    factor = Factor(bowl.potential.pattern, free, leaf.mesh.vertex_count, largest_band)
    assert factor.factorise(bowl.potential.blocks(convex=True).copy())
    right = np.random.default_rng(0).normal(size=(leaf.mesh.vertex_count, 3))
    solved = factor.solve(right)
    assert not solved[~bowl.free].any() and factor.byte_count > 0
    loose = np.repeat(bowl.free, 3)
    matrix = bowl.matrix(convex=True)[np.ix_(loose, loose)]
    np.testing.assert_allclose(matrix @ solved.ravel()[loose], right.ravel()[loose], rtol=0, atol=1e-9)
    assert np.linalg.eigvalsh(bowl.matrix(convex=False)[np.ix_(loose, loose)])[0] < 0.0
    assert not factor.factorise(bowl.potential.blocks(convex=False).copy())
