"""The material of a leaf in SI units, and what follows from it for the tables of the structure and the water.

With the thickness ``h`` and Young's modulus ``E``, a sheet has the membrane stiffness ``E h`` and the bending stiffness
``E h^3 / (12 (1 - nu^2))``. Turgor falls linearly with the relative water content ``y`` (Tyree and Hammel 1972, with a
constant bulk modulus ``epsilon``) and is lost at ``y_tlp``:

    P / P0 = (y - y_tlp) / (1 - y_tlp),      y_tlp = 1 - pi0 / epsilon.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from leafwarp.scene.fields import (
    Bounds,
    Curve,
    Fraction,
    Length,
    MassPerArea,
    Number,
    Pressure,
    Share,
    Table,
    plain_number,
)
from leafwarp.scene.presets import PRESETS

Thickness = Annotated[Length, Bounds(1e-6, 0.1, "m")]
Modulus = Annotated[Pressure, Bounds(1e-3, 1e13, "Pa")]
ShrunkShare = Annotated[Fraction, Bounds(-0.5, 0.95)]

# The keys that set those of other tables where these are left out. Their response curves, which follow from bounded
# figures, cannot leave what is accepted.
FOLLOWS_FROM = {
    "structure.membrane_stiffness": ("lamina_modulus", "thickness"),
    "structure.bending_stiffness": ("lamina_modulus", "thickness", "poisson_ratio"),
    "structure.vein_stiffness": ("vein_modulus", "vein_thickness", "lamina_modulus", "thickness"),
    "structure.vein_bending_stiffness": ("vein_modulus", "vein_thickness", "lamina_modulus", "thickness"),
    "structure.dry_mass": ("dry_mass",),
    "structure.water_mass": ("saturated_water",),
    "shrink.along_veins": ("shrink_along", "shrink_across"),
    "shrink.plastic_set": ("plastic_set",),
    "curl.thickness": ("thickness",),
    "curl.vein_resistance": ("thickness", "vein_thickness"),
    "curl.plastic_set": ("plastic_set",),
}


class MaterialTable(Table):
    """What the leaf is made of. What is left out is that of the preset."""

    preset: Literal[tuple(PRESETS)] = Field("tree", description="Kind of leaf whose figures hold where none is given.")
    thickness: Thickness | None = Field(None, description="Of the lamina [m].")
    vein_thickness: Thickness | None = Field(None, description="Of a vein of capacity 1 [m].")
    lamina_modulus: Modulus | None = Field(None, description="Young's modulus of the turgid lamina [Pa].")
    vein_modulus: Modulus | None = Field(None, description="Young's modulus of a vein of capacity 1 [Pa].")
    poisson_ratio: Annotated[Number, Bounds(-0.99, 0.5)] | None = Field(
        None,
        description="Of the lamina; it enters the bending stiffness. The mesh itself has 1/3 in its plane and -1/3 in "
        "bending, whatever this says.",
    )
    dry_mass: Annotated[MassPerArea, Bounds(1e-6, 1e6, "kg/m2")] | None = Field(
        None, description="Mass of the dry leaf [kg/m^2]."
    )
    saturated_water: Annotated[MassPerArea, Bounds(1e-6, 1e6, "kg/m2")] | None = Field(
        None, description="Mass of the water of the saturated leaf [kg/m^2]."
    )
    osmotic_potential: Annotated[Pressure, Bounds(1.0, 1e9, "Pa", "a positive number")] | None = Field(
        None, description="Osmotic potential at full turgor, as a positive number [Pa]."
    )
    bulk_modulus: Annotated[Pressure, Bounds(1.0, 1e11, "Pa")] | None = Field(
        None, description="Bulk elastic modulus of the cells [Pa]; the turgor loss point is 1 - osmotic/bulk."
    )
    wilted_stiffness: Annotated[Fraction, Bounds(1e-3, 1.0)] | None = Field(
        None, description="Stiffness at the turgor loss point over that of the turgid leaf."
    )
    dry_stiffness: Annotated[Number, Bounds(1e-3, 1e6)] | None = Field(
        None, description="Stiffness of the dry leaf over that at the turgor loss point."
    )
    shrink_across: ShrunkShare | None = Field(
        None, description="Share of its length that the dry leaf has lost across the veins."
    )
    shrink_along: ShrunkShare | None = Field(None, description="The same along the veins.")
    mismatch: Annotated[Fraction, Bounds(-1.0, 1.0)] | None = Field(
        None,
        description="Strain between the two sides of the dry leaf; positive bends toward the photographed side. A wide "
        "leaf rolls to the curvature mismatch / thickness, a narrow strip bends to 1.5 times that.",
    )
    plastic_set: Share | None = Field(
        None, description="Share of shrinking and curling at their greatest that stays when the leaf is rewatered."
    )

    @model_validator(mode="after")
    def _filled_from_preset(self) -> MaterialTable:
        self.__dict__.update(self.filled(**PRESETS[self.preset]).__dict__)
        if not 0.0 < self.turgor_loss_point < 1.0:
            raise ValueError(
                f"osmotic_potential {self.osmotic_potential:g} Pa and bulk_modulus {self.bulk_modulus:g} Pa put the "
                f"turgor loss point at {self.turgor_loss_point:g}; accepted: between 0 and 1, so an osmotic potential "
                "below the bulk modulus"
            )
        across, along = self.shrink_across, self.shrink_along
        if not (across == along == 0.0 or (across != 0.0 and 0.0 <= along / across <= 10.0)):
            raise ValueError(
                f"shrink_along {along:g} and shrink_across {across:g}; accepted: of one sign, and along up to 10 times "
                "across"
            )
        return self

    @property
    def turgor_loss_point(self) -> float:
        """Relative water content at which turgor is lost."""
        return 1.0 - self.osmotic_potential / self.bulk_modulus

    @property
    def turgor(self) -> Curve:
        """Turgor over that of the saturated leaf, a response curve."""
        return ((self.turgor_loss_point, 0.0), (1.0, 1.0))

    @property
    def density(self) -> float:
        """Mass of the saturated leaf over its volume [kg/m^3]."""
        return (self.dry_mass + self.saturated_water) / self.thickness

    @property
    def area_lost(self) -> float:
        """Share of its area that the dry leaf has lost, if nothing resists."""
        return 1.0 - (1.0 - self.shrink_across) * (1.0 - self.shrink_along)

    @property
    def membrane_stiffness(self) -> float:
        """Young's modulus times thickness of the lamina [N/m]."""
        return self.lamina_modulus * self.thickness

    @property
    def bending_stiffness(self) -> float:
        """Of the lamina [N m]."""
        return self.lamina_modulus * self.thickness**3 / (12.0 * (1.0 - self.poisson_ratio**2))

    def sources(self, key: str) -> str:
        """The keys of this table that one of another table follows from, with their values."""
        return ", ".join(f"material.{name} = {plain_number(getattr(self, name))}" for name in FOLLOWS_FROM[key])

    def structure(self) -> dict[str, object]:
        """Keys of [structure] that follow."""
        modulus, thickness = self.vein_modulus / self.lamina_modulus, self.vein_thickness / self.thickness
        return {
            "membrane_stiffness": self.membrane_stiffness,
            "bending_stiffness": self.bending_stiffness,
            "vein_stiffness": modulus * thickness,
            "vein_bending_stiffness": modulus * thickness**3,
            "wilting": ((self.turgor_loss_point, self.wilted_stiffness), (1.0, 1.0)),
            "drying": ((0.0, self.dry_stiffness), (self.turgor_loss_point, 1.0)),
            "dry_mass": self.dry_mass,
            "water_mass": self.saturated_water,
        }

    def shrink(self) -> dict[str, object]:
        """Keys of [shrink] that follow."""
        across = self.shrink_across
        return {
            "curve": ((0.0, across), (self.turgor_loss_point, 0.0)),
            "along_veins": self.shrink_along / across if across != 0.0 else 1.0,
            "plastic_set": self.plastic_set,
        }

    def curl(self) -> dict[str, object]:
        """Keys of [curl] that follow. The same strain between its sides bends a vein the less, the thicker it is."""
        return {
            "mismatch": ((0.0, self.mismatch), (self.turgor_loss_point, 0.0)),
            "thickness": self.thickness,
            "vein_resistance": max(0.0, 1.0 - self.thickness / self.vein_thickness),
            "plastic_set": self.plastic_set,
        }
