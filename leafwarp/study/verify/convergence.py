"""Orders of convergence on a manufactured solution with sources, variable diffusivity and closed margins."""

from __future__ import annotations

from functools import cache

import numpy as np

from leafwarp.study.verify.case import Check, near
from leafwarp.study.verify.drawn_fluid import SECOND_ORDER, STAGES, diffusion_sample, exchange_matrices

END = 0.1  # [s]
STEPS = (20, 40, 80)
CELLS = (8, 16, 32)


def manufactured_solution(device: str) -> list[Check]:
    """First order in the step, second in the cell, for each scheme; second in the step where that is asked for."""
    checks = []
    for scheme in STAGES:
        for what, expected, (sizes, errors) in (
            ("step", 1.0, errors_in_the_step(scheme, device)),
            ("cell", 2.0, errors_in_the_cell(scheme, device)),
        ):
            order = np.log(errors[-2] / errors[-1]) / np.log(sizes[-2] / sizes[-1])
            checks.append(near(f"{scheme}: order in the {what}", expected, order, 0.1))
        sizes, errors = errors_of_second_order(scheme, device)
        order = np.log(errors[-2] / errors[-1]) / np.log(sizes[-2] / sizes[-1])
        checks.append(near(f"{scheme}{SECOND_ORDER}: order in the step", 2.0, order, 0.2))
    return checks


@cache
def errors_in_the_step(scheme: str, device: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Steps [s] and root mean square errors, against the same cells in continuous time."""
    count = 16
    exact = _exact_in_time(count, END)
    errors = [_root_mean_square(_march(scheme, count, steps, device) - exact) for steps in STEPS]
    return tuple(END / steps for steps in STEPS), tuple(errors)


@cache
def errors_of_second_order(scheme: str, device: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Steps [s] and root mean square errors of steps of second order, without a source, likewise."""
    count = 16
    diffusivity = 1.0 + 0.5 * _cosines(count)[3]
    both = exchange_matrices(diffusivity, diffusivity > 0.0, 1.0, (1.0 / count, 1.0 / count))
    rates, modes = np.linalg.eigh((both[0] + both[1]).toarray())
    start = _exact(count, 0.0)
    exact = (modes @ (np.exp(-rates * END) * (modes.T @ start.ravel()))).reshape(start.shape)
    errors = []
    for steps in STEPS:
        table = {"tolerance": 1e-6}
        sample = diffusion_sample(
            diffusivity, diffusivity > 0.0, start, scheme + SECOND_ORDER, END / steps, (1.0, 1.0), device, fluid=table
        )
        sample.fluid.advance(END)
        errors.append(_root_mean_square(sample.water - exact))
    return tuple(END / steps for steps in STEPS), tuple(errors)


@cache
def errors_in_the_cell(scheme: str, device: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Widths of a cell [m] and root mean square errors, against the solution itself."""
    # Two steps extrapolated to none leave the error of the cells.
    steps = 160 if scheme == "split" else 40
    errors = []
    for count in CELLS:
        settled = 2.0 * _march(scheme, count, steps, device) - _march(scheme, count, steps // 2, device)
        errors.append(_root_mean_square(settled - _exact(count, END)))
    return tuple(1.0 / count for count in CELLS), tuple(errors)


def _root_mean_square(field: np.ndarray) -> float:
    return float(np.sqrt(np.mean(field**2)))


def _cosines(count: int) -> tuple[np.ndarray, ...]:
    centre = np.pi * (np.arange(count) + 0.5) / count
    x, y = centre[None, :], centre[:, None]
    return x, y, np.cos(x) * np.cos(2.0 * y), np.cos(x) * np.cos(y)


def _exact(count: int, time: float) -> np.ndarray:
    """``u = (1 + exp(-t)/2 cos(pi x) cos(2 pi y)) / 2``: half the usual one, to lie in [0, 1]."""
    return 0.5 + 0.25 * np.exp(-time) * _cosines(count)[2]


def _exact_in_time(count: int, time: float) -> np.ndarray:
    """What the cells hold if nothing but space is discrete, shape [count, count].

    ``y' = -L y + exp(-t) s`` with the symmetric matrix L of the exchange between the cells has the solution
    ``y = exp(-t) p + exp(-L t) (y_0 - p)`` with ``(L - 1) p = s``, by the eigenvectors of L.
    """
    diffusivity = 1.0 + 0.5 * _cosines(count)[3]
    both = exchange_matrices(diffusivity, diffusivity > 0.0, 1.0, (1.0 / count, 1.0 / count))
    rates, modes = np.linalg.eigh((both[0] + both[1]).toarray())
    forced = (modes.T @ _source(count, 0.0).ravel()) / (rates - 1.0)
    start = modes.T @ _exact(count, 0.0).ravel()
    return (modes @ (np.exp(-time) * forced + np.exp(-rates * time) * (start - forced))).reshape(count, count)


def _source(count: int, time: float) -> np.ndarray:
    """``u_t - div(D grad u)`` with ``D = 1 + cos(pi x) cos(pi y)/2``."""
    x, y, mode, bump = _cosines(count)
    gradients = np.sin(x) * np.cos(y) * np.sin(x) * np.cos(2.0 * y) + 2.0 * np.cos(x) * np.sin(y) * np.cos(x) * np.sin(
        2.0 * y
    )
    flow = np.pi**2 * (-5.0 * (1.0 + 0.5 * bump) * mode + 0.5 * gradients)
    return 0.25 * np.exp(-time) * (-mode - flow)


def _march(scheme: str, count: int, steps: int, device: str) -> np.ndarray:
    """The water at the end, by so many steps on so many cells each way."""
    bump = _cosines(count)[3]
    step = END / steps
    sample = diffusion_sample(
        1.0 + 0.5 * bump,
        bump > -2.0,
        _exact(count, 0.0),
        scheme,
        step=step,
        size=(1.0, 1.0),
        device=device,
        fluid={"tolerance": 1e-6},
    )
    for index in range(steps):
        sample.set_water(sample.water + step * _source(count, (index + 1) * step))
        sample.diffuse()
    return sample.water
