"""The exchange with the supply: its equation, its limits, the cut and the rewatering, and its account."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from fluid_sample import (
    SCHEMES,
    Sample,
    ellipse,
    exchange_matrices,
    make_sample,
    make_scene,
    petiole_leaf,
    stage_name,
)
from leafwarp.errors import InputError
from leafwarp.sim.fluid import FluidSteps
from leafwarp.sim.fluid.source import Opening

# Of one operation on contents of about 1.
ULP = {"float32": 1.2e-7, "float64": 2.3e-16}
# Of max y, of one step: some units in the last place, gathered along a line.
ROUNDING = {"float32": 1e-6, "float64": 2e-15}
# The residual bounds the unsplit scheme's error in the 2-norm; in float32 the rounding of the contents comes on top.
TOLERANCE = 1e-5
RELATIVE_ERROR = {"float32": TOLERANCE + 1e-6, "float64": TOLERANCE**2}
# Of the ledger after some tens of steps.
LEDGER = {"float32": 2e-6, "float64": 2e-14}
STEP = 60.0
STILL = {"fluid": {"step": STEP, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0}}
WEIGHTS = {(2, 9): 0.2, (2, 10): 0.3, (3, 9): 0.5}


def foot_map(mask: np.ndarray) -> np.ndarray:
    foot = np.zeros(mask.shape)
    for place, weight in WEIGHTS.items():
        assert mask[place]
        foot[place] = weight
    return foot


def still_sample(device: str, precision: str, content: float, **source: float) -> Sample:
    mask = ellipse(20)
    maps = {"water": np.full(mask.shape, content), "source": foot_map(mask)}
    return make_sample(STILL | {"source": source}, mask, maps, device=device, precision=precision)


def flowing_sample(
    scheme: str, beta: float, strength: float, device: str, precision: str, steps: int = 10, **source: float
) -> Sample:
    """Random water on an ellipse; the source's ``S`` summed over its cells is ``strength`` times the cell count."""
    mask = ellipse(20, 24)
    rng = np.random.default_rng(1)
    venation = np.where(rng.random(mask.shape) < 0.2, 0.0, rng.random(mask.shape))
    maps = {
        "venation": venation,
        "source": foot_map(mask),
        "water": rng.uniform(0.2, 0.7, mask.shape).astype(np.float32).astype(float),
    }
    tables = {
        "fluid": {"step": STEP, "scheme": scheme, "lamina_diffusivity": 0.0, "vein_diffusivity": beta / STEP},
        "source": {"conductance": strength / STEP} | source,
        "time": {"duration": steps * STEP, "frames": 2},
    }
    return make_sample(tables, mask, maps, mask.shape[::-1], device, precision)


def exchange(sample: Sample) -> np.ndarray:
    """``S`` of every cell in a whole step, flattened."""
    weights = np.where(sample.leaf.mask, sample.leaf.maps["source"], 0.0).ravel()
    return sample.scene.source.conductance * STEP * sample.leaf.mask.sum() * weights / weights.sum()


def implicit(system: sparse.spmatrix, strength: np.ndarray, old: np.ndarray, supply: float) -> np.ndarray:
    """``(I + S + L) y = f + S supply`` by a direct solve, refined once, for the differences from the supply."""
    matrix = (sparse.diags(1.0 + strength) + system).tocsc()
    solve = splu(matrix).solve
    difference = solve(old - supply)
    return supply + difference + solve(old - supply - matrix @ difference)


def reference(sample: Sample, scheme: str, old: np.ndarray, open_share: float = 1.0) -> tuple[np.ndarray, float]:
    """One step in float64, and the content that entered."""
    supply = sample.scene.source.supply
    diffusivity = sample.scene.fluid.vein_diffusivity * sample.leaf.maps["venation"]
    mask = sample.leaf.mask
    along_x, along_y = exchange_matrices(diffusivity, mask, STEP)
    strength = exchange(sample) * open_share
    passes = [(along_x + along_y, strength)]
    if scheme == "split":
        passes = [(along_x, strength / 2.0), (along_y, strength / 2.0)]
    content, added = old.ravel(), 0.0
    for system, part in passes:
        content = implicit(system, part, content, supply)
        content[~mask.ravel()] = 0.0
        added += float(part @ (supply - content)) / mask.sum()
    return content.reshape(mask.shape), added


def test_a_leaf_without_a_source_is_refused() -> None:
    mask = ellipse(8)
    for fluid in (STILL["fluid"], {}):
        with pytest.raises(InputError, match=r"maps\.source: .* accepted"):
            make_sample({"fluid": fluid, "source": {"conductance": 1.0}}, mask, {"source": np.zeros(mask.shape)})


def test_the_source_fills_as_its_equation_says(device: str, precision: str) -> None:
    """Where nothing flows: backward Euler of ``dy/dt = G w N (supply - y)``."""
    sample = still_sample(device, precision, 0.3, conductance=1e-4, supply=0.9)
    expected = sample.water
    for place in WEIGHTS:
        strength = exchange(sample).reshape(expected.shape)[place]
        expected[place] += 0.6 * strength / (1.0 + strength)
    before = sample.state.launch_count
    assert sample.step("source") == pytest.approx(expected, abs=2 * ULP[precision])
    assert sample.state.launch_count - before == sample.stages["source"].launches + 1  # it is opened once
    assert abs(sample.fluid.ledger().error) <= 1e-15
    assert sample.fluid.ledger().added > 0.0


@pytest.mark.parametrize("beta", [0.01, 10.0])
@pytest.mark.parametrize("strength", [1e-3, 1.0, 1e3, 1e8])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_step_agrees_with_a_direct_solve(
    scheme: str, beta: float, strength: float, device: str, precision: str
) -> None:
    sample = flowing_sample(scheme, beta, strength, device, precision, supply=0.9)
    old = sample.water
    expected, added = reference(sample, scheme, old)
    after = sample.step(stage_name(scheme))
    if scheme == "split":
        # Supply and strength are rounded to the precision too.
        assert after == pytest.approx(expected, abs=3.0 * ROUNDING[precision])
    else:
        slack = ROUNDING[precision] * np.sqrt(after.size)
        assert np.linalg.norm(after - expected) <= RELATIVE_ERROR[precision] * np.linalg.norm(after) + slack
    if strength <= 1.0:
        # S (supply - y) loses digits for a larger S.
        rounding = {"float32": 3e-6, "float64": 3e-10 if scheme == "iterated" else 1e-14}
        assert sample.fluid.ledger().added == pytest.approx(added, abs=rounding[precision])


@pytest.mark.parametrize("strength", [1e-12, 1e-3, 1.0, 1e3, 1e6, 1e12, 1e300])
@pytest.mark.parametrize("supply", [0.0, 0.45, 1.0])
@pytest.mark.parametrize(("scheme", "beta"), [
    ("split", 1.0), ("split", 1e9), ("unsplit", 1.0), ("unsplit", 1e9), ("iterated", 1.0), ("iterated", 1e3),
])  # fmt: skip
def test_contents_stay_between_the_leafs_and_the_supply(
    scheme: str, beta: float, supply: float, strength: float, device: str, precision: str
) -> None:
    sample = flowing_sample(scheme, beta, strength, device, precision, supply=supply)
    low, high = min(sample.leaf_water.min(), supply), max(sample.leaf_water.max(), supply)
    # A mean of two numbers may leave their range by a rounding; the unsplit scheme by its tolerance.
    slack = 2.0 * ULP[precision]
    if scheme != "split":
        slack += RELATIVE_ERROR[precision] * np.linalg.norm(sample.leaf_water)
    for index in range(5):
        sample.step(stage_name(scheme), index)
        assert low - slack <= sample.leaf_water.min() <= sample.leaf_water.max() <= high + slack
        assert not sample.water[~sample.leaf.mask].any()
    assert abs(sample.fluid.ledger().error) <= LEDGER[precision]
    if strength >= 1e6:
        # A strong source holds its cells at the supply but for about beta / S, of which each cell gets a share.
        held = sample.water[sample.leaf.maps["source"] > 0.0]
        assert held == pytest.approx(supply, abs=slack + 100.0 * beta / strength)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_leaf_as_wet_as_its_supply_stays_the_same_to_the_last_bit(scheme: str, device: str, precision: str) -> None:
    sample = flowing_sample(scheme, 1e4, 1e3, device, precision, supply=0.3)
    sample.set_water(np.where(sample.leaf.mask, 0.3, 0.0))
    before = sample.water
    for index in range(3):
        assert np.array_equal(sample.step(stage_name(scheme), index), before)
    assert sample.fluid.ledger().added == 0.0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_wetter_leaf_gives_water_back(scheme: str, device: str, precision: str) -> None:
    sample = flowing_sample(scheme, 5.0, 1e-1, device, precision, steps=40, supply=0.1)
    before = sample.leaf_water
    sample.fluid.advance(40 * STEP)
    ledger = sample.fluid.ledger()
    assert ledger.added < -0.1
    assert abs(ledger.error) <= LEDGER[precision]
    assert 0.1 - 1e-5 <= sample.leaf_water.min() and sample.leaf_water.max() < before.max()


@pytest.mark.parametrize(("cut_at", "shares"), [(0.0, ()), (60.0, (1.0,)), (90.0, (1.0, 0.5)), (1e9, (1.0, 1.0, 1.0))])
def test_a_cut_ends_the_source_where_nothing_flows(cut_at: float, shares: tuple, device: str, precision: str) -> None:
    sample = still_sample(device, precision, 0.0, conductance=1e-4, cut_at=cut_at)
    for index in range(3):
        launches = sample.state.launch_count
        sample.step("source", index)
        # Closing the source is a launch too, once.
        assert (sample.state.launch_count > launches + 1) == (index < len(shares))
    strength = exchange(sample).reshape(sample.water.shape)[3, 9]
    missing = np.prod([1.0 / (1.0 + strength * share) for share in shares])
    assert sample.water[3, 9] == pytest.approx(1.0 - missing, abs=4 * ULP[precision])


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("cut_at", [0.0, 60.0, 90.0])
def test_a_cut_ends_the_source(cut_at: float, scheme: str, device: str, precision: str) -> None:
    """The step of the cut takes its share of the exchange; the steps after it are those of a leaf without a source."""
    sample = flowing_sample(scheme, 5.0, 1e-1, device, precision, supply=0.9, cut_at=cut_at)
    name = stage_name(scheme)
    expected, added = sample.water, 0.0
    for index in range(2):
        share = min(max(cut_at / STEP - index, 0.0), 1.0)
        expected, entered = reference(sample, scheme, expected, share)
        added += entered
        assert sample.step(name, index) == pytest.approx(expected, abs=5.0 * ROUNDING[precision] + 1e-9)
    ledger = sample.fluid.ledger()
    assert ledger.added == pytest.approx(added, abs=LEDGER[precision] + 1e-9)
    sample.step(name, 2)  # closes the source where the step before was cut
    assert sample.fluid.ledger().added == ledger.added

    tables = sample.scene.model_dump(exclude_unset=True)
    plain = make_sample(
        {"fluid": tables["fluid"], "time": tables["time"]}, sample.leaf.mask, sample.leaf.maps,
        sample.leaf.frame.size, device, precision,
    )  # fmt: skip
    plain.set_water(sample.water)
    launches = [s.state.launch_count for s in (sample, plain)]
    assert_same_step(scheme, sample.step(name, 3), plain.step(name, 3), precision)
    if scheme != "iterated":  # which takes as many iterations as what it starts from asks for
        assert sample.state.launch_count - launches[0] == plain.state.launch_count - launches[1]
    assert sample.fluid.ledger().added == ledger.added


def assert_same_step(scheme: str, after: np.ndarray, other: np.ndarray, precision: str) -> None:
    """To the last bit; conjugate gradients, whose start depends on the steps before, to their tolerance."""
    if scheme == "iterated":
        assert np.linalg.norm(after - other) <= {"float32": 2e-5, "float64": 2e-10}[precision] * np.linalg.norm(other)
    else:
        assert np.array_equal(after, other)


@pytest.mark.parametrize("step", [7.0, 60.0, 61.7, 1000.0])
@pytest.mark.parametrize(
    ("cut_at", "rewatered_at", "seconds"),
    [
        (0.0, None, 0.0),
        (130.0, None, 130.0),
        (0.0, 0.5, 999.5),
        (130.0, 130.5, 999.5),
        (130.0, 140.0, 990.0),
        (119.5, 660.25, 459.25),
        (60.0, 990.0, 70.0),
        (130.0, 1e9, 130.0),
    ],
)
def test_the_source_is_open_but_between_cut_and_rewatering(
    cut_at: float, rewatered_at: float | None, seconds: float, step: float
) -> None:
    """Added up over the steps, whatever their length; a step knows its own part alone."""
    scene = make_scene({
        "fluid": {"step": step},
        "source": {"conductance": 1e-3, "cut_at": cut_at, "rewatered_at": rewatered_at},
        "time": {"duration": 1000.0, "frames": 2},
    })  # fmt: skip
    steps, opening = FluidSteps.of(scene), Opening(scene)
    total = 0.0
    for index in range(steps.count):
        before = opening.seconds
        assert opening.update(steps.interval(index)) == (opening.seconds != before)
        assert 0.0 <= opening.seconds <= steps.length
        total += opening.seconds
    # A moment within a share of 1e-8 of a step from its end is that end.
    assert total == pytest.approx(seconds, abs=4e-8 * step)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_between_cut_and_rewatering_agree_with_a_direct_solve(scheme: str, device: str, precision: str) -> None:
    times = {"cut_at": 0.75 * STEP, "rewatered_at": 2.5 * STEP}
    sample = flowing_sample(scheme, 5.0, 1e-1, device, precision, supply=0.9, **times)
    plain = flowing_sample(scheme, 5.0, 1e-1, device, precision, supply=0.9)
    expected, added = sample.water, 0.0
    for index, share in enumerate((0.75, 0.0, 0.5, 1.0)):
        expected, entered = reference(sample, scheme, expected, share)
        added += entered
        before = sample.water
        assert sample.step(stage_name(scheme), index) == pytest.approx(expected, abs=5.0 * ROUNDING[precision] + 1e-9)
    assert sample.fluid.ledger().added == pytest.approx(added, abs=LEDGER[precision] + 1e-9)
    # Open again, it is the source that was never cut.
    plain.step(stage_name(scheme), 0)
    plain.set_water(before)
    assert_same_step(scheme, plain.step(stage_name(scheme), 1), sample.water, precision)


def rewatered_sample(scheme: str, step: float, device: str, precision: str = "float64", **source: float) -> Sample:
    """A leaf on its petiole that transpires for 16 h, cut at 1 h 7 min and put into water at 9 h 13 min."""
    mask, maps = petiole_leaf(24, "y")
    tables = {
        "fluid": {"step": step, "scheme": scheme, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-6},
        "transpiration": {"rate": 3e-5, "cuticle_rate": 2e-6, "closure": [[0.75, 0.0], [1.0, 1.0]]},
        "source": {"conductance": 3e-4, "cut_at": 4020.0, "rewatered_at": 33180.0} | source,
        "time": {"duration": 57600.0, "frames": 2},
    }
    maps["stomata"] = mask.astype(float)
    return make_sample(tables, mask, maps, device=device, precision=precision)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_severed_leaf_dries_and_fills_again(scheme: str, device: str, precision: str) -> None:
    sample = rewatered_sample(scheme, 120.0, device, precision)
    moments = {0.0: None, 4020.0: None, 33120.0: None, 57600.0: None}
    for time in moments:
        sample.fluid.advance(time)
        moments[time] = (sample.leaf_water.mean(), sample.fluid.ledger())
        assert abs(moments[time][1].error) <= 5.0 * LEDGER[precision]
    (start, _), (cut, before), (dry, between), (end, after) = moments.values()
    assert start == 1.0 and cut > 0.85
    assert dry < 0.75
    assert between.added == pytest.approx(before.added, abs=5.0 * LEDGER[precision])
    assert after.added > before.added + 0.1
    assert end > dry + 0.05
    never = rewatered_sample(scheme, 120.0, device, precision, cut_at=None, rewatered_at=None)
    never.fluid.advance(57600.0)
    assert end == pytest.approx(never.leaf_water.mean(), abs=0.01)


@pytest.mark.parametrize("scheme", ["split", "unsplit"])
def test_the_history_of_a_rewatered_leaf_does_not_depend_on_where_steps_end(scheme: str, device: str) -> None:
    """Steps that end with the cut and the rewatering, and steps that do not: the same but for the step's own error."""
    finest = 6.0
    exact = rewatered_sample(scheme, finest, device)
    exact.fluid.advance(57600.0)
    errors = []
    for step in (120.0, 113.0, 60.0, 57.0, 30.0, 31.0):
        sample = rewatered_sample(scheme, step, device)
        sample.fluid.advance(57600.0)
        errors.append(np.abs(sample.water - exact.water).max() / (step - finest))
    # Of first order, so in proportion to the step; an aligned step is not the better one.
    assert np.array(errors) == pytest.approx(errors[-1], rel=0.2)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_two_runs_agree_to_the_last_bit(scheme: str, device: str, precision: str) -> None:
    runs = []
    for _ in range(2):
        sample = flowing_sample(scheme, 20.0, 0.1, device, precision, cut_at=3.5 * STEP)
        sample.fluid.advance(10 * STEP)
        runs.append((sample.water.tobytes(), sample.fluid.ledger()))
    assert runs[0] == runs[1]


@pytest.mark.parametrize(("scheme", "closed", "opened"), [("split", 2, 6), ("unsplit", 0, 2), ("iterated", 7, 8)])
def test_only_a_scene_with_a_source_pays_for_it(scheme: str, closed: int, opened: int) -> None:
    """Launches of a step without an iteration: the water is the same everywhere."""
    mask = ellipse(12)
    fluid = {"fluid": {"step": STEP, "scheme": scheme, "lamina_diffusivity": 1e-7, "vein_diffusivity": 1e-7}}
    plain = make_sample(fluid, mask)
    assert not [name for name in plain.state.names if "source" in name]
    assert not [c for c in plain.state.recorded if "source" in c.kernel_name or "exchange" in c.kernel_name]
    fed = make_sample(fluid | {"source": {"conductance": 1e-3}}, mask, {"source": mask.astype(float)})
    name = stage_name(scheme)
    assert list(plain.stages) == [name, "water"]
    assert list(fed.stages) == ["source", name, "water"]
    if scheme == "split" and plain.state.many_threads:
        closed, opened = closed + 4, opened + 4  # three launches instead of one for each of two solves
    for sample, launches in ((plain, closed), (fed, opened)):
        sample.step(name, 0)
        before = sample.state.launch_count
        sample.step(name, 1)
        assert sample.state.launch_count - before == launches
