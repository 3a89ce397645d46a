"""Table of many leaves in one scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from leafwarp.scene.fields import Bounds, Fraction, Integer, Length, Number, Share, Switch, Table
from leafwarp.scene.leaf import LeafTable

Angle = Annotated[Number, Bounds(0.0, 180.0, "degrees")]


class LeavesTable(Table):
    """Many leaves of one or more photos. Each draws how it differs from a seed of its own: more leaves leave the others
    as they are.

    Every amount is the most by which a leaf differs, all smaller ones being equally likely; 0 is not at all.
    """

    count: Annotated[Integer, Bounds(1, 100_000)] = Field(
        description="Number of leaves; with [[leaf]] by default that of the photos."
    )
    photos: tuple[LeafTable, ...] = Field(
        (),
        description="Further photos, tables like [leaf]; [[leaf]] written more than once says the same. The leaves are "
        "of the photos in turn.",
    )
    seed: Annotated[Integer, Bounds(0, 2**31 - 1)] = Field(0, description="Seed of all that follows.")
    size: Annotated[Fraction, Bounds(0.0, 0.9)] = Field(
        0.0, description="Lengths of a leaf: up to this share more or less."
    )
    stiffness: Annotated[Fraction, Bounds(0.0, 0.9)] = Field(
        0.0, description="Stiffness of a leaf in its plane and in bending: up to this share more or less."
    )
    water: Share = Field(0.0, description="Water of a leaf at the start: up to this share less.")
    turn: Angle = Field(0.0, description="Turned about the vertical: up to this angle either way [degrees].")
    tilt: Angle = Field(0.0, description="Tip up or down: up to this angle either way [degrees].")
    roll: Angle = Field(
        0.0, description="Rolled about the axis from base to tip: up to this angle either way [degrees]."
    )
    camber: Switch = Field(True, description="Every leaf has a camber of its own; false: all have that of leaf.seed.")
    arrangement: Literal["grid", "stem"] = Field(
        "grid",
        description="grid: side by side on a plane; stem: around a vertical stem, each at the golden angle to the one "
        "below.",
    )
    spacing: Annotated[Length, Bounds(0.0, 1000.0, "m")] | None = Field(
        None,
        description="Distance of neighbours in the grid, or of successive leaves along the stem [m]; default: in the "
        "grid such that leaves do not touch at the start, however they are turned; along the stem 0.25 times the "
        "leaf's length.",
    )
