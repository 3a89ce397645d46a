"""Rectangular sheets clamped at one end, of regular and of irregular triangles: the beams of the cases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh.anneal import anneal
from leafwarp.leaf.mesh.fill import fill
from leafwarp.leaf.mesh.topology import boundary_edges, mesh_from_triangles
from leafwarp.leaf.mesh.vein_lines import NO_LINES
from leafwarp.study.verify.drawn_leaf import strip_triangles

Kind = Literal["hexagonal", "irregular"]
KINDS: tuple[Kind, ...] = ("hexagonal", "irregular")
ROW = 0.75**0.5  # distance of two rows of equilateral triangles [edges]


@dataclass(frozen=True)
class Sheet:
    """A clamped sheet along x, its clamp line at x = 0.

    The vertices of two columns are held, half a cell each side of the clamp line: the hinges on the second of them
    bend, and stand for half a cell each way.

    Attributes:
        mesh: The mesh.
        length: From the clamp line to the free end [m].
        width: As it came out [m].
        held: Which vertices are held, bool, shape [vertex_count].
    """

    mesh: LeafMesh
    length: float
    width: float
    held: np.ndarray

    @property
    def end(self) -> np.ndarray:
        """Indices of the vertices at the free end."""
        return np.flatnonzero(self.mesh.positions[:, 0] > self.length * (1.0 - 1e-9))

    @property
    def positions(self) -> np.ndarray:
        """In the plane z = 0 [m], shape [vertex_count, 3]."""
        return np.column_stack((self.mesh.positions, np.zeros(self.mesh.vertex_count)))


def clamped_sheet(kind: Kind, length: float, width: float, edges: int, seed: int = 0) -> Sheet:
    """A clamped sheet.

    Its width is the nearest one into which equilateral triangles fit: a lattice that is stretched by a hundredth one
    way has a bending stiffness that is up to 1.3 hundredths larger one way than the other.

    Args:
        kind: "hexagonal" (rows of equilateral triangles across) or "irregular" (the mesher of the leaves).
        length: From the clamp line to the free end [m].
        width: [m].
        edges: Mean edges in a length.
        seed: Of the irregular mesh.
    """
    across = max(2, round(width * edges / length))
    columns = max(2, 2 * round((edges / ROW + 0.5) / 2))
    cell = length / (columns - 0.5)
    width = across * cell / ROW
    if kind == "hexagonal":
        points, triangles = strip_triangles(width, cell * columns, across, rows=columns)
        # It runs across; a turn by a quarter and a shift bring it along x.
        positions = np.column_stack((cell * (columns / 2 - 0.5) + points[:, 1], width / 2 - points[:, 0]))
    else:
        positions, triangles = _irregular(length, width, across, cell, seed)
    held = positions[:, 0] < cell * 0.51
    positions[np.abs(positions[:, 0] - length) < 1e-9 * length, 0] = length
    return Sheet(mesh_from_triangles(positions, triangles), length, width, held)


def _irregular(length: float, width: float, across: int, cell: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A column of held triangles, and beyond it the leaf mesher's."""
    edge = width / across
    root, end = np.linspace(-0.5, 0.5, across + 1) * width, round((length - cell / 2) / edge)
    side = np.linspace(cell / 2, length, end + 1)
    loop = np.concatenate(
        [
            np.column_stack((side[:-1], np.full(end, root[0]))),
            np.column_stack((np.full(across, length), root[:-1])),
            np.column_stack((side[:0:-1], np.full(end, root[-1]))),
            np.column_stack((np.full(across, cell / 2), root[:0:-1])),
        ]
    )
    points, triangles, _ = fill([loop], NO_LINES, edge)
    boundary = np.unique(boundary_edges(mesh_from_triangles(points, triangles)))
    points, triangles = anneal(points / edge, triangles, boundary, np.zeros((0, 2)), seed)
    points *= edge
    points[boundary] = np.where(np.abs(points[boundary] - cell / 2) < 1e-9 * length, cell / 2, points[boundary])
    second = np.flatnonzero(points[:, 0] < cell * 0.51)
    second = second[np.argsort(points[second, 1])]
    first = len(points) + np.arange(across + 2)
    heights = np.concatenate([[root[0]], 0.5 * (root[1:] + root[:-1]), [root[-1]]])
    points = np.concatenate([points, np.column_stack((np.full(across + 2, -cell / 2), heights))])
    up = np.column_stack((first[:-1], second, first[1:]))
    down = np.column_stack((second[:-1], second[1:], first[1:-1]))
    return points, np.concatenate([triangles, up, down])
