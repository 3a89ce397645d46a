"""Diffusion line by line: against LAPACK and exact modes, and bounded at any beta."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_banded
from scipy.sparse.linalg import spsolve

from fluid_sample import SCHEMES, diffusion_sample, ellipse, exchange_matrices, random_diffusivity, stage_name
from leafwarp.sim.fluid.conductance import face_conductance

# Of max y, of one step: some units in the last place, gathered along a line.
ROUNDING = {"float32": 1e-6, "float64": 2e-15}


def banded_line(beta: np.ndarray, old: np.ndarray) -> np.ndarray:
    """One line by LAPACK, in float64; ``beta`` between each cell and the next, shape [cell - 1]."""
    band = np.zeros((3, len(old)))
    band[1] = 1.0
    band[1, :-1] += beta
    band[1, 1:] += beta
    band[0, 1:] = -beta
    band[2, :-1] = -beta
    return solve_banded((1, 1), band, old)


@pytest.mark.parametrize("shape", [(7, 40), (40, 7), (1, 33), (33, 1), (1, 1), (2, 2)])
def test_each_line_agrees_with_lapack(shape: tuple[int, int], device: str, precision: str) -> None:
    rng = np.random.default_rng(1)
    mask = rng.random(shape) < 0.9
    # LAPACK's own error grows with beta: it is a reference up to about 10.
    diffusivity = random_diffusivity(rng, shape, (-3.0, 0.4))
    water = np.where(mask, rng.random(shape), 0.0)
    cell = (0.5, 2.0)
    sample = diffusion_sample(
        diffusivity,
        mask,
        water,
        size=(shape[1] * cell[0], shape[0] * cell[1]),
        device=device,
        precision=precision,
    )
    faces = face_conductance(diffusivity, mask, cell, 1.0)
    expected = np.array([banded_line(beta[:-1], old) for beta, old in zip(faces.x, water, strict=True)])
    expected = np.array([banded_line(beta[:-1], old) for beta, old in zip(faces.y.T, expected.T, strict=True)]).T
    assert sample.step("split_diffusion") == pytest.approx(expected, abs=2.0 * ROUNDING[precision])


def test_faces_take_the_mean_of_two_cells_and_close_at_the_margin() -> None:
    mask = np.array([[True, True, False], [True, True, True]])
    diffusivity = np.array([[1.0, 3.0, 100.0], [5.0, 7.0, 9.0]])
    faces = face_conductance(diffusivity, mask, (0.5, 2.0), 1.0)
    assert faces.x.tolist() == [[8.0, 0.0, 0.0], [24.0, 32.0, 0.0]]
    assert faces.y.tolist() == [[0.75, 1.25, 0.0], [0.0, 0.0, 0.0]]


@pytest.mark.parametrize("angle", [0.0, 15.0, 30.0, 45.0])
def test_a_vein_conducts_alike_at_every_angle(angle: float) -> None:
    """Flow through an antialiased vein three cells wide between two electrodes, over the continuum's."""
    count, width = 64, 3.0
    centre = np.arange(count) - (count - 1) / 2
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    along = direction[0] * centre[None, :] + direction[1] * centre[:, None]
    across = -direction[1] * centre[None, :] + direction[0] * centre[:, None]
    diffusivity = np.clip(width / 2 + 0.5 - np.abs(across), 0.0, 1.0)
    length = 40.0
    alive = np.abs(along) < length / 2 + 4.0
    x, y = exchange_matrices(diffusivity, alive, 1.0)
    held = (np.abs(along) > length / 2).ravel()
    system = (x + y).tocsc()
    free = ~held & (system.diagonal() > 0.0)
    content = np.where(along.ravel() > 0.0, 1.0, 0.0)
    content[free] = spsolve(system[free][:, free], -(system[free][:, held] @ content[held]))
    flow = (system @ content)[held & (along.ravel() > 0.0)].sum()
    assert flow == pytest.approx(width / length, rel=0.1)


@pytest.mark.parametrize(("p", "q"), [(1, 0), (0, 1), (2, 3), (15, 15), (31, 5)])
@pytest.mark.parametrize("beta", [0.0, 0.3, 40.0, 1e6])
def test_a_cosine_decays_by_the_exact_factor(p: int, q: int, beta: float, device: str, precision: str) -> None:
    count = 32
    centre = (np.arange(count) + 0.5) / count
    mode = np.cos(p * np.pi * centre)[None, :] * np.cos(q * np.pi * centre)[:, None]
    uniform = np.full((count, count), beta)
    sample = diffusion_sample(
        uniform, uniform >= 0.0, 0.5 + 0.5 * mode, device=device, precision=precision,
        fluid={"lamina_diffusivity": beta},
    )  # fmt: skip
    rates = [4.0 * beta * np.sin(k * np.pi / (2 * count)) ** 2 for k in (p, q)]
    expected = 0.5 + 0.5 * mode / ((1.0 + rates[0]) * (1.0 + rates[1]))
    name = "split_diffusion"
    after = sample.step(name) if name in sample.stages else sample.water
    # A factor of 1e-6 in the amplitude is a few roundings of the weights times sqrt(beta) cells of reach.
    assert after == pytest.approx(expected, abs=4.0 * ROUNDING[precision])


@pytest.mark.parametrize("decades", [(-6.0, 6.0), (0.0, 12.0), (12.0, 12.0), (25.0, 40.0)])
def test_water_stays_and_keeps_its_range_at_any_beta(decades: tuple, device: str, precision: str) -> None:
    rng = np.random.default_rng(2)
    shape = (48, 70)
    mask = ellipse(*shape)
    water = np.where(mask, rng.random(shape), 0.0)
    diffusivity = random_diffusivity(rng, shape, decades)
    sample = diffusion_sample(diffusivity, mask, water, device=device, precision=precision)
    before = sample.leaf_water
    for _ in range(5):
        sample.step("split_diffusion")
        after = sample.leaf_water
        assert np.isfinite(after).all()
        assert abs(after.sum() - before.sum()) <= ROUNDING[precision] * len(after)
        assert after.min() >= before.min()
        assert after.max() <= before.max()
        assert not sample.water[~mask].any()
        before = after


@pytest.mark.parametrize("content", [0.0, 1.0, 0.3])
def test_a_constant_field_stays_the_same_to_the_last_bit(content: float, device: str, precision: str) -> None:
    rng = np.random.default_rng(3)
    mask = ellipse(40)
    water = np.where(mask, content, 0.0)
    diffusivity = random_diffusivity(rng, mask.shape, (-6.0, 12.0))
    sample = diffusion_sample(diffusivity, mask, water, device=device, precision=precision)
    before = sample.water
    assert np.array_equal(sample.step("split_diffusion"), before)


def test_water_stays_over_many_steps(device: str, precision: str) -> None:
    """Roundings do not add up in one direction: 500 steps lose no more than one may."""
    rng = np.random.default_rng(4)
    mask = ellipse(48)
    water = np.where(mask, 0.9 * rng.random(mask.shape), 0.0)
    sample = diffusion_sample(
        np.full(mask.shape, 0.6),
        mask,
        water,
        device=device,
        precision=precision,
        fluid={"lamina_diffusivity": 0.6},
    )
    before = sample.leaf_water.mean()
    for _ in range(500):
        sample.stages[stage_name("split")].run(None)
    assert abs(sample.leaf_water.mean() - before) <= 2.0 * ROUNDING[precision]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_isolated_cells_keep_their_water(scheme: str, device: str, precision: str) -> None:
    mask = np.zeros((6, 6), bool)
    mask[0, 0] = mask[2, 3] = mask[4, 1:5] = True
    water = np.where(mask, np.linspace(0.1, 0.9, 36).reshape(6, 6), 0.0)
    sample = diffusion_sample(np.full(mask.shape, 1e6), mask, water, scheme, device=device, precision=precision)
    before = sample.water
    after = sample.step(stage_name(scheme))
    assert after[0, 0] == before[0, 0] and after[2, 3] == before[2, 3]
    # Cells in a row at beta 1e6 are mixed but for about 1 / beta of their differences.
    assert after[4, 1:5] == pytest.approx(np.full(4, before[4, 1:5].mean()), abs=2e-6)


def test_two_runs_agree_to_the_last_bit(device: str, precision: str) -> None:
    rng = np.random.default_rng(5)
    mask = ellipse(40)
    water = np.where(mask, rng.random(mask.shape), 0.0)
    diffusivity = random_diffusivity(rng, mask.shape, (-2.0, 4.0))
    for scheme in SCHEMES:
        runs = []
        for _ in range(2):
            sample = diffusion_sample(diffusivity, mask, water, scheme, device=device, precision=precision)
            runs.append(sample.step(stage_name(scheme)).tobytes())
        assert runs[0] == runs[1]
