"""The structure at the extremes, for every method of motion: stiffness, load, shapes, starts and steps.

What other tests show already:

======================================================  =============================================================
stiffness 0, and factors 1e-6 to 1e6                    test_structure_shapes: test_any_stiffness_is_computed_or_...;
                                                        test_implicit_motion: test_stiffness_of_any_size_stays_...
mass ratios of 1e6, explicit                            test_motion: test_mass_ratios_of_a_million_stay_finite
edges brought to no length, explicit                    test_structure_shapes: test_edges_of_no_length_and_...
slivers                                                 test_structure_shapes: test_slivers;
                                                        test_implicit_motion: test_triangles_of_any_height_move_or_...
hinges folded to half a turn and past it, explicit      test_structure_shapes: test_hinges_folded_flat,
                                                        test_rest_angles_past_half_a_turn_close_the_fold_and_no_more;
                                                        test_structure_bending
one triangle                                            test_structure_shapes: test_a_single_triangle_swings;
                                                        test_implicit_motion: test_a_single_triangle_swings_about_...
a step that becomes too long, a thrown vertex           test_motion: test_a_frame_that_goes_wrong_is_redone_...,
                                                        test_a_vertex_that_is_thrown_is_an_error
======================================================  =============================================================
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.sim.implicit.relaxation import turned_back
from leafwarp.sim.motion import make_motion
from leafwarp.sim.simulation import Simulation
from leafwarp.study.stability.drift import KEPT, Ringing
from leafwarp.study.stability.point import REFUSED, STABLE
from meshes import leaf_of, mesh_of, scene_of, strip, two_triangles
from structure_reference import rig_of, rotation
from swept import outcomes, points_of

FRAME = 1.0 / 24.0
GRAVITY = {"gravity": [0.0, 0.0, -9.81], "drag": 2.0}
METHODS = [("explicit", "float32"), ("explicit", "float64"), ("implicit", "float64"), ("quasistatic", "float64")]
by_every_method = pytest.mark.parametrize("how", METHODS, ids=" ".join)


def moving(how, structure, motion, leaf, device):
    method, precision = how
    scene = scene_of(structure, {"method": method} | motion, solver={"maximum_substeps": 4096})
    rig = rig_of(scene, leaf, device, precision)
    return rig, make_motion(scene, leaf, rig.state, rig.stages)


def moves_or_is_refused(rig, motion, frames=3) -> bool:
    """Play some frames; whether they were computed. A refusal leaves the frame before."""
    for frame in range(1, frames + 1):
        before = rig.get("position")
        try:
            motion.advance(FRAME, frame)
        except SimulationError as error:
            assert re.match(rf"frame {frame}: (motion|implicit_motion|quasistatic_motion): .*; .+", str(error))
            np.testing.assert_array_equal(rig.get("position"), before)
            return False
        assert np.isfinite(rig.get("position")).all() and np.isfinite(rig.get("velocity")).all()
        assert np.linalg.norm(rig.get("position") - before, axis=1).max() <= 4.0 * rig.leaf.length
    return True


def stretches(rig) -> np.ndarray:
    ends = rig.get("position")[rig.leaf.mesh.edges]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rig.get("edge_rest_length")


def test_stiffness_of_1e_minus_9_to_1e9_hangs_alike_or_is_refused(device):
    found = outcomes(points_of("stiffness", (1e-9, 1e9), device, ("implicit", "quasistatic")))
    # Nothing so soft bears its own weight.
    for (_, _, factor), outcome in found.items():
        assert outcome == (REFUSED if factor == 1e-9 else STABLE), found


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_explicit_motion_of_any_stiffness_moves_or_says_which_step_would_do(factor, device, precision):
    structure = {"membrane_stiffness": 5.0 * factor, "bending_stiffness": 1e-6 * factor}
    _, motion = moving(("explicit", precision), structure, GRAVITY, strip(columns=6), device)
    with pytest.raises(SimulationError) as refusal:
        for frame in range(1, 4):
            motion.advance(FRAME, frame)
    if factor < 1.0:
        assert "the membrane does not hold" in str(refusal.value)
        return
    needs = re.search(
        r"needs (\S+) substeps, more than .* = 4096: steps of (\S+) s would do; lower", str(refusal.value)
    )
    assert float(needs[1]) * float(needs[2]) == pytest.approx(FRAME, rel=0.01)


def test_the_step_that_would_do_does(device, precision):
    """What a refusal names, taken as the step, is let through."""

    def motion_of(most: int):
        structure = {"membrane_stiffness": 500.0, "bending_stiffness": 1e-6}
        scene = scene_of(structure, GRAVITY, solver={"maximum_substeps": most})
        rig = rig_of(scene, strip(columns=6), device, precision)
        return make_motion(scene, rig.leaf, rig.state, rig.stages)

    with pytest.raises(SimulationError) as refusal:
        motion_of(64).advance(FRAME, 1)
    step = float(re.search(r"steps of (\S+) s would do", str(refusal.value))[1])
    enough = int(np.ceil(1.01 * FRAME / step))  # the message rounds it
    assert 64 < motion_of(enough).advance(FRAME, 1) <= enough


def test_a_step_that_became_too_long_is_refused_with_the_one_that_is_needed(device, precision):
    """A triangle a millionth as high as it is long opens, and its hinge swings faster and faster."""
    mesh = mesh_of([[0, 0], [1e-2, 0], [5e-3, 8e-3], [5e-3, -1e-8]], [[0, 1, 2], [1, 0, 3]])
    load = {"gravity": [0.0, -9.81, 0.0], "drag": 2.0}
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-7}
    scene = scene_of(structure, load, solver={"maximum_substeps": 256})
    rig = rig_of(scene, leaf_of(mesh), device, precision)
    found = r"step of (\S+) s became too long for the .* mesh, which needs steps of (\S+) s, with 256"
    with pytest.raises(SimulationError, match=found) as refusal:
        make_motion(scene, rig.leaf, rig.state, rig.stages).settle()
    steps = re.search(found, str(refusal.value))
    assert 0.0 < float(steps[2]) < float(steps[1])


def test_a_thousand_g_and_mass_ratios_of_a_million(device):
    for name, value, methods in (("gravity", 1e3, ("implicit", "quasistatic")), ("mass_ratio", 1e6, ())):
        points = points_of(name, (value,), device, methods)
        assert set(outcomes(points).values()) == {STABLE}, points


def test_explicit_motion_bears_a_thousand_g(device, precision):
    structure = {"membrane_stiffness": 1000.0, "bending_stiffness": 1e-5}
    load = {"gravity": [0.0, 0.0, -9810.0], "drag": 2.0}
    rig, motion = moving(("explicit", precision), structure, load, strip(columns=4), device)
    assert moves_or_is_refused(rig, motion)
    # Held at its base, it has fallen and swings.
    assert stretches(rig).max() < 2.0 and rig.get("position")[:, 2].min() < -0.5 * rig.leaf.length


@pytest.mark.parametrize("how", METHODS[:3], ids=" ".join)
def test_a_soft_membrane_under_a_thousand_g_is_refused(how, device):
    load = {"gravity": [0.0, 0.0, -9810.0], "drag": 2.0}
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-6}
    rig, motion = moving(how, structure, load, strip(columns=3), device)
    assert not moves_or_is_refused(rig, motion)


@by_every_method
def test_two_triangles_hang_from_their_base(how, device):
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-7}
    rig, motion = moving(how, structure, GRAVITY | {"clamp": False}, two_triangles(), device)
    assert moves_or_is_refused(rig, motion, frames=24)
    assert rig.get("position")[1:, 2].mean() < -0.5e-2
    assert stretches(rig).max() < 1.1


@by_every_method
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize(
    ("corners", "triangles"),
    [
        ([[0, 0], [1, 0], [0.5, 1], [0.5, 1], [-0.5, 1]], [[0, 1, 2], [0, 2, 3], [0, 3, 4]]),
        ([[0, 0], [1, 0], [0.5, 1], [0.5, 0]], [[0, 1, 2], [1, 0, 3]]),
    ],
    ids=["an edge without length", "a triangle without area"],
)
@pytest.mark.parametrize("bending", [{}, {"bending_stiffness": 1e-7}], ids=["membrane", "sheet"])
def test_a_mesh_that_is_degenerate_at_rest_is_refused(how, corners, triangles, bending, device):
    """No mesh of a leaf is: a vertex without area has no mass, and an edge without length no stiffness."""
    leaf = leaf_of(mesh_of(1e-2 * np.array(corners), triangles))
    rig, motion = moving(how, {"membrane_stiffness": 5.0} | bending, GRAVITY, leaf, device)
    assert not moves_or_is_refused(rig, motion)


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("start", ["edge without length", "all in a point", "folded flat", "folded through"])
def test_degenerate_starts_unfold(method, start, device):
    folded = start.startswith("folded")
    leaf = two_triangles() if folded else strip(columns=4)
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-7}
    rig, motion = moving((method, "float64"), structure, {"drag": 2.0}, leaf, device)
    position = rig.get("position")
    if folded:
        position[3] = position[2] - [0.0, 0.0, 1e-7 * (start == "folded through")]
    else:
        first, second = leaf.mesh.edges[5]
        position[slice(None) if start == "all in a point" else first] = position[second]
    rig.put(position=position)
    assert moves_or_is_refused(rig, motion, frames=12)
    if start == "all in a point":
        # No edge points anywhere: nothing says which way to unfold.
        np.testing.assert_array_equal(rig.get("position"), position)
        return
    np.testing.assert_allclose(stretches(rig), 1.0, atol=1e-3)
    np.testing.assert_allclose(rig.get("hinge_angle"), 0.0, atol=1e-2)


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("rest", [np.pi, -np.pi, 3.2, 50.0])
def test_hinges_close_to_half_a_turn_and_no_further(method, rest, device):
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-7}
    rig, motion = moving((method, "float64"), structure, {"drag": 20.0}, two_triangles(), device)
    rig.put(hinge_rest_angle=[rest])
    if moves_or_is_refused(rig, motion, frames=12):
        assert abs(rig.get("hinge_angle")[0]) < 2.0 * np.pi


@by_every_method
def test_rest_lengths_down_to_2_per_cent(how, device):
    """Slowly: by half a per cent at a time, as a leaf is told of its water."""
    leaf = strip(columns=6, width=0.03)
    rig, motion = moving(how, {"membrane_stiffness": 5.0, "bending_stiffness": 1e-8}, {"drag": 20.0}, leaf, device)
    rest, triangles = rig.get("edge_rest_length"), leaf.mesh.triangles
    shares = np.geomspace(1.0, 0.02, 783 if how[0] == "explicit" else 24)
    for frame, share in enumerate([*shares, *12 * [0.02]], start=1):
        rig.put(edge_rest_length=share * rest)
        motion.advance(FRAME / 4 if how[0] == "explicit" else FRAME, frame)
    assert np.abs(stretches(rig) - 1.0).max() < 0.02
    a, b, c = np.moveaxis(rig.get("position")[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    # As it was, but smaller, and perhaps turned: no triangle is folded over its neighbour.
    cosines = normals @ normals.sum(axis=0) / (np.linalg.norm(normals, axis=1) * np.linalg.norm(normals.sum(axis=0)))
    assert cosines.min() > 0.99


@pytest.mark.parametrize("lost", [0.2, 0.8])
def test_a_leaf_held_at_one_vertex_shrinks_without_turning(lost, device):
    """Nothing keeps it from turning, so that whatever an equilibrium has turned by would stay and add up."""
    leaf = strip(columns=10, jitter=0.2)
    scene = scene_of(
        {"membrane_stiffness": 1e4, "bending_stiffness": 3e-5},
        {"method": "quasistatic", "pin_radius": 0.0},
        time={"duration": 1.0, "frames": 13},
        water={"curve": [[0.0, 1.0], [1.0, 0.0]]},
        shrink={"curve": [[0.0, lost], [1.0, 0.0]]},
    )
    for frame in Simulation(scene, leaf, device).frames():
        left = 1.0 - lost * (1.0 - frame.water[0])
        expected = left * np.column_stack((leaf.mesh.positions, np.zeros(leaf.mesh.vertex_count)))
        np.testing.assert_allclose(frame.points, expected, rtol=0, atol=1e-5 * leaf.length)


X, Y, Z = np.eye(3)


@pytest.mark.parametrize(
    ("held", "pull", "axis", "comes_back"),
    [
        ([0], 0 * Z, X + Y + Z, True),
        ([0], 9.8 * Z, Z, True),
        ([0], 9.8 * Z, Y, False),
        ([0, 1], 0 * Z, X, True),
        ([0, 1], 2.0 * X, X, True),
        ([0, 1], 9.8 * Z, X, False),
    ],
    ids=["free", "about the load", "against the load", "about a line", "about a line along the load", "hanging"],
)
def test_only_what_changes_no_energy_is_turned_back(held, pull, axis, comes_back):
    random = np.random.default_rng(4)
    start = random.normal(size=(9, 3))
    start[1] = start[0] + [1.5, 0.0, 0.0]
    is_held = np.isin(np.arange(9), held)
    found = start[0] + (start - start[0]) @ rotation(axis, 0.7).T
    weights = random.uniform(1.0, 2.0, 9)
    turned = turned_back(found, start, is_held, weights, pull)
    distance = [float(weights @ np.square(each - start).sum(axis=1)) for each in (turned, found)]
    assert distance[0] <= distance[1]
    assert (distance[0] < 1e-24) == comes_back
    # Neither the load's energy nor what is held, nor the shape, is changed.
    np.testing.assert_allclose(turned @ pull, found @ pull, rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned[is_held], found[is_held], rtol=0, atol=1e-12)
    apart = [np.linalg.norm(each[:, None] - each[None], axis=2) for each in (turned, found)]
    np.testing.assert_allclose(*apart, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(turned_back(start, start, is_held, np.ones(9), pull), start)


def starts(leaf, rest):
    random = np.random.default_rng(3)
    size = leaf.length
    return {
        "mirrored": rest * [1.0, -1.0, 1.0],
        "turned over": rest @ rotation((1.0, 0.0, 0.0), np.pi).T,
        "inside out": -rest,
        "tangled": random.permutation(rest),
        "random": random.uniform(-size, size, rest.shape),
        "far apart": random.uniform(-100.0 * size, 100.0 * size, rest.shape),
    }


@by_every_method
@pytest.mark.parametrize("name", ["mirrored", "turned over", "inside out", "tangled", "random", "far apart"])
def test_any_start_gains_no_energy_or_is_refused(how, name, device):
    leaf = strip(columns=4, jitter=0.2)
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-6}
    rig, motion = moving(how, structure, {"drag": 2.0}, leaf, device)
    start = starts(leaf, rig.get("position"))[name]
    pinned = rig.get("pinned")
    start -= start[pinned][0] - rig.get("position")[pinned][0]
    rig.put(position=start)

    def stretched() -> float:
        rest = rig.get("edge_rest_length")
        return float(rig.get("edge_stiffness") @ np.square(rest * (stretches(rig) - 1.0)))

    before = stretched()
    is_rigid = name in ("mirrored", "turned over", "inside out")
    if not moves_or_is_refused(rig, motion):
        assert not is_rigid
        return
    assert stretched() <= (1e-9 if is_rigid else before)


def test_crumpled_leaves_gain_no_energy(device):
    points = points_of("crumple", (1e-3, 1.0), device)
    assert set(outcomes(points).values()) == {STABLE}, points


def test_energy_and_momenta_stay_over_many_steps(device):
    assert set(outcomes(points_of("motion_steps", (1, 10_000), device)).values()) == {STABLE}


@pytest.mark.slow
def test_energy_and_momenta_stay_over_a_million_steps(device, precision):
    finding = Ringing(device, precision).run_to(1_000_000)
    assert not finding.faults and finding.error < KEPT[precision]


@pytest.mark.slow
def test_a_mesh_of_100_000_vertices_moves(device, precision):
    leaf = strip(0.1, 0.08, columns=330)
    assert leaf.mesh.vertex_count > 100_000
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-9}
    rig, motion = moving(("explicit", precision), structure, GRAVITY, leaf, device)
    assert moves_or_is_refused(rig, motion, frames=1)
    # Free fall, but for what is held and for the little that this does in a frame.
    fallen = rig.get("position")[:, 2].min()
    assert fallen == pytest.approx(-0.5 * 9.81 * FRAME**2, rel=0.15)
