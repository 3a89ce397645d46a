"""Sampling of maps at points: bilinear over leaf cells only."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.sampling import sampling_stencils, smooth_over_leaf
from leafwarp_kernels.sampling import sample_map


def sample(values: np.ndarray, mask: np.ndarray, uv: np.ndarray, device: str, precision: str) -> np.ndarray:
    count = len(uv)
    cells, weights = sampling_stencils(uv, mask)
    state = State(
        [
            ArraySpec("values", values.shape, "real", ""),
            ArraySpec("cells", (count, 4), "int32", ""),
            ArraySpec("weights", (count, 4), "real", ""),
            ArraySpec("samples", (count,), "real", ""),
        ],
        device,
        precision,
    )
    state.upload("values", values)
    state.upload("cells", cells)
    state.upload("weights", weights)
    state.record(sample_map, count, [state["values"].flatten(), "cells", "weights"], ["samples"]).run()
    return state["samples"].numpy()


def ragged_mask(shape: tuple[int, int], seed: int) -> np.ndarray:
    mask = np.random.default_rng(seed).random(shape) > 0.4
    mask[shape[0] // 2, shape[1] // 2] = True
    return mask


@pytest.mark.parametrize("shape", [(17, 31), (1, 9), (9, 1), (1, 1)])
def test_a_constant_field_samples_exactly_constant(shape, device, precision) -> None:
    mask = ragged_mask(shape, 3)
    values = np.where(mask, 0.7, np.nan)  # what lies off the leaf must not matter, not even a NaN
    uv = np.random.default_rng(5).uniform(-0.1, 1.1, (400, 2))
    samples = sample(values, mask, uv, device, precision)
    assert (samples == np.array(0.7, dtype=precision)).all()


def test_a_linear_field_samples_exactly_at_every_point_inside(device, precision) -> None:
    height, width = 12, 20
    centers_u, centers_v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    values = 0.2 + 0.5 * centers_u[None, :] + 0.3 * centers_v[:, None]
    uv = np.random.default_rng(1).uniform((0.5 / width, 0.5 / height), (1 - 0.5 / width, 1 - 0.5 / height), (300, 2))
    samples = sample(values, np.ones((height, width), bool), uv, device, precision)
    tolerance = 4 * np.finfo(precision).eps  # a handful of roundings on values below 1
    assert np.abs(samples - (0.2 + 0.5 * uv[:, 0] + 0.3 * uv[:, 1])).max() <= tolerance


def test_hand_computed_margin_sample(device, precision) -> None:
    # Two leaf cells (0.2 and 0.6) left of two background cells; the point lies in the middle of the four.
    mask = np.array([[True, False], [True, False]])
    values = np.array([[0.2, 1.0], [0.6, 1.0]])
    quarter_up = sample(values, mask, np.array([[0.5, 0.5], [0.5, 0.375]]), device, precision)
    assert quarter_up == pytest.approx([0.4, 0.3], abs=1e-7)


def test_a_point_off_the_leaf_takes_the_nearest_leaf_cell(device, precision) -> None:
    mask = np.zeros((8, 8), bool)
    mask[1, 1] = mask[6, 6] = True
    values = np.zeros((8, 8))
    values[1, 1], values[6, 6] = 0.25, 0.75
    samples = sample(values, mask, np.array([[0.45, 0.4], [0.9, 0.6]]), device, precision)
    assert (samples == [0.25, 0.75]).all()


def test_weights_are_normalised_and_lie_on_the_leaf() -> None:
    mask = ragged_mask((30, 40), 7)
    cells, weights = sampling_stencils(np.random.default_rng(2).random((1000, 2)), mask)
    assert np.abs(weights.sum(axis=1) - 1.0).max() < 1e-15 * 4
    assert mask.reshape(-1)[cells].all()


def test_smoothing_keeps_a_constant_and_the_background_out() -> None:
    mask = ragged_mask((40, 40), 11)
    smooth = smooth_over_leaf(np.where(mask, 0.6, 5.0), mask, (2.0, 1.0))
    assert np.abs(smooth[mask] - 0.6).max() < 1e-12
    assert (smooth[~mask] == 0.0).all()
