"""What the mass-spring mesh is made of: spring constants, masses, the rest shape and the pins, in NumPy
float64."""

from __future__ import annotations

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf, LeafMesh
from leafwarp.leaf.specimen import Specimen
from leafwarp.scene import MotionTable, Scene

PIN_RADIUS = 0.03  # of the leaf's length
BENDING_POISSON_RATIO = -1.0 / 3.0  # of the sheet that hinges on equilateral triangles stand for


def edge_stiffness(mesh: LeafMesh, membrane_stiffness: float | np.ndarray) -> np.ndarray:
    """Stiffness of each edge spring [N/m], shape [edge_count].

    ``k = E h (sum of the adjacent triangles' areas) / |e|^2`` (Van Gelder 1998). On an equilateral mesh the
    sheet then has the membrane stiffness ``E h = 2 k / sqrt(3)`` and the Poisson ratio 1/3.

    Args:
        mesh: The flat mesh.
        membrane_stiffness: Young's modulus times thickness, ``E h`` [N/m], one for all or shape [edge_count].
    """
    return membrane_stiffness * mesh.edge_areas / _squared_lengths(mesh, mesh.edges)


def hinge_stiffness(mesh: LeafMesh, bending_stiffness: float | np.ndarray) -> np.ndarray:
    """Stiffness of each angular spring [N m/rad], shape [hinge_count]: ``k = D |e|^2 / (A1 + A2)``.

    Where the mesh is a single row of triangles, a petiole or a sheath, all bending is along the row, and that formula
    would make it as much too soft or too stiff as its triangles are slim or flat, ``(1 + (b / 2 w)^2)^2 / 2`` times
    ``D`` with sides of ``b`` along a row of the width ``w``. There ``k = 8/9 D (A1 + A2) / (2 s^2)`` with the span
    ``s`` of :func:`hinge_span`, which bends as a narrow strip of the sheet does, whatever the triangles (equilateral
    ones as by the other formula).

    Args:
        mesh: The flat mesh.
        bending_stiffness: ``D = E h^3 / (12 (1 - nu^2))`` of the sheet [N m], one for all or shape [hinge_count]. The
            hinges stand for a sheet whose bending Poisson ratio is -1/3: a narrow strip bends with about 0.95 D, a
            very narrow one with 8/9 D.
    """
    areas, span = _hinge_areas(mesh), _row_span(mesh)
    stiffness = _squared_lengths(mesh, mesh.hinges[:, :2]) / areas
    in_row = span > 0.0
    stiffness[in_row] = (1.0 - BENDING_POISSON_RATIO**2) * areas[in_row] / (2.0 * span[in_row] ** 2)
    return bending_stiffness * stiffness


def hinge_span(mesh: LeafMesh) -> np.ndarray:
    """Length that each hinge's angle stands for [m], shape [hinge_count].

    A sheet of natural curvature ``kappa`` has the rest angles ``kappa * span``, whatever the mesh. It is the distance
    between the centroids of the two triangles, measured across the edge; in a single row of triangles the mean of their
    shares of the row's length, over the cosine by which the edge leans out of the row's normal.
    """
    span = _row_span(mesh)
    return np.where(span > 0.0, span, 2.0 / 3.0 * hinge_height(mesh))


def hinge_height(mesh: LeafMesh) -> np.ndarray:
    """Mean height of each hinge's two triangles over its edge [m], shape [hinge_count]."""
    return _hinge_areas(mesh) / np.sqrt(_squared_lengths(mesh, mesh.hinges[:, :2]))


def vertex_mass(mesh: LeafMesh, dry_mass: float, water_mass: float, water: float | np.ndarray = 1.0) -> np.ndarray:
    """Mass of each vertex [kg], shape [vertex_count]: ``(dry mass + water mass * y) * vertex area``.

    Args:
        mesh: The flat mesh.
        dry_mass: Mass of the dry leaf [kg/m^2].
        water_mass: Mass of the water of the saturated leaf [kg/m^2].
        water: Relative water content, one for all or shape [vertex_count].
    """
    return (dry_mass + water_mass * np.asarray(water, dtype=np.float64)) * mesh.vertex_areas


def cambered_positions(leaf: Leaf, camber: float, seed: int) -> np.ndarray:
    """Rest positions [m], shape [vertex_count, 3]: the flat mesh lifted by a smooth, small imperfection.

    A leaf that shrinks in its plane is in equilibrium however much it wants to buckle; the camber decides
    which way it goes. It is a shallow bowl toward the photographed side, warped by a seeded saddle and a
    seeded cubic wave:

        z / (camber L) = r^2 / 2 + a r^2 cos(2 phi - alpha) / 4 + b r^3 cos(3 phi - beta) / 4,      |a|, |b|
        <= 1,

    with the polar coordinates ``r`` (in lengths ``L`` of the leaf, so at most 1) and ``phi`` about the
    petiole base. It depends on the place on the leaf alone, not on the mesh, is flat at the base, and is
    nowhere higher than ``camber * L``.

    Args:
        leaf: The leaf; the petiole base is the origin.
        camber: Height as a share of the leaf's length.
        seed: Chooses the saddle and the wave.
    """
    random = np.random.default_rng(seed)
    saddle, wave = random.uniform(-1.0, 1.0, size=2)
    saddle_turn, wave_turn = random.uniform(0.0, 2.0 * np.pi, size=2)
    point = (leaf.mesh.positions[:, 0] + 1j * leaf.mesh.positions[:, 1]) / leaf.length
    height = 0.5 * np.abs(point) ** 2
    height += 0.25 * saddle * (point**2 * np.exp(-1j * saddle_turn)).real
    height += 0.25 * wave * (point**3 * np.exp(-1j * wave_turn)).real
    return np.column_stack((leaf.mesh.positions, camber * leaf.length * height))


def rest_positions(scene: Scene, leaf: Leaf) -> np.ndarray:
    """The unstressed shape that a scene asks for, the photo's with its camber [m], shape [vertex_count, 3]."""
    return leaf.join(lambda photo, specimen: _rest_shape(scene, photo, specimen))


def start_positions(scene: Scene, leaf: Leaf) -> np.ndarray:
    """The unstressed shape as each leaf is turned in the world, about its petiole base [m], shape [vertex_count, 3]."""

    def turned(photo: Leaf, specimen: Specimen) -> np.ndarray:
        shape = _rest_shape(scene, photo, specimen)
        return shape if specimen.rotation is None else shape @ specimen.rotation.T

    return leaf.join(turned)


def _rest_shape(scene: Scene, photo: Leaf, specimen: Specimen) -> np.ndarray:
    camber = scene.leaf.camber if specimen.camber is None else specimen.camber
    seed = scene.leaf.seed if specimen.seed is None else specimen.seed
    return specimen.size * cambered_positions(photo, camber, seed)


def membrane_stiffness(scene: Scene, leaf: Leaf) -> np.ndarray:
    """``E h`` of the lamina at every edge spring [N/m], shape [edge_count]."""
    factor = leaf.join(lambda photo, specimen: np.full(photo.mesh.edge_count, specimen.stiffness))
    return scene.structure.membrane_stiffness * factor


def bending_stiffness(scene: Scene, leaf: Leaf) -> np.ndarray:
    """``D`` of the lamina at every angular spring [N m], shape [hinge_count]; 0 where the scene has none."""
    factor = leaf.join(lambda photo, specimen: np.full(photo.mesh.hinge_count, specimen.stiffness))
    return (scene.structure.bending_stiffness or 0.0) * factor


def edge_lengths(mesh: LeafMesh, positions: np.ndarray) -> np.ndarray:
    """Length of each edge [m], shape [edge_count], at positions [m], shape [vertex_count, 3]."""
    ends = positions[mesh.edges]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def dihedral_angles(mesh: LeafMesh, positions: np.ndarray) -> np.ndarray:
    """Signed angle of each hinge [rad], in (-pi, pi], 0 where flat, positive where folded toward the
    photographed side.

    Args:
        mesh: The mesh.
        positions: Vertex positions [m], shape [vertex_count, 3].
    """
    a, b, c, d = np.moveaxis(positions[mesh.hinges], 1, 0)
    edge = b - a
    first, second = np.cross(edge, c - a), np.cross(d - a, edge)
    sine = np.linalg.norm(edge, axis=1) * np.einsum("ij,ij->i", c - a, second)
    return np.arctan2(sine, np.einsum("ij,ij->i", first, second))


def pinned_vertices(leaf: Leaf, motion: MotionTable) -> np.ndarray:
    """Which vertices are held, shape [vertex_count], bool.

    Those within ``pin_radius`` of the petiole base, the nearest one at least. With ``clamp`` also every
    vertex of a triangle that touches them, so that the direction is held, too.

    Raises:
        InputError: The whole leaf would be held.
    """
    return leaf.join(lambda photo, specimen: _pinned(photo, specimen.size, motion))


def _pinned(leaf: Leaf, size: float, motion: MotionTable) -> np.ndarray:
    distance = size * np.hypot(*leaf.mesh.positions.T)
    length = size * leaf.length
    radius = PIN_RADIUS * length if motion.pin_radius is None else motion.pin_radius
    pinned = distance <= radius
    pinned[np.argmin(distance)] = True
    if motion.clamp:
        first_row = leaf.mesh.triangles[pinned[leaf.mesh.triangles].any(axis=1)]
        pinned[first_row.ravel()] = True
    if pinned.all():
        raise InputError(
            f"motion.pin_radius = {radius:g} m holds every vertex of the leaf; accepted: less than its length, "
            f"{length:g} m"
        )
    return pinned


def _squared_lengths(mesh: LeafMesh, edges: np.ndarray) -> np.ndarray:
    along = mesh.positions[edges[:, 1]] - mesh.positions[edges[:, 0]]
    return np.einsum("ij,ij->i", along, along)


def _row_span(mesh: LeafMesh) -> np.ndarray:
    """Spans of the hinges of single rows of triangles [m], shape [hinge_count]; 0 of all others.

    Such a hinge runs from margin to margin, and each of its triangles has one side on the margin, along the row.
    """

    def key(ends: np.ndarray) -> np.ndarray:
        return np.sort(ends.astype(np.int64), axis=-1) @ (mesh.vertex_count, 1)

    margin = mesh.edges[~np.isin(key(mesh.edges), key(mesh.hinges[:, :2]))]
    on_margin = np.zeros(mesh.vertex_count, bool)
    on_margin[margin] = True
    span = np.zeros(mesh.hinge_count)
    # Few run from margin to margin.
    chosen = np.flatnonzero(on_margin[mesh.hinges[:, :2]].all(axis=1))
    hinges = mesh.hinges[chosen]
    in_row, along = np.ones(len(chosen), bool), []
    for opposite in (2, 3):
        from_a, from_b = (np.isin(key(hinges[:, [end, opposite]]), key(margin)) for end in (0, 1))
        in_row &= from_a != from_b
        end = np.where(from_a, hinges[:, 0], hinges[:, 1])
        along.append(mesh.positions[hinges[:, opposite]] - mesh.positions[end])
    edge = mesh.positions[hinges[:, 1]] - mesh.positions[hinges[:, 0]]
    # Both along the row the same way.
    first, second = along
    second = np.where((np.einsum("ij,ij->i", first, second) < 0.0)[:, None], -second, second)
    direction = first + second
    crossed = np.abs(edge[:, 0] * direction[:, 1] - edge[:, 1] * direction[:, 0])
    in_row &= crossed > 0.0
    sides = np.linalg.norm(first, axis=1) + np.linalg.norm(second, axis=1)
    lengths = np.linalg.norm(edge, axis=1) * np.linalg.norm(direction, axis=1)
    span[chosen[in_row]] = (0.25 * sides * lengths)[in_row] / crossed[in_row]
    return span


def _hinge_areas(mesh: LeafMesh) -> np.ndarray:
    """Sum of the areas of each hinge's two triangles [m^2]."""
    a, b, c, d = np.moveaxis(mesh.positions[mesh.hinges], 1, 0)
    edge = b - a
    across = c - d
    return 0.5 * np.abs(edge[:, 0] * across[:, 1] - edge[:, 1] * across[:, 0])
