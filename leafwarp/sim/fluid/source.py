"""The exchange with a supply at the petiole base."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import warp as wp

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.specimen import once_a_photo
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import MAXIMUM_BETA
from leafwarp.sim.fluid.spans import line_spans, thread_segments
from leafwarp.sim.fluid.steps import SNAP, FluidSteps
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.source import count_lines, fill_lines, open_source


def source_cells(leaf: Leaf) -> np.ndarray:
    """Cells that exchange water with the supply, shape [ny, nx], bool.

    Raises:
        InputError: The map shows no source on the leaf.
    """

    def cells(photo: Leaf) -> np.ndarray:
        is_source = (photo.maps["source"] > 0.0) & photo.mask
        if not is_source.any():
            raise InputError(
                "maps.source: the map is 0 on the whole leaf; accepted: a map that is bright where water enters"
            )
        return is_source

    return leaf.tile(once_a_photo(cells))


def source_rates(leaf: Leaf, conductance: float) -> np.ndarray:
    """Rate at which each cell nears the supply [1/s], shape [ny, nx]: its share of what the whole leaf exchanges.

    Args:
        leaf: The leaf.
        conductance: Of the source, over the water of the saturated leaf [1/s].
    """

    def rates(photo: Leaf) -> np.ndarray:
        weights = np.where(photo.mask, photo.maps["source"], 0.0)
        with np.errstate(over="ignore"):
            return conductance * (weights / weights[weights > 0.0].sum()) * photo.mask.sum()

    return leaf.tile(once_a_photo(rates))


class Opening:
    """How long the source is open in a step, and whether that has changed.

    It is open until ``source.cut_at``, and from ``source.rewatered_at`` on.

    Args:
        scene: With [source].

    Attributes:
        seconds: How long it is open in the present step [s]; 0 before the first one.
    """

    def __init__(self, scene: Scene):
        self.seconds = 0.0
        self._step = FluidSteps.of(scene).length
        self._cut = math.inf if scene.source.cut_at is None else scene.source.cut_at
        self._rewatered = math.inf if scene.source.rewatered_at is None else scene.source.rewatered_at

    def set_time_step(self, seconds: float) -> None:
        """Take steps of another length [s] from now on; the next one counts as changed."""
        self._step, self.seconds = seconds, math.nan

    def update(self, interval: Interval) -> bool:
        """Go to a step.

        Returns:
            Whether the source is open for another time than in the step before: at the start, and in the steps in
            and after which it is cut or rewatered.
        """
        before, self.seconds = self.seconds, self._open_in(interval.start)
        return self.seconds != before

    def changes(self) -> tuple[int, ...]:
        """The steps, counted from 0, in which it is open for another time than in the step before."""
        moments = [moment / self._step for moment in (self._cut, self._rewatered) if math.isfinite(moment)]
        near = {math.floor(moment) + off for moment in moments for off in (-1, 0, 1, 2)}
        start = self._step
        return tuple(
            index for index in sorted(near) if index > 0
            and self._open_in(index * start) != self._open_in((index - 1) * start)
        )  # fmt: skip

    def _open_in(self, start: float) -> float:
        """How long it is open in the step from a moment on [s]."""
        until_cut = max(0.0, min(self._cut - start, self._step))
        since_rewatered = max(0.0, min(start + self._step - self._rewatered, self._step))
        seconds = until_cut + since_rewatered
        if seconds <= SNAP * self._step:
            return 0.0
        return self._step if seconds >= (1.0 - SNAP) * self._step else seconds


class Supply:
    """The launches around a solve with the source's exchange: fill the source cells, and count what entered.

    A stage that solves for the water of a step adds the array "source_exchange" to the diagonal of its system, and
    runs the two commands of :meth:`record` before and after the solve while the source is open.

    Args:
        scene: With [source].
        leaf: The leaf.
        directions: Line directions, "x" for rows and "y" for columns, of the stage's solves in a step.
        lines_mix: The solve moves water between the lines of its direction, so that all of them are counted, and
            not only those with a source cell.

    Attributes:
        arrays: The arrays that the stage has to declare.
        is_source: Cells that exchange water with the supply, shape [ny, nx], bool.
        opening: How long the source is open.
    """

    def __init__(self, scene: Scene, leaf: Leaf, directions: str, lines_mix: bool = False):
        self.is_source = source_cells(leaf)
        self.opening = Opening(scene)
        self._supply = scene.source.supply
        self._spans = {}
        for direction in directions:
            mask, is_source = (m if direction == "x" else m.T for m in (leaf.mask, self.is_source))
            counted = True if lines_mix else is_source.any(axis=1)[:, None]
            self._spans[direction] = line_spans(mask & counted)
        self.arrays = tuple(self._declare())

    def _declare(self) -> Iterable[ArraySpec]:
        for direction, span in self._spans.items():
            lines = "rows" if direction == "x" else "columns"
            yield ArraySpec(f"source_span_{direction}", span.shape, "int32", f"cells of {lines} counted for the source")

    def record(self, stage: Stage, state: State, direction: str) -> tuple[Command, Command]:
        """Record what is done before and after a solve along the lines of a direction.

        Args:
            stage: The stage that solves; it gets the array of what was added.
            state: Holds the arrays.
            direction: "x" for rows, "y" for columns.
        """
        span, added = f"source_span_{direction}", f"added_by_source_{direction}"
        state.upload(span, self._spans[direction])
        water, exchange = (_lines(state[name], direction) for name in ("water", "source_exchange"))
        cells, segments = thread_segments(water.shape[1], state)
        dim = (segments, water.shape[0])
        stage.add_array(state, ArraySpec(added, dim, "float64", "content added to each segment of the lines"))
        return (
            state.record(fill_lines, dim, [exchange, span, cells, self._supply], [water, added]),
            state.record(count_lines, dim, [water, span, cells], [added]),
        )


def _lines(array: wp.array, direction: str) -> wp.array:
    return array if direction == "x" else array.transpose((1, 0))


class Source(Stage):
    """Opens the source: what each of its cells exchanges with the supply in a step.

    Where water flows, the diffusion solves for the exchange together with the flow; where nothing flows, this stage
    fills the cells itself.
    """

    name = "source"
    purpose = "water exchanged with the supply at the petiole base, while the leaf is not cut"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._is_source = source_cells(leaf)
        self._opening = Opening(scene)
        # The split scheme solves twice a step, each time for half of the exchange.
        self._solves = 2 if scene.water_flows and scene.fluid.scheme == "split" else 1
        self._supply = None if scene.water_flows else Supply(scene, leaf, "x")
        count = int(self._is_source.sum())
        self.arrays = (
            ArraySpec("source_cell", (count, 2), "int32", "row and column of each source cell"),
            ArraySpec("source_rate", (count,), "float64", "rate at which each source cell nears the supply [1/s]"),
            ArraySpec("source_exchange", leaf.mask.shape, "real", "the same rates times the time of a solve"),
            *(self._supply.arrays if self._supply is not None else ()),
        )

    def bind(self, state: State) -> None:
        cells = np.argwhere(self._is_source)
        step = FluidSteps.of(self.scene).length
        rate = source_rates(self.leaf, self.scene.source.conductance)[self._is_source]
        state.upload("source_cell", cells)
        state.upload("source_rate", np.minimum(rate, min(MAXIMUM_BETA / step, MAXIMUM_BETA)))
        self._open = state.record(open_source, len(cells), ["source_cell", "source_rate", 0.0], ["source_exchange"])
        if self._supply is not None:
            self.commands = list(self._supply.record(self, state, "x"))

    def set_time_step(self, seconds: float) -> None:
        self._opening.set_time_step(seconds)
        if self._supply is not None:
            self._supply.opening.set_time_step(seconds)

    def launches_of(self, interval: Interval | None = None) -> list[Command]:
        if self._opening.update(interval):
            self._open.launch.set_param_by_name("open_for", self._opening.seconds / self._solves)
            self._open.run()
        return self.commands if self._opening.seconds > 0.0 else []
