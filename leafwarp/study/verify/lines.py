"""Line solves of the diffusion against LAPACK and against rational numbers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from leafwarp.sim.fluid.conductance import face_conductance
from leafwarp.study.verify.case import Check, near
from leafwarp.study.verify.drawn_fluid import diffusion_sample, random_diffusivity

# Of the largest content, of one line: some units in the last place, gathered along it.
ROUNDING = {"float32": 1e-6, "float64": 2e-15}


def line_solve(device: str) -> list[Check]:
    """Rows and columns against LAPACK at moderate beta, and one line against rational numbers at any."""
    checks = []
    for precision, tolerance in ROUNDING.items():
        for along in ("rows", "columns"):
            error = _error_against_lapack(along, device, precision)
            checks.append(near(f"{along} against LAPACK, {precision}: error / largest y", 0.0, error, tolerance))
        for decades in ((-12.0, 12.0), (11.0, 12.0)):
            error = _error_against_fractions(decades, device, precision)
            name = f"beta 1e{decades[0]:+.0f} to 1e{decades[1]:+.0f} against rational numbers, {precision}"
            checks.append(near(f"{name}: error / largest y", 0.0, error, tolerance))
    return checks


def _error_against_lapack(along: str, device: str, precision: str) -> float:
    """Largest error on lines that dead lines between them keep apart, relative to the largest content."""
    from scipy.linalg import solve_banded

    rng = np.random.default_rng(1)
    shape = (33, 80)
    mask = np.zeros(shape, bool)
    mask[::2] = rng.random((17, 80)) < 0.9
    # LAPACK's own error grows with beta: it is a reference up to about 10.
    diffusivity = random_diffusivity(rng, shape, (-3.0, 1.0))
    # What a float32 can hold, so that both start from the same.
    water = np.where(mask, rng.random(shape), 0.0).astype(np.float32).astype(np.float64)
    beta = face_conductance(diffusivity, mask, (1.0, 1.0), 1.0).x
    maps = [diffusivity, mask, water]
    maps = maps if along == "rows" else [each.T for each in maps]
    got = diffusion_sample(*maps, device=device, precision=precision).diffuse()
    expected = np.empty(shape)
    for row in range(shape[0]):
        band = np.zeros((3, shape[1]))
        band[0, 1:] = band[2, :-1] = -beta[row, :-1]
        band[1] = 1.0 + beta[row]
        band[1, 1:] += beta[row, :-1]
        expected[row] = solve_banded((1, 1), band, water[row])
    return float(np.abs((got if along == "rows" else got.T) - expected).max() / water.max())


def _error_against_fractions(decades: tuple[float, float], device: str, precision: str) -> float:
    """Largest error on one line of 40 cells, relative to the largest content."""
    rng = np.random.default_rng(6)
    diffusivity = random_diffusivity(rng, (1, 40), decades)
    water = rng.random((1, 40)).astype(np.float32)
    mask = np.ones((1, 40), bool)
    sample = diffusion_sample(diffusivity, mask, water, device=device, precision=precision)
    beta = [Fraction(float(value)) for value in sample.state["conductance_x"].numpy()[0, :-1]]
    expected = _exact_line(beta, [Fraction(float(value)) for value in water[0]])
    return float(np.abs(sample.diffuse()[0] - expected).max() / water.max())


def _exact_line(beta: list[Fraction], old: list[Fraction]) -> list[float]:
    """One line by the textbook elimination in rational numbers."""
    count = len(old)
    diagonal = [1 + (beta[i - 1] if i else 0) + (beta[i] if i < count - 1 else 0) for i in range(count)]
    content = list(old)
    for i in range(1, count):
        factor = -beta[i - 1] / diagonal[i - 1]
        diagonal[i] += factor * beta[i - 1]
        content[i] -= factor * content[i - 1]
    content[-1] /= diagonal[-1]
    for i in reversed(range(count - 1)):
        content[i] = (content[i] + beta[i] * content[i + 1]) / diagonal[i]
    return [float(value) for value in content]
