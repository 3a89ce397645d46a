"""Tables of the structure: the mass-spring mesh, how it follows the water, and what moves it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from leafwarp.quantity import quantity
from leafwarp.scene.fields import (
    Bounds,
    Curve,
    Length,
    MassPerArea,
    Number,
    Share,
    Switch,
    Table,
    Vector,
    curve_within,
    product,
)

MOST_SHRINK = 0.95  # of a length


class ShrinkTable(Table):
    """Rest lengths that follow the water."""

    curve: curve_within(-0.5, MOST_SHRINK) | None = Field(
        None, description="Points [relative water content, share of the length lost]; default: that of [material]."
    )
    along_veins: Annotated[Number, Bounds(0.0, 10.0)] = Field(
        1.0, description="Shrinking along the veins over that across them; default: 1, or that of [material]."
    )
    vein_resistance: Share = Field(0.0, description="Share of the shrinking that a vein of capacity 1 resists.")
    plastic_set: Share = Field(
        0.0, description="Share of the shrinking at its greatest that stays when the leaf is rewatered."
    )


class CurlTable(Table):
    """Rest angles that follow the water: one side of the leaf shrinks more than the other."""

    mismatch: curve_within(-1.0, 1.0) | None = Field(
        None,
        description="Points [relative water content, strain between the two sides]; positive bends toward the "
        "photographed side. It means that of two equal layers, free to bend in every direction: a narrow strip bends "
        "to the curvature 1.5 mismatch / thickness, a wide leaf rolls to 2/3 of it, mismatch / thickness, since the "
        "hinges have an effective Poisson ratio of -1/3. For a wide leaf of curvature k give k * thickness. "
        "Default: that of [material].",
    )
    thickness: Annotated[Length, Bounds(1e-7, 1.0, "m")] = Field(
        2.5e-4, description="Thickness of the lamina [m]; default: 0.25 mm, or that of [material]."
    )
    vein_resistance: Share = Field(
        0.0, description="Share of the curling that a vein of capacity 1 resists; default: 0, or that of [material]."
    )
    plastic_set: Share = Field(
        0.0, description="Share of the curling at its greatest that stays when the leaf is rewatered."
    )


_StiffnessFactor = curve_within(0.0, 1e6)


class StructureTable(Table):
    """The mass-spring mesh (paper, Sec. III-B)."""

    membrane_stiffness: Annotated[quantity("membrane stiffness"), Bounds(0.0, 1e12, "N/m")] | None = Field(
        None,
        description="Young's modulus times thickness [N/m]; default: that of [material]. Explicit motion wants a soft "
        "membrane: 2 to 20.",
    )
    bending_stiffness: Annotated[quantity("bending stiffness"), Bounds(0.0, 1e9, "N m")] | None = Field(
        None,
        description="Bending stiffness of the lamina [N m]; default: that of [material]; without: no angular springs.",
    )
    bending: Literal["gradient", "paper"] = Field(
        "gradient",
        description="Force of the angular springs: the gradient of their energy, which conserves momentum, or the "
        "paper's push on two vertices, which does not.",
    )
    vein_stiffness: Annotated[Number, Bounds(0.0, 1e12)] = Field(
        1.0, description="Stiffness of a vein of capacity 1 over the lamina's."
    )
    vein_bending_stiffness: Annotated[Number, Bounds(0.0, 1e12)] | None = Field(
        None, description="The same for bending; default: vein_stiffness, or that of [material]."
    )
    stiffness: _StiffnessFactor = Field(
        ((0.0, 1.0),), description="Points [relative water content, factor on every stiffness]."
    )
    wilting: _StiffnessFactor = Field(
        ((0.0, 1.0),),
        description="The same as turgor is lost: a further factor; default: 1, or by the turgor of [material].",
    )
    drying: _StiffnessFactor = Field(
        ((0.0, 1.0),),
        description="The same as the leaf without turgor dries: a further factor; default: 1, or that of [material].",
    )
    dry_mass: Annotated[MassPerArea, Bounds(1e-6, 1e6, "kg/m2")] = Field(
        0.05, description="Mass of the dry leaf [kg/m^2]; default: 0.05, or that of [material]."
    )
    water_mass: Annotated[MassPerArea, Bounds(0.0, 1e6, "kg/m2")] = Field(
        0.25,
        description="Mass of the water of the saturated leaf [kg/m^2]; default: 0.25, or that of [material]. [stomata] "
        "makes its rates of it.",
    )
    damping: Share = Field(
        0.05,
        description="Damping along springs and hinges: damping ratio of a stretching wave a fortieth of the leaf's "
        "length long; no oscillation of the mesh is damped by more than twice that.",
    )

    @property
    def stiffness_factor(self) -> Curve:
        """Factor of the water content on every stiffness, wilting and drying included."""
        return product(self.stiffness, self.wilting, self.drying)


class MotionTable(Table):
    """What moves the leaf, and where it is held."""

    method: Literal["explicit", "implicit", "quasistatic"] = Field(
        "explicit",
        description="explicit: small steps, for a soft membrane. quasistatic: equilibria, at every frame and on the "
        "way, for a real leaf's stiffness; a leaf that dries for hours has no inertia to speak of. implicit: the same "
        "with inertia in the film's time, by backward Euler in steps of a frame. Default: explicit, or quasistatic "
        "with [material]; with a quality or a tolerance, implicit where explicit steps would take longer.",
    )

    gravity: Vector | None = Field(None, description="Acceleration of gravity [m/s^2], z up; left out: none.")
    drag: Annotated[Number, Bounds(0.0, 1e6, "1/s")] = Field(
        2.0, description="Rate at which still air takes up the leaf's speed [1/s]."
    )
    wind: Vector | None = Field(
        None, description="Speed of the air [m/s], which drags the leaf along; left out: still air."
    )
    pin_radius: Annotated[Length, Bounds(0.0, unit="m")] | None = Field(
        None,
        description="Vertices this near the petiole base are held [m], and shrink with the leaf; left out: 3 % of the "
        "leaf's length.",
    )
    clamp: Switch = Field(False, description="Also hold the first row of triangles past the pins (the direction, too).")
    settle: Switch = Field(
        False,
        description="Let the leaf come to rest under gravity before the first frame; quasistatic motion always does.",
    )
