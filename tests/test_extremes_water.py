"""The water at the extremes: steps, conductances, sinks, sources and maps far beyond any leaf's.

What other tests show already:

======================================================  =============================================================
beta 0 to 1e40, a fifth of the cells dead               test_fluid_split: test_a_cosine_decays_by_the_exact_factor,
                                                        test_water_stays_and_keeps_its_range_at_any_beta;
                                                        test_fluid_unsplit: test_any_beta_gives_a_bounded_step_or_...
isolated cells                                          test_fluid_split: test_isolated_cells_keep_their_water
1 x N, N x 1, one cell, leaves one cell wide            test_fluid_water: test_thin_maps_and_leaves_one_cell_wide;
                                                        test_fluid_unsplit: test_any_shape_of_map; test_sampling
bone dry, saturated                                     test_fluid_water: test_bone_dry_and_saturated;
                                                        test_fluid_unsplit: test_a_leaf_may_dry_out
sinks larger than the content                           test_fluid_water: test_a_sink_takes_no_more_than_is_there,
                                                        test_closing_stomata_take_no_more_than_is_there
sources into full cells, strengths 1e-12 to 1e300       test_fluid_source: test_contents_stay_between_the_leafs_...,
                                                        test_a_leaf_as_wet_as_its_supply_stays_the_same_to_the_...
steps 1e-300 to 3e11 s                                  test_fluid_water: test_steps_beyond_reason_are_refused,
                                                        test_closing_stomata_take_no_more_than_is_there
======================================================  =============================================================
"""

from __future__ import annotations

import numpy as np
import pytest

from fluid_sample import SCHEMES, diffusion_sample, ellipse, make_sample
from leafwarp.study.stability.drift import drying_leaf
from leafwarp.study.stability.point import BROKEN, INACCURATE, REFUSED, STABLE
from swept import outcomes, points_of

ITERATED = "unsplit, conjugate_gradients"
# Of a mean content after some steps.
LEDGER = {"float32": 2e-6, "float64": 1e-12}


def refused(found: dict) -> set:
    return {key for key, outcome in found.items() if outcome == REFUSED}


def test_a_step_of_1e_minus_6_to_1e9_diffusion_times_spreads_water_and_loses_none(device: str) -> None:
    steps = (1e-6, 1e-2, 1e2, 1e9)
    points = points_of("fluid_step", steps, device)
    found = outcomes(points)
    # Iterations in float32 do not end where nothing but rounding is left of the 1 on the diagonal.
    assert refused(found) == {(ITERATED, "float32", 1e9)}
    assert "fluid.scheme = 'split'" in points[ITERATED, "float32", 1e9].message
    for (method, precision, step), outcome in found.items():
        if (method, precision, step) not in refused(found):
            # In 8 steps of a hundredth of that time an error of first order shows, and that of the splitting; before
            # and after they do not.
            shows = step == 1e-2 and method != "unsplit, order 2"
            assert outcome == (INACCURATE if shows else STABLE), points[method, precision, step]


def test_a_fed_leaf_stays_within_its_range_at_any_step(device: str) -> None:
    points = points_of("fed_step", (1e-6, 1e-3, 1.0, 1e9), device)
    found = outcomes(points)
    assert not {key for key, outcome in found.items() if outcome in (BROKEN, REFUSED)}
    for (method, precision, step), outcome in found.items():
        # Splitting keeps the steady state of steps much shorter than the diffusion time alone; no scheme does that of a
        # step in which all water transpires.
        most = 1e-3 if method.startswith("split") else 1.0
        assert outcome == (STABLE if step <= most else INACCURATE), points[method, precision, step]


@pytest.mark.parametrize(("name", "values"), [("conductance", (1e-12, 1.0, 1e12)), ("contrast", (1.0, 1e12))])
def test_any_conductance_and_contrast_is_solved_for_or_refused(name: str, values: tuple, device: str) -> None:
    points = points_of(name, values, device)
    found = outcomes(points)
    expected = {(ITERATED, "float32", 1e12)}
    assert refused(found) == (expected | {(ITERATED, "float64", 1e12)} if name == "contrast" else expected)
    assert {found[key] for key in found.keys() - refused(found)} == {STABLE}, points


def test_any_source_fills_and_any_sink_dries_as_its_equation_says(device: str) -> None:
    for name, values in (("source", (1e-6, 1.0, 1e12)), ("sinks", (1e-6, 1.0, 1e9))):
        points = points_of(name, values, device)
        assert set(outcomes(points).values()) == {STABLE}, points


@pytest.mark.parametrize("scheme", SCHEMES)
def test_islands_share_no_water(scheme: str, device: str, precision: str) -> None:
    """Three islands, two of which touch at a corner; a source feeds one of them, all of them transpire."""
    mask = np.zeros((12, 14), bool)
    mask[1:5, 1:6] = mask[5:9, 6:12] = mask[11, 1:13] = True
    mask[2, 2] = False  # a hole
    island = np.zeros(mask.shape, int)
    island[1:5, 1:6], island[5:9, 6:12], island[11, 1:13] = 1, 2, 3
    foot = np.zeros(mask.shape)
    foot[1, 1] = 1.0
    tables = {
        "fluid": {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1.0, "vein_diffusivity": 1.0},
        "source": {"conductance": 1e-3},
        "transpiration": {"rate": 1e-5, "cuticle_rate": 1e-5},
        "time": {"duration": 1200.0, "frames": 2},
    }
    water = np.where(mask, 0.2 + 0.2 * island, 0.0)
    sample = make_sample(tables, mask, {"water": water, "source": foot}, (1.4, 1.2), device, precision)
    sample.fluid.advance(1200.0)
    slack = 1e-4 if scheme == "iterated" and precision == "float32" else 2e-6
    for number in (2, 3):
        own = mask & (island == number)
        assert sample.water[own] == pytest.approx(0.2 + 0.2 * number - 1200.0 * 1e-5, abs=slack)
    assert sample.water[mask & (island == 1)].min() > 0.9
    assert not sample.water[~mask].any()
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]


def test_the_account_closes_after_thousands_of_steps(device: str) -> None:
    found = outcomes(points_of("fluid_steps", (1.0, 1e3), device))
    assert set(found.values()) == {STABLE}


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "steps"), [("split", 1e6), ("unsplit", 1e5)])
def test_the_account_closes_after_a_million_steps(scheme: str, steps: float, device: str, precision: str) -> None:
    """A step by the factor takes ten times as long as a split one: a tenth of them."""
    sample = drying_leaf(scheme, precision, device, steps)
    sample.fluid.advance(60.0 * steps)
    assert 0.0 <= sample.leaf_water.min() <= sample.leaf_water.max() <= 1.0
    ledger = sample.fluid.ledger()
    # Of the contents, rounded at every step; of the account, whose float64 is rounded a million times.
    limit = {"float32": 1e-5, "float64": 1e-10}[precision] * (ledger.start + ledger.added)
    assert abs(ledger.error) <= limit and ledger.added > 1e-3 * steps


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["split", "iterated"])
def test_a_map_of_4096_cells_each_way(scheme: str, device: str, precision: str) -> None:
    count = 4096
    mask = ellipse(count)
    rng = np.random.default_rng(6)
    coarse = 10.0 ** rng.uniform(-2.0, 2.0, (64, 64))
    diffusivity = np.kron(coarse, np.ones((64, 64)))
    water = np.where(mask, np.kron(rng.random((64, 64)), np.ones((64, 64))), 0.0)
    sample = diffusion_sample(diffusivity, mask, water, scheme, device=device, precision=precision)
    before = sample.leaf_water
    sample.fluid.advance(2.0)
    after = sample.leaf_water
    slack = 0.0 if scheme == "split" else 1e-5 * np.linalg.norm(before)
    assert before.min() - slack <= after.min() <= after.max() <= before.max() + slack
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]
    assert 0.0 < np.abs(after - before).max() and not sample.water[~mask].any()
