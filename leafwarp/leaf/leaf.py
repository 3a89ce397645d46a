"""What the simulation knows of a leaf: a flat triangle mesh, the frame its maps cover, the maps, the texture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from leafwarp.leaf.specimen import AS_PHOTOGRAPHED, Specimen


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
class Findings:
    """What was found in the photo, for a person to judge. Points are pixels of the upright photo, (x, y), y down.

    Attributes:
        outline: Corners of the closed outline, shape [count, 2].
        base: The petiole's end.
        base_found: How: "stalk", "veins" or "given".
        photo_size: Width and height of the photo [pixels].
        pixel: Size of a photo pixel [m].
        confidence: How sure the segmentation is, in [0, 1]; 1 where a mask is given.
        notes: Sentences for the user, one a line.
        veins: Points of each stretch of vein, shape [count, 2], and the share of the leaf drained through each of them,
            shape [count].
        vein_kind: Where the veins come from: "photo", or "pinnate", "palmate" or "parallel" where they are made up.
        seconds: Wall time of each step of the preparation [s].
    """

    outline: np.ndarray
    base: tuple[float, float]
    photo_size: tuple[int, int] = (0, 0)
    base_found: str = "given"
    pixel: float = 1.0
    confidence: float = 1.0
    notes: tuple[str, ...] = ()
    veins: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    vein_kind: str = ""
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Leaf:
    """A leaf ready for simulation.

    Attributes:
        mesh: The mesh.
        frame: The rectangle that the maps and the texture cover.
        length: Distance from the petiole base to the farthest point of the outline [m].
        texture: Colour of the frame, 8-bit RGB, top row first, shape [height, width, 3]; colour bled past the
            outline. A fourth channel is the opacity, where the leaf has holes that its mesh does not have.
        mask: Cells that are leaf, bottom row first, shape [ny, nx], bool; one 4-connected region.
            Absent (None) where the scene asks for no maps.
        maps: Named maps, bottom row first, shape [ny, nx], float64, in [0, 1]; of ``venation`` (flow capacity),
            ``stomata``, ``water`` (relative water content at the start), ``source`` (non-negative weights with sum 1:
            where water enters), those that the scene requires.
        findings: What was found in the photo; None for a leaf that is not made from one.
        fine_venation: The venation before it was averaged over the cells of the maps, as it is drawn between their
            centres: on a whole number of cells for one of theirs each way. None where it is known no finer.
    """

    mesh: LeafMesh
    frame: MapFrame
    length: float
    texture: np.ndarray
    mask: np.ndarray | None = None
    maps: dict[str, np.ndarray] = field(default_factory=dict)
    findings: Findings | None = None
    fine_venation: np.ndarray | None = None

    @property
    def uv(self) -> np.ndarray:
        """Map coordinates of the vertices, shape [vertex_count, 2], float64."""
        return self.frame.uv(self.mesh.positions)

    @property
    def is_many(self) -> bool:
        """Whether the scene asks for leaves, however many, with places of their own."""
        return False

    @property
    def photos(self) -> tuple[Leaf, ...]:
        """The prepared leaf of each photo."""
        return (self,)

    @property
    def photo_of(self) -> tuple[int, ...]:
        """Index of the photo of each leaf."""
        return (0,)

    @property
    def specimens(self) -> tuple[Specimen, ...]:
        """How each leaf departs from its photo."""
        return (AS_PHOTOGRAPHED,)

    @property
    def vertex_groups(self) -> tuple[slice, ...]:
        """Vertices of groups of leaves, each small enough to be kept in a processor's cache; here one group."""
        return (slice(0, self.mesh.vertex_count),)

    @property
    def vertex_slices(self) -> tuple[slice, ...]:
        """Where each leaf's vertices are: all of them belong to the one leaf."""
        return (slice(0, self.mesh.vertex_count),)

    def join(self, function: Callable[[Leaf, Specimen], np.ndarray]) -> np.ndarray:
        """What a function makes of each leaf (a value or row for each of its points), one after the other.

        Args:
            function: Of the leaf as photographed, and of how it departs from that.
        """
        return function(self, AS_PHOTOGRAPHED)

    def tile(self, function: Callable[[Leaf, Specimen], np.ndarray]) -> np.ndarray:
        """What a function makes of each leaf, a map, as a map of all. Arguments as :meth:`join`."""
        return function(self, AS_PHOTOGRAPHED)
