"""Orders of convergence on a manufactured solution with sources, variable diffusivity and closed margins."""

from __future__ import annotations

import numpy as np
import pytest

from fluid_sample import SCHEMES, Sample, diffusion_sample, stage_name

END = 0.1


def cosines(count: int) -> tuple[np.ndarray, ...]:
    centre = np.pi * (np.arange(count) + 0.5) / count
    x, y = centre[None, :], centre[:, None]
    return x, y, np.cos(x) * np.cos(2.0 * y), np.cos(x) * np.cos(y)


def exact(count: int, time: float) -> np.ndarray:
    """``u = (1 + exp(-t)/2 cos(pi x) cos(2 pi y)) / 2``: half the usual one, to lie in [0, 1]."""
    return 0.5 + 0.25 * np.exp(-time) * cosines(count)[2]


def source(count: int, time: float) -> np.ndarray:
    """``u_t - div(D grad u)`` with ``D = 1 + cos(pi x) cos(pi y)/2``."""
    x, y, mode, bump = cosines(count)
    gradients = np.sin(x) * np.cos(y) * np.sin(x) * np.cos(2.0 * y) + 2.0 * np.cos(x) * np.sin(y) * np.cos(x) * np.sin(
        2.0 * y
    )
    flow = np.pi**2 * (-5.0 * (1.0 + 0.5 * bump) * mode + 0.5 * gradients)
    return 0.25 * np.exp(-time) * (-mode - flow)


def march(scheme: str, count: int, steps: int, device: str) -> np.ndarray:
    bump = cosines(count)[3]
    step = END / steps
    sample: Sample = diffusion_sample(
        1.0 + 0.5 * bump,
        bump > -2.0,
        exact(count, 0.0),
        scheme,
        step=step,
        size=(1.0, 1.0),
        device=device,
        fluid={"tolerance": 1e-6},
    )
    for index in range(steps):
        sample.set_water(sample.water + step * source(count, (index + 1) * step))
        sample.step(stage_name(scheme))
    return sample.water


def order(errors: list[float]) -> float:
    return float(np.log2(errors[-2] / errors[-1]))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_first_order_in_the_step(scheme: str, device: str) -> None:
    count = 16
    fine = 2.0 * march(scheme, count, 320, device) - march(scheme, count, 160, device)
    errors = [float(np.sqrt(np.mean((march(scheme, count, steps, device) - fine) ** 2))) for steps in (20, 40, 80)]
    assert order(errors) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("scheme", "steps"), [("split", 160), ("unsplit", 40), ("iterated", 40)])
def test_second_order_in_the_cell(scheme: str, steps: int, device: str) -> None:
    errors = []
    for count in (8, 16, 32):
        # Two steps extrapolated to none leave the error of the cells.
        settled = 2.0 * march(scheme, count, steps, device) - march(scheme, count, steps // 2, device)
        errors.append(float(np.sqrt(np.mean((settled - exact(count, END)) ** 2))))
    assert order(errors) == pytest.approx(2.0, abs=0.1)
