"""Whole leaves at the extremes: their size, their place, abrupt responses, water that comes and goes, thin maps.

What other tests show already:

======================================================  =============================================================
maps of one row, one column, one cell, on their own     test_sampling; test_fluid_water: test_thin_maps_and_leaves_...
a leaf that dries, fills again and keeps a set          test_coupling: test_what_dried_curled_stays_curled_...
storms                                                  test_structure_shapes: test_storms
======================================================  =============================================================
"""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.sim.motion import Motion
from leafwarp.sim.simulation import Simulation
from leafwarp.study.stability.point import INACCURATE, STABLE
from leafwarp.study.verify.drawn_leaf import scene_of
from meshes import leaf_of, mesh_of, strip
from structure_reference import rig_of
from swept import outcomes, points_of

METHODS = [("explicit", "float32"), ("explicit", "float64"), ("implicit", "float64"), ("quasistatic", "float64")]
by_every_method = pytest.mark.parametrize("how", METHODS, ids=" ".join)


def simulated(how, leaf: Leaf, device: str, motion: dict | None = None, structure: dict | None = None, **tables):
    method, precision = how
    scene = scene_of(
        {"membrane_stiffness": 5.0, "bending_stiffness": 1e-6} | (structure or {}),
        {"method": method, "drag": 4.0} | (motion or {}),
        solver={"precision": precision, "maximum_substeps": 4096},
        **tables,
    )
    return Simulation(scene, leaf, device)


def frames_or_refusal(simulation: Simulation) -> list[np.ndarray]:
    """Points of the frames that were computed; all are finite and none is thrown."""
    points: list[np.ndarray] = []
    try:
        for frame in simulation.frames():
            assert np.isfinite(frame.points).all() and np.isfinite(frame.velocities).all()
            assert np.isfinite(frame.water).all() and np.isfinite(frame.normals).all()
            assert np.linalg.norm(frame.points, axis=1).max() < 10.0 * simulation.leaf.length
            points.append(frame.points.astype(np.float64))
    except SimulationError as error:
        assert error.frame == len(points) + 1 and "; " in str(error)
    return points


NEWTON = ("implicit", "quasistatic")


def test_a_leaf_of_a_millimetre_hangs_like_one_of_ten_metres(device):
    points = points_of("leaf_length", (1e-3, 10.0), device, NEWTON)
    assert set(outcomes(points).values()) == {STABLE}, points


def two_frames(size: float, device: str, precision: str, shift=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Where a strip of a size [m] falls in two frames, over its size, with all that moves it in proportion to that."""
    grown = size / 0.1
    scene = scene_of(
        {"membrane_stiffness": 5.0 * grown**2, "bending_stiffness": 1e-6 * grown**4},
        {"gravity": [0.0, 0.0, -9.81 * grown], "drag": 2.0},
        leaf={"length": size},
    )
    rig = rig_of(scene, strip(size, width=0.3 * size, columns=6), device, precision)
    rig.put(position=rig.get("position") + shift)
    motion = Motion(scene, rig.leaf, rig.state, rig.stages)
    for frame in (1, 2):
        motion.advance(1.0 / 24.0, frame)
    assert np.isfinite(rig.get("velocity")).all()
    return (rig.get("position") - shift) / size


@pytest.mark.parametrize("size", [1e-3, 10.0])
def test_explicit_motion_knows_no_size(size, device, precision):
    expected = two_frames(0.1, device, precision)
    assert expected[:, 2].min() < -0.1
    atol = {"float32": 1e-4, "float64": 1e-10}[precision]
    np.testing.assert_allclose(two_frames(size, device, precision), expected, rtol=0, atol=atol)


def test_a_leaf_a_kilometre_from_the_origin(device):
    points = points_of("distance", (1e3,), device, NEWTON)
    assert set(outcomes(points).values()) == {STABLE}, points


def test_explicit_motion_a_kilometre_from_the_origin(device, precision):
    expected = two_frames(0.1, device, precision)
    # A float32 tells places 1 km away apart to 0.06 mm, a float64 to 1e-13 m.
    atol = {"float32": 0.3, "float64": 1e-8}[precision]
    found = two_frames(0.1, device, precision, shift=(600.0, 0.0, 800.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


def test_an_abrupt_shrinking_ends_where_it_should_but_in_explicit_motion(device):
    points = points_of("curve_width", (1e-12,), device)
    for (method, *_), outcome in outcomes(points).items():
        # A pull by a fifth within a substep folds soft triangles over, which stay so.
        assert outcome == (INACCURATE if method == "explicit" else STABLE), points


@by_every_method
@pytest.mark.parametrize("width", [1e-15, 1e-12, 1e-6])
def test_every_response_may_be_abrupt(how, width, device):
    low, high = 0.47 - width, 0.47

    def step(before: float, after: float) -> list[list[float]]:
        return [[low, after], [high, before]]

    simulation = simulated(
        how,
        strip(columns=6),
        device,
        {"gravity": [0.0, 0.0, -0.1]},
        {"stiffness": step(1.0, 0.3), "wilting": step(1.0, 0.5), "drying": step(1.0, 4.0)},
        time={"duration": 1.0, "frames": 6},
        water={"curve": [[0.0, 1.0], [0.5, 0.0]]},
        shrink={"curve": step(0.0, 0.02), "plastic_set": 0.5},
        curl={"mismatch": step(0.0, 0.002), "plastic_set": 0.5},
    )
    assert len(frames_or_refusal(simulation)) == 6


@by_every_method
def test_watering_and_drying_in_turn_each_frame(how, device):
    """Odd frames are wet and even ones dry; a leaf without inertia goes back and forth between two shapes."""
    count = 25
    simulation = simulated(
        how,
        strip(columns=6),
        device,
        {"gravity": [0.0, 0.0, -0.1], "clamp": True},
        {"stiffness": [[0.0, 0.5], [1.0, 1.0]]},
        time={"duration": float(count - 1), "frames": count},
        water={"curve": [[float(k), 1.0 - 0.8 * (k % 2)] for k in range(count)]},
        shrink={"curve": [[0.0, 0.1], [1.0, 0.0]]},
        curl={"mismatch": [[0.0, 0.005], [1.0, 0.0]]},
    )
    points = frames_or_refusal(simulation)
    assert len(points) == count
    if how[0] == "quasistatic":
        for wet, dry in zip(points[2::2], points[3::2], strict=False):
            np.testing.assert_allclose(wet, points[0], rtol=0, atol=1e-4 * simulation.leaf.length)
            np.testing.assert_allclose(dry, points[1], rtol=0, atol=1e-4 * simulation.leaf.length)
        assert np.abs(points[1] - points[0]).max() > 1e-2 * simulation.leaf.length


def thin_map(name: str) -> np.ndarray:
    """Masks [ny, nx] that are hardly a leaf's."""
    mask = np.zeros((9, 30), bool)
    if name == "one cell wide":
        mask[4] = True
    elif name == "islands":
        mask[2:7, 2:9] = mask[3:6, 14:20] = mask[1, 25:28] = True
    elif name == "dead cells":
        mask[:] = np.random.default_rng(1).random(mask.shape) > 0.2
        mask[4] = True
    else:
        rows, columns = map(int, name.split(" x "))
        mask = np.ones((rows, columns), bool)
    return mask


@pytest.mark.parametrize("name", ["1 x 30", "30 x 1", "1 x 1", "one cell wide", "islands", "dead cells"])
@pytest.mark.parametrize("scheme", ["split", "unsplit"])
def test_leaves_on_thin_maps_and_islands_dry(name, scheme, device, precision):
    """Every spring finds water on the leaf, however little of the map is leaf; the account closes."""
    mask = thin_map(name)
    foot = np.zeros(mask.shape)
    foot[tuple(np.argwhere(mask)[len(np.argwhere(mask)) // 2])] = 1.0
    maps = {"water": np.where(mask, 0.9, 0.0), "source": foot, "venation": 0.5 * mask, "stomata": 1.0 * mask}
    leaf = leaf_of(strip(columns=6).mesh, 0.1, mask=mask, maps=maps)
    simulation = simulated(
        ("explicit", precision),
        leaf,
        device,
        time={"duration": 3600.0, "frames": 4},
        fluid={"step": 60.0, "scheme": scheme},
        source={"conductance": 1e-5, "cut_at": 1200.0},
        transpiration={"rate": 1e-4, "cuticle_rate": 5e-5},
        shrink={"curve": [[0.0, 0.1], [1.0, 0.0]], "vein_resistance": 0.5},
        curl={"mismatch": [[0.0, 0.002], [1.0, 0.0]]},
    )
    assert len(frames_or_refusal(simulation)) == 4
    for points in ("edge", "hinge", "vertex"):
        water = simulation.state[f"{points}_water"].numpy()
        # What transpires from a whole leaf would leave 0.54 everywhere.
        assert 0.4 < water.min() <= water.max() < 1.0
    assert abs(simulation.fluid.ledger().error) <= {"float32": 2e-6, "float64": 1e-13}[precision]


@by_every_method
def test_the_smallest_leaf_does_everything(how, device):
    """Two triangles and a map of two cells flow, dry, shrink, curl, stiffen and hang."""
    mesh = mesh_of(1e-2 * np.array([[0, 0], [1, 0], [0.5, 0.87], [1.5, 0.87]]), [[0, 1, 2], [1, 3, 2]])
    mask = np.ones((1, 2), bool)
    maps = {"water": np.ones((1, 2)), "venation": np.array([[1.0, 0.0]]), "stomata": np.ones((1, 2))}
    simulation = simulated(
        how,
        leaf_of(mesh, mask=mask, maps=maps),
        device,
        {"gravity": [0.0, 0.0, -1.0]},
        {"vein_stiffness": 3.0, "stiffness": [[0.0, 2.0], [1.0, 1.0]]},
        time={"duration": 3600.0, "frames": 12},
        fluid={"step": 60.0},
        transpiration={"rate": 5e-4, "cuticle_rate": 1e-4},
        shrink={"curve": [[0.0, 0.1], [1.0, 0.0]]},
        curl={"mismatch": [[0.0, 0.005], [1.0, 0.0]]},
    )
    assert len(frames_or_refusal(simulation)) == 12
    assert simulation.state["water"].numpy().max() < 1e-6
