"""How computations on different meshes are compared, and which are worth their time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from leafwarp.study.tradeoff.errors import errors_of, pareto_front
from leafwarp.study.tradeoff.explore import combinations
from leafwarp.study.tradeoff.reference import errors_fall_with_the_step
from leafwarp.study.tradeoff.setting import Setting
from leafwarp.study.tradeoff.surface import find_places, sample_points
from leafwarp.study.tradeoff.table import Row
from leafwarp.study.tradeoff.trial import Trial
from meshes import strip

BASE = Setting((256, 256), 60.0, "split", 1, None, 1000, True, "explicit", None, 0.9, None, "float32")


def trial(points: np.ndarray, water: np.ndarray) -> Trial:
    return Trial(points, water, 0.0, 1.0, 1.0, 0.0, 1, 1, 0.0, 0, 10)


def test_errors_made_by_hand() -> None:
    points, water = np.zeros((2, 3, 3)), np.array([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5]])
    moved, wetter = points.copy(), water.copy()
    moved[1, :, 2] = 0.03
    moved[1, 0, 2] = 0.05
    wetter[0, 1] += 0.1
    errors = errors_of(trial(moved, wetter), trial(points, water), length=0.1)
    assert errors.largest_shape == pytest.approx(0.5) and errors.largest_water == pytest.approx(0.1)
    assert errors.shape == pytest.approx(np.sqrt((0.25 + 2 * 0.09) / 6))
    assert errors.shape_over_time.tolist() == pytest.approx([0.0, np.sqrt((0.25 + 2 * 0.09) / 3)])
    assert errors.water == pytest.approx(np.sqrt(0.01 / (3 * 1.0 + 3 * 0.25)))
    assert errors.water_over_time.tolist() == pytest.approx([np.sqrt(0.01 / 3), 0.0])
    dry = trial(points, np.zeros_like(water))
    assert errors_of(dry, dry, 0.1).water == 0.0
    assert errors_of(trial(points, np.full_like(water, 0.1)), dry, 0.1).water == pytest.approx(0.1)


def test_a_linear_field_is_sampled_exactly_on_any_mesh() -> None:
    """Inside the mesh and outside, so that nothing but the shape itself differs from mesh to mesh."""
    meshes = [strip(columns=columns, jitter=jitter).mesh for columns, jitter in ((6, 0.0), (11, 0.2))]
    places = sample_points(meshes[0], 300)
    assert 250 < len(places) < 350
    outside = places.max(axis=0) + 0.004
    places = np.vstack([places, outside])
    expected = places @ [[2.0, 0.0, -1.0], [0.5, 3.0, 0.0]] + [0.1, 0.2, 0.3]
    for mesh in meshes:
        found = find_places(mesh, places)
        np.testing.assert_allclose(found.weights.sum(axis=1), 1.0, atol=1e-12)
        values = mesh.positions @ [[2.0, 0.0, -1.0], [0.5, 3.0, 0.0]] + [0.1, 0.2, 0.3]
        np.testing.assert_allclose(found.sample(mesh, values), expected, atol=1e-12)
        assert (found.weights[:-1].min(axis=1) > -0.05).all()


def test_the_sampled_points_are_spread_evenly_over_the_leaf() -> None:
    mesh = strip(columns=12, jitter=0.2).mesh
    points = sample_points(mesh, 2000)
    areas, middle = mesh.vertex_areas, mesh.positions
    for power in ((1, 0), (0, 1), (2, 0), (1, 1)):
        mean = np.prod(points**power, axis=1).mean()
        expected = (np.prod(middle**power, axis=1) * areas).sum() / areas.sum()
        assert mean == pytest.approx(expected, rel=0.03, abs=1e-5)


def test_pareto_front_of_points_made_by_hand() -> None:
    seconds = [1.0, 2.0, 3.0, 4.0, 4.0, 5.0, np.nan]
    errors = [9.0, 5.0, 6.0, 1.0, 1.0, 0.5, 0.0]
    assert pareto_front(seconds, errors).tolist() == [True, True, False, True, True, True, False]
    # Below the floor errors cannot be told apart: the slower one gains nothing.
    assert pareto_front(seconds, errors, floor=1.0).tolist() == [True, True, False, True, True, False, False]


def test_combinations_promise_what_their_parts_do() -> None:
    finer, coarser, unsplit = BASE.scaled_map(2.0), replace(BASE, vertices=250), replace(BASE, scheme="unsplit")
    measured = {BASE: 0.10, finer: 0.12, coarser: 0.105, unsplit: 0.02, replace(unsplit, fluid_step=240.0): 0.021}
    costs = {"split": 1.0, "unsplit": 2.0}

    def seconds(setting: Setting) -> float:
        return costs[setting.scheme] * setting.cells / 65536 * (60.0 / setting.fluid_step) + setting.vertices / 250

    guesses = combinations(BASE, measured, seconds)
    assert guesses == sorted(guesses, key=lambda guess: guess.seconds)
    found = {guess.setting: guess for guess in guesses}
    best = found[replace(unsplit, fluid_step=240.0, vertices=250)]
    assert best.error == pytest.approx(np.sqrt(0.021**2 + 0.105**2 - 0.10**2)) and best.seconds == 1.5
    assert not set(found) & set(measured)
    # Finer maps only cost here; nothing with them is on the front.
    assert all(setting.map_size == BASE.map_size for setting in found)


def test_of_too_many_combinations_those_of_beaten_choices_are_left_out(monkeypatch) -> None:
    """A study of twenty minutes on blade.toml came to 6336, and ended in a traceback."""
    vertices = {replace(BASE, vertices=count): 50.0 / count for count in range(50, 2000, 50)}
    steps = {replace(BASE, fluid_step=3.0 * count): 0.01 * count for count in range(1, 40)}
    beaten = {replace(BASE, fluid_step=3.0 * count + 1.0): 0.9 for count in range(1, 40)}
    measured = vertices | steps | beaten | {BASE: 0.2}

    def seconds(setting: Setting) -> float:
        return 100.0 / setting.fluid_step + setting.vertices

    wanted = combinations(BASE, measured, seconds)
    monkeypatch.setattr("leafwarp.study.tradeoff.explore.MOST_COMBINATIONS", 40 * 41)
    assert combinations(BASE, measured, seconds) == wanted
    monkeypatch.setattr("leafwarp.study.tradeoff.explore.MOST_COMBINATIONS", 100)
    few = combinations(BASE, measured, seconds)
    assert 1 < len(few) <= 100


def test_a_reference_that_finer_steps_move_away_from_is_not_converged() -> None:
    def errors(*found: float, **choices) -> dict[Setting, float]:
        return {
            replace(BASE, fluid_step=step, **choices): error
            for step, error in zip((240.0, 15.0, 60.0), found, strict=False)
        }

    assert errors_fall_with_the_step(errors(0.3, 0.1, 0.2), 0.0)
    assert not errors_fall_with_the_step(errors(0.03, 0.5, 0.1), 0.1)
    assert errors_fall_with_the_step(errors(0.03, 0.05, 0.1), 0.1)
    assert errors_fall_with_the_step(errors(0.5), 0.0)
    # In between, errors of the step and of the map may cancel.
    assert errors_fall_with_the_step(errors(0.15, 0.1, 0.2), 0.0)
    # Other maps and other schemes have errors of their own.
    assert errors_fall_with_the_step(errors(0.3, 0.1, 0.2) | errors(0.9, 0.8, 0.8, scheme="unsplit"), 0.0)
    assert not errors_fall_with_the_step(errors(0.3, 0.1, 0.2) | errors(0.7, 0.8, 0.8, scheme="unsplit"), 0.0)
    assert errors_fall_with_the_step({replace(BASE, fluid_step=None): 1.0}, 0.0)


def test_a_row_is_what_its_plain_data_say() -> None:
    row = Row(replace(BASE, motion="implicit"), "draft", "motion.method = implicit", "done", 1.5, water_error=0.25)
    assert (row.as_dict()["map_width"], row.as_dict()["vertices"]) == (256, 1000)
    assert Row.from_dict(row.as_dict()) == row
    dry = Row(replace(BASE, map_size=None, fluid_step=None, scheme=None), "", "", "skipped: budget", 1.0)
    assert dry.as_dict()["map_width"] is None and Row.from_dict(dry.as_dict()) == dry
