"""Where a leaf, or each of many, lies on its stage."""

from __future__ import annotations

from dataclasses import dataclass

from pxr import Sdf

from leafwarp.leaf.leaf import Leaf

ONE_LEAF, MANY_LEAVES = Sdf.Path("/Leaf"), Sdf.Path("/Leaves")
LEAST_DIGITS = 4  # of a leaf's number in its name


@dataclass(frozen=True)
class LeafPrim:
    """One leaf's prims and what of the arrays is its own.

    Attributes:
        model: The leaf's component.
        mesh: Its mesh.
        photo: Its photo: the prepared leaf that it is made from.
        photo_index: Index of the photo.
        vertices: Where its vertices are in the arrays of a frame.
        place: Its petiole base in the world [m], z up.
    """

    model: Sdf.Path
    mesh: Sdf.Path
    photo: Leaf
    photo_index: int
    vertices: slice
    place: tuple[float, float, float]


@dataclass(frozen=True)
class Prims:
    """All prims of a stage.

    Attributes:
        root: The default prim: the leaf itself, or the assembly of many.
        leaves: The leaves.
        photos: Prepared leaf of each photo.
    """

    root: Sdf.Path
    leaves: tuple[LeafPrim, ...]
    photos: tuple[Leaf, ...]

    @classmethod
    def of(cls, leaf: Leaf) -> Prims:
        """The prims of a leaf, or of many."""
        count = len(leaf.specimens)
        digits = max(LEAST_DIGITS, len(str(count)))
        prims = []
        for index, (photo, own, specimen) in enumerate(
            zip(leaf.photo_of, leaf.vertex_slices, leaf.specimens, strict=True)
        ):
            model = MANY_LEAVES.AppendChild(f"leaf_{index + 1:0{digits}d}") if leaf.is_many else ONE_LEAF
            mesh = model.AppendPath("leaf" if leaf.is_many else "geo/leaf")
            prims.append(LeafPrim(model, mesh, leaf.photos[photo], photo, own, specimen.place))
        return cls(MANY_LEAVES if leaf.is_many else ONE_LEAF, tuple(prims), leaf.photos)

    @property
    def is_many(self) -> bool:
        """Whether the root is an assembly of leaves."""
        return self.root == MANY_LEAVES

    @property
    def materials(self) -> Sdf.Path:
        """The scope of the materials, which all leaves share."""
        return self.root.AppendChild("mtl")

    def photo_material(self, index: int) -> Sdf.Path:
        """The material that shows a photo."""
        return self.materials.AppendChild("photo" if index == 0 else f"photo_{index + 1}")

    def texture_file(self, index: int) -> Sdf.Path:
        """The attribute that says where the texture of a photo lies."""
        return self.photo_material(index).AppendPath("texture").AppendProperty("inputs:file")
