"""The coupling step: how the structure follows the water, against hand-computed values."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim import material
from leafwarp.sim.coupling import point_uv
from leafwarp.sim.simulation import Simulation
from meshes import scene_of, strip

# A parameter is a product of a few numbers of its own precision: some roundings of its own size.
ROUNDINGS = {"float32": 8 * np.finfo(np.float32).eps, "float64": 8 * np.finfo(np.float64).eps}
# A map value reaches a spring through float weights and one difference of contents near 1.
SAMPLING = {"float32": 4e-6, "float64": 1e-13}

CELLS = (24, 60)  # rows, columns


def leaf_with_maps(water: np.ndarray | float = 1.0, venation: np.ndarray | float = 0.0) -> Leaf:
    plain = strip(0.08, 0.03, 16, jitter=0.2)
    maps = {"water": np.broadcast_to(water, CELLS).copy(), "venation": np.broadcast_to(venation, CELLS).copy()}
    return dataclasses.replace(plain, mask=np.ones(CELLS, bool), maps=maps)


def flowing(**tables) -> Scene:
    """A scene with a fluid that stands still, so that the water stays what the map says."""
    fluid = {"step": 1.0, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0}
    return scene_of(**{"structure": {"bending_stiffness": 1e-6}, "fluid": fluid, **tables})


def bound(scene: Scene, leaf: Leaf, device: str, precision: str) -> Simulation:
    return Simulation(scene.with_changes({"solver.precision": precision}), leaf, device)


def left_to_right() -> np.ndarray:
    """Water that falls linearly along x, from 0.9 at the base."""
    return 0.9 - 0.5 * (np.arange(CELLS[1]) + 0.5)[None, :] / CELLS[1] + np.zeros((CELLS[0], 1))


def inside(uv: np.ndarray) -> np.ndarray:
    """Points between cell centres, where a bilinear sample of a linear field is exact."""
    return (np.abs(uv[:, 0] - 0.5) < 0.5 - 0.5 / CELLS[1]) & (np.abs(uv[:, 1] - 0.5) < 0.5 - 0.5 / CELLS[0])


def test_water_is_sampled_at_the_middle_of_every_spring(device, precision) -> None:
    leaf = leaf_with_maps(left_to_right())
    curve = [[0.0, 0.3], [1.0, 0.0]]
    simulation = bound(
        flowing(shrink={"curve": curve}, curl={"mismatch": [[0, 0.01], [1, 0]]}), leaf, device, precision
    )
    mesh = leaf.mesh
    middles = {
        "edge": leaf.uv[mesh.edges].mean(axis=1),
        "hinge": leaf.uv[mesh.hinges[:, 2:]].mean(axis=1),
        "vertex": leaf.uv,
    }
    for points, uv in middles.items():
        water = simulation.state[f"{points}_water"].numpy()
        expected = 0.9 - 0.5 * uv[:, 0]
        assert np.abs(water - expected)[inside(uv)].max() < SAMPLING[precision]
        assert water.min() >= 0.4 and water.max() <= 0.9


def test_a_dry_start_is_the_unstressed_shape(device, precision) -> None:
    """Curves act as their change since the photo was taken, so a leaf photographed half dry is at rest."""
    leaf = leaf_with_maps(left_to_right())
    tables = {"shrink": {"curve": [[0, 0.3], [0.55, 0.1], [1, 0]]}, "curl": {"mismatch": [[0, 0.02], [1, 0]]}}
    simulation = bound(flowing(**tables), leaf, device, precision)
    positions = material.rest_positions(simulation.scene, leaf)
    lengths = material.edge_lengths(leaf.mesh, positions).astype(precision)
    assert (simulation.state["edge_rest_length"].numpy() == lengths).all()
    angles = material.dihedral_angles(leaf.mesh, positions).astype(precision)
    assert (simulation.state["hinge_rest_angle"].numpy() == angles).all()


def drained(scene: Scene, leaf: Leaf, content: float, device: str, precision: str) -> Simulation:
    """A simulation whose water map is set to one content, then coupled."""
    simulation = bound(scene, leaf, device, precision)
    simulation.state.upload("water_now", np.full(CELLS, content))
    simulation._couple(None)
    return simulation


@pytest.mark.parametrize(("content", "shrink"), [(1.0, 0.0), (0.8, 0.04), (0.5, 0.15), (0.2, 0.3), (0.05, 0.3)])
def test_rest_lengths_follow_a_piecewise_linear_curve(content, shrink, device, precision) -> None:
    leaf = leaf_with_maps()
    curve = [[0.2, 0.3], [0.6, 0.1], [0.9, 0.0]]
    expected = {1.0: 0.0, 0.8: 0.1 / 3, 0.5: 0.15, 0.2: 0.3, 0.05: 0.3}[content]
    simulation = drained(flowing(shrink={"curve": curve}), leaf, content, device, precision)
    start = material.edge_lengths(leaf.mesh, material.rest_positions(simulation.scene, leaf))
    ratio = simulation.state["edge_rest_length"].numpy() / start
    assert np.abs(ratio - (1.0 - expected)).max() < ROUNDINGS[precision]


def test_veins_resist_shrinking_and_curling_in_proportion(device, precision) -> None:
    leaf = leaf_with_maps(venation=0.5)
    tables = {
        "shrink": {"curve": [[0, 0.4], [1, 0]], "vein_resistance": 0.5},
        "curl": {"mismatch": [[0, 0.02], [1, 0]], "thickness": 2e-4, "vein_resistance": 1.0},
    }
    simulation = drained(flowing(**tables), leaf, 0.25, device, precision)
    positions = material.rest_positions(simulation.scene, leaf)
    ratio = simulation.state["edge_rest_length"].numpy() / material.edge_lengths(leaf.mesh, positions)
    assert np.abs(ratio - (1.0 - 0.3 * (1.0 - 0.5 * 0.5))).max() < SAMPLING[precision]
    # Two equal layers with a mismatch of 0.015 bend to 1.5 * 0.015 / 2e-4 = 112.5 /m; a vein of 0.5 resists half.
    expected = material.dihedral_angles(leaf.mesh, positions) + 112.5 * 0.5 * material.hinge_span(leaf.mesh)
    angle = simulation.state["hinge_rest_angle"].numpy()
    assert np.abs(angle - expected).max() < SAMPLING[precision] * np.abs(expected).max()


@pytest.mark.parametrize("curve", [[[0.0, 1.0]], [[0.0, 0.5], [1.0, 1.5]]], ids=["constant", "varying"])
def test_stiffness_is_the_products_of_lamina_vein_and_water(curve, device, precision) -> None:
    leaf = leaf_with_maps(venation=0.25)
    structure = {"membrane_stiffness": 5.0, "bending_stiffness": 2e-6, "vein_stiffness": 9.0, "stiffness": curve}
    simulation = drained(flowing(structure=structure), leaf, 0.7, device, precision)
    factor = (1.0 + 8.0 * 0.25) * (1.2 if len(curve) > 1 else 1.0)
    edge = material.edge_stiffness(leaf.mesh, 5.0) * factor
    hinge = material.hinge_stiffness(leaf.mesh, 2e-6) * factor
    assert np.abs(simulation.state["edge_stiffness"].numpy() / edge - 1.0).max() < SAMPLING[precision]
    assert np.abs(simulation.state["hinge_stiffness"].numpy() / hinge - 1.0).max() < SAMPLING[precision]


def test_a_drying_leaf_gets_lighter(device, precision) -> None:
    leaf = leaf_with_maps()
    structure = {"dry_mass": 0.04, "water_mass": 0.3}
    simulation = drained(flowing(structure=structure), leaf, 0.5, device, precision)
    area = 0.08 * 0.03
    assert simulation.state["mass"].numpy().sum() == pytest.approx((0.04 + 0.15) * area, rel=1e-6)


def test_a_margin_is_not_half_dry(device, precision) -> None:
    """The outline's springs lie on the edge of the leaf's cells; what lies beyond must not dry them."""
    leaf = leaf_with_maps(0.8)
    mask = np.zeros(CELLS, bool)
    mask[6:-6, 8:-8] = True
    ragged = dataclasses.replace(leaf, mask=mask, maps={k: np.where(mask, v, 0.0) for k, v in leaf.maps.items()})
    simulation = bound(flowing(shrink={"curve": [[0, 0.3], [1, 0]]}), ragged, device, precision)
    assert (simulation.state["edge_water"].numpy() == np.array(0.8, precision)).all()
    assert (simulation.state["vertex_water"].numpy() == np.array(0.8, precision)).all()


def test_a_thin_vein_is_not_missed_by_luck() -> None:
    """Venation is smoothed to the edge length: a two-cell vein moved by half an edge still reaches the springs."""
    totals = []
    for shift in (0, 1, 2, 3):
        venation = np.zeros(CELLS)
        venation[10 + shift : 12 + shift] = 1.0
        leaf = leaf_with_maps(venation=venation)
        simulation = bound(flowing(structure={"vein_stiffness": 5.0}), leaf, "cpu", "float64")
        totals.append(simulation.state["edge_venation"].numpy().mean())
    assert max(totals) / min(totals) < 1.25


def test_prescribed_water_is_the_curve_at_the_frames_time(device, precision) -> None:
    scene = scene_of(
        water={"curve": [[0.0, 1.0], ["1 h", 0.6], ["3 h", 0.4]]},
        time={"duration": "4 h", "frames": 5},
        solver={"precision": precision},
    )
    simulation = Simulation(scene, strip(0.08, 0.03, 8), device)
    water = [frame.water for frame in simulation.frames()]
    for values, expected in zip(water, [1.0, 0.6, 0.5, 0.4, 0.4], strict=True):
        assert (values == np.float32(np.array(expected, precision))).all()


def test_midpoints_of_hinges_lie_between_the_opposite_vertices() -> None:
    leaf = leaf_with_maps()
    first = leaf.mesh.hinges[0]
    assert point_uv(leaf, "hinge")[0] == pytest.approx((leaf.uv[first[2]] + leaf.uv[first[3]]) / 2)
