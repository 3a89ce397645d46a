"""Spring constants, rest shape, masses and pins."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.sim import material
from leafwarp.sim.material import (
    cambered_positions,
    edge_stiffness,
    hinge_span,
    hinge_stiffness,
    pinned_vertices,
)
from meshes import leaf_of, mesh_of, scene_of, strip, two_triangles


def test_an_equilateral_sheet_has_the_membrane_stiffness_asked_for():
    mesh = two_triangles(side=0.02).mesh
    inner = [i for i, edge in enumerate(mesh.edges) if set(edge) == {0, 1}]
    # E h = 2 k / sqrt(3) for an edge between two equilateral triangles.
    np.testing.assert_allclose(2.0 * edge_stiffness(mesh, 7.0)[inner] / np.sqrt(3.0), 7.0, rtol=1e-12)


def equilateral_patch(cells: int = 12, side: float = 0.01):
    """A parallelogram of equilateral triangles."""
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    positions = side * np.column_stack((column + 0.5 * row, 0.75**0.5 * row))
    corners = [j * (cells + 1) + i for j in range(cells) for i in range(cells)]
    lower = [(v, v + 1, v + cells + 1) for v in corners]
    upper = [(v + 1, v + cells + 2, v + cells + 1) for v in corners]
    return mesh_of(positions, lower + upper)


@pytest.mark.parametrize("strain", [[[1e-5, 0], [0, 0]], [[1e-5, 0], [0, 1e-5]], [[0, 1e-5], [1e-5, 0]]])
def test_a_uniform_strain_stores_the_energy_of_a_sheet_of_poisson_ratio_one_third(strain):
    mesh, membrane, nu = equilateral_patch(), 11.0, 1.0 / 3.0
    flat = np.column_stack((mesh.positions, np.zeros(mesh.vertex_count)))
    moved = flat.copy()
    moved[:, :2] += mesh.positions @ np.array(strain)
    change = material.edge_lengths(mesh, moved) - material.edge_lengths(mesh, flat)
    energy = 0.5 * np.sum(edge_stiffness(mesh, membrane) * change**2) / mesh.vertex_areas.sum()
    exact = (1 - nu) * np.sum(np.square(strain)) + nu * np.trace(strain) ** 2
    # The strain is small, not infinitesimal.
    assert energy == pytest.approx(membrane / (2 * (1 - nu**2)) * exact, rel=1e-4)


def test_a_shallow_bowl_has_the_rest_angles_of_its_curvature():
    mesh, kappa = equilateral_patch(), 0.5
    center = mesh.positions - mesh.positions.mean(axis=0)
    bowl = np.column_stack((mesh.positions, 0.5 * kappa * np.sum(center**2, axis=1)))
    # Slopes up to 3 % change the angles by their square.
    np.testing.assert_allclose(material.dihedral_angles(mesh, bowl), kappa * hinge_span(mesh), rtol=5e-3)


def test_hinge_constants_follow_their_formulas():
    mesh = mesh_of([[0, 0], [2, 0], [0.5, 1.0], [1.5, -3.0]], [[0, 1, 2], [1, 0, 3]])
    np.testing.assert_allclose(hinge_span(mesh), (1.0 + 3.0) / 3.0)
    np.testing.assert_allclose(hinge_stiffness(mesh, 5.0), 5.0 * 4.0 / (1.0 + 3.0))


def test_mass_follows_the_water():
    mesh = two_triangles().mesh
    total = 2 * 0.75**0.5 / 2 * 1e-4
    assert material.vertex_mass(mesh, 0.05, 0.25).sum() == pytest.approx(0.30 * total)
    assert material.vertex_mass(mesh, 0.05, 0.25, np.zeros(4)).sum() == pytest.approx(0.05 * total)


@pytest.mark.parametrize("seed", range(8))
def test_camber_is_small_smooth_and_the_same_on_every_mesh(seed):
    coarse, fine = strip(columns=10), strip(columns=40, jitter=0.2)
    lifted = cambered_positions(coarse, 0.02, seed)
    np.testing.assert_array_equal(lifted[:, :2], coarse.mesh.positions)
    assert 0.15 * 0.02 * coarse.length < np.abs(lifted[:, 2]).max() <= 0.02 * coarse.length
    # A vertex in the same place is lifted alike.
    other = cambered_positions(fine, 0.02, seed)
    shared = 0
    for position, height in zip(coarse.mesh.positions, lifted[:, 2], strict=True):
        near = np.argmin(np.hypot(*(fine.mesh.positions - position).T))
        if np.allclose(fine.mesh.positions[near], position, atol=1e-12):
            assert other[near, 2] == pytest.approx(height, abs=1e-12)
            shared += 1
    assert shared >= 4
    # No height and no slope at the base.
    near_base = np.hypot(*fine.mesh.positions.T) < 0.1 * fine.length
    assert np.abs(other[near_base, 2]).max() <= 0.02 * fine.length * 0.1**2


def test_camber_depends_on_the_seed_and_vanishes_at_zero():
    leaf = strip()
    assert not np.allclose(cambered_positions(leaf, 0.02, 0), cambered_positions(leaf, 0.02, 1))
    assert np.all(cambered_positions(leaf, 0.0, 3)[:, 2] == 0.0)


def test_pins():
    leaf = strip(columns=20)
    distance = np.hypot(*leaf.mesh.positions.T)

    def pinned(**motion):
        return pinned_vertices(leaf, scene_of(motion=motion).motion)

    np.testing.assert_array_equal(pinned(), distance <= 0.03 * leaf.length)
    np.testing.assert_array_equal(pinned(pin_radius=0.02), distance <= 0.02)
    assert pinned(pin_radius=0.0).sum() == 1 and pinned(pin_radius=0.0)[np.argmin(distance)]
    clamped = pinned(pin_radius=0.0, clamp=True)
    touching = leaf.mesh.triangles[(leaf.mesh.triangles == np.argmin(distance)).any(axis=1)]
    assert set(np.flatnonzero(clamped)) == set(touching.ravel())


def test_a_leaf_whose_base_is_off_the_mesh_still_has_a_pin():
    leaf = leaf_of(mesh_of([[1.0, 0.0], [2.0, 0.0], [1.5, 1.0]], [[0, 1, 2]]))
    np.testing.assert_array_equal(pinned_vertices(leaf, scene_of().motion), [True, False, False])
