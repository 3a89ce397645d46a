"""The motion: integration against exact solutions, the choice of the step, retries, settling."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.sim.blocks import BLOCK
from leafwarp.sim.motion import _NOTHING, Motion
from leafwarp.sim.stable_step import step_limit
from meshes import leaf_of, mesh_of, one_triangle, scene_of, strip
from structure_reference import ROUNDING, crumpled, rig_of, stiffness_matrix

FRAME = 1.0 / 24.0
BENDING = {"bending_stiffness": 1e-6}


def free(rig):
    """Let every vertex go, and start the motion anew."""
    rig.put(pinned=np.zeros(rig.leaf.mesh.vertex_count, bool))
    return rig.motion()


def test_free_fall_is_exact(device, precision):
    gravity = np.array([0.5, 0.0, -9.81])
    rig = rig_of(scene_of(BENDING, {"gravity": gravity.tolist()}), strip(columns=6), device, precision)
    motion, start = free(rig), rig.get("position")
    count = motion.advance(FRAME, 1)
    # Symplectic Euler falls by g dt^2 (1 + 2 + ... + n).
    fallen = gravity * FRAME**2 * (count + 1) / (2 * count)
    size = ROUNDING[precision] * np.abs(fallen).max()
    np.testing.assert_allclose(rig.get("position") - start, np.broadcast_to(fallen, start.shape), rtol=0, atol=size)
    np.testing.assert_allclose(
        rig.get("velocity"), np.broadcast_to(gravity * FRAME, start.shape), rtol=0, atol=ROUNDING[precision]
    )


def test_wind_carries_a_free_leaf_to_its_speed(device, precision):
    wind = np.array([3.0, -1.0, 0.5])
    rig = rig_of(scene_of(BENDING, {"drag": 20.0, "wind": wind.tolist()}), strip(columns=6), device, precision)
    motion = free(rig)
    for frame in range(1, 25):
        motion.advance(FRAME, frame)
    expected = wind * (1.0 - np.exp(-20.0))
    np.testing.assert_allclose(rig.get("velocity").mean(axis=0), expected, rtol=1e-3)


def test_weight_and_drag_balance_at_the_terminal_speed(device, precision):
    rig = rig_of(scene_of(BENDING, {"gravity": [0, 0, -9.81], "drag": 30.0}), strip(columns=6), device, precision)
    motion = free(rig)
    for frame in range(1, 25):
        motion.advance(FRAME, frame)
    np.testing.assert_allclose(rig.get("velocity")[:, 2], -9.81 / 30.0, rtol=1e-3)


def test_a_stretched_triangle_rings_at_its_frequency(device, precision):
    leaf = one_triangle(0.01)
    rig = rig_of(scene_of({"membrane_stiffness": 2.0, "damping": 0.0}), leaf, device, precision)
    free(rig)
    # Breathing of an equilateral triangle of masses m and springs k: omega^2 = 3 k / m.
    omega = np.sqrt(3.0 * rig.get("edge_stiffness")[0] / rig.get("mass")[0])
    center, steps = leaf.mesh.positions.mean(axis=0), 64
    start = np.column_stack((center + 1.001 * (leaf.mesh.positions - center), np.zeros(3)))
    rig.put(position=start, time_step=[2.0 * np.pi / omega / 4.0 / steps])
    for _ in range(4 * steps):
        for name in ("edge_springs", "integration"):
            rig.stage(name).run()
    # Back after a period, up to the phase error of symplectic Euler, (omega dt)^2 / 24 of it.
    assert np.abs(rig.get("position") - start).max() < 0.01 * 1e-3 * 0.01 + 10 * ROUNDING[precision] * 1e-5
    for _ in range(2 * steps):
        for name in ("edge_springs", "integration"):
            rig.stage(name).run()
    half = np.column_stack((center + 0.999 * (leaf.mesh.positions - center), np.zeros(3)))
    assert np.abs(rig.get("position") - half).max() < 0.02 * 1e-3 * 0.01 + 10 * ROUNDING[precision] * 1e-5


def test_pinned_vertices_stay_exactly(device, precision):
    scene = scene_of(BENDING, {"gravity": [0, 0, -9.81], "drag": 2.0, "clamp": True})
    rig = rig_of(scene, strip(columns=8), device, precision)
    motion, before = rig.motion(), rig.state["position"].numpy().copy()
    for frame in range(1, 4):
        motion.advance(FRAME, frame)
    pinned = rig.get("pinned")
    after = rig.state["position"].numpy()
    assert after[pinned].tobytes() == before[pinned].tobytes() and np.all(rig.get("velocity")[pinned] == 0.0)
    assert np.all(after[~pinned, 2] < before[~pinned, 2])


def test_two_runs_are_the_same_bits(device, precision):
    results = []
    for _ in range(2):
        scene = scene_of(BENDING, {"gravity": [0, 0, -9.81], "drag": 2.0})
        rig = rig_of(scene, strip(columns=8, jitter=0.2), device, precision)
        motion = rig.motion()
        for frame in range(1, 4):
            motion.advance(FRAME, frame)
        results.append(rig.state["position"].numpy().tobytes() + rig.state["velocity"].numpy().tobytes())
    assert results[0] == results[1]


def test_damping_brings_a_shaken_leaf_to_rest_and_keeps_its_momentum(device, precision):
    rig = rig_of(scene_of(BENDING | {"damping": 0.5}), strip(columns=6), device, precision)
    motion = free(rig)
    rig.put(velocity=0.05 * np.random.default_rng(0).normal(size=(rig.leaf.mesh.vertex_count, 3)))
    mass = rig.get("mass")[:, None]

    def momenta():
        x, v = rig.get("position"), rig.get("velocity")
        return (mass * v).sum(axis=0), np.cross(x, mass * v).sum(axis=0), float(np.sum(mass * v * v))

    before = momenta()
    for frame in range(1, 13):
        motion.advance(FRAME, frame)
    after = momenta()
    impulse = float(np.sum(mass * 0.05))
    np.testing.assert_allclose(after[0], before[0], rtol=0, atol=10 * ROUNDING[precision] * impulse)
    np.testing.assert_allclose(after[1], before[1], rtol=0, atol=10 * ROUNDING[precision] * impulse * 0.1)
    assert after[2] < 0.2 * before[2]


def test_the_damping_time_is_that_of_a_wave_whatever_the_mesh(device):
    times = []
    for columns in (4, 8, 16):
        leaf = strip(columns=columns, length=0.04, width=0.02)
        rig = rig_of(scene_of({"membrane_stiffness": 5.0, "damping": 0.1}), leaf, device, "float64")
        rig.motion()
        times.append(float(rig.get("damping_time")[0]))
    structure = rig.scene.structure
    wave = 2.0 * np.pi / (0.04 / 40.0) * np.sqrt(5.0 / (structure.dry_mass + structure.water_mass))
    np.testing.assert_allclose(times, 2.0 * 0.1 / wave, rtol=1e-6)


def test_the_damped_wave_is_that_of_the_saturated_leaf(device):
    def damping_time(**structure):
        rig = rig_of(scene_of(structure | {"damping": 0.01}), strip(columns=8), device, "float64")
        rig.motion()
        return float(rig.get("damping_time")[0]), rig.stage("stable_step").largest_squared_frequency()

    soft, _ = damping_time(membrane_stiffness=0.05)
    softened, _ = damping_time(membrane_stiffness=5.0, stiffness=[[0.2, 1.0], [1.0, 0.01]])
    assert softened == pytest.approx(soft)
    # Without a membrane there is no such wave.
    alone, squared = damping_time(membrane_stiffness=0.0, bending_stiffness=1e-3)
    assert alone == pytest.approx(2.0 * 0.01 / np.sqrt(squared), rel=1e-5)


def test_no_oscillation_is_damped_by_more_than_twice_the_ratio(device):
    rig = rig_of(scene_of({"bending_stiffness": 1.0, "damping": 0.3}), strip(columns=8), device, "float64")
    rig.motion()
    largest = rig.stage("stable_step").largest_squared_frequency()
    assert rig.get("damping_time")[0] == pytest.approx(2.0 * 0.6 / np.sqrt(largest), rel=1e-5)


@pytest.mark.parametrize(("tau", "drag"), [(0.0, 0.0), (1e-3, 0.0), (1e-1, 3.0), (0.0, 50.0)])
def test_the_step_limit_is_that_of_symplectic_euler(tau, drag):
    squared = 40.0**2
    damping = tau * squared + drag
    limit = step_limit(squared, tau, drag)

    def grows(step):
        # One step of (x, v): v' = v - dt (omega^2 x + c v), x' = x + dt v'.
        update = np.array([[1 - step**2 * squared, step * (1 - step * damping)], [-step * squared, 1 - step * damping]])
        return np.abs(np.linalg.eigvals(update)).max() > 1.0 + 1e-9

    assert not grows(0.999 * limit) and grows(1.001 * limit)


def test_nothing_limits_a_leaf_without_stiffness_and_drag():
    assert step_limit(0.0, 0.0, 0.0) == np.inf
    assert step_limit(0.0, 0.0, 4.0) == pytest.approx(0.5)
    assert step_limit(np.inf, 0.0, 0.0) == 0.0


@pytest.mark.parametrize("amount", [0.0, 0.1, 0.25])
@pytest.mark.parametrize(
    "structure",
    [{}, {"bending_stiffness": 1e-7}, {"bending_stiffness": 1e-4}],
    ids=["edges", "soft hinges", "stiff hinges"],
)
def test_the_frequency_bound_holds_and_is_tight(device, precision, amount, structure):
    leaf = strip(columns=8, width=0.04, jitter=0.15)
    rig = rig_of(scene_of(structure), leaf, device, precision)
    rig.put(position=crumpled(leaf, amount))
    names = [name for name in ("edge_springs", "angular_springs") if name[:4] == "edge" or structure]
    rig.forces(*names)
    bound = rig.stage("stable_step").largest_squared_frequency()
    assert rig.get("squared_frequency")[rig.get("pinned")].max() == 0.0

    exact = rig_of(scene_of(structure), leaf, "cpu", "float64")

    def forces(positions):
        exact.put(position=positions)
        return exact.forces(*names)

    matrix = stiffness_matrix(forces, rig.get("position"), 1e-8)
    loose = np.repeat(~rig.get("pinned"), 3)
    scale = 1.0 / np.sqrt(np.repeat(rig.get("mass"), 3)[loose])
    matrix = scale[:, None] * (0.5 * (matrix + matrix.T))[np.ix_(loose, loose)] * scale
    largest = np.linalg.eigvalsh(matrix)[-1]
    assert bound >= largest * (1.0 - 1e-4)
    # Flat, the directions separate and the bound is near; crumpled, bent hinges are counted in every
    # direction.
    assert bound <= (1.7 if amount == 0.0 else 4.0) * largest


@pytest.mark.parametrize("angle", [-2.5, -0.5, 0.5, 2.5])
def test_the_frequency_bound_counts_what_a_bent_hinge_holds(device, precision, angle):
    # A foot outside the edge, where the angle's second derivative is large.
    mesh = mesh_of([[0, 0], [1e-2, 0], [1.6e-2, 9e-3], [4e-3, -6e-3]], [[0, 1, 2], [1, 0, 3]])
    scene = scene_of({"membrane_stiffness": 1e-6, "bending_stiffness": 1e-5})
    flat = np.column_stack((mesh.positions, np.zeros(4)))
    flat[2:, 2] = np.abs(flat[2:, 1]) * np.sin(angle / 2)
    flat[2:, 1] *= np.cos(angle / 2)

    rig, exact = (
        rig_of(scene, leaf_of(mesh), device, precision),
        rig_of(scene, leaf_of(mesh), "cpu", "float64"),
    )
    for each in (rig, exact):
        each.put(position=flat, hinge_rest_angle=[-np.sign(angle) * 3.0], mass=np.ones(4), pinned=np.zeros(4, bool))
    rig.forces("angular_springs")

    def forces(positions):
        exact.put(position=positions)
        return exact.forces("edge_springs", "angular_springs")

    matrix = stiffness_matrix(forces, flat, 1e-8)
    largest = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[-1]
    assert rig.stage("stable_step").largest_squared_frequency() >= largest


def test_a_mesh_is_stable_at_the_step_that_is_used(device, precision):
    rig = rig_of(scene_of(BENDING | {"damping": 0.0}), strip(columns=8, jitter=0.2), device, precision)
    motion = rig.motion()
    rig.put(velocity=1e-4 * np.random.default_rng(0).normal(size=(rig.leaf.mesh.vertex_count, 3)))
    for frame in range(1, 13):
        motion.advance(FRAME, frame)
    assert motion.retries == 0 and np.abs(rig.get("velocity")).max() < 1e-3


def test_substeps_follow_the_stiffness(device, precision):
    rig = rig_of(scene_of(), strip(columns=8), device, precision)
    motion = rig.motion()
    first = motion.required_substeps(FRAME)
    assert motion.advance(FRAME, 1) == first
    rig.put(edge_stiffness=16.0 * rig.get("edge_stiffness"))
    # Four times the frequency, and more damping by the springs.
    assert 4 * (first - 1) <= motion.required_substeps(FRAME) <= 8 * first
    assert first - 1 <= motion.required_substeps(FRAME / 4) <= 2 * first


@pytest.mark.parametrize("count", [1, 5, 32, 33, 127])
def test_any_number_of_substeps_is_the_same_as_one_by_one(count, device, precision):
    positions = []
    for chunk in (count, 1):
        rig = rig_of(scene_of(BENDING, {"gravity": [0, 0, -9.81]}), strip(columns=6), device, precision)
        motion = rig.motion()
        for _ in range(count // chunk):
            motion._run_substeps(chunk, 1e-5, motion._stages, _NOTHING)
        positions.append(rig.get("position"))
    assert (positions[0] == positions[1]).all()


def test_launches_inside_graphs_are_counted(device, precision):
    scene = scene_of(BENDING, {"gravity": [0, 0, -9.81]}, shrink={"curve": [[1.0, 0.0], [0.2, 0.1]]})
    rig = rig_of(scene, strip(columns=8), device, precision)
    motion, guard, ramp = rig.motion(), rig.stage("stable_step"), rig.stage("ramp")
    each = sum(stage.launches for stage in rig.stages if stage.rate == "substep")
    counts = []
    for frame in (1, 2):
        before = rig.state.launch_count
        counts.append(motion.advance(FRAME, frame))
        assert counts[-1] > BLOCK // 8
        ramped = ramp.launches_in(counts[-1]) + rig.stage("hold").launches_in(counts[-1])
        assert rig.state.launch_count - before == counts[-1] * each + guard.launches + ramped
    assert motion.substeps == sum(counts) and motion.largest_substeps == max(counts)


def test_a_frame_is_safe_from_its_first_parameters_to_its_last(device, precision):
    for change in (1.0 / 16.0, 16.0):
        rig = rig_of(scene_of({"stiffness": [[0.2, 2.0], [1.0, 1.0]]}), strip(columns=8), device, precision)
        motion = rig.motion()
        stiffest = motion.required_substeps(FRAME) * max(1.0, change**0.5)
        rig.put(edge_stiffness=change * rig.get("edge_stiffness"))
        assert motion.advance(FRAME, 1) >= 0.95 * stiffest
        assert motion.retries == 0


def test_a_refused_frame_leaves_no_trace_in_the_next_ones_substeps(device, precision):
    rig = rig_of(scene_of(BENDING, solver={"maximum_substeps": 64}), strip(columns=8, jitter=0.2), device, precision)
    motion = rig.motion()
    needed = motion.required_substeps(FRAME)
    rig.put(velocity=30.0 * np.random.default_rng(0).normal(size=(rig.leaf.mesh.vertex_count, 3)))
    with pytest.raises(SimulationError):
        motion.advance(FRAME, 1)
    assert motion.required_substeps(FRAME) == needed


def test_settling_lets_nothing_follow_the_water(device, precision):
    motion = {"wind": [0.0, 0.0, 0.2], "drag": 20.0, "clamp": True}
    shrink = {"curve": [[1.0, 0.0], [0.2, 0.1]]}
    rig = rig_of(scene_of(BENDING, motion, shrink=shrink), strip(columns=6), device, precision)
    moving = rig.motion()
    moving.advance(FRAME, 1)
    clock = rig.get("ramp_clock").tobytes()
    rig.put(edge_rest_length=0.99 * rig.get("edge_rest_length"))
    lengths = rig.get("edge_rest_length").tobytes()
    moving.settle()
    assert rig.get("ramp_clock").tobytes() == clock and rig.get("edge_rest_length").tobytes() == lengths


def test_nothing_is_allocated_in_a_frame(device, precision, monkeypatch):
    import warp as wp

    rig = rig_of(scene_of(BENDING, {"gravity": [0, 0, -9.81]}), strip(columns=8), device, precision)
    motion = rig.motion()
    motion.advance(FRAME, 1)
    made, begin = [], wp.array.__init__

    def counted(array, *arguments, **options):
        begin(array, *arguments, **options)
        # Reading back from a GPU makes an array on the host; a view has nothing to free.
        if array.device == rig.state.device and array.deleter is not None:
            made.append(array.shape)

    monkeypatch.setattr(wp.array, "__init__", counted)
    wp.zeros(3, device=device)
    assert made.pop() == (3,)
    graphs = dict(motion._graphs)
    motion.advance(FRAME, 2)
    assert made == [] and motion._graphs == graphs


def test_a_frame_that_goes_wrong_is_redone_with_more_substeps(device, precision, monkeypatch):
    scene = scene_of(BENDING, {"gravity": [0, 0, -9.81], "drag": 2.0})
    rig = rig_of(scene, strip(columns=8), device, precision)
    reference = rig_of(scene, strip(columns=8), device, precision)
    motion, expected = rig.motion(), reference.motion()
    quarter = -(-expected.required_substeps(FRAME) // 4)
    monkeypatch.setattr(Motion, "required_substeps", lambda self, duration: quarter)
    assert motion.advance(FRAME, 1) == 4 * quarter and motion.retries == 2
    monkeypatch.setattr(Motion, "required_substeps", lambda self, duration: 4 * quarter)
    assert expected.advance(FRAME, 1) == 4 * quarter and expected.retries == 0
    # The frame was taken back completely: what remains is what the right number of substeps alone gives.
    for name in ("position", "velocity", "hinge_angle"):
        assert rig.state[name].numpy().tobytes() == reference.state[name].numpy().tobytes()


def test_a_frame_that_cannot_be_saved_is_an_error_and_is_taken_back(device, precision):
    rig = rig_of(scene_of(solver={"maximum_substeps": 64}), one_triangle(), device, precision)
    motion, before = rig.motion(), rig.get("position")
    rig.put(velocity=np.full((3, 3), np.nan))
    with pytest.raises(SimulationError, match=r"frame 7: motion: the velocity of vertex 0 is \[nan, nan, nan\] m/s"):
        motion.advance(FRAME, 7)
    np.testing.assert_array_equal(rig.get("position"), before)


def test_a_vertex_that_is_thrown_is_an_error(device, precision):
    rig = rig_of(scene_of({"membrane_stiffness": 0.0}), one_triangle(), device, precision)
    motion = rig.motion()
    rig.put(velocity=np.full((3, 3), 100.0))
    with pytest.raises(SimulationError, match=r"a vertex moved 7.22 m, on a leaf of 0.01 m"):
        motion.advance(FRAME, 1)


def test_bending_that_tears_the_membrane_is_refused(device, precision):
    """Rest angles of a dome that only a membrane stretched many times over could take."""
    scene = scene_of({"membrane_stiffness": 0.5, "bending_stiffness": 1e-4}, {"drag": 2.0})
    rig = rig_of(scene, strip(0.1, 0.08, columns=10, jitter=0.2), device, precision)
    rig.put(hinge_rest_angle=np.full(rig.leaf.mesh.hinge_count, 1.2))
    motion = rig.motion()
    with pytest.raises(SimulationError, match=r"stretched to .* raise structure.membrane|a vertex moved"):
        for frame in range(1, 60):
            motion.advance(FRAME, frame)
    ends = rig.get("position")[rig.leaf.mesh.edges]
    stretch = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rig.get("edge_rest_length")
    assert stretch.max() < 3.1  # no frame that was let through shows it


def test_shares_of_the_stages_leave_the_leaf_alone(device, precision):
    rig = rig_of(scene_of(BENDING, {"gravity": [0, 0, -9.81]}), strip(columns=8), device, precision)
    motion = rig.motion()
    motion.advance(FRAME, 1)
    before = [rig.get(name) for name in ("position", "velocity", "hinge_angle")]
    launches = rig.state.launch_count
    shares = motion.stage_shares()
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(shares) == {"edge_springs", "angular_springs", "gravity", "integration"}
    assert rig.state.launch_count == launches
    for name, values in zip(("position", "velocity", "hinge_angle"), before, strict=True):
        np.testing.assert_array_equal(rig.get(name), values)


def test_too_many_substeps_are_refused_with_a_remedy(device, precision):
    rig = rig_of(scene_of({"membrane_stiffness": 5e6}), strip(columns=8), device, precision)
    before = rig.get("position")
    with pytest.raises(
        SimulationError, match=r"needs \d+ substeps, more than solver.maximum_substeps = 8192.*membrane"
    ):
        rig.motion().advance(FRAME, 3)
    np.testing.assert_array_equal(rig.get("position"), before)
    rig = rig_of(scene_of({"membrane_stiffness": 0.01}, {"drag": 1e6}), strip(columns=8), device, precision)
    with pytest.raises(SimulationError, match=r"lower motion.drag"):
        rig.motion().advance(FRAME, 3)


def test_settling_leaves_a_hanging_leaf_at_rest(device, precision):
    scene = scene_of(
        {"membrane_stiffness": 5.0, "bending_stiffness": 5e-6},
        {"gravity": [0, 0, -9.81], "drag": 2.0, "clamp": True},
    )
    rig = rig_of(scene, strip(columns=8, length=0.06, width=0.02), device, precision)
    motion, flat = rig.motion(), rig.get("position")
    settled = motion.settle()
    rest = rig.get("position")
    assert settled.settled and settled.swing < 1e-3
    assert np.all(rig.get("velocity") == 0.0)
    assert rest[:, 2].min() < -0.1 * rig.leaf.length
    for frame in range(1, 13):
        motion.advance(FRAME, frame)
    # It does not drop as the film starts.
    moved = np.abs(rig.get("position") - rest).max()
    assert moved < 5e-3 * rig.leaf.length and moved < 0.02 * np.abs(rest - flat).max()


def test_the_paper_bending_reports_its_unbalanced_torque(device, precision):
    leaf = strip(columns=6, jitter=0.2)
    torques = []
    for bending in ("gradient", "paper"):
        rig = rig_of(scene_of(BENDING | {"bending": bending}), leaf, device, precision)
        motion = rig.motion()
        rig.put(position=crumpled(leaf, 0.1))
        motion.advance(FRAME / 8, 1)
        torques.append(motion.unbalanced_torque)
    assert torques[0] is None and torques[1] > 0.0


def test_mass_ratios_of_a_million_stay_finite(device, precision):
    rig = rig_of(scene_of({"membrane_stiffness": 0.5}), strip(columns=4), device, precision)
    mass = rig.get("mass")
    mass[::3] *= 1e6
    rig.put(mass=mass)
    motion = rig.motion()
    rig.put(position=crumpled(rig.leaf, 0.05))
    for frame in range(1, 4):
        motion.advance(FRAME, frame)
    assert np.isfinite(rig.get("position")).all()


def test_a_leaf_without_hinges_launches_nothing_for_them(device, precision):
    rig = rig_of(scene_of(BENDING, {"gravity": [0, 0, -9.81], "drag": 1.0}), one_triangle(), device, precision)
    assert "angular_springs" not in {stage.name for stage in rig.stages}
    assert rig.motion().advance(FRAME, 1) >= 1
    tiny = leaf_of(mesh_of([[0, 0], [1e-2, 0], [0, 1e-2]], [[0, 1, 2]]))
    assert rig_of(scene_of(BENDING | {"bending": "paper"}), tiny, device, precision).motion().advance(FRAME, 1) >= 1
