"""Transpiration, the fluid's clock and the ledger."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from fluid_sample import SCHEMES, Sample, ellipse, make_sample, make_scene
from leafwarp.errors import InputError
from leafwarp.sim.fluid import FluidSteps

# Of one operation on contents of about 1.
ULP = {"float32": 1.2e-7, "float64": 2.3e-16}
# Ledger after some tens of steps: roundings of the line solves, far below a unit in the last place each.
LEDGER = {"float32": 2e-6, "float64": 2e-14}
STILL = {"fluid": {"step": 60.0, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0}}


def full_tables(scheme: str = "split", **time: float) -> dict:
    return {
        "fluid": {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
        "transpiration": {"rate": 1e-4, "cuticle_rate": 2e-5},
        "source": {"conductance": 1e-3},
        "time": {"duration": 1500.0, "frames": 4} | time,
    }


def full_maps(mask: np.ndarray, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    rows, columns = mask.shape
    y, x = np.mgrid[0:rows, 0:columns]
    foot = mask & (y < 0.15 * rows)
    return {
        "venation": np.clip(2.0 - np.abs(x - columns / 2), 0.0, 1.0),
        "stomata": np.where(mask, rng.random(mask.shape), 0.0),
        "water": rng.uniform(0.5, 1.0, mask.shape),
        "source": foot / max(foot.sum(), 1),
    }


def full_sample(device: str, precision: str, scheme: str = "split", **time: float) -> Sample:
    mask = ellipse(40, 32)
    return make_sample(full_tables(scheme, **time), mask, full_maps(mask), (0.08, 0.1), device, precision)


def test_transpiration_follows_stomata_and_cuticle(device: str, precision: str) -> None:
    mask = ellipse(20)
    maps = full_maps(mask)
    table = {"rate": 2e-3, "cuticle_rate": 5e-4}
    sample = make_sample(STILL | {"transpiration": table}, mask, maps, device=device, precision=precision)
    before = sample.water
    share = maps["stomata"] / maps["stomata"][mask].mean()
    expected = np.where(mask, before - np.minimum(before, 60.0 * (5e-4 + share * 1.5e-3)), 0.0)
    assert sample.step("transpiration") == pytest.approx(expected, abs=2 * ULP[precision])
    assert sample.fluid.ledger().transpired == pytest.approx(60.0 * 2e-3, rel=1e-6)


def test_cuticle_alone_needs_no_map(device: str, precision: str) -> None:
    mask = ellipse(20)
    table = {"rate": 1e-3, "cuticle_rate": 1e-3}
    sample = make_sample(STILL | {"transpiration": table}, mask, device=device, precision=precision)
    assert "stomatal_rate" not in sample.state
    assert sample.step("transpiration")[mask] == pytest.approx(0.94, abs=ULP[precision])
    assert not sample.water[~mask].any()


@pytest.mark.parametrize("rate", [1e-2, 1e6, 1e300])
def test_a_sink_takes_no_more_than_is_there(rate: float, device: str, precision: str) -> None:
    mask = ellipse(20)
    maps = full_maps(mask)
    table = {"rate": rate, "cuticle_rate": rate / 3}
    sample = make_sample(STILL | {"transpiration": table}, mask, maps, device=device, precision=precision)
    for index in range(10):
        assert sample.step("transpiration", index).min() >= 0.0
    assert sample.water.max() == 0.0 or rate == 1e-2
    assert abs(sample.fluid.ledger().error) <= 1e-15


def test_a_leaf_without_stomata_is_refused() -> None:
    mask = ellipse(8)
    tables = STILL | {"transpiration": {"rate": 1e-3}}
    with pytest.raises(InputError, match=r"maps\.stomata: .* accepted: .*cuticle_rate"):
        make_sample(tables, mask, {"stomata": np.zeros(mask.shape)})


def test_steps_fill_the_duration_and_are_no_longer_than_asked() -> None:
    steps = FluidSteps.of(make_scene({"fluid": {"step": 7.0}, "time": {"duration": 100.0, "frames": 2}}))
    assert (steps.count, steps.length) == (15, pytest.approx(100.0 / 15))
    assert steps.interval(14).end == pytest.approx(100.0)
    assert steps.passed(0.0) == 0.0
    assert steps.passed(steps.length * (1.0 + 1e-12)) == 1.0
    assert steps.passed(1.25 * steps.length) == pytest.approx(1.25)
    assert steps.passed(1e9) == 15.0
    assert FluidSteps.of(make_scene({"fluid": {"step": 1e9}, "time": {"duration": 100.0, "frames": 2}})).count == 1


@pytest.mark.parametrize(("duration", "step"), [(1e6, 1e-3), (1e12, 1e-300)])
def test_steps_beyond_reason_are_refused(duration: float, step: float) -> None:
    scene = make_scene({"fluid": {"step": step}, "time": {"duration": duration, "frames": 2}})
    with pytest.raises(InputError, match=r"fluid\.step = .* accepted: "):
        FluidSteps.of(scene)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_ledger_closes(scheme: str, device: str, precision: str) -> None:
    sample = full_sample(device, precision, scheme)
    sample.fluid.advance(1500.0)
    ledger = sample.fluid.ledger()
    assert ledger.start == pytest.approx(0.75, abs=0.02)
    assert ledger.added > 0.01 and ledger.transpired > 0.05
    assert abs(ledger.error) <= LEDGER[precision]
    assert ledger.now == pytest.approx(sample.leaf_water.mean(), abs=1e-12)
    assert 0.0 <= sample.water.min() and sample.water.max() <= 1.0 + ULP[precision]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_frames_do_not_change_the_history(scheme: str, device: str, precision: str) -> None:
    """3, 25 or 70 frames: the same bytes wherever two of them share a moment at the end of a step."""
    histories = []
    for frames in (3, 25, 70):
        sample = full_sample(device, precision, scheme)
        moments = {}
        for frame in range(frames + 1):
            time = 1500.0 * frame / frames
            sample.fluid.advance(time)
            moments[round(time, 6)] = sample.state["water_now"].numpy().tobytes()
        histories.append((moments, sample.state["water"].numpy().tobytes(), sample.fluid.ledger()))
    for moments, last, ledger in histories[1:]:
        shared = {t for t in moments if t in histories[0][0] and (t / 60.0).is_integer()}
        assert {0.0, 1500.0} <= shared
        assert all(moments[t] == histories[0][0][t] for t in shared)
        assert last == histories[0][1] and ledger == histories[0][2]


def test_a_frame_between_two_steps_sees_their_blend(device: str, precision: str) -> None:
    sample = full_sample(device, precision)
    sample.fluid.advance(120.0)
    before = sample.water
    assert np.array_equal(sample.state["water_now"].numpy(), before)
    for share in (0.25, 0.5, 0.9):
        assert sample.fluid.advance(120.0 + 60.0 * share) == (1 if share == 0.25 else 0)
        expected = (1.0 - share) * before + share * sample.water
        assert sample.state["water_now"].numpy() == pytest.approx(expected, abs=2 * ULP[precision])
    after = sample.water
    assert sample.fluid.advance(180.0) == 0
    assert np.array_equal(sample.state["water_now"].numpy(), after)
    assert np.abs(after - before).max() > 1e-3


def test_two_runs_agree_to_the_last_bit(device: str, precision: str) -> None:
    runs = []
    for _ in range(2):
        sample = full_sample(device, precision)
        sample.fluid.advance(1000.0)
        runs.append((sample.state["water_now"].numpy().tobytes(), sample.fluid.ledger()))
    assert runs[0] == runs[1]


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 24), (24, 1), (20, 3)])
def test_thin_maps_and_leaves_one_cell_wide(shape: tuple, scheme: str, device: str, precision: str) -> None:
    mask = np.ones(shape, bool) if min(shape) == 1 else np.array([[False, True, False]] * shape[0])
    maps = full_maps(mask)
    maps["source"] = np.zeros(shape)
    maps["source"][0, shape[1] // 2 if shape[0] > 1 else 0] = 1.0
    sample = make_sample(full_tables(scheme), mask, maps, device=device, precision=precision)
    sample.fluid.advance(1500.0)
    assert np.isfinite(sample.water).all()
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]


@pytest.mark.parametrize("content", [0.0, 1.0])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_bone_dry_and_saturated(content: float, scheme: str, device: str, precision: str) -> None:
    mask = ellipse(24)
    maps = full_maps(mask) | {"water": np.full(mask.shape, content)}
    sample = make_sample(full_tables(scheme), mask, maps, device=device, precision=precision)
    sample.fluid.advance(1500.0)
    # Off the range by the tolerance of the unsplit scheme at most.
    slack = 1e-5
    assert -slack <= sample.water.min() <= sample.water.max() <= 1.0 + slack
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]


def test_only_what_the_scene_requires_is_there() -> None:
    mask = ellipse(8)
    sample = make_sample(STILL, mask)
    assert list(sample.stages) == ["water"]
    assert set(sample.state.names) == {"water", "water_before", "water_now", "water_sign"}
    sample.fluid.advance(600.0)
    assert sample.state.launch_count == 1
    split = make_sample({"fluid": {"lamina_diffusivity": 1e-7, "vein_diffusivity": 1e-7}}, mask)
    assert list(split.stages) == ["split_diffusion", "water"]
    assert "unsplit_residual" not in split.state


CLOSURES = {
    "turgor": ((0.8, 0.0), (1.0, 1.0)),
    "open until half turgor": ((0.8, 0.0), (0.9, 1.0)),
    "never quite closed": ((0.3, 0.1), (0.5, 0.6), (0.9, 1.0)),
    "lower at first": ((0.78, 0.0), (0.85, 0.7), (0.95, 1.0), (1.0, 0.4)),
    "a step": ((0.7, 0.0), (0.7 + 1e-12, 1.0)),
}
OPEN_RATE, CUTICLE_RATE = 2e-5, 1e-6  # 0.072 and 0.0036 an hour


def closing_sample(
    closure: tuple | None, step: float, duration: float, device: str, precision: str = "float64", **table: float
) -> Sample:
    """Cells of many contents, which nothing links, under stomata that close."""
    mask = ellipse(12)
    rng = np.random.default_rng(2)
    maps = {"water": rng.uniform(0.0, 1.0, mask.shape), "stomata": rng.uniform(0.2, 1.0, mask.shape)}
    maps["water"][mask.nonzero()[0][:3], mask.nonzero()[1][:3]] = (1.0, 0.8, 0.9)
    tables = {
        "fluid": STILL["fluid"] | {"step": step},
        "transpiration": {"rate": OPEN_RATE, "cuticle_rate": CUTICLE_RATE, "closure": closure} | table,
        "time": {"duration": duration, "frames": 2},
    }
    return make_sample(tables, mask, maps, device=device, precision=precision)


@pytest.mark.parametrize("hours", [0.2, 12.0, 200.0])
@pytest.mark.parametrize("name", ["turgor", "open until half turgor", "never quite closed", "lower at first"])
def test_a_step_of_any_length_takes_what_the_equation_says(name: str, hours: float, device: str) -> None:
    """The time to fall from a content to another is the integral of ``dy / r(y)``, here by adaptive quadrature."""
    sample = closing_sample(CLOSURES[name], 3600.0 * hours, 3600.0 * hours, device)
    knots, openings = np.array(CLOSURES[name]).T
    stomata = sample.leaf.maps["stomata"] / sample.leaf.maps["stomata"][sample.leaf.mask].mean()
    before, after = sample.water, sample.step("transpiration")
    for place in zip(*sample.leaf.mask.nonzero(), strict=True):

        def rate(content: float, place: tuple = place) -> float:
            return CUTICLE_RATE + stomata[place] * (OPEN_RATE - CUTICLE_RATE) * np.interp(content, knots, openings)

        start, end = before[place], after[place]
        ends = [end, *(knot for knot in knots if end < knot < start), start]
        parts = [quad(lambda y: 1.0 / rate(y), *part, epsabs=0.0, epsrel=1e-12)[0] for part in pairwise(ends)]
        late = sum(parts) - sample.scene.time.duration
        if end == 0.0:
            assert late < 0.0
        else:
            # Rounding of contents of about 1 and of the sum of the parts.
            assert late * rate(end) == pytest.approx(0.0, abs=1e-14)
    assert abs(sample.fluid.ledger().error) <= 1e-14


@pytest.mark.parametrize("name", CLOSURES)
def test_one_step_of_12_hours_equals_720_of_a_minute(name: str, device: str, precision: str) -> None:
    one = closing_sample(CLOSURES[name], 12 * 3600.0, 12 * 3600.0, device, precision)
    many = closing_sample(CLOSURES[name], 60.0, 12 * 3600.0, device, precision)
    for sample in (one, many):
        sample.fluid.advance(12 * 3600.0)
    assert (one.fluid.steps_done, many.fluid.steps_done) == (1, 720)
    # In float32 720 stored contents are rounded, each by half a unit in the last place.
    bound = {"float32": 720 * ULP["float32"] / 4.0, "float64": 1e-12}
    assert np.abs(one.water - many.water).max() <= bound[precision]
    assert one.fluid.ledger().transpired == pytest.approx(many.fluid.ledger().transpired, abs=bound[precision])


def test_the_turgor_loss_point_is_crossed_when_it_should_be(device: str) -> None:
    """With closure proportional to turgor from y = 1: ``y - b = (1 - b) exp(-m t)`` with ``b`` below the loss point.

    The rate is s (y - L) / (1 - L) + c, so L is reached at ln((s + c) / c) (1 - L) / s, and is left with the cuticle's.
    """
    loss_point, seconds = 0.8, 100 * 3600.0
    mask = ellipse(8)
    stomatal = OPEN_RATE - CUTICLE_RATE
    crossing = np.log(OPEN_RATE / CUTICLE_RATE) * (1.0 - loss_point) / stomatal
    assert 0.0 < crossing < seconds
    for duration in (crossing, crossing * (1.0 - 1e-9), crossing * (1.0 + 1e-9), seconds):
        tables = {
            "fluid": STILL["fluid"] | {"step": duration},
            "transpiration": {"rate": OPEN_RATE, "cuticle_rate": CUTICLE_RATE, "closure": CLOSURES["turgor"]},
            "time": {"duration": duration, "frames": 2},
        }
        sample = make_sample(tables, mask, {"stomata": np.ones(mask.shape)}, device=device, precision="float64")
        after = sample.step("transpiration")[mask]
        assert after == pytest.approx(loss_point - CUTICLE_RATE * (duration - crossing), abs=1e-14)


@pytest.mark.parametrize("step", [1e-6, 1e3, 3e11])
@pytest.mark.parametrize("rate", [1e-300, 1e-5, 1e6, 1e300])
@pytest.mark.parametrize("cuticle_share", [0.0, 1e-12, 0.5])
def test_closing_stomata_take_no_more_than_is_there(
    cuticle_share: float, rate: float, step: float, device: str, precision: str
) -> None:
    for closure in CLOSURES.values():
        sample = closing_sample(
            closure, step, 3 * step, device, precision, rate=rate, cuticle_rate=rate * cuticle_share
        )
        start = before = sample.water
        for index in range(3):
            after = sample.step("transpiration", index)
            assert np.isfinite(after).all() and (after >= 0.0).all() and (after <= before).all()
            before = after
        assert abs(sample.fluid.ledger().error) <= 1e-14
        if cuticle_share == 0.0 and closure[0][1] == 0.0:
            # Closed stomata lose nothing: no step, however long, passes the point where they close.
            closed_from = closure[0][0]
            was_closed = start <= closed_from
            assert np.array_equal(before[was_closed], start[was_closed])
            assert (before[~was_closed] >= closed_from - ULP[precision]).all()


def test_open_stomata_are_those_of_a_scene_without_a_closure(device: str, precision: str) -> None:
    """To the last bit, and nothing more is allocated or launched."""
    always, plain = (closing_sample(closure, 60.0, 600.0, device, precision) for closure in (((0.5, 1.0),), None))
    for sample in (always, plain):
        sample.fluid.advance(600.0)
    assert always.water.tobytes() == plain.water.tobytes()
    assert set(always.state.names) == set(plain.state.names)
    assert not [name for name in plain.state.names if "closure" in name]
    assert {c.kernel_name for c in plain.state.recorded} == {c.kernel_name for c in always.state.recorded}
    assert "leafwarp_kernels.transpiration.transpire_with_closure" not in {c.kernel_name for c in plain.state.recorded}
    closing = closing_sample(CLOSURES["turgor"], 60.0, 600.0, device, precision)
    assert set(closing.state.names) - set(plain.state.names) == {"closure_water", "closure_opening"}
    closing.fluid.advance(600.0)
    assert closing.state.launch_count == plain.state.launch_count


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_ledger_closes_with_closing_stomata(scheme: str, device: str, precision: str) -> None:
    mask = ellipse(40, 32)
    tables = full_tables(scheme)
    tables["transpiration"] |= {"closure": CLOSURES["turgor"]}
    sample = make_sample(tables, mask, full_maps(mask), (0.08, 0.1), device, precision)
    sample.fluid.advance(1500.0)
    ledger = sample.fluid.ledger()
    assert ledger.transpired > 0.02 and abs(ledger.error) <= LEDGER[precision]


@pytest.mark.parametrize("scheme", ["split", "unsplit"])
def test_closing_stomata_converge_at_first_order_where_water_flows(scheme: str, device: str) -> None:
    """Loss and flow of a step follow one another: what the step changes falls in proportion to it."""
    mask = ellipse(24)
    maps = full_maps(mask)
    maps["water"] = np.where(mask, 1.0, 0.0)
    results = []
    for step in (800.0, 400.0, 200.0, 100.0, 50.0):
        tables = {
            "fluid": {"step": step, "scheme": scheme, "lamina_diffusivity": 2e-10, "vein_diffusivity": 1e-9},
            "transpiration": {"rate": OPEN_RATE, "cuticle_rate": CUTICLE_RATE, "closure": CLOSURES["turgor"]},
            "time": {"duration": 16000.0, "frames": 2},
        }
        sample = make_sample(tables, mask, maps, device=device, precision="float64")
        sample.fluid.advance(16000.0)
        results.append(sample.water)
    changes = [np.abs(a - b).max() for a, b in pairwise(results)]
    orders = np.log2(np.divide(changes[:-1], changes[1:]))
    assert orders == pytest.approx([1.0] * 3, abs=0.1)
    assert changes[-1] < 1e-4
