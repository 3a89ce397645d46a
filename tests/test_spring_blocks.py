"""The springs in a CPU's vector lanes, against the kernels of a GPU: a vertex's edges, or a hinge, a thread."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from leafwarp.sim.spring_blocks import hinge_edges, in_blocks
from leafwarp.study.verify.drawn_leaf import flat
from leafwarp_kernels.angular_springs import angular_spring_forces
from leafwarp_kernels.edge_springs import edge_spring_forces
from leafwarp_kernels.hinge_gather import gather_hinge_forces
from meshes import scene_of, strip, two_triangles
from structure_reference import crumpled, rig_of

# Of the largest force: sums of some twenty forces, in another order.
ROUNDING = {"float32": 1e-5, "float64": 1e-14}
STRUCTURE = {"bending_stiffness": 1e-6}


def a_thread_a_spring(rig) -> np.ndarray:
    """The forces by the scalar kernels; the hinges' angles are put back."""
    state, mesh = rig.state, rig.leaf.mesh
    springs = ["vertex_edge_start", "vertex_edges", "vertex_neighbors", "edge_rest_length", "edge_stiffness"]
    inputs = ["position", "velocity", *springs, "damping_time"]
    state.record(edge_spring_forces, mesh.vertex_count, inputs, ["force"]).run()
    if "hinge_angle" in state:
        angle = state["hinge_angle"].numpy().copy()
        forces = wp.zeros(4 * mesh.hinge_count, dtype=state.vector, device=state.device)
        springs = ["hinge_vertices", "hinge_rest_angle", "hinge_stiffness", "damping_time"]
        inputs = ["position", "velocity", *springs]
        state.record(angular_spring_forces, mesh.hinge_count, inputs, ["hinge_angle", forces]).run()
        inputs = ["vertex_hinge_start", "vertex_hinge_slots", forces]
        state.record(gather_hinge_forces, mesh.vertex_count, inputs, ["force"]).run()
        state.upload("hinge_angle", angle)
    return rig.get("force")


@pytest.mark.parametrize("structure", [{}, STRUCTURE])
@pytest.mark.parametrize("amount", [0.0, 0.02, 0.3, 2.0])
def test_lanes_agree_with_a_thread_a_spring(structure: dict, amount: float, device: str, precision: str) -> None:
    """On a flat, a wavy, a crumpled and a tangled strip, damped and moving."""
    rig = rig_of(scene_of(structure), strip(columns=9, jitter=0.15), device, precision)
    random, mesh = np.random.default_rng(3), rig.leaf.mesh
    rig.put(
        position=crumpled(rig.leaf, amount),
        velocity=random.normal(size=(mesh.vertex_count, 3)),
        damping_time=[3e-3],
        edge_stiffness=random.uniform(1.0, 9.0, mesh.edge_count),
    )
    names = ["edge_springs"]
    if structure:
        rig.put(hinge_rest_angle=random.uniform(-4.0, 4.0, mesh.hinge_count))
        names.append("angular_springs")
    expected = a_thread_a_spring(rig)
    assert np.abs(expected).max() > 0.0
    actual = rig.forces(*names)
    assert actual == pytest.approx(expected, abs=ROUNDING[precision] * np.abs(expected).max())


def test_edges_without_length_and_triangles_without_area_push_nothing_to_infinity(device: str, precision: str) -> None:
    rig = rig_of(scene_of(STRUCTURE), two_triangles(), device, precision)
    positions = flat(rig.leaf)
    positions[1] = positions[0]
    rig.put(position=positions)
    names = ("edge_springs", "angular_springs")
    assert np.isfinite(rig.forces(*names)).all()
    assert rig.forces(*names) == pytest.approx(a_thread_a_spring(rig), abs=1e-6)
    rig.put(position=np.zeros_like(positions))
    assert not rig.forces(*names).any()


def test_every_hinge_lies_on_its_edge() -> None:
    mesh = strip(columns=6, jitter=0.1).mesh
    edges = mesh.edges[hinge_edges(mesh)]
    assert np.array_equal(np.sort(mesh.hinges[:, :2], axis=1), np.sort(edges, axis=1))
    assert len(np.unique(hinge_edges(mesh))) == mesh.hinge_count


def test_the_last_block_is_filled_up() -> None:
    blocks = in_blocks(np.arange(70).reshape(35, 2), -1)
    assert blocks.shape == (2, 2, 32)
    assert blocks[0, :, 3].tolist() == [6, 7]
    assert blocks[1, :, 2].tolist() == [68, 69]
    assert (blocks[1, :, 3:] == -1).all()
