"""The unsplit diffusion against a direct sparse solve, and what splitting costs in a diagonal vein."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import splu, spsolve

from fluid_sample import (
    diffusion_sample,
    ellipse,
    exchange_matrices,
    make_sample,
    random_diffusivity,
    stage_name,
)
from leafwarp.errors import SimulationError
from leafwarp.sim.fluid import unsplit
from leafwarp.study.verify.water import front

NAME = "unsplit_diffusion"
TOLERANCE = 1e-5
# The residual bounds the error in the 2-norm, relative to the contents: the scene's tolerance, float64 its
# square. In float32 the rounding of the contents comes on top.
RELATIVE_ERROR = {"float32": TOLERANCE + 1e-6, "float64": TOLERANCE**2}
LEFT_OPEN = "unsplit, solver left open"
by_either_solver = pytest.mark.parametrize("scheme", ["unsplit", "iterated"])
ROUNDING = {"float32": 2e-7, "float64": 1e-15}


def veined(rows: int, columns: int, contrast: float) -> tuple[np.ndarray, np.ndarray]:
    """An elliptic leaf with a midrib and slanting side veins: mask and diffusivity, 1 in the veins."""
    mask = ellipse(rows, columns)
    y, x = np.mgrid[0:rows, 0:columns].astype(float)
    x -= columns / 2
    distance = np.abs(x)
    for foot in range(6, rows, 12):
        distance = np.minimum(distance, np.abs(y - foot - 0.8 * np.abs(x)) / 1.3)
    return mask, (np.clip(2.0 - distance, 0.0, 1.0) * (contrast - 1.0) + 1.0) / contrast


@pytest.mark.parametrize("beta", [1.0, 100.0, 1e4, 1e6])
@pytest.mark.parametrize("contrast", [100.0, 1000.0])
@by_either_solver
def test_a_step_agrees_with_a_direct_solve(
    scheme: str, beta: float, contrast: float, device: str, precision: str
) -> None:
    rng = np.random.default_rng(1)
    mask, shape = veined(56, 44, contrast)
    water = np.where(mask, rng.random(mask.shape), 0.0).astype(np.float32)
    sample = diffusion_sample(beta * shape, mask, water, scheme, device=device, precision=precision)
    x, y = exchange_matrices(beta * shape, mask, 1.0)
    old = sample.water.ravel()
    # One step of refinement: the direct solve's own residual is of the order of beta roundings.
    solve = splu((sparse.identity(mask.size) + x + y).tocsc()).solve
    expected = solve(old)
    expected = expected + solve(old - expected - (x + y) @ expected)
    after = sample.step(stage_name(scheme)).ravel()
    assert np.linalg.norm(after - expected) <= RELATIVE_ERROR[precision] * np.linalg.norm(old)
    assert abs(after.sum() - old.sum()) <= ROUNDING[precision] * mask.sum()
    inside = mask.ravel()
    tolerance = RELATIVE_ERROR[precision]
    assert old[inside].min() - tolerance <= after[inside].min() <= after[inside].max() <= old.max() + tolerance
    assert not after[~inside].any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (2, 2), (9, 25)])
@by_either_solver
def test_any_shape_of_map(scheme: str, shape: tuple[int, int], device: str, precision: str) -> None:
    rng = np.random.default_rng(2)
    mask = np.ones(shape, bool)
    diffusivity = random_diffusivity(rng, shape, (-2.0, 3.0))
    water = rng.random(shape).astype(np.float32)
    sample = diffusion_sample(
        diffusivity,
        mask,
        water,
        scheme,
        size=(0.5 * shape[1], 2.0 * shape[0]),
        device=device,
        precision=precision,
    )
    x, y = exchange_matrices(diffusivity, mask, 1.0, (0.5, 2.0))
    expected = spsolve((sparse.identity(mask.size) + x + y).tocsc(), water.ravel().astype(float))
    after = sample.step(stage_name(scheme)).ravel()
    assert np.linalg.norm(after - expected) <= RELATIVE_ERROR[precision] * np.linalg.norm(water)


@pytest.mark.parametrize("content", [0.0, 1.0, 0.3])
def test_a_constant_field_takes_no_iteration_and_no_solve(content: float, device: str, precision: str) -> None:
    mask, diffusivity = veined(30, 24, 100.0)
    water = np.where(mask, content, 0.0)
    for scheme in ("unsplit", "iterated"):
        sample = diffusion_sample(1e4 * diffusivity, mask, water, scheme, device=device, precision=precision)
        before = sample.water
        stage = sample.stages[stage_name(scheme)]
        assert np.array_equal(sample.step(stage.name), before)
        assert (stage.iterations if scheme == "iterated" else stage.system.solves) == 0


@pytest.mark.parametrize("decades", [(-6.0, 6.0), (0.0, 12.0), (12.0, 12.0), (25.0, 40.0)])
@pytest.mark.parametrize("scheme", ["unsplit", "iterated", LEFT_OPEN])
def test_any_beta_gives_a_bounded_step_or_a_clear_refusal(
    scheme: str, decades: tuple, device: str, precision: str
) -> None:
    rng = np.random.default_rng(3)
    mask = ellipse(20, 16)
    water = np.where(mask, rng.random(mask.shape), 0.0)
    diffusivity = random_diffusivity(rng, mask.shape, decades)
    sample = diffusion_sample(diffusivity, mask, water, scheme, device=device, precision=precision)
    before = sample.leaf_water
    try:
        sample.fluid.advance(1.0, frame=2)
    except SimulationError as error:
        # The factor solves all of them; conjugate gradients in double precision all but contrasts of 1e12.
        assert scheme == "iterated" and (precision == "float32" or decades in [(0.0, 12.0), (25.0, 40.0)])
        assert re.match(rf"frame 2: {NAME}: after (\d+ iterations|6 solves)", str(error))
        assert "fluid.scheme = 'split'" in str(error)
        return
    after = sample.leaf_water
    # A component of the leaf that is cut off by dead cells keeps its water to the tolerance; the whole to
    # rounding.
    tolerance = RELATIVE_ERROR[precision] * np.sqrt(len(before))
    assert before.min() - tolerance <= after.min() <= after.max() <= before.max() + tolerance
    assert abs(after.sum() - before.sum()) <= ROUNDING[precision] * len(before)


def test_a_factor_takes_over_from_iterations_that_do_not_end(monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    """Filled from a source that is cut: the steps of the factor, to the rounding of the contents, and the ledger."""
    monkeypatch.setattr(unsplit, "ITERATIONS_BEFORE_FACTOR", 1)
    mask, diffusivity = veined(30, 24, 100.0)
    foot = np.zeros(mask.shape)
    foot[np.argwhere(mask)[:4, 0], np.argwhere(mask)[:4, 1]] = 0.25
    after = []
    for scheme in ("unsplit", LEFT_OPEN):
        tables = {
            "fluid": {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
            "source": {"conductance": 5e-5, "cut_at": 270.0},
            "time": {"duration": 600.0, "frames": 2},
        }
        maps = {"venation": diffusivity, "source": foot, "water": np.where(mask, 0.3, 0.0)}
        sample = make_sample(tables, mask, maps, device=device)
        sample.fluid.advance(600.0)
        after.append(sample.leaf_water)
        ledger = sample.fluid.ledger()
        assert ledger.added > 0.0
        assert abs(ledger.error) <= 1e-6
    stage = sample.stages[NAME]
    assert stage.iterations == 1 and stage.system.solves >= 10
    assert np.abs(after[0] - after[1]).max() <= 10 * ROUNDING["float32"]


@pytest.mark.parametrize("decades", [(17.0, 24.0), (25.0, 40.0)])
def test_numbers_that_ran_over_do_not_stay_when_the_factor_takes_over(decades: tuple, device: str) -> None:
    rng = np.random.default_rng(5)
    mask = np.ones((12, 12), bool)
    foot = np.zeros(mask.shape)
    foot[0, :3] = 1.0
    diffusivity = random_diffusivity(rng, mask.shape, decades)
    most = float(diffusivity.max())
    tables = {
        "fluid": {"step": 1.0, "scheme": LEFT_OPEN, "lamina_diffusivity": 0.0, "vein_diffusivity": most},
        "source": {"conductance": 1e-3},
        "time": {"duration": 10.0, "frames": 2},
    }
    maps = {"venation": diffusivity / most, "source": foot, "water": rng.random(mask.shape)}
    sample = make_sample(tables, mask, maps, (12.0, 12.0), device)
    sample.fluid.advance(2.0)
    assert sample.stages[NAME].system is not None
    assert np.isfinite(sample.leaf_water).all()
    assert abs(sample.fluid.ledger().error) < 1e-6


def test_a_leaf_may_dry_out(device: str, precision: str) -> None:
    """In the step in which the last water goes, the one before says nothing about what is left."""
    mask, diffusivity = veined(24, 20, 100.0)
    tables = {
        "fluid": {"step": 60.0, "scheme": "iterated", "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
        "transpiration": {"rate": 4e-4},
        "time": {"duration": 60.0 * 60, "frames": 2},
    }
    sample = make_sample(tables, mask, {"venation": diffusivity, "stomata": mask}, device=device, precision=precision)
    sample.fluid.advance(60.0 * 60)
    assert abs(sample.leaf_water).max() < 1e-6
    assert abs(sample.fluid.ledger().error) < 1e-6


def test_too_few_iterations_are_refused_with_a_remedy(monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    monkeypatch.setattr(unsplit, "MAXIMUM_ITERATIONS", 3)
    mask, diffusivity = veined(30, 24, 100.0)
    water = np.where(mask, np.linspace(0.0, 1.0, mask.size).reshape(mask.shape), 0.0)
    sample = diffusion_sample(1e5 * diffusivity, mask, water, "iterated", device=device, precision="float32")
    with pytest.raises(
        SimulationError, match=r"frame 7: unsplit_diffusion: after 3 iterations .* fluid.tolerance = 1e-05"
    ):
        sample.fluid.advance(1.0, frame=7)


def test_looking_at_the_residual_less_often_changes_nothing(device: str, precision: str) -> None:
    mask, diffusivity = veined(30, 24, 100.0)
    water = np.where(mask, np.linspace(0.0, 1.0, mask.size).reshape(mask.shape), 0.0)
    after = []
    for looks in (1, 7):
        sample = diffusion_sample(50.0 * diffusivity, mask, water, "iterated", device=device, precision=precision)
        sample.stages[NAME]._iterations_per_look = looks
        after.append(sample.step(NAME).tobytes())
        iterations = sample.stages[NAME].iterations
    assert after[0] == after[1]
    assert 0 < iterations < 200


# Plant time is the same in each: beta * steps = 2500. Splitting holds back what flows along a vein that is
# not parallel to the lines; the shares are what is measured, with a margin of a tenth.
@pytest.mark.parametrize(
    ("angle", "beta", "least", "most"),
    [
        (0.0, 625.0, 0.6, 0.8),
        (0.0, 39.0625, 0.9, 1.0),
        (30.0, 625.0, 0.0, 0.04),
        (30.0, 39.0625, 0.5, 0.7),
        (45.0, 625.0, 0.0, 0.02),
        (45.0, 39.0625, 0.45, 0.65),
        (45.0, 9.765625, 0.7, 0.9),
    ],
)
def test_splitting_holds_water_back_in_a_slanting_vein(
    angle: float, beta: float, least: float, most: float, device: str
) -> None:
    steps = round(2500.0 / beta)
    split, expected = front(angle, beta, steps, "split", device)
    assert expected > 0.35
    assert least <= split / expected <= most


@by_either_solver
def test_the_scheme_keeps_the_ledger(scheme: str, device: str, precision: str) -> None:
    mask, diffusivity = veined(40, 32, 100.0)
    foot = np.zeros(mask.shape)
    foot[np.argwhere(mask)[:4, 0], np.argwhere(mask)[:4, 1]] = 0.25
    tables = {
        "fluid": {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
        "transpiration": {"rate": 1e-4, "cuticle_rate": 1e-4},
        "source": {"conductance": 5e-5},
        "time": {"duration": 1800.0, "frames": 2},
    }
    maps = {"venation": diffusivity, "source": foot}
    sample = make_sample(tables, mask, maps, device=device, precision=precision)
    sample.fluid.advance(1800.0)
    ledger = sample.fluid.ledger()
    assert ledger.transpired > 0.1 and ledger.added > 0.0
    # Thirty steps of rounding, each well below the unit in the last place.
    assert abs(ledger.error) <= {"float32": 1e-6, "float64": 1e-14}[precision]
