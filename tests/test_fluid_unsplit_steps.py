"""Successive unsplit steps, each started from the last, and the multigrid cycle that solves them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from fluid_sample import Sample, ellipse, exchange_matrices, make_sample, petiole_leaf
from leafwarp.sim.fluid.multigrid import System
from leafwarp.sim.fluid.unsplit import UnsplitDiffusion, extreme_eigenvalues
from leafwarp_kernels.conjugate_gradients import UNSEEN, WORTH_UNSEEN

NAME = "unsplit_diffusion"
TOLERANCE = {"float32": 1e-5, "float64": 1e-10}


def midrib() -> np.ndarray:
    return np.broadcast_to(np.clip(2.0 - np.abs(np.arange(48) - 23.5), 0.0, 1.0), (48, 48))


def rough() -> np.ndarray:
    """Three decades from cell to cell."""
    return 10.0 ** np.random.default_rng(6).uniform(-3.0, 0.0, (48, 48))


def drying_leaf(device: str, precision: str, steps: int = 64, venation: np.ndarray | None = None) -> Sample:
    """An elliptic leaf that transpires unevenly, without a source; it has a midrib, or other veins."""
    mask = ellipse(48)
    tables = {
        "fluid": {"step": 60.0, "scheme": "iterated", "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-5},
        "transpiration": {"rate": 5e-6},
        "time": {"duration": 60.0 * steps, "frames": 2},
    }
    venation = midrib() if venation is None else venation
    maps = {"venation": venation, "stomata": np.linspace(0.2, 1.0, 48)[:, None] + np.zeros(mask.shape)}
    return make_sample(tables, mask, maps, device=device, precision=precision)


@pytest.mark.parametrize("veins", [midrib, rough])
def test_errors_do_not_add_up_over_steps(veins: Callable[[], np.ndarray], device: str, precision: str) -> None:
    """What is left of a residual goes into the next step: after 64 steps the error is that of about one."""
    sample = drying_leaf(device, precision, venation=veins())
    mask, cell = sample.leaf.mask, 0.1 / 48
    diffusivity = 1e-8 + (1e-5 - 1e-8) * sample.leaf.maps["venation"]
    x, y = exchange_matrices(diffusivity, mask, 60.0, (cell, cell))
    solve = splu((sparse.identity(mask.size) + x + y).tocsc()).solve
    loss = 60.0 * sample.state["stomatal_rate"].numpy().astype(np.float64)
    expected = sample.water
    for step in range(1, 65):
        expected = solve((expected - loss).ravel()).reshape(mask.shape)
        sample.fluid.advance(60.0 * step)
        error = np.linalg.norm(sample.water - expected) / np.linalg.norm(expected)
        # Rounding of the stored contents when water transpires comes on top, once a step.
        assert error <= TOLERANCE[precision] + step * np.finfo(precision).eps
    assert abs(sample.fluid.ledger().error) <= {"float32": 1e-6, "float64": 1e-14}[precision]


def test_a_part_that_hardly_anything_reaches_is_accurate_too(device: str) -> None:
    """A striped lobe behind a thin bridge: the steps' own residuals tell little of its slow modes."""
    shape, bridge = (20, 138), np.s_[6, 26:29]
    row, column = np.indices(shape)
    mask = (column < 26) | (column > 28)
    mask[bridge] = True
    venation = np.where(column < 26, 3.7e-3, (row + column - 29) % 5 < 2)
    venation[bridge] = 1e-4
    stomata = np.where(column < 26, 0.1 + 0.9 * column / 25, 5e-3 * row / 19)
    tolerance, steps = 2.5e-3, 40
    tables = {
        "transpiration": {"rate": 1.5e-6},
        "time": {"duration": 60.0 * steps, "frames": 2},
    }
    fluid = {"step": 60.0, "lamina_diffusivity": 1e-11, "vein_diffusivity": 3.2e-5, "tolerance": tolerance}
    maps = {"venation": venation * mask, "stomata": stomata * mask}
    samples = [
        make_sample(tables | {"fluid": fluid | {"scheme": scheme}}, mask, maps, device=device, precision="float64")
        for scheme in ("iterated", "unsplit")
    ]
    for step in range(1, steps + 1):
        for sample in samples:
            sample.fluid.advance(60.0 * step)
        after, expected = (sample.leaf_water for sample in samples)
        assert np.linalg.norm(after - expected) <= tolerance**2 * np.linalg.norm(expected)


def counted_probes(stage: UnsplitDiffusion) -> list[float]:
    """The steps whose systems are probed from now on, as they are [s]."""
    probed, probe = [], stage._probe

    def counted(step: object) -> None:
        probed.append(stage._time_step)
        probe(step)

    stage._probe = counted
    return probed


def test_what_bounds_the_error_is_learnt_with_and_without_the_source(device: str, precision: str) -> None:
    mask, maps = petiole_leaf(48, "diagonal")
    maps["venation"] = np.random.default_rng(1).integers(0, 2, mask.shape) * mask
    maps["stomata"] = np.linspace(0.2, 1.0, 48)[:, None] + np.zeros(mask.shape)
    tables = {
        "fluid": {"step": 60.0, "lamina_diffusivity": 1e-8, "vein_diffusivity": 1e-5},
        "source": {"conductance": 1e-3, "cut_at": 630.0, "rewatered_at": 1230.0},
        "transpiration": {"rate": 5e-5},
        "time": {"duration": 1800.0, "frames": 2},
    }
    samples = [
        make_sample(tables | {"fluid": tables["fluid"] | {"scheme": scheme}}, mask, maps, device=device, precision=kind)
        for scheme, kind in (("iterated", precision), ("unsplit", "float64"))
    ]
    stage = samples[0].stages[NAME]
    probed = counted_probes(stage)
    for step in range(1, 31):
        for sample in samples:
            sample.fluid.advance(60.0 * step)
        after, expected = (sample.leaf_water for sample in samples)
        error = np.linalg.norm(after - expected) / np.linalg.norm(expected)
        assert error <= TOLERANCE[precision] + step * np.finfo(precision).eps
    assert probed == [60.0] * 3 and stage.system is None


def test_what_bounds_the_error_holds_for_shorter_steps(device: str) -> None:
    samples = [drying_leaf(device, "float64", venation=rough()) for _ in range(2)]
    stages = [sample.stages[NAME] for sample in samples]
    stages[1]._take_factor()
    probed = counted_probes(stages[0])
    random = np.random.default_rng(0)
    for index in range(18):
        if index % 3 == 0 and index > 0:
            for stage in stages:
                stage.set_time_step((0.6, 30.0, 63.0, 600.0, 900.0)[index // 3 - 1])
        loss = random.uniform(0.0, 1e-3, stages[0].leaf.mask.shape)
        for stage, sample in zip(stages, samples, strict=True):
            sample.state.upload("water", np.where(stage.leaf.mask, sample.water - loss, 0.0))
            stage.run()
        after, expected = (sample.leaf_water for sample in samples)
        assert np.linalg.norm(after - expected) <= 2 * TOLERANCE["float64"] * np.linalg.norm(expected)
    assert probed == [60.0, 600.0, 900.0]


def test_what_the_last_step_found_saves_iterations(device: str, precision: str) -> None:
    iterations = []
    for forgets in (False, True):
        sample = drying_leaf(device, precision)
        stage = sample.stages[NAME]
        for step in range(1, 33):
            if forgets:
                stage._is_begun = False
            sample.fluid.advance(60.0 * step)
        iterations.append(stage.iterations)
    # Nearly all of what they share: the drying goes on as before.
    assert 0 < iterations[0] < 0.7 * iterations[1]


def test_most_steps_end_without_a_look_at_what_is_left(device: str, precision: str) -> None:
    """A cycle of the preconditioner for each iteration, and one more for some steps, not for each."""
    sample = drying_leaf(device, precision)
    stage = sample.stages[NAME]
    stage._iterations_per_look = 1
    cycles, replay = [], stage._replay

    def counted(commands: list) -> None:
        cycles.append(commands is stage._alone.precondition)
        replay(commands)

    sample.fluid.advance(60.0 * 16)
    stage._replay, begun = counted, stage.iterations
    sample.fluid.advance(60.0 * 64)
    assert 0 <= sum(cycles) - (stage.iterations - begun) <= 48 / 2
    # What was taken for small enough was looked at again.
    assert (sample.state["unsplit_worth"].numpy()[WORTH_UNSEEN] <= UNSEEN).all()


def test_the_iterations_show_the_extreme_eigenvalues() -> None:
    """Conjugate gradients on a diagonal matrix: from within, and close after as many iterations as there are values."""
    values = np.array([0.4, 0.5, 0.9, 1.0, 1.3])
    residual = np.ones(5)
    direction = residual.copy()
    lengths, shares = [], [0.0]
    for _ in range(5):
        square = residual @ residual
        lengths.append(square / (direction @ (values * direction)))
        least, largest = extreme_eigenvalues(np.array(lengths), np.array(shares))
        assert 0.4 - 1e-9 <= least <= largest <= 1.3 + 1e-9
        residual = residual - lengths[-1] * values * direction
        shares.append(residual @ residual / square)
        direction = residual + shares[-1] * direction
    assert (least, largest) == pytest.approx((0.4, 1.3), rel=1e-6)
    assert extreme_eigenvalues(np.array([1.0, 0.0]), np.array([0.0, 0.5])) == (0.0, np.inf)


def test_what_a_map_has_lost_elsewhere_is_no_residual(device: str, precision: str) -> None:
    """The mean that the flow must not change is not solved for anew in each step."""
    sample = drying_leaf(device, precision)
    stage = sample.stages[NAME]
    for step in range(1, 9):
        sample.fluid.advance(60.0 * step)
    residual = sample.state["unsplit_residual"].numpy().astype(np.float64)[sample.leaf.mask]
    assert abs(residual.mean()) < 0.01 * TOLERANCE[precision] * sample.leaf_water.mean()
    assert stage.iterations > 0


def test_two_runs_agree_to_the_last_bit(device: str, precision: str) -> None:
    after = []
    for _ in range(2):
        sample = drying_leaf(device, precision)
        sample.fluid.advance(60.0 * 9)
        after.append(sample.water.tobytes())
    assert after[0] == after[1]


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (7, 1), (5, 8), (8, 8), (9, 7)])
def test_a_coarser_level_is_the_system_on_blocks_of_cells(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(4)
    fine = System(rng.random(shape), rng.random(shape), rng.random(shape))
    fine.faces_x[:, -1] = fine.faces_y[-1] = 0.0
    coarse = fine.coarser()
    rows, columns = np.indices(shape)
    block = rows // 2 * coarse.mass.shape[1] + columns // 2
    prolongation = sparse.csr_matrix((np.ones(block.size), (np.arange(block.size), block.ravel())))
    expected = (prolongation.T @ matrix_of(fine) @ prolongation).toarray()
    assert matrix_of(coarse).toarray() == pytest.approx(expected, abs=1e-12)
    diagonal = matrix_of(coarse).diagonal().reshape(coarse.mass.shape)
    assert coarse.inverse_diagonal == pytest.approx(1.0 / diagonal)


def matrix_of(system: System) -> sparse.csr_matrix:
    """``E + L``, face by face."""
    index = np.arange(system.mass.size).reshape(system.mass.shape)
    matrix = sparse.lil_matrix((index.size, index.size))
    matrix.setdiag(system.mass.ravel())
    for faces, here, beyond in (
        (system.faces_x[:, :-1], index[:, :-1], index[:, 1:]),
        (system.faces_y[:-1], index[:-1], index[1:]),
    ):
        for beta, a, b in zip(faces.ravel(), here.ravel(), beyond.ravel(), strict=True):
            matrix[a, a] += beta
            matrix[b, b] += beta
            matrix[a, b] -= beta
            matrix[b, a] -= beta
    return matrix.tocsr()
