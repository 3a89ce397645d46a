"""The static equilibrium of a mesh: the minimum of its potential without inertia.

Pseudo-transient continuation (Kelley and Keyes 1998): every Newton step is held back by an inertia about where it
starts, which shrinks as steps succeed and grows as they fail. So a buckling sheet is followed downhill, not thrown,
and near the equilibrium nothing is left of the inertia.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.newton import Accuracy, Newton
from leafwarp.sim.implicit.potential import Evaluation
from leafwarp.sim.launch import State

MOST_STEPS = 400
# The first step's inertia would let the mean force go this share of the length.
FIRST_WAY = 0.05
GAIN = 0.1
FIRST_LOSS = 1e-3
LOSS = 4.0
# Shares of a step that count as success and as failure.
GOOD, BAD = 0.9, 0.3
# Inertia that no longer matters, over the first one; and that of a mesh that nothing holds.
NEGLIGIBLE = 1e-9
MOST_FAILURES = 8


def keeps_from_turning(held: np.ndarray, length: float) -> bool:
    """Whether held points [m], shape [count, 3], do not all lie on a line, about which a mesh could turn."""
    spread = np.linalg.svd(held - held.mean(axis=0), compute_uv=False) if len(held) > 2 else np.zeros(3)
    return bool(spread[1] > 1e-9 * length)


def turned_back(
    found: np.ndarray, start: np.ndarray, held: np.ndarray, weights: np.ndarray, pull: np.ndarray
) -> np.ndarray:
    """An equilibrium turned to where it is nearest to where it was looked for from, by what changes no energy.

    A mesh that is held at one vertex, or along a line, turns freely: about the vertex, or about the line; under a
    load, about the direction of that alone. How far it has turned says nothing but how it was looked for.

    Args:
        found: Positions of the equilibrium [m], shape [vertex_count, 3].
        start: Where it was looked for from, shape [vertex_count, 3].
        held: Which vertices are held, shape [vertex_count]; they do not keep it from turning.
        weights: What each distance counts, shape [vertex_count].
        pull: Load on a unit of mass [m/s^2], shape [3].
    """
    pivot = start[held].mean(axis=0)
    before, after = start - pivot, found - pivot
    line = before[held][np.argmax(np.linalg.norm(before[held], axis=1))]
    axes = [pull] if pull.any() else []
    if np.linalg.norm(line) > 1e-9 * np.abs(before).max():
        axes.append(line)
    axes = [axis / np.linalg.norm(axis) for axis in axes]
    keeps_its_place = len(axes) == 2 and np.linalg.norm(np.cross(*axes)) > 1e-9
    if keeps_its_place or np.array_equal(found, start):
        return found
    covariance = before.T @ (weights[:, None] * after)
    if not axes:
        # Kabsch 1976.
        left, _, right = np.linalg.svd(covariance)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    else:
        along = axes[0]
        skew = covariance - covariance.T
        sine = along @ (skew[2, 1], skew[0, 2], skew[1, 0])
        angle = np.arctan2(sine, np.trace(covariance) - along @ covariance @ along)
        cross = np.cross(np.eye(3), along)
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    turned = pivot + after @ turn.T
    turned[held] = found[held]
    return turned


def relax(
    newton: Newton,
    state: State,
    start: np.ndarray,
    weights: np.ndarray,
    length: float,
    accuracy: Accuracy,
    *,
    is_held: bool = True,
    each_step: Callable[[], None] | None = None,
) -> Evaluation:
    """Come to rest downhill from positions.

    Args:
        newton: Newton's method on the potential, whose loads and springs are set.
        state: The arrays of the potential; its inertia and goal are set here.
        start: Positions [m], shape [vertex_count, 3].
        weights: What the inertia is proportional to, shape [vertex_count]; its scale does not matter.
        length: Size of the mesh [m].
        accuracy: When it counts as at rest.
        is_held: Whether what is held keeps the mesh from turning, too, so that no inertia need be left.
        each_step: Called after every step.

    Raises:
        NotConverged: No equilibrium was found.
    """
    weights = weights / weights.mean()
    state.upload("goal", start)
    state.upload("inertia", np.zeros(len(weights)))
    here = newton.start(start)
    if newton.is_at_rest(here):
        return here
    first = max(np.abs(here.gradient).mean(), 1e-9 * here.mean_force) / (FIRST_WAY * length)
    rate = least = 0.0 if is_held else NEGLIGIBLE * first
    failures, way = 0, np.inf
    for _ in range(MOST_STEPS):
        state.upload("inertia", rate * weights)
        newton.inertia_changed()
        try:
            way, share, after = newton.step(here)
        except NotConverged:
            failures += 1
            if failures > MOST_FAILURES:
                raise
            rate = max(100.0 * rate, FIRST_LOSS * first)
            continue
        if each_step is not None:
            each_step()
        state.upload("goal", after.positions)
        state.upload("inertia", np.zeros(len(weights)))
        here = newton.start(after.positions)
        balanced = newton.is_balanced(here, accuracy)
        # Of the whole step: where rounding rules, a part of it may be as low.
        if balanced and rate <= least and way <= share * accuracy.step * length:
            return here
        if share >= GOOD or balanced:
            rate = GAIN * rate if rate > NEGLIGIBLE * first else least
        elif share <= BAD:
            rate = max(LOSS * rate, FIRST_LOSS * first)
    raise NotConverged(
        f"after {MOST_STEPS} steps toward equilibrium a force of {here.residual:.3g} N is left on a vertex, where "
        f"{here.mean_action:.3g} N act on one, and the last step went {way:.3g} m"
    )
