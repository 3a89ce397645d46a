"""Sweeps of the water: the step, the conductances, the sinks and the source."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from leafwarp.sim.fluid.conductance import face_conductance
from leafwarp.study.stability.point import Finding, Trial, decades
from leafwarp.study.stability.reference import solve_exchange, step_of_diffusion
from leafwarp.study.verify.drawn_fluid import (
    Sample,
    diffusion_sample,
    ellipse,
    exchange_matrices,
    make_sample,
    random_diffusivity,
)

# Names of :func:`leafwarp.study.verify.drawn_fluid.make_scene`, and what a scene says.
SCHEMES = {
    "split": "split",
    "unsplit": "unsplit, factor",
    "iterated": "unsplit, conjugate_gradients",
    "unsplit, solver left open": "unsplit",
}
OF_SECOND_ORDER = {
    "split, second order": "split, order 2",
    "unsplit, solver left open, second order": "unsplit, order 2",
}
PRECISIONS = ("float32", "float64")
# Largest error of a content that a user would not see.
VISIBLE = 0.01
# What a step is solved to, relative to the contents: fluid.tolerance, and the rounding of the contents on top of it; in
# float64 its square.
SOLVED = {"float32": 1e-5 + 1e-6, "float64": 1e-10}
# Of the mean content: what may be lost in some steps. The factor and the iterations make up for it in float32's
# contents, too.
LOST = {"float32": 2e-6, "float64": 1e-13}
STEPS = 8


def _methods(schemes: Iterable[str]) -> Iterator[tuple[str, str]]:
    for scheme in schemes:
        for precision in PRECISIONS:
            # In float64 a scene that names no solver has the factor.
            if (scheme, precision) != ("unsplit, solver left open", "float64"):
                yield scheme, precision


def _trials(
    values: Iterable[float],
    compute: Callable[[float, str, str], Finding],
    tolerances: dict[str, float],
    schemes: dict[str, str] = SCHEMES,
) -> Iterator[Trial]:
    """A trial for every scheme, precision and number; compute takes them in the order number, scheme, precision."""
    for scheme, precision in _methods(schemes):
        for value in values:
            call = partial(compute, value, scheme, precision)
            yield Trial(schemes[scheme], precision, value, tolerances[precision], call)


def _finding(
    sample: Sample, before: np.ndarray, expected: np.ndarray, precision: str, *, relative: bool, limits: tuple = ()
) -> Finding:
    """Judge the water of a sample.

    Args:
        sample: It, after its steps.
        before: Contents of the leaf's cells at the start, shape [cell_count].
        expected: What they should be now.
        precision: Of the sample.
        relative: The error is the norm of the difference over that of the contents, or the largest difference.
        limits: Lowest and highest content that is possible; those at the start, where no water comes or goes.
    """
    after = sample.leaf_water
    faults = []
    if not np.isfinite(sample.water).all():
        faults.append("a content is not a finite number")
    else:
        low, high = limits or (before.min(), before.max())
        # The unsplit scheme's errors may lead out of the range.
        slack = SOLVED[precision] * max(1.0, np.linalg.norm(before))
        if after.min() < low - slack or after.max() > high + slack:
            faults.append(f"contents of {after.min():.9g} to {after.max():.9g} in a leaf of {low:.9g} to {high:.9g}")
        ledger = sample.fluid.ledger()
        moved = max(1.0, abs(ledger.added), abs(ledger.transpired))
        if abs(ledger.error) > LOST[precision] * moved:
            faults.append(f"the ledger is off by {ledger.error:.3g}")
        if sample.water[~sample.leaf.mask].any():
            faults.append("there is water beside the leaf")
    difference = after - expected
    error = np.linalg.norm(difference) / np.linalg.norm(expected) if relative else np.abs(difference).max()
    return Finding(float(error), tuple(faults))


# A leaf with a vein that slants over its map, one metre a cell.
ROWS, COLUMNS = 28, 22


@cache
def _veined_leaf() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mask, diffusivity [m^2/s] and contents at the start (a wet foot) of a leaf; shapes [ny, nx]."""
    mask = ellipse(ROWS, COLUMNS)
    y, x = np.indices(mask.shape)
    across = (x - COLUMNS / 2 + 0.5) - 0.5 * (y - ROWS / 2 + 0.5)
    vein = np.clip(2.0 - np.abs(across), 0.0, 1.0) * mask
    water = np.where(y < ROWS / 4, 0.9, 0.2) * mask
    return mask, VEIN * (0.01 + 0.99 * vein), water


# Diffusivity of the vein [m^2/s] with which the leaf's diffusion time, height squared over that, is 1 s.
VEIN = float(ROWS**2)


@cache
def _modes() -> tuple[np.ndarray, np.ndarray]:
    """Rates [1/s] and modes of diffusion between the leaf's cells, shapes [cell_count] and [cell_count, cell_count]."""
    mask, diffusivity, _ = _veined_leaf()
    along_x, along_y = exchange_matrices(diffusivity, mask, 1.0)
    inside = np.flatnonzero(mask)
    rates, modes = np.linalg.eigh((along_x + along_y).toarray()[np.ix_(inside, inside)])
    # A leaf in one piece has one mode that does not decay.
    rates[0] = 0.0
    return rates, modes


def fluid_step(device: str) -> Iterator[Trial]:
    """Water from a wet foot spreads for some steps; in exact time each mode decays as ``exp(-rate t)``."""
    mask, diffusivity, water = _veined_leaf()
    start = water[mask]

    def spread(step: float, scheme: str, precision: str) -> Finding:
        rates, modes = _modes()
        expected = modes @ (np.exp(-rates * step * STEPS) * (modes.T @ start))
        # Not by diffusion_sample: its thousand steps would last longer than a scene may.
        tables = {
            "fluid": {"step": step, "scheme": scheme, "lamina_diffusivity": 0.0, "vein_diffusivity": VEIN},
            "time": {"duration": STEPS * step, "frames": 2},
        }
        maps = {"venation": diffusivity / VEIN, "water": water}
        sample = make_sample(tables, mask, maps, (COLUMNS, ROWS), device, precision)
        sample.fluid.advance(STEPS * step, frame=2)
        return _finding(sample, start, expected, precision, relative=False)

    return _trials(decades(range(-6, 10)), spread, dict.fromkeys(PRECISIONS, VISIBLE), SCHEMES | OF_SECOND_ORDER)


SUPPLY, LOSS = 1e-3 * VEIN, 1e-4 * VEIN  # conductance of the source and rate of transpiration [1/s]


@cache
def _fed_leaf() -> tuple[np.ndarray, np.ndarray]:
    """Weights of the source, shape [ny, nx], and the contents that are steady, shape [cell_count]."""
    mask, diffusivity, _ = _veined_leaf()
    foot = np.zeros(mask.shape)
    row = np.argmax(mask.any(axis=1)) + 2
    foot[row, np.argmax(mask[row] * diffusivity[row])] = 1.0
    along_x, along_y = exchange_matrices(diffusivity, mask, 1.0)
    inside = np.flatnonzero(mask)
    system = (along_x + along_y).toarray()[np.ix_(inside, inside)]
    inflow = SUPPLY * mask.sum() * foot.ravel()[inside]
    return foot, np.linalg.solve(system + np.diag(inflow), inflow - LOSS)


def fed_step(device: str) -> Iterator[Trial]:
    """A leaf whose source makes up for what transpires, started in its steady state: there it should stay."""
    mask, diffusivity, _ = _veined_leaf()
    foot, steady = _fed_leaf()
    content = np.zeros(mask.shape)
    content[mask] = steady

    def stay(step: float, scheme: str, precision: str) -> Finding:
        tables = {
            "fluid": {"step": step, "scheme": scheme, "lamina_diffusivity": 0.0, "vein_diffusivity": VEIN},
            "source": {"conductance": SUPPLY},
            "transpiration": {"rate": LOSS, "cuticle_rate": LOSS},
            "time": {"duration": STEPS * step, "frames": 2},
        }
        maps = {"venation": diffusivity / VEIN, "water": content, "source": foot}
        sample = make_sample(tables, mask, maps, (COLUMNS, ROWS), device, precision)
        sample.fluid.advance(STEPS * step, frame=2)
        return _finding(sample, steady, steady, precision, relative=False, limits=(0.0, 1.0))

    return _trials(decades(range(-6, 10)), stay, dict.fromkeys(PRECISIONS, VISIBLE), SCHEMES | OF_SECOND_ORDER)


def _one_step(diffusivity: np.ndarray, scheme: str, precision: str, device: str) -> Finding:
    """A step of 1 s from random contents against one in exact arithmetic; cells are 1 m wide."""
    mask = ellipse(16, 14)
    # What a float32 holds, so that both precisions start from the same.
    water = np.where(mask, np.random.default_rng(3).random(mask.shape, np.float32), 0.0).astype(np.float64)
    sample = diffusion_sample(diffusivity, mask, water, scheme, device=device, precision=precision)
    before = sample.leaf_water
    faces = face_conductance(diffusivity, mask, (1.0, 1.0), 1.0)
    expected = step_of_diffusion((faces.x, faces.y), mask, water, scheme == "split")[mask]
    sample.fluid.advance(1.0, frame=2)
    return _finding(sample, before, expected, precision, relative=True)


def conductance(device: str) -> Iterator[Trial]:
    """A step with the same conductance everywhere."""

    def mix(beta: float, scheme: str, precision: str) -> Finding:
        return _one_step(np.full((16, 14), beta), scheme, precision, device)

    return _trials(decades(range(-12, 13, 2)), mix, SOLVED)


def contrast(device: str) -> Iterator[Trial]:
    """A step with conductances from 1 up to the contrast, at random from cell to cell, a fifth of the cells dead."""

    def mix(ratio: float, scheme: str, precision: str) -> Finding:
        diffusivity = random_diffusivity(np.random.default_rng(4), (16, 14), (0.0, np.log10(ratio)))
        return _one_step(diffusivity, scheme, precision, device)

    return _trials(decades(range(0, 13)), mix, SOLVED)


def source(device: str) -> Iterator[Trial]:
    """A step that fills a leaf from some cells of its foot."""
    mask = ellipse(16, 14)
    beta = 10.0
    foot = np.zeros(mask.shape)
    foot[np.argwhere(mask)[:3, 0], np.argwhere(mask)[:3, 1]] = 1.0

    def fill(strength: float, scheme: str, precision: str) -> Finding:
        tables = {
            "fluid": {"step": 1.0, "scheme": scheme, "lamina_diffusivity": beta, "vein_diffusivity": beta},
            "source": {"conductance": strength},
            "time": {"duration": 1.0, "frames": 2},
        }
        maps = {"water": np.full(mask.shape, 0.25), "source": foot}
        sample = make_sample(tables, mask, maps, mask.shape[::-1], device, precision)
        before, inside = sample.leaf_water, np.flatnonzero(mask)
        inflow = strength * mask.sum() * foot[mask] / foot.sum()
        exchanges = [
            np.maximum(-matrix.toarray()[np.ix_(inside, inside)], 0.0) * (1.0 - np.eye(len(inside)))
            for matrix in exchange_matrices(np.full(mask.shape, beta), mask, 1.0)
        ]
        # Each pass of the split scheme has half of the source.
        parts = [(each, inflow / 2.0) for each in exchanges] if scheme == "split" else [(sum(exchanges), inflow)]
        expected = before
        for exchange, part in parts:
            expected = solve_exchange(exchange, 1.0 + part, expected + part)
        sample.fluid.advance(1.0, frame=2)
        return _finding(sample, before, expected, precision, relative=True, limits=(0.25, 1.0))

    return _trials(decades(range(-6, 13, 2)), fill, SOLVED)


def sinks(device: str) -> Iterator[Trial]:
    """A leaf that loses water where it is; open stomata lose it at a constant rate, closing ones exponentially."""
    mask = ellipse(12)
    start, closed, steps = 0.9, 0.5, 3
    closures: dict[str, Any] = {"open stomata": None, "closing stomata": [[closed, 0.0], [1.0, 1.0]]}

    def dry(share: float, method: str, precision: str) -> Finding:
        closure = {} if closures[method] is None else {"closure": closures[method]}
        tables = {
            "fluid": {"step": 1.0, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0},
            "transpiration": {"rate": share} | closure,
            "time": {"duration": float(steps), "frames": 2},
        }
        maps = {"water": np.full(mask.shape, start), "stomata": np.ones(mask.shape)}
        sample = make_sample(tables, mask, maps, device=device, precision=precision)
        before = sample.leaf_water
        lost = share * steps
        left = closed + (start - closed) * np.exp(-lost / (1.0 - closed)) if closure else max(0.0, start - lost)
        sample.fluid.advance(float(steps), frame=2)
        return _finding(sample, before, np.full(len(before), left), precision, relative=False, limits=(0.0, start))

    for method in closures:
        for precision in PRECISIONS:
            for value in decades(range(-6, 10)):
                yield Trial(method, precision, value, SOLVED[precision], partial(dry, value, method, precision))
