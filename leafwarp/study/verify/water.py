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

# What a mean of two numbers may leave their range by.
UNIT_IN_LAST_PLACE = {"float32": 2.4e-7, "float64": 4.5e-16}
PRECISIONS = ("float32", "float64")
# To which the unsplit scheme solves in float64: the square of the default fluid.tolerance.
UNSPLIT_TOLERANCE = 1e-10


def _uniform_sample(
    beta: float, count: int, water: np.ndarray, scheme: str, device: str, precision: str, **fluid: float
) -> Sample:
    """A square map on which beta is the same everywhere."""
    uniform = np.full((count, count), beta)
    table = {"lamina_diffusivity": beta} | fluid
    return diffusion_sample(uniform, uniform >= 0.0, water, scheme, device=device, precision=precision, fluid=table)


def mode_decay(device: str) -> list[Check]:
    """``cos(p pi x) cos(q pi y)`` on N^2 cells: a step multiplies it by ``1 / ((1 + l_p) (1 + l_q))``, and without
    splitting by ``1 / (1 + l_p + l_q)``, with ``l_p = 4 beta sin^2(p pi / 2N)``."""
    count, p, q = 32, 2, 3
    centre = np.pi * (np.arange(count) + 0.5) / count
    mode = np.cos(p * centre)[None, :] * np.cos(q * centre)[:, None]
    checks = []
    for scheme in ("split", "unsplit"):
        for precision in PRECISIONS:
            # A factor is some roundings of the contents, and the unsplit scheme's tolerance.
            tolerance = 4.0 * ROUNDING[precision]
            if scheme == "unsplit":
                tolerance += {"float32": 1e-5, "float64": UNSPLIT_TOLERANCE}[precision]
            for beta in (0.3, 40.0, 1e6):
                along_x, along_y = (4.0 * beta * np.sin(k * np.pi / (2 * count)) ** 2 for k in (p, q))
                both = (1.0 + along_x) * (1.0 + along_y) if scheme == "split" else 1.0 + along_x + along_y
                sample = _uniform_sample(beta, count, 0.5 + 0.5 * mode, scheme, device, precision)
                after = 2.0 * (sample.diffuse() - 0.5)
                got = (after * mode).sum() / (mode**2).sum()
                checks.append(near(f"{scheme}, beta {beta:g}, {precision}: factor", 1.0 / both, got, tolerance))
    return checks


def maximum_principle(device: str) -> list[Check]:
    """Five steps over 12 decades of beta on a leaf-shaped map."""
    checks = []
    for scheme in ("split", "unsplit"):
        for precision in PRECISIONS:
            for decades in ((-6.0, 6.0), (0.0, 12.0)) if scheme == "split" else ((-6.0, 6.0),):
                lost, beyond = _lost_and_beyond(scheme, decades, device, precision)
                name = f"{scheme}, beta 1e{decades[0]:+.0f} to 1e{decades[1]:+.0f}, {precision}"
                slack = UNIT_IN_LAST_PLACE[precision]
                if scheme == "unsplit":
                    slack += {"float32": 1e-5, "float64": UNSPLIT_TOLERANCE}[precision]
                checks.append(near(f"{name}: water lost a step, of largest y", 0.0, lost, ROUNDING[precision]))
                checks.append(near(f"{name}: beyond the extremes", 0.0, beyond, slack))
    return checks


def _lost_and_beyond(scheme: str, decades: tuple[float, float], device: str, precision: str) -> tuple[float, float]:
    """Most of the mean content that a step loses, and most that it leaves the range before it by."""
    rng = np.random.default_rng(2)
    mask = ellipse(48, 70)
    water = np.where(mask, rng.random(mask.shape), 0.0)
    diffusivity = random_diffusivity(rng, mask.shape, decades)
    sample = diffusion_sample(diffusivity, mask, water, scheme, device=device, precision=precision)
    lost = beyond = 0.0
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
            # Some roundings, and the tolerance of the unsplit scheme.
            checks.append(near(f"{scheme}, dt {step:g}: amplitude of the steady state", expected, got, 1e-9))
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
