"""Spring constants, rest shape, masses and pins."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.leaf.leaf import LeafMesh
from leafwarp.sim import material
from leafwarp.sim.material import (
    cambered_positions,
    edge_stiffness,
    hinge_span,
    hinge_stiffness,
    pinned_vertices,
)
from leafwarp.sim.simulation import Simulation
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


def row_of_triangles(side: float, width: float, lean: float = 0.0):
    """A single row: sides on its margins, along x, leaning by a share of a side."""
    places = np.arange(25)
    return mesh_of(
        np.column_stack((0.5 * side * places + lean * side * (places % 2), width * (places % 2))),
        [(k, k + 1, k + 2) if k % 2 else (k, k + 2, k + 1) for k in range(23)],
    )


@pytest.mark.parametrize("lean", [0.0, 0.3])
@pytest.mark.parametrize("flatness", [0.3, 2.0 / 3.0**0.5, 4.0])
def test_a_single_row_of_triangles_bends_as_a_narrow_strip_whatever_their_shape(flatness, lean):
    """A strip of a sheet of bending Poisson ratio nu bends with D (1 - nu^2)."""
    kappa, width = 0.5, 1e-2
    mesh = row_of_triangles(flatness * width, width, lean)
    # Rolled up; triangles at the ends have two sides on the margin, and their hinges are not of the row.
    x, y = mesh.positions.T
    rolled = np.column_stack((np.sin(kappa * x) / kappa, y, (1.0 - np.cos(kappa * x)) / kappa))
    inner = slice(1, -1)
    hinges = np.argsort(mesh.positions[mesh.hinges[:, :2], 0].mean(axis=1))[inner]
    angles = material.dihedral_angles(mesh, rolled)[hinges]
    if lean == 0.0:
        np.testing.assert_allclose(angles, kappa * hinge_span(mesh)[hinges], rtol=1e-3)
        length = 0.5 * flatness * width * len(angles)
        energy = 0.5 * np.sum(hinge_stiffness(mesh, 3.0)[hinges] * angles**2)
        assert energy == pytest.approx(0.5 * 3.0 * (8.0 / 9.0) * kappa**2 * length * width, rel=1e-3)
    edges = np.diff(mesh.positions[mesh.hinges[hinges, :2]], axis=1)[:, 0]
    across = np.abs(edges[:, 1]) / np.linalg.norm(edges, axis=1)
    length = 0.5 * flatness * width * len(hinges)
    # A moment about the width turns each hinge by its share along the edge; together they turn the row's end as it
    # would turn that of a beam.
    turned = np.sum(across**2 / hinge_stiffness(mesh, 3.0)[hinges])
    assert turned == pytest.approx(length / (3.0 * (8.0 / 9.0) * width))
    # And free of loads, at its rest angles, by as much as its natural curvature.
    assert np.sum(hinge_span(mesh)[hinges] * across) == pytest.approx(length)
    if flatness == 2.0 / 3.0**0.5 and lean == 0.0:
        areas = mesh.vertex_areas.sum() / mesh.triangle_count
        lengths = np.linalg.norm(edges, axis=1)
        np.testing.assert_allclose(hinge_stiffness(mesh, 3.0)[hinges], 3.0 * lengths**2 / (2.0 * areas))


def test_hinges_beside_a_margin_are_not_of_a_single_row():
    mesh = equilateral_patch(3)
    height = material.hinge_height(mesh)
    inside = np.isin(mesh.hinges[:, :2], [5, 6, 9, 10]).any(axis=1)
    np.testing.assert_allclose(hinge_span(mesh)[inside], 2.0 / 3.0 * height[inside])


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


SHEET = {
    "thickness": "0.2 mm",
    "vein_thickness": "0.2 mm",
    "lamina_modulus": "30 MPa",
    "vein_modulus": "30 MPa",
    "poisson_ratio": 0.3,
    "shrink_across": 0.0,
    "shrink_along": 0.0,
    "mismatch": 0.0,
}
MEMBRANE, BENDING = 30e6 * 2e-4, 30e6 * (2e-4) ** 3 / (12.0 * (1.0 - 0.3**2))


def sheet_springs(columns: int, jitter: float = 0.0) -> tuple[LeafMesh, np.ndarray, np.ndarray]:
    """A strip of a uniform material, and the stiffness of its springs as the simulation has them."""
    # As wide as four rows of equilateral triangles at ten columns, so that the triangles are equilateral.
    leaf = strip(0.1, 0.04 * 0.75**0.5, columns, jitter, seed=1)
    state = Simulation(scene_of(material=SHEET), leaf).state
    return leaf.mesh, state["edge_stiffness"].numpy(), state["hinge_stiffness"].numpy()


def pulled(mesh: LeafMesh, stiffness: np.ndarray) -> tuple[float, float]:
    """Tension over strain [N/m] and contraction over strain of a strip in small stretch, free at its sides."""
    x, y = mesh.positions.T
    directions = np.diff(mesh.positions[mesh.edges], axis=1)[:, 0]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    system = np.zeros((mesh.vertex_count, 2, mesh.vertex_count, 2))
    for (a, b), k, u in zip(mesh.edges, stiffness, directions, strict=True):
        block = k * np.outer(u, u)
        system[a, :, a] += block
        system[b, :, b] += block
        system[a, :, b] -= block
        system[b, :, a] -= block
    system = system.reshape(2 * mesh.vertex_count, -1)
    left, right = np.flatnonzero(x < 1e-9), np.flatnonzero(x > x.max() - 1e-9)
    fixed = np.concatenate((2 * left, 2 * right, [2 * left[np.argmin(np.abs(y[left]))] + 1]))
    free = np.setdiff1d(np.arange(len(system)), fixed)
    moved = np.zeros(len(system))
    strain = 1e-3
    moved[2 * right] = strain * x.max()
    moved[free] = np.linalg.solve(system[np.ix_(free, free)], -system[np.ix_(free, fixed)] @ moved[fixed])
    tension = (system @ moved)[2 * right].sum() / np.ptp(y)
    inner = np.abs(x / x.max() - 0.5) < 0.3
    return tension / strain, -np.polyfit(y[inner], moved[1::2][inner], 1)[0] / strain


@pytest.mark.parametrize("columns", [10, 20])
def test_a_stretched_strip_has_the_membrane_stiffness_of_its_material(columns):
    stiffness, poisson = pulled(*sheet_springs(columns)[:2])
    # The triangles at the ends are no equilateral ones.
    assert stiffness == pytest.approx(MEMBRANE, rel=0.01)
    assert poisson == pytest.approx(1.0 / 3.0, rel=0.02)


def test_on_an_irregular_mesh_the_membrane_stiffness_nears_its_materials_with_the_resolution():
    errors = [abs(pulled(*sheet_springs(columns, jitter=0.2)[:2])[0] / MEMBRANE - 1.0) for columns in (10, 20)]
    assert errors[0] < 0.1 and errors[1] < 0.7 * errors[0]


CURVATURE = 0.2  # [1/m]
# Second derivatives of the height over the curvature, and the energy over D curvature^2 / 2 of a sheet whose Poisson
# ratio in bending is -1/3: k1^2 + k2^2 - 2/3 k1 k2.
BENT = {
    "along": ([[1.0, 0.0], [0.0, 0.0]], 1.0),
    "across": ([[0.0, 0.0], [0.0, 1.0]], 1.0),
    "at 45 degrees": ([[0.5, 0.5], [0.5, 0.5]], 1.0),
    "bowl": ([[1.0, 0.0], [0.0, 1.0]], 4.0 / 3.0),
    "saddle": ([[1.0, 0.0], [0.0, -1.0]], 8.0 / 3.0),
}


@pytest.mark.parametrize("form", BENT)
def test_a_bent_strip_has_the_bending_stiffness_of_its_material(form):
    hessian, expected = BENT[form]
    ratios = []
    for columns in (10, 20):
        mesh, _, stiffness = sheet_springs(columns)
        height = 0.5 * CURVATURE * np.einsum("vi,ij,vj->v", mesh.positions, np.array(hessian), mesh.positions)
        angles = material.dihedral_angles(mesh, np.column_stack((mesh.positions, height)))
        energy = 0.5 * np.sum(stiffness * angles**2)
        # A hinge stands for a third of its triangles; there is none along the margin.
        area = np.sum(hinge_span(mesh) * np.linalg.norm(np.diff(mesh.positions[mesh.hinges[:, :2]], axis=1), axis=2).T)
        ratios.append(energy / (0.5 * area * 0.5 * BENDING * CURVATURE**2))
    coarse, fine = ratios
    # The margin's share of the hinges falls with the edge length, and with it the error.
    assert fine == pytest.approx(expected, rel=0.1)
    assert abs(fine - expected) < 0.6 * abs(coarse - expected)
    assert 2.0 * fine - coarse == pytest.approx(expected, rel=0.02)
