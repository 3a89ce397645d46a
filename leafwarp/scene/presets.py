"""Figures of some kinds of leaf, in SI units."""

from __future__ import annotations

PRESETS: dict[str, dict[str, float]] = {
    "tree": {
        "thickness": 2.0e-4,
        "vein_thickness": 6.0e-4,
        "lamina_modulus": 5.0e7,
        "vein_modulus": 2.5e8,
        "poisson_ratio": 0.3,
        "dry_mass": 0.08,
        "saturated_water": 0.12,
        "osmotic_potential": 1.5e6,
        "bulk_modulus": 1.2e7,
        "wilted_stiffness": 0.3,
        "dry_stiffness": 5.0,
        "shrink_across": 0.14,
        "shrink_along": 0.09,
        "mismatch": 0.01,
        "plastic_set": 0.0,
    },
}
