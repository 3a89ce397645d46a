"""The potential of implicit motion: gradient and Hessian against differences, its positive part, its factors."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from leafwarp.sim.implicit.factor import Factor
from leafwarp.sim.implicit.newton import Newton
from leafwarp_kernels.hinge_hessian import side_of
from meshes import leaf_of, mesh_of, scene_of, strip
from structure_reference import angle_of, crumpled, gradient, hinge_angles, hinge_gradient, rig_of, spring_gradient

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

    def expected_energy(self, positions):
        """In NumPy, edge by edge and hinge by hinge."""
        get, mesh = self.rig.get, self.rig.leaf.mesh
        lengths = np.array([np.linalg.norm(positions[i] - positions[j]) for i, j in mesh.edges])
        energy = 0.5 * (get("edge_strength") * (lengths - get("edge_target_length")) ** 2).sum()
        if self.potential.hinged:
            angles = np.array([angle_of(*positions[hinge]) for hinge in mesh.hinges])
            energy += 0.5 * (get("hinge_strength") * (angles - get("hinge_target_angle")) ** 2).sum()
        away = positions - get("goal")
        return energy + 0.5 * (get("inertia") * (away**2).sum(axis=1)).sum() - (get("load") * positions).sum()

    def expected_gradient(self, positions):
        """In NumPy, held vertices included."""
        get, mesh = self.rig.get, self.rig.leaf.mesh
        total = spring_gradient(positions, mesh.edges, get("edge_strength"), get("edge_target_length"))
        if self.potential.hinged:
            total += hinge_gradient(positions, mesh.hinges, get("hinge_strength"), get("hinge_target_angle"))
        return total + get("inertia")[:, None] * (positions - get("goal")) - get("load")

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


# Of sums in another order, over the largest term.
ROUNDING = 1e-13


@pytest.mark.parametrize("hinged", [True, False], ids=["sheet", "membrane"])
@pytest.mark.parametrize("case", CASES)
def test_energy_and_gradient_are_those_of_the_formulas(device, case, hinged):
    leaf, positions = CASES[case]()
    bowl = Bowl(leaf, device, hinged=hinged)
    got = bowl.potential.evaluate(positions)
    assert got.energy == pytest.approx(bowl.expected_energy(positions), rel=ROUNDING)
    expected = bowl.expected_gradient(positions)
    # The formulas themselves, by differences of their energy: the truncated rest of these is below 1e-7.
    differences = gradient(bowl.expected_energy, positions, 1e-6)
    np.testing.assert_allclose(expected, differences, rtol=0, atol=1e-7 * np.abs(expected).max())
    assert not got.gradient[~bowl.free].any()
    size = bowl.rig.get("force_magnitude").max()
    np.testing.assert_allclose(got.gradient[bowl.free], expected[bowl.free], rtol=0, atol=ROUNDING * size)


def test_what_acts_is_load_inertia_and_a_hundredth_of_bending(device):
    leaf, positions = CASES["crumpled"]()
    bowl = Bowl(leaf, device)
    get, mesh = bowl.rig.get, leaf.mesh
    found = bowl.potential.evaluate(positions)
    bending = hinge_gradient(positions, mesh.hinges, get("hinge_strength"), get("hinge_target_angle"))
    inertia = get("inertia")[:, None] * (positions - get("goal"))
    expected = sum(share * np.linalg.norm(f, axis=1) for share, f in ((1, get("load")), (1, inertia), (0.01, bending)))
    assert found.mean_action == pytest.approx(expected.mean(), rel=1e-12)


@pytest.mark.parametrize("hinged", [True, False], ids=["sheet", "membrane"])
@pytest.mark.parametrize("case", CASES)
def test_the_hessian_is_the_derivative_of_the_gradient(device, case, hinged):
    leaf, positions = CASES[case]()
    # Soft edges, so that what the hinges add is not lost beside them.
    bowl = Bowl(leaf, device, hinged=hinged, strength=1e-3)
    direction = np.random.default_rng(3).normal(size=positions.shape) * bowl.free[:, None]
    ends = [bowl.expected_gradient(positions + sign * 1e-8 * direction) for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / 2e-8
    bowl.base(positions)
    got = bowl.potential.product(direction)
    assert not got[~bowl.free].any()
    np.testing.assert_allclose(got[bowl.free], expected[bowl.free], rtol=0, atol=3e-6 * np.abs(expected).max())
    assembled = (bowl.matrix(convex=False) @ direction.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(got[bowl.free], assembled[bowl.free], rtol=0, atol=1e-12 * np.abs(got).max())


def test_the_angles_of_many_hinges_are_those_of_each(device):
    leaf, positions = CASES["crumpled"]()
    bowl = Bowl(leaf, device)
    bowl.potential.evaluate(positions)
    expected = [angle_of(*positions[hinge]) for hinge in leaf.mesh.hinges]
    np.testing.assert_allclose(hinge_angles(positions, leaf.mesh.hinges), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(bowl.rig.get("hinge_trial_angle"), expected, rtol=0, atol=1e-13)


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


def test_a_solve_with_an_old_factor_reaches_its_reduction(device):
    leaf = strip(columns=6, jitter=0.2)
    bowl = Bowl(leaf, device, fold=0.0)
    bowl.rig.put(edge_target_length=0.5 * bowl.rig.get("edge_rest_length"))
    newton = Newton(bowl.potential, ~bowl.free, leaf.length)
    bowl.base(crumpled(leaf, 0.0))
    newton._factorise()
    gradient = bowl.potential.evaluate(crumpled(leaf, 0.02)).gradient
    bowl.base(crumpled(leaf, 0.02))
    old = newton._factor.solve(-gradient)
    step = newton._conjugate_gradients(gradient, 1e-3)
    size = np.linalg.norm(gradient)
    assert np.linalg.norm(bowl.potential.product(old) + gradient) > 1e-2 * size
    assert np.linalg.norm(bowl.potential.product(step) + gradient) <= 1e-3 * size
    assert newton.effort.linear_iterations > 1


def test_a_solve_that_meets_a_direction_that_bends_away_refuses_or_follows_it(device):
    leaf = strip(columns=6, jitter=0.2)
    bowl = Bowl(leaf, device)
    newton = Newton(bowl.potential, ~bowl.free, leaf.length)
    positions = crumpled(leaf, 0.2)
    bowl.base(positions)
    assert not newton._factorise()
    gradient = bowl.potential.evaluate(positions).gradient
    assert newton._conjugate_gradients(gradient, 1e-6) is None
    step = newton._conjugate_gradients(gradient, 1e-6, leaves_saddle=True)
    # It goes down.
    assert np.vdot(gradient, step) < 0.0 and not step[~bowl.free].any()
    before, after = (bowl.potential.evaluate(positions + share * step).energy for share in (0.0, 1e-3))
    assert after < before
