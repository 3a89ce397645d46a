"""Grain: whether the sheet that a mesh makes bends alike in all directions.

A sheet of hinges has the bending energy ``E = sum k theta^2 / 2`` with ``k = D |e|^2 / (A1 + A2)``. On a
flat mesh laid over the height ``z = x.K x / 2`` (curvature tensor ``K``, small), the angle of a hinge ``(a, b, c,
d)`` is

    theta = (z_c - z at the foot of c on the line ab) / height of c + the same for d,

linear in ``K``. A cylinder of curvature ``kappa`` whose axis is turned by ``phi`` has ``K = kappa n n^T``, with
``n = (-sin phi, cos phi)`` across the axis, and a sheet without grain spends the same energy on it whatever
``phi``. A lattice of equilateral triangles passes that test to rounding, and still buckles along its three rows:
so the mesh's ``alignment``, its six-fold order ``|mean exp(6 i beta)|`` over the directions ``beta`` of its edges,
is measured too. It is 1 for one crystal and 0 where no direction is preferred (Nelson and Halperin 1979).

A disc of few hinges bends unequally by chance, as a few dice do not show their mean: over discs of annealed meshes
without grain the variation of ``n`` hinges has the median ``1.0 / sqrt(n)`` and is below ``2.2 / sqrt(n)`` in 99 of
100, from 40 hinges to 4,400. Less than that says nothing of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh.topology import boundary_edges

INTERIOR = 0.9  # radius of the measured disc, as a share of the largest that fits into the leaf


@dataclass(frozen=True)
class Grain:
    """How a disc cut out of a mesh bends in different directions.

    Attributes:
        stiffness: Energy of bending the disc into a cylinder, over that of the sheet ``D kappa^2 area / 2``, for
            each direction of the cylinder's axis, evenly spread over half a turn, shape [directions].
        variation: Largest less smallest stiffness over the mean; 0 is a sheet without grain.
        chance: What the variation of so many hinges without grain is by chance, in the median.
        alignment: Six-fold order of the edges' directions, 0 to 1.
        centre: Centre of the disc [m].
        radius: Radius of the disc [m].
    """

    stiffness: np.ndarray
    variation: float
    chance: float
    alignment: float
    centre: tuple[float, float]
    radius: float


def grain(
    mesh: LeafMesh,
    centre: tuple[float, float] | None = None,
    radius: float | None = None,
    directions: int = 12,
) -> Grain:
    """Measure the grain of a disc cut out of a mesh.

    Args:
        mesh: The flat mesh.
        centre: Centre of the disc [m]; where the largest disc fits, where it is not given.
        radius: Radius of the disc [m]; 0.9 of what fits about the centre, where it is not given.
        directions: Number of directions of the cylinder's axis.

    Raises:
        InputError: The disc holds no hinge.
    """
    clearance = _clearance(mesh)
    if centre is None:
        centre = mesh.positions[np.argmax(clearance)]
    middle = np.asarray(centre, np.float64)
    if radius is None:
        radius = INTERIOR * float(clearance[np.argmin(np.linalg.norm(mesh.positions - middle, axis=1))])
    midpoints = 0.5 * (mesh.positions[mesh.hinges[:, 0]] + mesh.positions[mesh.hinges[:, 1]])
    hinges = mesh.hinges[np.linalg.norm(midpoints - middle, axis=1) < radius]
    if len(hinges) == 0:
        raise InputError(f"mesh: a disc of radius {radius:.3g} m holds no hinge; accepted: some edge lengths")
    response, weight, share = _curvature_response(mesh.positions - middle, hinges)
    axis = np.arange(directions) * (np.pi / directions)
    across = np.stack([np.sin(axis) ** 2, -2.0 * np.sin(axis) * np.cos(axis), np.cos(axis) ** 2])
    stiffness = weight @ (response @ across) ** 2 / share.sum()
    along = mesh.positions[hinges[:, 1]] - mesh.positions[hinges[:, 0]]
    return Grain(
        stiffness=stiffness,
        variation=float(np.ptp(stiffness) / stiffness.mean()),
        chance=float(1.0 / np.sqrt(len(hinges))),
        alignment=float(np.abs(np.exp(6j * np.arctan2(along[:, 1], along[:, 0])).mean())),
        centre=(float(middle[0]), float(middle[1])),
        radius=float(radius),
    )


def _curvature_response(positions: np.ndarray, hinges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each hinge: its angle for unit K_xx, K_xy and K_yy [m], shape [count, 3]; ``|e|^2 / (A1 + A2)``; and its
    share of the area [m^2], a third of its two triangles."""
    a, b, c, d = (positions[hinges[:, corner]] for corner in range(4))
    edge = b - a
    square = (edge**2).sum(axis=1)
    angle, areas = np.zeros((len(hinges), 3)), np.zeros(len(hinges))
    for corner in (c, d):
        foot = ((corner - a) * edge).sum(axis=1) / square
        double_area = np.abs(edge[:, 0] * (corner - a)[:, 1] - edge[:, 1] * (corner - a)[:, 0])
        at_foot = (1.0 - foot)[:, None] * _quadratics(a) + foot[:, None] * _quadratics(b)
        angle += (_quadratics(corner) - at_foot) * (np.sqrt(square) / double_area)[:, None]
        areas += 0.5 * double_area
    return angle, square / areas, areas / 3.0


def _quadratics(points: np.ndarray) -> np.ndarray:
    """Height over each point for unit K_xx, for K_xy = 1/2 (both off-diagonals together 1), and for unit K_yy."""
    x, y = points.T
    return 0.5 * np.column_stack([x * x, x * y, y * y])


def _clearance(mesh: LeafMesh) -> np.ndarray:
    """Distance of each vertex from the nearest boundary edge's middle [m], shape [vertex_count]."""
    from scipy.spatial import cKDTree

    ends = boundary_edges(mesh)
    middles = 0.5 * (mesh.positions[ends[:, 0]] + mesh.positions[ends[:, 1]])
    return cKDTree(middles).query(mesh.positions)[0]
