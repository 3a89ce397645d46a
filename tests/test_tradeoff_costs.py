"""What the trade expects settings to cost, held to work whose costs are known."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.study.tradeoff.costs import OVERHEAD, CostModel
from leafwarp.study.tradeoff.setting import Setting
from leafwarp.study.tradeoff.trial import Trial

OWN = Setting(
    map_size=(64, 64),
    fluid_step=60.0,
    scheme="split",
    order=1,
    step_tolerance=None,
    vertices=400,
    angular_springs=True,
    motion="explicit",
    coupling_interval=None,
    substep=0.9,
    force_tolerance=None,
    precision="float32",
)


def trial(*, start: float, fluid: float, motion: float) -> Trial:
    """A film that took so long [s]."""
    nothing = np.zeros((1, 1), np.float32)
    return Trial(nothing, nothing, start, fluid, motion, 0.0, 1, 1, 0.0, 0, 400)


@pytest.fixture
def costs() -> CostModel:
    """Of a film of 5 s, and of a finer one that takes most of a minute before its first frame."""
    model = CostModel(3600.0)
    model.learn(OWN, trial(start=2.0, fluid=1.0, motion=4.0), 10.0)
    fine = OWN.with_(map_size=(1024, 1024), vertices=6400)
    model.learn(fine, trial(start=30.0, fluid=300.0, motion=250.0), 600.0)
    return model


def test_nothing_is_known_at_first() -> None:
    model = CostModel(3600.0)
    assert model.film(OWN) == 0.0
    assert model.predict(OWN) == OVERHEAD


def test_what_was_measured_is_expected_again(costs: CostModel) -> None:
    assert costs.film(OWN) == pytest.approx(5.0)
    assert costs.predict(OWN) == pytest.approx(10.0)


def test_a_dear_one_makes_the_cheap_ones_no_dearer(costs: CostModel) -> None:
    coarse = OWN.with_(vertices=200)
    # Explicit motion costs vertices ** 1.5; the process and its leaf as much as with 400.
    assert costs.predict(coarse) == pytest.approx(1.0 + (2.0 + 4.0) / 2**1.5 + 3.0)


def test_finer_ones_take_longer_before_the_film_too(costs: CostModel) -> None:
    finer = OWN.with_(map_size=(2048, 2048), vertices=6400)
    assert costs.film(finer) == pytest.approx(4 * 300.0 + 250.0)
    assert costs.predict(finer) == pytest.approx(costs.film(finer) + 30.0 + 4 * 20.0)


def test_motion_of_another_kind_is_expected_on_the_dear_side(costs: CostModel) -> None:
    assert costs.predict(OWN.with_(motion="quasistatic")) >= 1.0 + 3.0 * (2.0 + 4.0) + 3.0


def test_what_a_kept_trial_took_around_its_film_is_not_taken_for_nothing() -> None:
    model = CostModel(3600.0)
    model.learn(OWN, trial(start=2.0, fluid=1.0, motion=4.0), None)
    assert model.predict(OWN) == pytest.approx(7.0 + OVERHEAD)


def test_a_mesh_whose_step_hinges_decide_is_expected_to_cost_what_two_have_shown(costs: CostModel) -> None:
    finer, finest = (OWN.with_(vertices=count) for count in (25_600, 102_400))
    before = costs.film(finest)
    # Sixteen times as long with four times the vertices.
    costs.learn(finer, trial(start=480.0, fluid=1.0, motion=4000.0), 4600.0)
    assert costs.film(finer) == pytest.approx(4001.0)
    assert costs.film(finest) == pytest.approx(1.0 + 16.0 * 4000.0) and costs.film(finest) > 3.9 * before
    # Nothing is told of other motions, nor by meshes that are nearly the same.
    quasistatic = OWN.with_(motion="quasistatic")
    in_double_precision = 1.5  # for the fluid
    assert costs.film(quasistatic.with_(vertices=102_400)) == pytest.approx(in_double_precision + 12000.0 * 4.0**1.3)
    costs.learn(OWN.with_(vertices=110_000), trial(start=0.0, fluid=1.0, motion=1e6), 1e6)
    assert costs.film(OWN.with_(vertices=220_000)) == pytest.approx(1.0 + 1e6 * 2.0**2.5)
