"""The verification cases, in order."""

from __future__ import annotations

from leafwarp.errors import InputError
from leafwarp.study.verify.case import Case

CASES = (
    Case(
        "line_solve",
        "Each line of a diffusion step against LAPACK, and against rational numbers over 24 decades of beta.",
        "lines:line_solve",
    ),
    Case(
        "mode_decay",
        "A cosine over the map decays in one step by the exact factor of the scheme.",
        "water:mode_decay",
    ),
    Case(
        "maximum_principle",
        "Diffusion neither makes nor loses water nor leaves the range of the contents, not by a rounding, over 12 "
        "decades of beta with a fifth of the cells dead.",
        "water:maximum_principle",
    ),
    Case(
        "manufactured_solution",
        "Orders of convergence in the step and in the cell on a known solution with sources, variable diffusivity and "
        "closed margins.",
        "convergence:manufactured_solution",
    ),
    Case(
        "steady_state_bias",
        "The steady state under sources has 1 / (1 + lambda dt / 2) of its amplitude with the split scheme, and all of "
        "it with the unsplit one.",
        "water:steady_state_bias",
    ),
    Case(
        "front_in_a_vein",
        "Water that advances along a straight vein, level and slanting, against a direct float64 solve of the unsplit "
        "system.",
        "water:front_in_a_vein",
    ),
    Case(
        "force_gradient",
        "The springs' forces are minus the gradient of their energy, which finite differences show.",
        "forces:force_gradient",
    ),
    Case(
        "implicit_potential",
        "The potential of implicit motion: its energy against the springs', its gradient and Hessian against "
        "differences, no net force or torque, and nothing felt of a rigid motion.",
        "implicit_forces:implicit_potential",
    ),
    Case(
        "momentum",
        "The springs' forces on a crumpled leaf add up to no force and no torque.",
        "forces:momentum",
    ),
    Case(
        "rigid_motion",
        "A leaf that is moved and turned as a whole feels no force, and a crumpled one the turned forces.",
        "forces:rigid_motion",
    ),
    Case(
        "fold_angle",
        "The angle of a hinge is that of the fold, continuous through flat and through a quarter turn.",
        "forces:fold_angle",
    ),
    Case(
        "own_weight",
        "Cantilevers under six of their own weights, on regular and irregular meshes: the droop against the elastica "
        "with 0.95 D, and how far it is off a plate's on a coarse and a fine mesh; a sheet as thin as a leaf against "
        "the elastica with D.",
        "beams:own_weight",
    ),
    Case(
        "end_load",
        "A cantilever with P L^2 / EI = 4 on its end against the elastica.",
        "beams:end_load",
    ),
    Case(
        "self_buckling",
        "The height at which an upright sheet buckles under its own weight, against Greenhill's.",
        "beams:self_buckling",
    ),
    Case(
        "two_layers",
        "A mismatch between two layers bends a narrow strip to 1.5 de/h and rolls a wide plate to 2/3 of it.",
        "layers:two_layers",
    ),
    Case(
        "midvein_curl",
        "A blade rolls up about its midvein in proportion to the mismatch, as a plate clamped along it does.",
        "leaves:midvein_curl",
    ),
    Case(
        "mesh_independence",
        "Droop and curl of a blade with the same camber on 500 and 1,700 vertices against 8,000; the droop of a stiff "
        "blade and of one that hangs down.",
        "leaves:mesh_independence",
    ),
    Case(
        "area_loss",
        "Area that a leaf of the default material loses as it dries, against the mean of 380 species.",
        "leaves:area_loss",
    ),
    Case(
        "kohlrabi_drying",
        "A severed kohlrabi leaf's measured contents over 11 hours, from published parameters.",
        "drying:kohlrabi_drying",
    ),
)


def cases_named(names: tuple[str, ...] | list[str]) -> tuple[Case, ...]:
    """The cases of some names, in their order; all where no name is given.

    Raises:
        InputError: There is no case of such a name.
    """
    known = [case.name for case in CASES]
    for name in names:
        if name not in known:
            raise InputError(f"verify {name}: no such case; accepted: {', '.join(known)}")
    return tuple(case for case in CASES if case.name in names) if names else CASES
