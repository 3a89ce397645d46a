"""Diffusion against exact modes, its own principles, and a direct solve."""

from __future__ import annotations

import numpy as np

from leafwarp.study.verify.case import Check, near, near_share
from leafwarp.study.verify.drawn_fluid import (
    Sample,
    diffusion_sample,
    ellipse,
    exchange_matrices,
    random_diffusivity,
)
from leafwarp.study.verify.lines import ROUNDING

PRECISIONS = ("float32", "float64")


def _uniform_sample(
    beta: float, count: int, water: np.ndarray, scheme: str, device: str, precision: str, **fluid: float
) -> Sample:
    """A square map on which beta is the same everywhere."""
    uniform = np.full((count, count), beta)
    table = {"lamina_diffusivity": beta} | fluid
    return diffusion_sample(uniform, uniform >= 0.0, water, scheme, device=device, precision=precision, fluid=table)


def mode_decay(device: str) -> list[Check]:
    """``cos(p pi x) cos(q pi y)`` on N^2 cells: a step multiplies it by ``1 / ((1 + l_p) (1 + l_q))``, and without
    splitting by ``1 / (1 + l_p + l_q)``, with ``l_p = 4 beta sin^2(p pi / 2N)``.

    The error is the largest of a cell over the amplitude that is left, and what is allowed is the rounding of the
    contents, of which the mode is twice the departure from 1/2, over that amplitude. At a large beta the slowest mode
    is taken: of any other less is left than a float32 can hold.
    """
    count = 32
    centre = np.pi * (np.arange(count) + 0.5) / count
    checks = []
    for scheme in ("split", "unsplit"):
        for precision in PRECISIONS:
            for beta, p, q in ((0.3, 2, 3), (40.0, 2, 3), (1e6, 1, 0)):
                mode = np.cos(p * centre)[None, :] * np.cos(q * centre)[:, None]
                along_x, along_y = (4.0 * beta * np.sin(k * np.pi / (2 * count)) ** 2 for k in (p, q))
                factor = 1.0 / ((1.0 + along_x) * (1.0 + along_y) if scheme == "split" else 1.0 + along_x + along_y)
                sample = _uniform_sample(beta, count, 0.5 + 0.5 * mode, scheme, device, precision)
                after = 2.0 * (sample.diffuse() - 0.5)
                got = (after * mode).sum() / (mode**2).sum()
                error = np.abs(after - factor * mode).max() / factor
                name = f"{scheme}, beta {beta:g}, {precision}: amplitude that is left"
                checks.append(Check(name, factor, float(got), float(error), 2.0 * ROUNDING[precision] / factor, True))
    return checks


def maximum_principle(device: str) -> list[Check]:
    """Five steps over 12 decades of beta on a leaf-shaped map, from random contents and from patches of two.

    The extremes are not exceeded by a rounding either. A line's content is a mean of two others, and the mean of two
    floating-point numbers leaves their range only where one of them has all the weight but a rounding; that one has the
    other in it by at least one part in the cells of the line, and is no extreme. The unsplit scheme solves for the
    change, which is nothing where all is alike.
    """
    checks = []
    for scheme in ("split", "unsplit"):
        for precision in PRECISIONS:
            for decades in ((-6.0, 6.0), (0.0, 12.0)):
                lost, beyond = _lost_and_beyond(scheme, decades, device, precision)
                name = f"{scheme}, beta 1e{decades[0]:+.0f} to 1e{decades[1]:+.0f}, {precision}"
                checks.append(near(f"{name}: water lost a step, of largest y", 0.0, lost, ROUNDING[precision]))
                checks.append(near(f"{name}: beyond the extremes", 0.0, beyond, 0.0))
    return checks


def _lost_and_beyond(scheme: str, decades: tuple[float, float], device: str, precision: str) -> tuple[float, float]:
    """Most of the mean content that a step loses, and most that it leaves the range before it by."""
    rng = np.random.default_rng(2)
    mask = ellipse(48, 70)
    diffusivity = random_diffusivity(rng, mask.shape, decades)
    patches = np.kron(rng.random((12, 14)) < 0.5, np.ones((4, 5), bool))
    lost = beyond = 0.0
    for water in (rng.random(mask.shape), np.where(patches, 0.13, 0.9)):
        sample = diffusion_sample(
            diffusivity, mask, np.where(mask, water, 0.0), scheme, device=device, precision=precision
        )
        before = sample.leaf_water
        for _ in range(5):
            sample.diffuse()
            after = sample.leaf_water
            lost = max(lost, abs(after.mean() - before.mean()) / before.max())
            beyond = max(beyond, after.max() - before.max(), before.min() - after.min())
            before = after
    return lost, beyond


def steady_state_bias(device: str) -> list[Check]:
    """A source in the shape of a mode, until nothing changes any more.

    Adding ``dt f`` and then solving rows and columns is steady at ``1 / (1 + lambda dt / 2)`` of the amplitude that
    holds the source in balance, lambda being the mode's rate along each direction.
    """
    count = 24
    centre = np.pi * (np.arange(count) + 0.5) / count
    mode = np.cos(centre)[None, :] * np.cos(centre)[:, None]
    rate = 4.0 * count**2 * np.sin(np.pi / (2 * count)) ** 2  # of a unit square and a diffusivity of 1
    checks = []
    for scheme in ("split", "unsplit"):
        for step in (0.01, 0.1, 1.0):
            sample = diffusion_sample(
                np.ones((count, count)), mode > -2.0, 0.5 + 0.0 * mode, scheme, step, (1.0, 1.0), device, "float64",
                {"lamina_diffusivity": 1.0},
            )  # fmt: skip
            # An amplitude of 0.4 that is exact keeps the contents within 0 and 1.
            added = step * 2.0 * rate * 0.4 * mode
            for _ in range(round(40.0 / np.log1p(rate * step))):
                sample.set_water(sample.water + added)
                sample.diffuse()
            got = ((sample.water - 0.5) * mode).sum() / (0.4 * (mode**2).sum())
            expected = 1.0 / (1.0 + 0.5 * rate * step) if scheme == "split" else 1.0
            # Roundings of the contents, and of what some tens of steps leave of the way to the steady state.
            checks.append(near(f"{scheme}, dt {step:g}: amplitude of the steady state", expected, got, 1e-12))
    return checks


FRONT_TIME = 1250.0  # beta times steps


def front_in_a_vein(device: str) -> list[Check]:
    """The content at the middle of a vein three cells wide whose foot is held wet."""
    checks = []
    for angle in (0.0, 30.0, 45.0):
        for beta in (625.0, 39.0625):
            for scheme in ("unsplit", "iterated"):
                got, expected = front(angle, beta, 4, scheme, device)
                name = f"{scheme}, {angle:g} degrees, beta {beta:g}: content"
                checks.append(near(name, expected, got, 1e-7))
    # Splitting carries water by about one width of a slanting vein a step, whatever beta is: short steps are exact.
    for angle in (0.0, 30.0, 45.0):
        beta = FRONT_TIME / 1024
        got, expected = front(angle, beta, 1024, "split", device)
        checks.append(near_share(f"split, {angle:g} degrees, beta {beta:.3g}: content", expected, got, 0.05))
    return checks


def front(angle: float, beta: float, steps: int, scheme: str, device: str) -> tuple[float, float]:
    """Content at the middle of a straight vein with a wet foot: by the scheme, and by a direct solve.

    Args:
        angle: Of the vein with the rows [degree].
        beta: Exchange of a step between cells of the vein.
        steps: Number of steps.
        scheme: Of the diffusion.
        device: Warp device.
    """
    import scipy.sparse as sparse
    from scipy.sparse.linalg import splu

    count, width = 64, 3.0
    centre = np.arange(count) - (count - 1) / 2
    direction = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    along = direction[0] * centre[None, :] + direction[1] * centre[:, None]
    across = -direction[1] * centre[None, :] + direction[0] * centre[:, None]
    vein = np.clip(width / 2 + 0.5 - np.abs(across), 0.0, 1.0)
    diffusivity = vein + 1e-3 * (1.0 - vein)
    mask = np.ones(vein.shape, bool)
    foot = along < -20.0
    middle = np.unravel_index(np.argmin(np.abs(along) + np.abs(across)), vein.shape)
    sample = diffusion_sample(diffusivity, mask, 0.0 * vein, scheme, step=beta, device=device)
    x, y = exchange_matrices(diffusivity, mask, beta)
    solve = splu((sparse.identity(mask.size) + x + y).tocsc()).solve
    water, expected = sample.water, np.zeros(mask.size)
    for _ in range(steps):
        water[foot] = 1.0
        expected[foot.ravel()] = 1.0
        sample.set_water(water)
        water = sample.diffuse()
        expected = solve(expected)
    return float(water[middle]), float(expected.reshape(mask.shape)[middle])
