"""Usual ranges of what a scene says in physical units: a value outside of them is accepted, with a warning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from leafwarp.scene.fields import plain_number

if TYPE_CHECKING:
    from leafwarp.scene import Scene


@dataclass(frozen=True)
class Usual:
    """The usual range of a value.

    Attributes:
        low: Smallest usual value.
        high: Largest usual value.
        unit: Unit of both, and of the value; empty for a plain number.
        why: Whose values they are, or what the value follows from.
    """

    low: float
    high: float
    unit: str
    why: str


# By key, or by what follows from keys: dotted names of attributes of the scene.
USUAL: dict[str, Usual] = {
    "material.thickness": Usual(5e-5, 3e-3, "m", "laminas from films to succulents"),
    "material.vein_thickness": Usual(5e-5, 2e-2, "m", "bundles of a grass to midribs of large leaves"),
    "material.lamina_modulus": Usual(1e6, 5e9, "Pa", "soft herbs to sclerophylls and fibrous blades"),
    "material.vein_modulus": Usual(1e6, 3e10, "Pa", "soft herbs to fibres"),
    "material.poisson_ratio": Usual(0.0, 0.5, "", "plant tissues"),
    "material.dry_mass": Usual(0.01, 1.5, "kg/m2", "leaf mass per area, Wright et al. 2004"),
    "material.saturated_water": Usual(0.02, 5.0, "kg/m2", "thin leaves to succulents"),
    "material.density": Usual(
        300.0,
        1500.0,
        "kg/m3",
        "it follows from dry_mass, saturated_water and thickness; tissue with air in it, to wood",
    ),
    "material.osmotic_potential": Usual(3e5, 5e6, "Pa", "pressure-volume curves, Bartlett et al. 2012"),
    "material.bulk_modulus": Usual(1e6, 6e7, "Pa", "pressure-volume curves, Bartlett et al. 2012"),
    "material.turgor_loss_point": Usual(
        0.6, 0.98, "", "it follows from osmotic_potential and bulk_modulus; leaves mostly have 0.8 to 0.95"
    ),
    "material.wilted_stiffness": Usual(0.01, 1.0, "", "a wilted leaf is soft, but no cloth"),
    "material.dry_stiffness": Usual(1.0, 100.0, "", "a dry leaf is stiffer than a wilted one"),
    "material.area_lost": Usual(
        0.0, 0.82, "", "it follows from shrink_across and shrink_along; 380 species, Blonder et al. 2012"
    ),
    "material.mismatch": Usual(-0.1, 0.1, "", "0.01 curls a leaf of 0.25 mm to a radius of 2 cm"),
    "air.temperature": Usual(263.15, 323.15, "K", "air around a leaf; a plain number is in kelvin"),
    "air.pressure": Usual(5e4, 1.1e5, "Pa", "from the sea to 5,500 m"),
    "air.deficit": Usual(0.0, 8000.0, "Pa", "the vapour pressure deficit; a hot desert has 8000"),
    "stomata.open_conductance": Usual(0.005, 1.5, "mol/m2/s", "leaves in light have 0.05 to 0.6, Koerner 1995"),
    "stomata.minimum_conductance": Usual(1e-4, 0.05, "mol/m2/s", "247 species, Duursma et al. 2019"),
}


def unusual_values(scene: Scene) -> tuple[str, ...]:
    """A line for every value of a scene that lies outside its usual range."""
    lines = []
    for key, usual in USUAL.items():
        table, name = key.split(".")
        holder = getattr(scene, table)
        value = None if holder is None else getattr(holder, name)
        if value is not None and not usual.low <= value <= usual.high:
            unit = f" {usual.unit}" if usual.unit else ""
            usual_range = f"{plain_number(usual.low)} to {plain_number(usual.high)}{unit}"
            lines.append(f"{key} = {plain_number(value)}{unit}: usual: {usual_range} ({usual.why})")
    return tuple(lines)
