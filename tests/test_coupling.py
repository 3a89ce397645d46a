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
from leafwarp.sim.vein_direction import edge_alignment, vein_directions
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


# A raster of parallel veins shows their direction to within 3 degrees; a direction that is sure by 0.99.
ALIGNMENT = 0.11


def leaf_with_parallel_veins(degrees: float, spacing: float = 4e-3) -> Leaf:
    """A strip of 8 cm by 3 cm with drawn, antialiased veins at an angle to its length, a quarter as wide as their
    spacing [m]."""
    plain = strip(0.08, 0.03, 16, jitter=0.2)
    rows, columns = 120, 320
    x = plain.frame.origin[0] + (np.arange(columns) + 0.5) / columns * plain.frame.size[0]
    y = plain.frame.origin[1] + (np.arange(rows) + 0.5) / rows * plain.frame.size[1]
    turn = np.radians(degrees)
    across = y[:, None] * np.cos(turn) - x[None, :] * np.sin(turn)
    to_vein = np.abs((across / spacing) % 1.0 - 0.5) * spacing
    venation = np.clip((0.125 * spacing - to_vein) * columns / plain.frame.size[0] + 0.5, 0.0, 1.0)
    return dataclasses.replace(plain, mask=np.ones((rows, columns), bool), maps={"venation": venation})


@pytest.mark.parametrize("degrees", [0, 30, 90])
def test_edges_know_how_they_lie_to_the_veins(degrees) -> None:
    leaf = leaf_with_parallel_veins(degrees)
    along = np.diff(leaf.mesh.positions[leaf.mesh.edges], axis=1)[:, 0]
    angle = np.arctan2(along[:, 1], along[:, 0]) - np.radians(degrees)
    assert np.abs(edge_alignment(leaf) - np.cos(2.0 * angle)).max() < ALIGNMENT


@pytest.mark.parametrize("degrees", [0, 30, 90])
def test_a_leaf_shrinks_along_and_across_its_veins_as_the_scene_says(degrees, device, precision) -> None:
    leaf = leaf_with_parallel_veins(degrees)
    along, across = 0.03, 0.12
    scene = scene_of(
        structure={"membrane_stiffness": 5.0, "damping": 0.3},
        motion={"drag": 20.0},
        shrink={"curve": [[0, across], [1, 0]], "along_veins": along / across},
        water={"curve": [[0.0, 1.0], [0.4, 0.0]]},
        time={"duration": 1.0, "frames": 60},
        solver={"precision": precision},
    )
    simulation = Simulation(scene, leaf, device)
    *_, last = simulation.frames()
    rest = leaf.mesh.positions - leaf.mesh.positions.mean(axis=0)
    moved = last.points[:, :2] - last.points[:, :2].mean(axis=0)
    stretch = np.linalg.lstsq(rest, moved, rcond=None)[0]
    values, directions = np.linalg.eigh(stretch @ stretch.T)
    # Springs at an angle shrink by the strain, not by the root of its square: half the square of its difference.
    assert 1.0 - np.sqrt(values) == pytest.approx([across, along], abs=0.003)
    turn = np.radians(degrees)
    assert abs(directions[:, 1] @ (np.cos(turn), np.sin(turn))) == pytest.approx(1.0, abs=2e-3)


def test_where_no_vein_shows_the_leaf_shrinks_by_the_mean_of_both() -> None:
    """No direction is sure in a plain lamina, where veins cross at right angles, or where they hardly show."""
    plain, crossed, crossing = (leaf_with_parallel_veins(degrees, 2e-3) for degrees in (0, 0, 90))
    plain.maps["venation"][:] = 0.4
    crossed.maps["venation"] = np.maximum(crossed.maps["venation"], crossing.maps["venation"])
    faint = leaf_with_parallel_veins(30)
    faint.maps["venation"] *= 1e-3
    assert np.abs(vein_directions(plain)).max() < 1e-20
    assert np.linalg.norm(vein_directions(faint), axis=-1).max() < 0.1
    # Near the margin the mean sees one vein more than those that cross it.
    assert np.linalg.norm(vein_directions(crossed), axis=-1)[20:-20, 20:-20].max() < 0.1
    scene = scene_of(shrink={"curve": [[0, 0.2], [1, 0]], "along_veins": 0.5}, water={"curve": [[0.0, 1.0]]})
    simulation = Simulation(scene, plain)
    simulation.state["edge_water"].fill_(0.0)
    simulation.stage("rest_lengths").run()
    ratio = simulation.state["edge_rest_length"].numpy() / material.edge_lengths(
        plain.mesh, material.rest_positions(scene, plain)
    )
    assert ratio == pytest.approx(1.0 - 0.15, rel=1e-6)


def test_the_margin_has_no_direction_of_its_own() -> None:
    """A leaf of one capacity ends in a step of the map, which is no vein."""
    leaf = leaf_with_parallel_veins(0)
    mask = np.zeros_like(leaf.mask)
    mask[20:-20, 30:-30] = True
    ragged = dataclasses.replace(leaf, mask=mask, maps={"venation": np.where(mask, 0.7, 0.0)})
    assert np.abs(vein_directions(ragged)).max() < 1e-9


SET_TABLES = {
    "shrink": {"curve": [[0, 0.3], [1, 0]]},
    "curl": {"mismatch": [[0, 0.02], [0.9, 0]]},
}
DRY_AND_REWATER = (1.0, 0.8, 0.5, 0.3, 0.5, 0.95, 1.0)


def set_history(plastic_set: float, contents, device: str, precision: str) -> dict[str, np.ndarray]:
    """Rest lengths and angles of a leaf whose water goes through some contents, each [len(contents), count]."""
    tables = {name: {**table, "plastic_set": plastic_set} for name, table in SET_TABLES.items()}
    simulation = bound(flowing(**tables), leaf_with_maps(), device, precision)
    seen = {"edge_rest_length": [], "hinge_rest_angle": []}
    for content in contents:
        simulation.state.upload("water_now", np.full(CELLS, content))
        simulation._couple(None)
        for name, values in seen.items():
            values.append(simulation.state[name].numpy().copy())
    return {name: np.array(values) for name, values in seen.items()}


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_what_dried_curled_stays_curled_by_a_share_when_rewatered(share, device, precision) -> None:
    plain = set_history(0.0, DRY_AND_REWATER, device, precision)
    kept = set_history(share, DRY_AND_REWATER, device, precision)
    driest = DRY_AND_REWATER.index(0.3)
    for name in plain:
        start, peak = plain[name][0], plain[name][driest]
        for step in range(driest, len(DRY_AND_REWATER)):
            expected = (1.0 - share) * plain[name][step] + share * peak
            assert np.abs(kept[name][step] - expected).max() < ROUNDINGS[precision] * np.abs(peak).max()
        assert np.abs(kept[name][-1] - start - share * (peak - start)).max() < (
            ROUNDINGS[precision] * np.abs(peak).max()
        )


def test_a_plastic_set_leaves_a_leaf_that_only_dries_alone(device, precision) -> None:
    drying = (1.0, 0.9, 0.6, 0.6, 0.1, 0.0)
    plain, kept = (set_history(share, drying, device, precision) for share in (0.0, 0.6))
    for name in plain:
        assert (plain[name] == kept[name]).all()


def test_a_second_drying_to_the_same_content_adds_nothing(device, precision) -> None:
    kept = set_history(0.5, (1.0, 0.4, 1.0, 0.4, 1.0), device, precision)
    for values in kept.values():
        assert (values[1] == values[3]).all() and (values[2] == values[4]).all()


def test_only_a_scene_with_a_plastic_set_remembers() -> None:
    def names(share: float) -> set[str]:
        shrink = {**SET_TABLES["shrink"], "plastic_set": share}
        return set(bound(flowing(shrink=shrink), leaf_with_maps(), "cpu", "float32").state.names)

    assert names(0.3) - names(0.0) == {"edge_rest_length_peak"}


def test_only_a_scene_that_shrinks_along_veins_looks_for_their_direction() -> None:
    shrink = {"curve": [[0, 0.2], [1, 0]]}
    assert scene_of(shrink=shrink).map_names == ()
    directed = scene_of(shrink={**shrink, "along_veins": 0.5})
    assert directed.map_names == ("venation",)
    # The directions are found on the host: no venation is sampled on the device.
    simulation = Simulation(directed, leaf_with_parallel_veins(0))
    assert not [name for name in simulation.state.names if "stencil" in name or "venation" in name]
