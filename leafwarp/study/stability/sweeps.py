"""The sweeps, in order."""

from __future__ import annotations

from collections.abc import Sequence

from leafwarp.errors import InputError
from leafwarp.study.stability.point import Sweep

SWEEPS = (
    Sweep(
        "fluid_step",
        "fluid step / diffusion time of the leaf",
        "Water spreads from a wet foot along a slanting vein in 8 steps.",
        "exact time on the same map: largest difference of a content",
        "water:fluid_step",
    ),
    Sweep(
        "fed_step",
        "fluid step / diffusion time of the leaf",
        "A leaf in the steady state between its source and transpiration goes on for 8 steps.",
        "the steady state: largest difference of a content",
        "water:fed_step",
    ),
    Sweep(
        "conductance",
        "beta",
        "One step from random contents with the same beta everywhere.",
        "the same step without rounding: norm of the difference over that of the contents",
        "water:conductance",
    ),
    Sweep(
        "contrast",
        "largest beta / smallest beta (1)",
        "One step with beta at random from cell to cell, a fifth of the cells dead.",
        "the same step without rounding: norm of the difference over that of the contents",
        "water:contrast",
    ),
    Sweep(
        "source",
        "conductance of the source x step",
        "One step that fills a leaf of a quarter of its water from three cells.",
        "the same step without rounding: norm of the difference over that of the contents",
        "water:source",
    ),
    Sweep(
        "sinks",
        "share of the saturated leaf's water lost in a step",
        "Transpiration alone, up to sinks far larger than the content, for 3 steps.",
        "the solution in exact time: largest difference of a content",
        "water:sinks",
    ),
    Sweep(
        "stiffness",
        "stiffness / that of a soft membrane (5 N/m)",
        "A clamped strip of 10 cm under its own weight, settled, for 4 frames.",
        "the equilibrium downhill, in float64: largest distance / length",
        "motion:stiffness",
    ),
    Sweep(
        "gravity",
        "gravity [g]",
        "A clamped strip with a membrane of 1 kN/m under its own weight, settled, for 4 frames.",
        "the equilibrium downhill, in float64: largest distance / length",
        "motion:gravity",
    ),
    Sweep(
        "mass_ratio",
        "largest mass of a vertex / smallest",
        "A free strip whose vertices move at random, for 4 frames.",
        "straight motion of its centre: way / length, momentum lost / all momenta",
        "motion:mass_ratio",
    ),
    Sweep(
        "rest_length",
        "rest length / that at the start",
        "A flat strip that shrinks in its plane, in 12 frames.",
        "the scaled strip: largest distance / its length",
        "motion:rest_length",
    ),
    Sweep(
        "curve_width",
        "change of the water in which a leaf shrinks by a fifth",
        "A flat strip that shrinks abruptly in its plane.",
        "the scaled strip: largest distance / its length",
        "motion:curve_width",
    ),
    Sweep(
        "crumple",
        "crumpling / edge length",
        "A strip let go from a crumpled shape, for 4 frames.",
        "its energy at the start: gain / that",
        "motion:crumple",
    ),
    Sweep(
        "sliver",
        "height of a triangle / its edge",
        "Two triangles that hang, settled, for 4 frames.",
        "the equilibrium downhill, in float64: largest distance / length",
        "motion:sliver",
    ),
    Sweep(
        "leaf_length",
        "length of the leaf [m]",
        "A clamped strip with all else in proportion, settled, for 4 frames.",
        "the equilibrium downhill, in float64: largest distance / length",
        "motion:leaf_length",
    ),
    Sweep(
        "distance",
        "distance from the origin [m]",
        "A clamped strip of 10 cm under its own weight, settled, for 4 frames.",
        "the equilibrium downhill, in float64: largest distance / length",
        "motion:distance",
    ),
    Sweep(
        "fluid_steps",
        "fluid steps",
        "A small leaf transpires and is fed.",
        "its ledger: what is missing / water that was there or came",
        "drift:fluid_steps",
    ),
    Sweep(
        "motion_steps",
        "explicit steps, each a twentieth of the longest that is stable",
        "Two free triangles ring without damping.",
        "energy and momenta at the start: change / that, or / all momenta",
        "drift:motion_steps",
    ),
)


def sweeps_named(names: Sequence[str]) -> tuple[Sweep, ...]:
    """The sweeps of some names, in their order; all where no name is given.

    Raises:
        InputError: There is no sweep of such a name.
    """
    known = [sweep.name for sweep in SWEEPS]
    for name in names:
        if name not in known:
            raise InputError(f"stability {name}: no such sweep; accepted: {', '.join(known)}")
    return tuple(sweep for sweep in SWEEPS if sweep.name in names) if names else SWEEPS
