"""Many leaves as one: a mesh of many pieces, and an atlas of maps in which every leaf has its own tile.

The simulation's kernels know vertices, springs and cells, never a leaf. So many leaves are computed in the launches of
one: their meshes follow each other in the lists, and their maps lie side by side in one map. No spring joins two
leaves, and no water passes from tile to tile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from leafwarp.leaf.leaf import Leaf, LeafMesh, MapFrame
from leafwarp.leaf.specimen import Specimen

GROUP = 32  # rounds of the photos in a group of leaves; as many as a block of springs has lanes


@dataclass(frozen=True)
class Leaves(Leaf):
    """Leaves of one or more photos, ready to be simulated together.

    What it has from :class:`Leaf` holds for all leaves together: the mesh in which they follow each other, each about
    its own petiole base and in its own size; the mask and the maps as an atlas; the length of the longest of them.
    Frame, texture and findings are those of the first photo.

    Attributes:
        specimens: The leaves.
        photos: The prepared leaf of each photo; maps all of one shape.
        photo_of: Index of the photo of each leaf.
    """

    specimens: tuple[Specimen, ...] = ()
    photos: tuple[Leaf, ...] = ()
    photo_of: tuple[int, ...] = ()

    @property
    def is_many(self) -> bool:
        """Leaves have places of their own, be it one leaf only."""
        return True

    @property
    def uv(self) -> np.ndarray:
        """Coordinates of the vertices in the map and texture of their own photo, shape [vertex_count, 2], float64."""
        return self.join(lambda photo, specimen: photo.uv)

    @property
    def vertex_slices(self) -> tuple[slice, ...]:
        """Where each leaf's vertices are."""
        ends = np.cumsum([self.photos[p].mesh.vertex_count for p in self.photo_of]).tolist()
        return tuple(map(slice, [0, *ends], ends))

    @property
    def vertex_groups(self) -> tuple[slice, ...]:
        """Vertices of groups of leaves that move one group after the other: their springs fill whole blocks of lanes.

        The photos take turns, so that 32 rounds of them have 32 times as many springs of each kind as one.
        """
        ends = [own.stop for own in self.vertex_slices]
        ends = [*ends[GROUP * len(self.photos) - 1 : -1 : GROUP * len(self.photos)], ends[-1]]
        return tuple(map(slice, [0, *ends], ends))

    def join(self, function: Callable[[Leaf, Specimen], np.ndarray]) -> np.ndarray:
        """What a function makes of each leaf, one after the other."""
        return np.concatenate(
            [function(self.photos[p], specimen) for p, specimen in zip(self.photo_of, self.specimens, strict=True)]
        )

    def tile(self, function: Callable[[Leaf, Specimen], np.ndarray]) -> np.ndarray:
        """What a function makes of each leaf, a map of its tile, as a map of all."""
        return _atlas(self.photos, self.photo_of, self.specimens, self.mask.shape, function)

    @property
    def places(self) -> np.ndarray:
        """Each vertex's way from its leaf's coordinates to the world [m], shape [vertex_count, 3]."""
        return self.join(lambda photo, specimen: np.tile(specimen.place, (photo.mesh.vertex_count, 1)))

    def laid_out(self) -> Leaf:
        """All leaves flat, as photographed, each in the frame of its tile: one leaf that covers the whole map."""
        rows, columns = _tile_shape(self.photos[0])
        width, height = self.frame.size
        count_across = max(specimen.corner[1] for specimen in self.specimens) // columns + 1
        count_up = max(specimen.corner[0] for specimen in self.specimens) // rows + 1

        def in_tile(photo: Leaf, specimen: Specimen) -> np.ndarray:
            row, column = specimen.corner
            return (photo.uv + np.array([column // columns, row // rows])) * (width, height)

        mesh = replace(self.mesh, positions=self.join(in_tile))
        frame = MapFrame((0.0, 0.0), (count_across * width, count_up * height))
        return Leaf(mesh, frame, self.length, self.texture, self.mask, self.maps)


def gather_leaves(photos: Sequence[Leaf], photo_of: Sequence[int], specimens: Sequence[Specimen]) -> Leaves:
    """Put leaves together; each gets a tile of the map.

    Args:
        photos: The prepared leaf of each photo, all with the same maps of one shape, or all without maps.
        photo_of: Index of the photo of each leaf.
        specimens: The leaves.
    """
    mask, maps = None, {}
    rows, columns = _tile_shape(photos[0])
    across = tiles_across(len(specimens), (rows, columns))
    specimens = [
        replace(specimen, corner=(index // across * rows, index % across * columns))
        for index, specimen in enumerate(specimens)
    ]
    if photos[0].mask is not None:
        shape = (-(-len(specimens) // across) * rows, across * columns)
        mask = _atlas(photos, photo_of, specimens, shape, lambda photo, specimen: photo.mask)
        for name in photos[0].maps:
            maps[name] = _atlas(photos, photo_of, specimens, shape, _varied_map(name))
    first = photos[0]
    return Leaves(
        mesh=_joined_mesh([photos[p].mesh for p in photo_of], [specimen.size for specimen in specimens]),
        frame=first.frame,
        length=max(photos[p].length * specimen.size for p, specimen in zip(photo_of, specimens, strict=True)),
        texture=first.texture,
        mask=mask,
        maps=maps,
        findings=first.findings,
        specimens=tuple(specimens),
        photos=tuple(photos),
        photo_of=tuple(photo_of),
    )


def tiles_across(count: int, tile: tuple[int, int]) -> int:
    """Tiles in a row of the atlas, which is about square: neither its rows nor its columns are few.

    Args:
        count: Number of tiles.
        tile: Rows and columns of a tile.
    """
    return min(count, max(1, math.ceil(math.sqrt(count * tile[0] / tile[1]))))


def _tile_shape(photo: Leaf) -> tuple[int, int]:
    """Rows and columns of a tile; 1 and 1 without maps."""
    return (1, 1) if photo.mask is None else photo.mask.shape


def _varied_map(name: str) -> Callable[[Leaf, Specimen], np.ndarray]:
    if name == "water":
        return lambda photo, specimen: photo.maps[name] * specimen.water
    return lambda photo, specimen: photo.maps[name]


def _atlas(
    photos: Sequence[Leaf],
    photo_of: Sequence[int],
    specimens: Sequence[Specimen],
    shape: tuple[int, int],
    function: Callable[[Leaf, Specimen], np.ndarray],
) -> np.ndarray:
    """The map of all leaves' tiles; 0 in tiles without a leaf."""
    atlas = None
    for index, specimen in zip(photo_of, specimens, strict=True):
        tile = function(photos[index], specimen)
        if atlas is None:
            atlas = np.zeros(shape, tile.dtype)
        row, column = specimen.corner
        atlas[row : row + tile.shape[0], column : column + tile.shape[1]] = tile
    return atlas


def _joined_mesh(meshes: Sequence[LeafMesh], sizes: Sequence[float]) -> LeafMesh:
    """Meshes one after the other, each in its own size."""
    starts = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])[:-1]

    def joined(name: str, power: int) -> np.ndarray:
        return np.concatenate([getattr(mesh, name) * size**power for mesh, size in zip(meshes, sizes, strict=True)])

    def indices(name: str) -> np.ndarray:
        values = [getattr(mesh, name) + start for mesh, start in zip(meshes, starts, strict=True)]
        return np.concatenate(values).astype(np.int32)

    return LeafMesh(
        positions=joined("positions", 1),
        triangles=indices("triangles"),
        edges=indices("edges"),
        hinges=indices("hinges"),
        edge_areas=joined("edge_areas", 2),
        vertex_areas=joined("vertex_areas", 2),
    )
