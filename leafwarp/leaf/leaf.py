"""What the simulation knows of a leaf: a flat triangle mesh, the frame its maps cover, the maps, the texture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class MapFrame:
    """The rectangle in the leaf's plane that every map and the texture cover.

    Attributes:
        origin: Lower left corner [m], (x, y).
        size: Width and height [m].
    """

    origin: tuple[float, float]
    size: tuple[float, float]

    def uv(self, positions: np.ndarray) -> np.ndarray:
        """Map coordinates in [0, 1] of positions [m], shape [count, 2]."""
        return (positions[:, :2] - np.asarray(self.origin)) / np.asarray(self.size)


@dataclass(frozen=True)
class LeafMesh:
    """A triangulated disc in the plane z = 0 with its edge springs and angular springs.

    Attributes:
        positions: Vertex positions [m], shape [vertex_count, 2], float64; the petiole base is the origin.
        triangles: Vertex indices, counter-clockwise from the photographed face, shape [triangle_count, 3], int32.
        edges: Vertex indices of each edge spring, shape [edge_count, 2], int32.
        hinges: Vertex indices of each angular spring, shape [hinge_count, 4], int32: the edge (a, b) in the
            direction it has in its first triangle, the opposite vertex of that triangle, and the opposite vertex
            of the second triangle.
        edge_areas: Sum of the areas of the one or two triangles at each edge [m^2], shape [edge_count].
        vertex_areas: A third of the area of the triangles at each vertex [m^2], shape [vertex_count].
    """

    positions: np.ndarray
    triangles: np.ndarray
    edges: np.ndarray
    hinges: np.ndarray
    edge_areas: np.ndarray
    vertex_areas: np.ndarray

    @property
    def vertex_count(self) -> int:
        return len(self.positions)

    @property
    def edge_count(self) -> int:
        return len(self.edges)

    @property
    def hinge_count(self) -> int:
        return len(self.hinges)

    @property
    def triangle_count(self) -> int:
        return len(self.triangles)


@dataclass(frozen=True)
class Leaf:
    """A leaf ready for simulation.

    Attributes:
        mesh: The mesh.
        frame: The rectangle that the maps and the texture cover.
        length: Distance from the petiole base to the farthest point of the outline [m].
        texture: Colour of the frame, 8-bit RGB, top row first, shape [height, width, 3]; colour bled past the outline.
        mask: Cells that are leaf, bottom row first, shape [ny, nx], bool; one 4-connected region.
            Absent (None) where the scene asks for no maps.
        maps: Named maps, bottom row first, shape [ny, nx], float64, in [0, 1]; of ``venation`` (flow capacity),
            ``stomata``, ``water`` (relative water content at the start), ``source`` (non-negative weights with sum 1:
            where water enters), those that the scene requires.
    """

    mesh: LeafMesh
    frame: MapFrame
    length: float
    texture: np.ndarray
    mask: np.ndarray | None = None
    maps: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def uv(self) -> np.ndarray:
        """Map coordinates of the vertices, shape [vertex_count, 2], float64."""
        return self.frame.uv(self.mesh.positions)
