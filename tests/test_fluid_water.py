"""Transpiration, the fluid's clock and the ledger."""

from __future__ import annotations

import numpy as np
import pytest

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
    assert steps.locate(0.0) == (0, 1.0)
    assert steps.locate(steps.length) == (1, 1.0)
    assert steps.locate(1.25 * steps.length) == (2, pytest.approx(0.25))
    assert steps.locate(1e9) == (15, 1.0)
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
    assert set(sample.state.names) == {"water", "water_before", "water_now"}
    sample.fluid.advance(600.0)
    assert sample.state.launch_count == 1
    split = make_sample({"fluid": {"lamina_diffusivity": 1e-7, "vein_diffusivity": 1e-7}}, mask)
    assert list(split.stages) == ["split_diffusion", "water"]
    assert "unsplit_residual" not in split.state
