"""Bent beams of any slope: the reference for the cantilevers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from leafwarp.errors import LeafwarpError

LARGEST_STEP = 2.0  # factor between two loads of which the second starts from the first's solution


@dataclass(frozen=True)
class Elastica:
    """A clamped inextensible beam, level at its root, under loads that point down.

    Attributes:
        arc: Distance along the beam, over its length.
        slope: Angle below the horizontal [rad].
        reach: Horizontal distance from the root, over the length.
        drop: Distance below the root, over the length.
    """

    arc: np.ndarray
    slope: np.ndarray
    reach: np.ndarray
    drop: np.ndarray


@cache
def elastica(weight: float = 0.0, end_load: float = 0.0) -> Elastica:
    """Solve ``theta'' = -(weight (1 - s) + end_load) cos(theta)``, ``theta(0) = 0``, ``theta'(1) = 0``.

    Args:
        weight: Weight number ``w L^3 / EI``, with the weight ``w`` of a unit of length; of a plate
            ``Gamma = sigma g L^3 / D``.
        end_load: ``P L^2 / EI``.

    Raises:
        LeafwarpError: The solver did not find the beam's shape.
    """
    from scipy.integrate import solve_bvp

    arc = np.linspace(0.0, 1.0, 41)
    # Slope, its derivative, reach and drop; at first of a straight beam.
    state = np.vstack([0.0 * arc, 0.0 * arc, arc, 0.0 * arc])
    factor = max(1, int(np.ceil(np.log(max(weight + end_load, 1.0)) / np.log(LARGEST_STEP))))
    for share in LARGEST_STEP ** np.arange(-factor, 1.0):

        def slopes(s: np.ndarray, y: np.ndarray, share: float = share) -> np.ndarray:
            load = share * (weight * (1.0 - s) + end_load)
            return np.vstack([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

        solution = solve_bvp(
            slopes, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), arc, state, tol=1e-8, max_nodes=20000
        )
        if not solution.success:
            raise LeafwarpError(
                f"the reference beam of weight number {weight:g} and end load {end_load:g} was not found: "
                f"{solution.message}"
            )
        arc, state = solution.x, solution.y
    return Elastica(arc, np.abs(state[0]), state[2], np.abs(state[3]))


def greenhill_number() -> float:
    """The weight number ``rho g A L^3 / EI`` at which an upright column buckles under its own weight, 7.8373: it is
    ``9/4`` of the square of the first zero of the Bessel function of order -1/3 (Greenhill 1881)."""
    from scipy.optimize import brentq
    from scipy.special import jv

    return 2.25 * brentq(lambda x: jv(-1.0 / 3.0, x), 1.0, 2.5, xtol=1e-14) ** 2
