"""The equilibrium of plain arrays, against what a spring, a hinge and a beam do."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.sim import material
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.equilibrium import equilibrium
from meshes import strip, two_triangles


def test_a_loaded_spring_stretches_by_its_load(device):
    positions = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    load = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.5]])
    found = equilibrium(
        positions, [[0, 1]], [0.1], [20.0], pinned=[True, False], loads=load, masses=[1.0, 0.01], device=device
    )
    # It swings down under the load, the weight of a mass not asked for left out, and hangs longer by F / k.
    np.testing.assert_allclose(found.positions[1], [0.0, 0.0, -0.125], rtol=0, atol=1e-7)
    assert found.energy == pytest.approx(0.5 * 20.0 * 0.025**2 - 0.5 * 0.125, rel=1e-6)
    assert found.residual < 1e-6 and found.iterations > 1


def test_a_hinge_folds_to_its_rest_angle_without_any_hold(device):
    mesh = two_triangles().mesh
    flat = np.column_stack((mesh.positions, np.zeros(4)))
    found = equilibrium(
        flat,
        mesh.edges,
        material.edge_lengths(mesh, flat),
        np.full(mesh.edge_count, 1e3),
        hinges=mesh.hinges,
        rest_angles=[0.8],
        hinge_stiffness=[1e-6],
        device=device,
    )
    assert material.dihedral_angles(mesh, found.positions)[0] == pytest.approx(0.8, abs=1e-6)


def cantilever(columns, membrane, weight, device, tolerance=1e-6, start=None):
    """A strip of 0.2 mm that is clamped at its left end and bends under its weight."""
    leaf = strip(length=0.1, width=0.03, columns=columns)
    mesh, bending = leaf.mesh, membrane * 2e-4**2 / 12.0
    flat = np.column_stack((mesh.positions, np.zeros(mesh.vertex_count)))
    found = equilibrium(
        flat if start is None else start,
        mesh.edges,
        material.edge_lengths(mesh, flat),
        material.edge_stiffness(mesh, membrane),
        hinges=mesh.hinges,
        hinge_stiffness=material.hinge_stiffness(mesh, bending),
        masses=weight * bending / (9.81 * 0.1**3) * mesh.vertex_areas,
        pinned=mesh.positions[:, 0] < 0.1 / columns,
        gravity=(0.0, 0.0, -9.81),
        tolerance=tolerance,
        device=device,
    )
    return leaf, found


@pytest.mark.parametrize("membrane", [1e3, 1e5])
@pytest.mark.parametrize("weight", [0.1, 5.0, 200.0])
def test_a_strip_bends_the_same_at_any_membrane_stiffness(device, membrane, weight):
    _, found = cantilever(16, membrane, weight, device)
    _, other = cantilever(16, 1e4, weight, device)
    droop, expected = found.positions[:, 2].min(), other.positions[:, 2].min()
    assert droop == pytest.approx(expected, rel=2e-2)
    if weight == 0.1:
        # A beam's weight bends it by Gamma / 8 of its length; the clamp takes a cell of it.
        assert droop == pytest.approx(-0.1 * 0.1 / 8.0, rel=0.2)


def test_the_equilibrium_does_not_depend_on_the_way_there(device):
    leaf, found = cantilever(16, 1e4, 20.0, device)
    start = np.column_stack((leaf.mesh.positions, np.zeros(leaf.mesh.vertex_count)))
    start[:, 2] = -0.02 * np.sin(30.0 * start[:, 0]) * (start[:, 0] > 0.1 / 16)
    _, other = cantilever(16, 1e4, 20.0, device, start=start)
    np.testing.assert_allclose(other.positions, found.positions, rtol=0, atol=1e-5 * leaf.length)


def test_a_finer_tolerance_moves_it_no_more(device):
    leaf, coarse = cantilever(12, 1e4, 50.0, device, tolerance=1e-4)
    _, fine = cantilever(12, 1e4, 50.0, device, tolerance=1e-9)
    assert fine.residual < 0.1 * max(coarse.residual, 1e-9)
    np.testing.assert_allclose(coarse.positions, fine.positions, rtol=0, atol=1e-5 * leaf.length)


def test_what_falls_has_no_equilibrium(device):
    mesh = two_triangles().mesh
    flat = np.column_stack((mesh.positions, np.zeros(4)))
    with pytest.raises(NotConverged):
        equilibrium(
            flat,
            mesh.edges,
            material.edge_lengths(mesh, flat),
            np.full(mesh.edge_count, 1e3),
            masses=np.full(4, 1e-6),
            gravity=(0.0, 0.0, -9.81),
            device=device,
        )
