"""Implicit and quasistatic motion: physics, convergence, extremes, and what happens when a step does not converge."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit import motion as implicit_motion
from leafwarp.sim.implicit import newton as newton_module
from leafwarp.sim.implicit.newton import Accuracy
from leafwarp.sim.motion import make_motion
from meshes import leaf_of, mesh_of, one_triangle, scene_of, strip
from structure_reference import crumpled, rig_of, stiffness_matrix

FRAME = 1.0 / 24.0
GRAVITY = [0.0, 0.0, -9.81]


def real(membrane=1e4, **structure):
    """A leaf of 0.2 mm with the membrane stiffness E h."""
    return {"membrane_stiffness": membrane, "bending_stiffness": membrane * 2e-4**2 / 12.0} | structure


def moving(method, structure, motion, leaf, device, free=False, **tables):
    rig = rig_of(scene_of(structure, {"method": method} | motion, **tables), leaf, device, "float64")
    if free:
        rig.put(pinned=np.zeros(leaf.mesh.vertex_count, bool))
    return rig, make_motion(rig.scene, leaf, rig.state, rig.stages)


def momenta(rig):
    mass, x, v = rig.get("mass")[:, None], rig.get("position"), rig.get("velocity")
    return (mass * v).sum(axis=0), np.cross(x, mass * v).sum(axis=0)


def test_free_fall_is_that_of_backward_euler(device):
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY}, strip(columns=6), device, free=True)
    start = rig.get("position")
    for frame in range(1, 4):
        assert motion.advance(FRAME, frame) == 1
    fallen = np.array(GRAVITY) * FRAME**2 * (1 + 2 + 3)
    np.testing.assert_allclose(rig.get("position") - start, np.broadcast_to(fallen, start.shape), rtol=0, atol=1e-9)


def test_drag_and_wind_are_those_of_backward_euler(device):
    wind = np.array([3.0, -1.0, 0.5])
    motion = {"drag": 20.0, "wind": wind.tolist()}
    rig, motion = moving("implicit", real(), motion, strip(columns=6), device, free=True)
    for frame in range(1, 4):
        motion.advance(FRAME, frame)
    expected = wind * (1.0 - (1.0 + 20.0 * FRAME) ** -3)
    np.testing.assert_allclose(rig.get("velocity").mean(axis=0), expected, rtol=1e-6)


def test_a_free_leaf_keeps_its_linear_momentum(device):
    leaf = strip(columns=6, jitter=0.2)
    rig, motion = moving("implicit", real(damping=0.5), {}, leaf, device, free=True)
    random = np.random.default_rng(0)
    rig.put(velocity=0.1 * random.normal(size=(leaf.mesh.vertex_count, 3)))
    before, _ = momenta(rig)
    for frame in range(1, 4):
        motion.advance(FRAME, frame)
        # The forces of all springs sum to zero; what is left is rounding of positions over a step.
        bound = 1e-15 * rig.get("mass").sum() * leaf.length / FRAME * 100.0
        np.testing.assert_allclose(momenta(rig)[0], before, rtol=0, atol=bound)


def test_a_free_leaf_loses_angular_momentum_by_first_order_in_the_step(device):
    """Backward Euler takes ``m v_(n+1) x v_n`` of it a step, that is its turn about the axis, squared."""
    leaf, turn, duration = strip(columns=6, jitter=0.2), np.array([0.0, 0.0, 2.0]), 0.25
    losses = []
    for steps in (10, 20, 40):
        rig, motion = moving("implicit", real(damping=0.5), {}, leaf, device, free=True)
        mass, positions = rig.get("mass")[:, None], rig.get("position")
        rig.put(velocity=np.cross(turn, positions - (mass * positions).sum(axis=0) / mass.sum()))
        _, before = momenta(rig)
        for step in range(steps):
            motion.advance(duration / steps, step + 1)
        _, after = momenta(rig)
        losses.append(1.0 - after @ before / (before @ before))
        assert np.linalg.norm(np.cross(after, before)) < 1e-6 * (before @ before)
    # omega^2 T dt at the finest, and half of it with half the step.
    assert losses[-1] == pytest.approx((turn @ turn) * duration**2 / 40, rel=0.1)
    for coarse, fine in pairwise(losses):
        assert coarse / fine == pytest.approx(2.0, rel=0.1)


def swinging_mode(structure, leaf, device):
    """Frequency [rad/s] of an oscillation at a fifth of the mesh's fastest, and its shape by vertices' masses."""
    rig, _ = moving("explicit", structure, {"clamp": True}, leaf, device)
    springs = [stage.name for stage in rig.stages if stage.name in ("edge_springs", "angular_springs")]
    still = np.zeros((leaf.mesh.vertex_count, 3))

    def forces(positions):
        rig.put(position=positions, velocity=still)
        return rig.forces(*springs)

    free, mass = np.repeat(~rig.get("pinned"), 3), np.repeat(rig.get("mass"), 3)
    matrix = stiffness_matrix(forces, rig.get("position"), 1e-7)[np.ix_(free, free)]
    squares, modes = np.linalg.eigh(0.5 * (matrix + matrix.T) / np.sqrt(np.outer(mass[free], mass[free])))
    frequencies = np.sqrt(np.maximum(squares, 0.0))
    chosen = np.argmin(np.abs(frequencies - 0.2 * frequencies[-1]))
    shape = np.zeros(len(free))
    shape[free] = modes[:, chosen]
    return frequencies[chosen], shape.reshape(-1, 3)


@pytest.mark.parametrize("structure", [{}, {"bending_stiffness": 2e-4}], ids=["membrane", "sheet"])
def test_both_methods_damp_alike(device, structure):
    """What the damping alone takes of an oscillation's energy in half a period."""
    leaf, steps = strip(columns=4, length=0.04, width=0.02, jitter=0.1), 300
    structure = {"membrane_stiffness": 5.0} | structure
    frequency, shape = swinging_mode(structure, leaf, device)
    taken = {}
    for method in ("explicit", "implicit"):
        energies = []
        for damping in (0.0, 1.0):
            rig, motion = moving(method, structure | {"damping": damping}, {"clamp": True}, leaf, device)
            start, root = rig.get("position"), np.sqrt(rig.get("mass"))[:, None]
            speed = 1e-7 * frequency
            rig.put(velocity=speed * shape / root * root.min())
            for step in range(steps):
                motion.advance(np.pi / frequency / steps, step + 1)
            way, pace = (
                ((values * root) * shape).sum() for values in (rig.get("position") - start, rig.get("velocity"))
            )
            energies.append(pace**2 + (frequency * way) ** 2)
            if method == "explicit":
                damping_time = float(rig.get("damping_time")[0])
        taken[method] = np.log(energies[0] / energies[1])
    # tau omega^2 times half a period; steps of a hundredth of a radian leave one per cent of it.
    assert taken["explicit"] == pytest.approx(damping_time * frequency * np.pi, rel=0.01)
    assert taken["explicit"] > 0.05
    assert taken["implicit"] == pytest.approx(taken["explicit"], rel=0.01)


def test_small_steps_agree_with_explicit_motion(device):
    leaf = strip(columns=8, length=0.06)
    structure, load = {"membrane_stiffness": 5.0, "bending_stiffness": 5e-6}, {"gravity": GRAVITY, "drag": 2.0}
    found = {}
    for method, steps in (("explicit", 1), ("implicit", 40)):
        rig, motion = moving(method, structure, load, leaf, device)
        for step in range(2 * steps):
            motion.advance(FRAME / steps, step + 1)
        found[method] = rig.get("position")
    way = np.abs(found["explicit"][:, 2]).max()
    assert way > 0.2 * leaf.length
    # First order in the step of 1 ms: 2 steps in 80 of the way.
    np.testing.assert_allclose(found["implicit"], found["explicit"], rtol=0, atol=0.03 * way)


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_two_runs_are_the_same_bits(device, method):
    results = []
    for _ in range(2):
        rig, motion = moving(method, real(), {"gravity": GRAVITY}, strip(columns=8, jitter=0.2), device)
        for frame in range(1, 4):
            motion.advance(FRAME, frame)
        results.append(rig.state["position"].numpy().tobytes() + rig.state["velocity"].numpy().tobytes())
    assert results[0] == results[1]


@pytest.mark.parametrize("membrane", [1e3, 1e4, 1e5])
def test_real_stiffness_takes_one_step_a_frame(device, membrane):
    leaf = strip(columns=14, jitter=0.1)
    load = {"gravity": GRAVITY, "drag": 2.0, "clamp": True}
    rig, motion = moving("implicit", real(membrane), load, leaf, device)
    for frame in range(1, 9):
        motion.advance(FRAME, frame)
    position = rig.get("position")
    assert motion.retries == 0 and motion.substeps == 8 and np.isfinite(position).all()
    ends = position[leaf.mesh.edges]
    stretch = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rig.get("edge_rest_length") - 1.0
    # Some times what the weight of the whole leaf, 0.3 N/m at the clamp, would do to it.
    assert np.abs(stretch).max() < 100.0 / membrane
    assert position[:, 2].min() < -0.02 * leaf.length
    pinned = rig.get("pinned")
    assert not position[pinned, 2].any() and not rig.get("velocity")[pinned].any()


def test_settled_shapes_agree(device):
    leaf = strip(columns=10, length=0.06, width=0.03, jitter=0.2)
    structure = {"membrane_stiffness": 20.0, "bending_stiffness": 2e-5}
    load = {"gravity": GRAVITY, "drag": 8.0, "clamp": True}
    shapes = {}
    for method in ("explicit", "implicit", "quasistatic"):
        rig, motion = moving(method, structure, load, leaf, device)
        assert motion.settle().settled and not rig.get("velocity").any()
        shapes[method] = rig.get("position")
    # The same by inertia and drag: two seconds in frames.
    rig, motion = moving("implicit", structure, load, leaf, device)
    for frame in range(1, 97):
        motion.advance(FRAME, frame)
    way = np.abs(shapes["quasistatic"][:, 2]).max()
    assert way > 0.2 * leaf.length

    def apart(first, second):
        return np.linalg.norm(first - second, axis=1).max() / leaf.length

    assert apart(shapes["implicit"], shapes["quasistatic"]) < 1e-6
    assert apart(rig.get("position"), shapes["quasistatic"]) < 1e-3
    assert apart(shapes["explicit"], shapes["quasistatic"]) < 5e-3


def test_an_equilibrium_is_left_at_no_frame(device):
    rig, motion = moving("quasistatic", real(), {"gravity": GRAVITY, "clamp": True}, strip(columns=8), device)
    motion.advance(FRAME, 1)
    first = rig.get("position")
    assert np.abs(rig.get("velocity")).max() > 0.0
    motion.advance(FRAME, 2)
    np.testing.assert_allclose(rig.get("position"), first, rtol=0, atol=1e-6 * rig.leaf.length)
    assert np.abs(rig.get("velocity")).max() < 1e-6 * rig.leaf.length / FRAME


def test_newton_converges_quadratically_and_goes_downhill(device):
    leaf = strip(columns=10, jitter=0.2)
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY, "clamp": True}, leaf, device)
    motion._set_times(FRAME, 0.0)
    rig.stage("implicit_motion").prepare_step()
    newton, ways = motion.newton, []
    here = newton.start(rig.get("position"))
    for _ in range(40):
        newton.forget()  # a new factor each time: the whole Hessian
        way, share, after = newton.step(here)
        assert after.energy <= here.energy + 1e-13 * here.energy_size
        ways.append(way / leaf.length)
        here = after
        if share == 1.0 and way < 1e-9 * leaf.length:
            break
    ways = [way for way in ways if way > 1e-12][-4:]
    assert len(ways) >= 3 and ways[-1] < 1e-6
    # A step that bends the leaf by its length over its thickness, 500, would be far beyond the quadratic.
    for before, way in pairwise(ways):
        assert way < 500.0 * before**2 + 1e-10


def test_a_converged_step_balances_its_forces(device):
    leaf = strip(columns=10, jitter=0.2)
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY, "clamp": True}, leaf, device)
    motion.advance(FRAME, 1)
    stage = rig.stage("implicit_motion")
    found = stage.potential.evaluate(rig.state["base_position"].numpy())
    assert found.residual <= motion.step_accuracy.force * found.mean_action
    np.testing.assert_array_equal(rig.get("position"), rig.get("base_position"))


def test_a_buckling_column_is_followed_to_its_bent_shape(device):
    leaf = strip(length=0.1, width=0.02, columns=16, jitter=0.1)
    structure = {"membrane_stiffness": 1e4, "bending_stiffness": 1e-6}
    rig, motion = moving("quasistatic", structure, {"gravity": [-9.81, 0.0, 0.0], "clamp": True}, leaf, device)
    start = rig.get("position")
    start[:, 2] += 1e-5 * (start[:, 0] / 0.1) ** 2 * ~rig.get("pinned")
    rig.put(position=start)
    assert motion.settle().settled
    # Far beyond the weight at which it buckles it hangs down past its foot, over a bend.
    found = rig.get("position")
    assert found[start[:, 0] > 0.099, 0].max() < -0.5 * leaf.length and np.ptp(found[:, 2]) > 0.01 * leaf.length


def test_rest_lengths_may_change_much_in_a_frame(device):
    leaf = strip(columns=10, jitter=0.2)
    for method in ("implicit", "quasistatic"):
        rig, motion = moving(method, real(), {"clamp": True}, leaf, device)
        shrunk = 0.8 * rig.get("edge_rest_length")
        rig.put(edge_rest_length=shrunk, hinge_rest_angle=np.full(leaf.mesh.hinge_count, 0.3))
        for frame in range(1, 4):
            motion.advance(FRAME, frame)
        ends = rig.get("position")[leaf.mesh.edges]
        assert np.isfinite(ends).all()
        assert np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / shrunk) < 1.02


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("factor", [0.0, 1e-6, 1e6], ids=["none", "soft", "stiff"])
def test_stiffness_of_any_size_stays_finite_or_is_refused(device, method, factor):
    leaf = strip(columns=5)
    structure = {"membrane_stiffness": 5.0 * factor, "bending_stiffness": 1e-6 * max(factor, 1e-3)}
    rig, motion = moving(method, structure, {"gravity": GRAVITY, "drag": 2.0, "clamp": True}, leaf, device)
    before = rig.get("position")
    if method == "quasistatic" and factor == 0.0:
        # Nothing holds what is not held itself.
        with pytest.raises(SimulationError, match="frame 1: quasistatic_motion"):
            motion.advance(FRAME, 1)
        np.testing.assert_array_equal(rig.get("position"), before)
        return
    try:
        motion.advance(FRAME, 1)
    except SimulationError as error:
        assert method == "quasistatic" and factor < 1.0, error
        np.testing.assert_array_equal(rig.get("position"), before)
    assert np.isfinite(rig.get("position")).all()


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
@pytest.mark.parametrize("height", [5e-3, 5e-4, 1e-4, 3e-5], ids=lambda height: f"height {height:g}")
def test_triangles_of_any_height_move_or_are_refused(device, method, height):
    """Beside an edge of a centimetre; meshes of leaves have none below a third of it."""
    mesh = mesh_of([[0, 0], [1e-2, 0], [5e-3, height], [5e-3, -8e-3]], [[0, 1, 2], [1, 0, 3]])
    rig, motion = moving(method, real(1e3), {"gravity": [0.0, -9.81, 0.0]}, leaf_of(mesh), device)
    for frame in range(1, 4):
        before = rig.get("position")
        try:
            motion.advance(FRAME, frame)
        except SimulationError:
            assert height < 1e-3
            np.testing.assert_array_equal(rig.get("position"), before)
    assert np.isfinite(rig.get("position")).all()


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_a_single_triangle_swings_about_its_pin(device, method):
    rig, motion = moving(method, real(1e3), {"gravity": [0.0, -9.81, 0.0]}, one_triangle(), device)
    for frame in range(1, 9):
        motion.advance(FRAME, frame)
    assert rig.get("position")[:, 1].mean() < -0.3e-2


def test_a_step_that_does_not_converge_is_taken_in_halves(device, monkeypatch):
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY}, strip(columns=8), device)
    minimise, tries = motion.newton.minimise, []

    def stubborn(start, accuracy):
        tries.append(rig.get("time_step")[0])
        if tries[-1] > 0.3 * FRAME:
            raise NotConverged("too far")
        return minimise(start, accuracy)

    monkeypatch.setattr(motion.newton, "minimise", stubborn)
    assert motion.advance(FRAME, 1) == 4 and motion.retries == 2
    np.testing.assert_allclose(tries, FRAME * np.array([1.0, 0.5, 0.25, 0.25, 0.25, 0.25]))
    # The same as a frame in four steps from the start.
    other, reference = moving("implicit", real(), {"gravity": GRAVITY}, strip(columns=8), device)
    for step in range(4):
        reference.advance(FRAME / 4, step + 1)
    np.testing.assert_allclose(rig.get("position"), other.get("position"), rtol=0, atol=1e-7)


def test_a_rest_state_that_is_too_far_is_approached_in_parts(device, monkeypatch):
    rig, motion = moving("quasistatic", real(), {"clamp": True}, strip(columns=8), device)
    target = np.full(rig.leaf.mesh.hinge_count, 0.1)
    rig.put(hinge_rest_angle=target)
    relax, tries = implicit_motion.relax, []

    def stubborn(*arguments, **options):
        tries.append(rig.get("hinge_rest_angle")[0])
        if len(tries) == 1:
            raise NotConverged("too far")
        return relax(*arguments, **options)

    monkeypatch.setattr(implicit_motion, "relax", stubborn)
    assert motion.advance(FRAME, 1) == 2 and motion.retries == 1
    np.testing.assert_allclose(tries, [0.1, 0.05, 0.1])
    np.testing.assert_array_equal(rig.get("hinge_rest_angle"), target)


REMEDY = {"implicit": "raise time.fps, or lower the load", "quasistatic": "lower the load or the curl, or let inertia"}


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_a_frame_that_cannot_be_found_is_refused_and_taken_back(device, method, monkeypatch):
    rig, motion = moving(method, real(), {"gravity": GRAVITY}, strip(columns=8, jitter=0.2), device)
    monkeypatch.setattr(newton_module, "MOST_ITERATIONS", 1)
    monkeypatch.setattr("leafwarp.sim.implicit.relaxation.MOST_STEPS", 1)
    names = ("position", "velocity", "hinge_angle", "edge_rest_length", "mass")
    before = {name: rig.get(name) for name in names}
    with pytest.raises(SimulationError, match=rf"frame 7: {method}_motion: after 1 .* {REMEDY[method]}"):
        motion.advance(FRAME, 7)
    assert motion.retries == implicit_motion.MOST_HALVINGS
    for name in names:
        np.testing.assert_array_equal(rig.get(name), before[name])


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_a_membrane_that_does_not_hold_is_refused_and_taken_back(device, method, monkeypatch):
    """A leaf that its weight stretches by more than is allowed, which is little here so that its shape is found."""
    monkeypatch.setattr(implicit_motion, "MOST_STRETCH", 1.001)
    soft = {"membrane_stiffness": 5.0, "bending_stiffness": 1e-6}
    rig, motion = moving(method, soft, {"gravity": GRAVITY, "clamp": True}, strip(columns=6), device)
    shapes = []
    with pytest.raises(
        SimulationError, match=rf"{method}_motion: an edge was stretched to .* raise structure.membrane"
    ):
        for frame in range(1, 50):
            shapes.append(rig.get("position"))
            motion.advance(FRAME, frame)
    np.testing.assert_array_equal(rig.get("position"), shapes[-1])
    _, motion = moving(method, soft, {"gravity": GRAVITY, "clamp": True}, strip(columns=6), device)
    with pytest.raises(SimulationError, match="settling: an edge was stretched to"):
        motion.settle()


@pytest.mark.parametrize("pin_radius", [0.0, 0.02])
def test_a_leaf_that_nothing_pulls_stays_where_it_is(device, pin_radius):
    """Held at one vertex it could turn freely; held at some it could not."""
    rig, motion = moving("quasistatic", real(), {"pin_radius": pin_radius}, strip(columns=8), device)
    before = rig.get("position")
    assert motion.advance(FRAME, 1) == 1
    np.testing.assert_array_equal(rig.get("position"), before)


def test_a_leaf_held_at_one_vertex_shrinks_where_it_is(device):
    rig, motion = moving("quasistatic", real(), {"pin_radius": 0.0}, strip(columns=8), device)
    lengths = rig.get("edge_rest_length")
    rig.put(edge_rest_length=0.9 * lengths)
    motion.advance(FRAME, 1)
    ends = rig.get("position")[rig.leaf.mesh.edges]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 0.9 * lengths, rtol=1e-4)


def test_what_is_not_finite_is_refused(device):
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY}, one_triangle(), device)
    rig.put(velocity=np.full((3, 3), np.nan))
    with pytest.raises(SimulationError, match=r"the velocity of vertex 0 is \[nan, nan, nan\] m/s"):
        motion.advance(FRAME, 2)
    assert np.isfinite(rig.get("position")).all()


def test_an_accuracy_that_is_never_reached_is_an_error(device):
    rig, motion = moving("implicit", real(), {"gravity": GRAVITY}, strip(columns=4), device)
    motion._set_times(FRAME, 0.0)
    rig.stage("implicit_motion").prepare_step()
    with pytest.raises(NotConverged):
        motion.newton.minimise(crumpled(rig.leaf, 0.0), Accuracy(force=-1.0, step=0.0))


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_only_what_moves_implicitly_is_there(device, damping):
    structure = {"membrane_stiffness": 5.0, "damping": damping}
    rig, _ = moving("implicit", structure, {}, strip(columns=4), device)
    assert [stage.name for stage in rig.stages] == ["implicit_motion"]
    assert not [name for name in rig.state.names if "hinge" in name or name == "force"]
    assert ("squared_frequency" in rig.state.names) == (damping > 0.0)
    kernels = {command.kernel_name for command in rig.stages[0].recorded}
    assert not [name for name in kernels if "hinge" in name]
