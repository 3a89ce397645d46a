"""The line solves of a CPU's lanes and of a GPU's segments, against one thread a line."""

from __future__ import annotations

import numpy as np
import pytest

from leafwarp.sim.fluid.lines import LineSolves, line_arrays
from leafwarp.sim.fluid.spans import block_spans, line_spans
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.tridiagonal import solve_lines

# Of max y: some units in the last place, gathered along a line.
ROUNDING = {"float32": 1e-6, "float64": 2e-15}
SHAPES = [(70, 150), (150, 70), (1, 100), (100, 1), (1, 1), (33, 32), (3, 300)]


class Lines:
    """The systems of a map's lines in one direction, with and without an excess of the diagonal."""

    def __init__(self, shape, direction: str, segmented: bool, device: str, precision: str, *, excess: bool, seed=1):
        rng = np.random.default_rng(seed)
        self.mask = rng.random(shape) < 0.95
        self.mask[:, : shape[1] // 3] &= rng.random((shape[0], 1)) < 0.5  # lines that begin and end anywhere
        specs = [
            *line_arrays(shape),
            ArraySpec("right_side", shape, "real", "right sides", padded=True),
            ArraySpec("solution", shape, "real", "solutions", padded=True),
            ArraySpec("excess", shape, "real", "excess of the diagonal"),
        ]
        self.state = state = State(specs, device, precision)
        self.direction, self.shape = direction, shape
        conductance = 10.0 ** rng.uniform(-3.0, 6.0, shape)
        x, y = conductance.copy(), conductance
        x[:, -1] = y[-1] = 0.0
        x[:, :-1][~(self.mask[:, 1:] & self.mask[:, :-1])] = 0.0
        y[:-1][~(self.mask[1:] & self.mask[:-1])] = 0.0
        state.upload("conductance_x", x)
        state.upload("conductance_y", y)
        for name, span in (("row", line_spans(self.mask)), ("column", line_spans(self.mask.T))):
            state.upload(f"{name}_span", span)
            state.upload(f"{name}_block_span", block_spans(span))
        state.upload("excess", np.where(self.mask, rng.uniform(0.0, 5.0, shape), 0.0))
        self.stage = Stage(None, None)
        self.excess = "excess" if excess else None
        self.solves = LineSolves(self.stage, state, direction, 1.0, self.excess, segmented=segmented)

    def solve(self, content: np.ndarray, *, in_place: bool = False) -> np.ndarray:
        target = "right_side" if in_place else "solution"
        self.state.upload("right_side", np.where(self.mask, content, 0.0))
        for command in self.solves.record("right_side", target):
            command.run()
        return self.state[target].numpy().copy()

    def reference(self, content: np.ndarray) -> np.ndarray:
        """One thread a line."""
        state, direction = self.state, self.direction
        state.upload("right_side", np.where(self.mask, content, 0.0))
        state.upload("solution", np.zeros(self.shape))
        turn = (0, 1) if direction == "x" else (1, 0)
        right_side, solution = (state[name].transpose(turn) for name in ("right_side", "solution"))
        span = "row_span" if direction == "x" else "column_span"
        inputs = [f"forward_weight_{direction}", f"backward_weight_{direction}", span, right_side]
        state.record(solve_lines, len(right_side), inputs, [solution]).run()
        return state["solution"].numpy().copy()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("direction", ["x", "y"])
@pytest.mark.parametrize("segmented", [False, True])
@pytest.mark.parametrize("excess", [False, True])
def test_all_solves_agree(
    shape: tuple[int, int], direction: str, segmented: bool, excess: bool, device: str, precision: str
) -> None:
    lines = Lines(shape, direction, segmented, device, precision, excess=excess)
    content = np.random.default_rng(2).random(shape)
    expected = lines.reference(content)
    assert lines.solve(content) == pytest.approx(expected, abs=ROUNDING[precision])
    assert np.array_equal(lines.solve(content, in_place=True), lines.solve(content))
    assert not expected[~lines.mask].any()


@pytest.mark.parametrize("direction", ["x", "y"])
@pytest.mark.parametrize("segmented", [False, True])
def test_what_is_the_same_everywhere_stays_so_to_the_last_bit(
    direction: str, segmented: bool, device: str, precision: str
) -> None:
    lines = Lines((70, 150), direction, segmented, device, precision, excess=False)
    content = np.where(lines.mask, np.asarray(0.3, precision), 0.0)
    assert np.array_equal(lines.solve(content), content.astype(precision))


@pytest.mark.parametrize("direction", ["x", "y"])
@pytest.mark.parametrize("segmented", [False, True])
def test_no_content_leaves_the_range_of_its_line(direction: str, segmented: bool, device: str, precision: str) -> None:
    """Not by a bit: every content is a mean of two others, held between them."""
    for seed in range(8):
        lines = Lines((70, 150), direction, segmented, device, precision, excess=False, seed=seed)
        rng = np.random.default_rng(seed)
        # Few values, so that most of what is averaged is alike but for rounding.
        content = rng.choice(rng.random(3).astype(precision), lines.shape)
        after, mask = lines.solve(content), lines.mask
        if direction == "y":
            content, after, mask = content.T, after.T, mask.T
        for before, now, on_leaf in zip(content, after, mask, strict=True):
            if on_leaf.any():
                assert now[on_leaf].min() >= before[on_leaf].min()
                assert now[on_leaf].max() <= before[on_leaf].max()


def test_a_block_covers_its_lines() -> None:
    span = np.zeros((LANES + 3, 2), np.int32)
    span[3], span[5] = (4, 9), (2, 6)
    assert block_spans(span).tolist() == [[2, 9], [0, 0]]


def test_a_cpu_allocates_nothing_for_segments(precision: str) -> None:
    names = set(Lines((70, 150), "x", False, "cpu", precision, excess=False).state.names)
    assert not [name for name in names if "segment" in name or "product" in name or "diagonal" in name]
