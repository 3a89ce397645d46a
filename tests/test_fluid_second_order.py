"""Fluid steps of second order, and steps that adapt to the water."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from fluid_sample import SCHEMES, Sample, ellipse, exchange_matrices, make_sample, make_scene, petiole_leaf
from leafwarp.errors import InputError, SimulationError
from leafwarp.leaf.leaf import Leaf, MapFrame
from leafwarp.scene import Scene
from leafwarp.sim.fluid.second_order import step_error
from leafwarp.sim.fluid.steps import HALF_STEP, FluidSteps
from leafwarp.sim.plan import make_stages

SIZE = (12, 10)
WIDTH = 0.1
DURATION = 1200.0
DIFFUSIVITY = 2e-7
LOSS, FEED = 1.5e-4, 2e-3  # [1/s]
# Ledger after some tens of steps; the extrapolation rounds once more.
LEDGER = {"float32": 3e-6, "float64": 3e-14}


def smooth_maps() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    mask = ellipse(*SIZE)
    row, column = np.indices(mask.shape)
    maps = {
        "water": np.where(mask, 0.7 + 0.2 * np.sin(0.5 * row) * np.cos(0.4 * column), 0.0),
        "stomata": np.where(mask, 1.0 + 0.5 * np.sin(0.3 * column), 0.0),
        "source": (mask & (row < 3)).astype(float),
    }
    return mask, maps


def fluid(scheme: str, count: int, device: str = "cpu", precision: str = "float64", **table) -> Sample:
    """A leaf with a smooth field, loss and a source in so many steps."""
    mask, maps = smooth_maps()
    own = {"step": DURATION / count, "scheme": scheme, "lamina_diffusivity": DIFFUSIVITY}
    tables = {
        "fluid": own | {"vein_diffusivity": DIFFUSIVITY, "order": 2} | table,
        "transpiration": {"rate": LOSS},
        "source": {"conductance": FEED},
        "time": {"duration": DURATION, "frames": 2},
    }
    size = (WIDTH, WIDTH * mask.shape[0] / mask.shape[1])
    return make_sample(tables, mask, maps, size, device, precision)


def exact_water() -> np.ndarray:
    """``dy/dt = -L y - g + G (1 - y)`` on the cells, solved by the exponential of its matrix."""
    mask, maps = smooth_maps()
    cell = WIDTH / mask.shape[1]
    along_x, along_y = exchange_matrices(np.full(mask.shape, DIFFUSIVITY), mask, 1.0, (cell, cell))
    inside = mask.ravel()
    exchange = (along_x + along_y).toarray()[np.ix_(inside, inside)]
    loss = LOSS * maps["stomata"][mask] / maps["stomata"][mask].mean()
    feed = FEED * maps["source"][mask] / maps["source"].sum() * mask.sum()
    count = len(loss)
    system = np.zeros((count + 1, count + 1))
    system[:count, :count] = -exchange - np.diag(feed)
    system[:count, count] = feed - loss
    return (expm(DURATION * system) @ np.append(maps["water"][mask], 1.0))[:count]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_errors_fall_with_the_square_of_the_step(scheme: str, device: str) -> None:
    expected = exact_water()

    def error(count: int, order: int) -> float:
        sample = fluid(scheme, count, device, order=order)
        sample.fluid.advance(DURATION)
        return float(np.linalg.norm(sample.leaf_water - expected) / np.linalg.norm(expected))

    first, second = ([error(count, order) for count in (24, 48, 96)] for order in (1, 2))
    assert np.log2(first[1] / first[2]) == pytest.approx(1.0, abs=0.1)
    assert np.log2(second[1] / second[2]) == pytest.approx(2.0, abs=0.2)
    assert second[0] < first[2]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_halves_tell_their_error(scheme: str, device: str) -> None:
    sample = fluid(scheme, 48, device)
    halves = fluid(scheme, 96, device, order=1)
    sample.fluid.advance(DURATION / 48)
    halves.fluid.advance(DURATION / 48)
    # They are what steps of half the length are, to the last bit.
    own = sample.state[HALF_STEP + "water"].numpy()
    assert own.tobytes() == halves.state["water"].numpy().tobytes()
    error = np.linalg.norm(sample.water - own) / np.linalg.norm(own)
    assert step_error(sample.state) == pytest.approx(error, rel=1e-9)
    # Of steps twice as long, four times as large, once the jump of the start is over.
    longer = fluid(scheme, 24, device)
    for each in (sample, longer):
        each.fluid.advance(DURATION)
    assert 3.0 < step_error(longer.state) / step_error(sample.state) < 5.0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_water_is_made_or_lost_and_none_leaves_its_bounds(scheme: str, device: str, precision: str) -> None:
    """While cells run dry, and others are filled to the brim."""
    mask, maps = smooth_maps()
    tables = {
        "fluid": {"step": 240.0, "scheme": scheme, "lamina_diffusivity": 1e-9, "vein_diffusivity": 1e-5, "order": 2},
        "transpiration": {"rate": 5e-4},
        "source": {"conductance": 5e-2, "supply": 0.9, "cut_at": 1000.0},
        "time": {"duration": 2400.0, "frames": 2},
    }
    maps["venation"] = (np.indices(mask.shape)[1] == 5) * 1.0
    sample = make_sample(tables, mask, maps, device=device, precision=precision)
    for step in range(1, 11):
        sample.fluid.advance(240.0 * step, step)
        sample.fluid.check(step)
        # What iterations leave undone aside.
        assert -1e-5 < sample.water.min() and sample.water.max() <= 0.9 + 1e-5
        assert abs(sample.fluid.ledger().error) <= LEDGER[precision]
    assert sample.leaf_water.min() < 1e-3
    assert sample.state["held_at_least"].numpy().sum() > 0.0
    # Split steps bring less water along the vein.
    assert scheme == "split" or sample.state["held_at_most"].numpy().sum() > 0.0


def test_a_step_that_would_overshoot_is_that_of_its_halves(device: str, precision: str) -> None:
    """Nothing transpires, so that nothing explains a content below 0: a spot on a dry leaf, at a large step."""
    mask = ellipse(24)
    water = np.where(np.indices(mask.shape).sum(axis=0) == 24, 1.0, 0.0) * mask
    table = {"step": 600.0, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-8, "order": 2}
    sample = make_sample({"fluid": table}, mask, {"water": water}, device=device, precision=precision)
    sample.fluid.advance(600.0)
    halves = sample.state[HALF_STEP + "water"].numpy()
    assert sample.state["water"].numpy().tobytes() == halves.tobytes()
    assert step_error(sample.state) > 0.0
    assert sample.water.sum() == pytest.approx(water.sum(), rel=1e-6)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_what_changes_nothing_changes_no_bit(scheme: str, device: str, precision: str) -> None:
    mask = ellipse(24)
    table = {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-8, "order": 2}
    sample = make_sample({"fluid": table}, mask, {"water": 0.37 * mask}, device=device, precision=precision)
    before = sample.state["water"].numpy().tobytes()
    for look in range(1, 11):
        sample.fluid.advance(60.0 * look, look)
        sample.fluid.check(look)
    assert sample.state["water"].numpy().tobytes() == before
    assert sample.fluid.steps_skipped > 0


def half_losing(order: int, count: int, device: str, precision: str, scheme: str, content: float = 1.0, **table):
    """A leaf of which one half transpires, at the end of 6000 s in so many steps."""
    mask = ellipse(24)
    fluid = {"step": 6000.0 / count, "scheme": scheme, "lamina_diffusivity": 1e-9, "vein_diffusivity": 1e-9}
    tables = {
        "fluid": fluid | {"order": order} | table,
        "transpiration": {"rate": 1e-4},
        "time": {"duration": 6000.0, "frames": 2},
    }
    maps = {"water": content * mask, "stomata": mask * (np.indices(mask.shape)[0] > 12)}
    sample = make_sample(tables, mask, maps, device=device, precision=precision)
    sample.fluid.advance(6000.0)
    return sample


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("content", [0.6, 1.0])
def test_rounding_leaves_the_order_alone(scheme: str, content: float, device: str) -> None:
    """0.6 is less than its float32, and errors of a step are less than what iterations may leave."""
    truth = half_losing(2, 1500, device, "float64", scheme, content).water
    first, second = (
        np.linalg.norm(half_losing(order, 100 * (3 - order), device, "float32", scheme, content).water - truth)
        for order in (1, 2)
    )
    assert second < 0.25 * first


@pytest.mark.parametrize("supply", [0.3, 0.6])
def test_a_leaf_as_wet_as_its_supply_keeps_its_ledger(supply: float, device: str) -> None:
    mask = ellipse(24)
    row = np.indices(mask.shape)[0]
    tables = {
        "fluid": {"step": 60.0, "lamina_diffusivity": 1e-10, "vein_diffusivity": 1e-10, "order": 2},
        "transpiration": {"rate": 1e-6},
        "source": {"conductance": 1.0, "supply": supply},
        "time": {"duration": 60.0 * 2000, "frames": 2},
    }
    maps = {"water": supply * mask, "stomata": mask * (row > 18), "source": mask * (row < 3)}
    sample = make_sample(tables, mask, maps, device=device)
    sample.fluid.advance(60.0 * 2000)
    assert abs(sample.fluid.ledger().error) < 1e-6


def test_as_many_steps_are_accepted_as_their_halves_allow() -> None:
    fluid = {"step": 1.0, "order": 2}
    assert FluidSteps.of(make_scene({"fluid": fluid, "time": {"duration": 4.9e6, "frames": 2}})).count == 4_900_000
    with pytest.raises(InputError, match=r"step = 1 s: 6e\+06 steps .* accepted: at most 5000000, a step of 1.2 s"):
        FluidSteps.of(make_scene({"fluid": fluid, "time": {"duration": 6e6, "frames": 2}}))


# Steps that adapt.


def drying(device: str, tolerance: float | None, count: int = 12, precision: str = "float64", **source) -> Sample:
    """An unsplit leaf that is cut off from its source after 40 % of the time."""
    mask, maps = smooth_maps()
    table = {"step": DURATION / count, "scheme": "unsplit", "lamina_diffusivity": 2e-7, "vein_diffusivity": 2e-7}
    source = {"conductance": 5e-2, "cut_at": 0.4 * DURATION} | source
    tables = {
        "fluid": table | {"order": 2} | ({"step_tolerance": tolerance} if tolerance else {}),
        "transpiration": {"rate": 3e-4},
        "source": source,
        "time": {"duration": DURATION, "frames": 2},
    }
    return make_sample(tables, mask, maps, device=device, precision=precision)


def play(sample: Sample, looks: int = 48) -> np.ndarray:
    """The water at so many moments."""
    found = []
    for look in range(1, looks + 1):
        sample.fluid.advance(DURATION * look / looks, look)
        found.append(sample.state["water_now"].numpy().astype(np.float64))
        sample.fluid.check(look)
    return np.array(found)


def test_a_smaller_tolerance_makes_a_smaller_error_with_more_steps(device: str) -> None:
    truth = play(drying(device, None, count=4800))
    errors, counts = [], []
    for tolerance in (3e-2, 3e-3, 3e-4):
        sample = drying(device, tolerance, count=1)
        errors.append(np.linalg.norm(play(sample) - truth) / np.linalg.norm(truth))
        counts.append(sample.fluid.steps_done)
        assert errors[-1] < tolerance
        assert abs(sample.fluid.ledger().error) < 1e-13
        equal = drying(device, None, count=counts[-1])
        assert np.linalg.norm(play(equal) - truth) / np.linalg.norm(truth) > 3.0 * errors[-1]
    assert errors[0] > 1.5 * errors[1] > 3.0 * errors[2] and counts[0] < counts[1] < counts[2]


@pytest.mark.parametrize("cut", [0.4, 0.57, 0.8])
def test_straight_lines_between_steps_show_the_cut(cut: float, device: str) -> None:
    """Wherever it falls in the longest steps, whose ends may both be right."""
    source = {"cut_at": cut * DURATION}
    truth, sample = play(drying(device, None, 4800, **source), 96), drying(device, 3e-3, 3, **source)
    error = np.linalg.norm(play(sample, 96) - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))
    assert error.max() < 0.02
    assert sample.fluid.steps_done < 200
    equal = play(drying(device, None, sample.fluid.steps_done, **source), 96)
    assert (np.linalg.norm(equal - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))).max() > 2.0 * error.max()


def test_steps_are_short_after_the_cut_and_long_again_later(device: str) -> None:
    sample = drying(device, 1e-4)
    fluid, lengths = sample.fluid, []
    for look in range(1, 241):
        before, moment = fluid.steps_done, DURATION * look / 240
        fluid.advance(moment)
        lengths += [(moment, fluid._last_span)] * (fluid.steps_done > before)
    spans = np.array(lengths)
    cut = 0.4 * DURATION
    just_after = spans[(spans[:, 0] >= cut) & (spans[:, 0] < cut + 0.05 * DURATION), 1].min()
    assert just_after < 0.25 * spans[spans[:, 0] < 0.95 * cut, 1].max()
    assert just_after < 0.25 * spans[spans[:, 0] > 0.8 * DURATION, 1].max()
    assert fluid.shortest_step <= just_after * fluid.steps.length
    assert fluid.steps_repeated > 0


@pytest.mark.parametrize("count", [3, 12])
def test_the_history_of_the_water_knows_nothing_of_the_frames(count: int, device: str, precision: str) -> None:
    few, many = (drying(device, 2e-3, count, precision) for _ in range(2))
    at_few, at_many = play(few, 6), play(many, 60)
    assert few.fluid.steps_done == many.fluid.steps_done
    assert few.state["water"].numpy().tobytes() == many.state["water"].numpy().tobytes()
    np.testing.assert_allclose(at_few, at_many[9::10], rtol=0.0, atol=1e-6 if precision == "float32" else 1e-12)


def test_a_step_taken_again_leaves_no_trace(device: str, precision: str) -> None:
    """A first step that is far too long, and one of the length that it ends up with."""
    sample = drying(device, 1e-3, 1, precision)
    sample.fluid.advance(0.01)
    parts = round(sample.fluid.steps.length / sample.fluid.shortest_step)
    assert parts >= 16 and 0 < sample.fluid.steps_repeated <= np.log2(parts)
    right = drying(device, None, parts, precision)
    right.fluid.advance(DURATION / parts)
    tolerance = {"float32": 1e-5, "float64": 1e-10}[precision]
    np.testing.assert_allclose(sample.water, right.water, rtol=0.0, atol=tolerance)
    assert sample.fluid.ledger().transpired == pytest.approx(right.fluid.ledger().transpired, rel=1e-5)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_scheme_adapts(scheme: str, device: str, precision: str) -> None:
    sample = fluid(scheme, 2, device, precision, step_tolerance=1e-3)
    sample.fluid.advance(DURATION)
    expected = exact_water()
    error = np.linalg.norm(sample.leaf_water - expected) / np.linalg.norm(expected)
    assert error < 2e-3
    assert 2 < sample.fluid.steps_done < 200 and sample.fluid.steps_repeated > 0
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_leaf_that_is_dry_at_the_end_of_a_step_dries_at_its_rate(scheme: str, device: str) -> None:
    mask = ellipse(12)
    tables = {
        "fluid": {"step": 3600.0, "scheme": scheme, "lamina_diffusivity": 1e-9, "vein_diffusivity": 1e-9, "order": 2},
        "transpiration": {"rate": 1e-2, "cuticle_rate": 1e-2},
        "time": {"duration": 3600.0, "frames": 2},
    }
    tables["fluid"]["step_tolerance"] = 1e-3
    sample = make_sample(tables, mask, device=device, precision="float64")
    for moment in (20.0, 60.0, 95.0, 120.0):
        sample.fluid.advance(moment)
        now = sample.state["water_now"].numpy()[mask]
        np.testing.assert_allclose(now, max(0.0, 1.0 - 1e-2 * moment), atol=0.01)


def test_a_step_that_no_solver_ends_is_taken_shorter(device: str) -> None:
    mask, maps = petiole_leaf(32, "diagonal")
    fluid = {"step": 3600.0, "scheme": "unsplit", "vein_diffusivity": 1e8, "tolerance": 1e-7}
    tables = {
        "fluid": fluid | {"order": 2, "step_tolerance": 1e-3},
        "transpiration": {"rate": 1e-4, "cuticle_rate": 1e-4},
        "source": {"conductance": 1e-2, "cut_at": 5000.0},
        "time": {"duration": 7200.0, "frames": 2},
    }
    sample = make_sample(tables, mask, maps, device=device)
    equal = make_sample(tables | {"fluid": fluid | {"order": 2}}, mask, maps, device=device)
    with pytest.raises(SimulationError, match="after 12 solves the error is"):
        equal.fluid.advance(7200.0, 2)
    sample.fluid.advance(7200.0, 2)
    assert sample.fluid.steps_over_tolerance == 0 and abs(sample.fluid.ledger().error) < 3e-6


def test_a_part_of_a_step_is_no_rest(device: str) -> None:
    """The source opens within a step, at rest until then: the look at which the water moves is not one of rest."""
    mask = ellipse(24)
    table = {"step": 100.0, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0, "order": 2, "step_tolerance": 1e-3}
    tables = {
        "fluid": table,
        "source": {"conductance": 1e-2, "cut_at": 0.0, "rewatered_at": 160.0},
        "time": {"duration": 3000.0, "frames": 2},
    }
    maps = {"water": 0.5 * mask, "source": mask * (np.indices(mask.shape)[0] < 3)}
    sample = make_sample(tables, mask, maps, device=device, precision="float64")
    before, moved = 0.5, 0
    for look in range(1, 301):
        sample.fluid.advance(10.0 * look, look)
        now = float(sample.state["water_now"].numpy()[mask].mean())
        assert now == before or not sample.fluid.is_at_rest, look
        moved += now != before
        before = now
        sample.fluid.check(look)
    assert moved > 10


def test_a_tolerance_needs_what_tells_the_error() -> None:
    with pytest.raises(ValueError, match=r"step_tolerance = 0.001 needs order = 2.*order is 1"):
        make_scene({"fluid": {"step_tolerance": 1e-3}})
    data = {
        "leaf": {"image": "leaf.png", "length": 0.1},
        "time": {"duration": 600.0},
        "structure": {"membrane_stiffness": 10.0},
        "fluid": {"order": 2, "step_tolerance": 1e-3},
        "shrink": {"curve": [[1.0, 0.0], [0.1, 0.2]], "plastic_set": 0.5},
    }
    with pytest.raises(InputError, match=r"fluid.step_tolerance = 0.001: accepted without plastic_set"):
        Scene.checked(data, "scene.toml")


def test_adaptive_steps_of_the_split_scheme_are_warned_of() -> None:
    fluid = {"order": 2, "step_tolerance": 1e-3}
    said = [make_scene({"fluid": fluid | {"scheme": scheme}}).warnings for scheme in ("split", "unsplit")]
    assert any("step_tolerance = 0.001: with fluid.scheme = 'split'" in line for line in said[0])
    assert not any("step_tolerance" in line for line in said[1])


def test_steps_of_first_order_have_nothing_of_it() -> None:
    mask, maps = smooth_maps()
    leaf = Leaf(None, MapFrame((0.0, 0.0), (WIDTH, WIDTH)), WIDTH, None, mask, maps)

    def names(order: int) -> tuple[set[str], dict[str, str]]:
        scene = make_scene({"fluid": {"order": order}, "transpiration": {"rate": 1e-4, "cuticle_rate": 1e-4}})
        stages, left_out = make_stages(scene, leaf, "fluid")
        return {spec.name for stage in stages for spec in stage.arrays}, left_out

    without, left_out = names(1)
    assert left_out["half_steps"] == left_out["extrapolation"] == "fluid.order is 1"
    assert {HALF_STEP + "water", "extrapolation"} <= names(2)[0] - without
    assert not any(name.startswith(HALF_STEP) for name in without)
