"""Tables of the leaf: the photo, the mesh and the maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from leafwarp.scene.fields import Bounds, Component, Fraction, Integer, Length, Number, Share, Switch, Table

MOST_CELLS = 8192  # of a map, each way
Cells = Annotated[Integer, Bounds(1, MOST_CELLS)]


class LeafTable(Table):
    """The photo and its scale."""

    image: Path = Field(description="Photo of the leaf (PNG, JPEG, TIFF, WebP), relative to the scene file.")
    mask: Path | None = Field(None, description="Image that is bright on the leaf; replaces the segmentation.")
    rect: tuple[Component, Component, Component, Component] | None = Field(
        None,
        description="Left, top, width and height [pixel of the photo, x right, y down] of the part in which to look "
        "for the leaf.",
    )
    base: tuple[Component, Component] | None = Field(
        None, description="Petiole base [pixel of the photo, x right, y down]; replaces the detection."
    )
    length: Annotated[Length, Bounds(1e-4, 100.0, "m")] | None = Field(
        None, description="Distance from the petiole base to the farthest point of the leaf [m]."
    )
    pixels_per_metre: Annotated[Number, Bounds(1.0, 1e8, "pixel/m")] | None = Field(
        None, description="Scale of the photo [pixel/m]; instead of length."
    )
    holes: Literal["fill", "keep"] = Field(
        "fill",
        description="fill: holes of the leaf are transparent in its texture; keep: they are holes of the mesh.",
    )
    camber: Annotated[Fraction, Bounds(0.0, 0.5)] = Field(
        0.01,
        description="Height of a smooth imperfection of the flat leaf, as a share of its length; it decides which way "
        "the leaf buckles.",
    )
    seed: Annotated[Integer, Bounds(0, 2**31 - 1)] = Field(
        0, description="Seed of the camber, and of veins and stomata that are made up."
    )

    @model_validator(mode="after")
    def _one_scale(self) -> LeafTable:
        if (self.length is None) == (self.pixels_per_metre is None):
            raise ValueError("give either 'length' or 'pixels_per_metre'")
        return self


class MeshTable(Table):
    """The triangle mesh."""

    vertices: Annotated[Integer, Bounds(30, 200_000)] = Field(1707, description="Number of vertices aimed at.")
    follow_veins: Switch = Field(False, description="Main veins become edges of the mesh.")


class MapsTable(Table):
    """The maps that the fluid lives on. Each is "auto" or an image that covers the same picture as the photo."""

    size: tuple[Cells, Cells] | Cells = Field(
        256,
        description="Cells of the map: one number for a square one, or [width, height]; default: 256, with [leaves] "
        "what suits the vertices, 32 to 256.",
    )
    venation: Literal["auto", "photo", "pinnate", "palmate", "parallel"] | Path = Field(
        "auto",
        description="Flow capacity, 0 (lamina) to 1 (midrib): an image, or the veins that the photo shows, or made-up "
        "ones; auto takes those of the photo where it shows them.",
    )
    stomata: Literal["auto"] | Path = Field("auto", description="Density of stomata, 0 to 1.")
    water: Literal["auto"] | Share | Path = Field(
        "auto", description="Relative water content at the start: an image, a number, or auto (saturated)."
    )
    source: Literal["auto"] | Path = Field("auto", description="Where water enters; auto is the petiole base.")

    @property
    def shape(self) -> tuple[int, int]:
        """Cells (width, height)."""
        return (self.size, self.size) if isinstance(self.size, int) else self.size
