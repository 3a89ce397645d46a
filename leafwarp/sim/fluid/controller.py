"""The fluid as the frame loop sees it: advance to a moment of plant time, and account for the water."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.steps import HALF_STEP, SNAP, FluidSteps, NotConverged
from leafwarp.sim.fluid.water import Water
from leafwarp.sim.launch import Command, State
from leafwarp.sim.stage import Stage
from leafwarp.stopwatch import Stopwatch

# Arrays that count what has left and entered.
LOSSES = {"transpired": 1.0, "held_at_least": -1.0}
GAINS = {"added_by_source_x": 1.0, "added_by_source_y": 1.0, "held_at_most": -1.0}
# Where steps adapt, over the longest: the shortest one, which is taken whatever its error, and the longest within which
# the source may open or close, as neither its ends nor its middle need show what that does.
SHORTEST, LONGEST_ACROSS = 2.0**-12, 2.0**-6
# The share of the allowed error below which the next step may be twice as long; its error is four times as large.
EASY_SHARE = 0.2
# Error that rounding may show, in units of the last place.
ROUNDING = 16.0
# One step in so many runs stage by stage, which tells how the time of the others is shared out.
STEPS_PER_TIMING = 64


@dataclass(frozen=True)
class WaterLedger:
    """Where the water went, in contents of the saturated leaf (so the mean of y over the leaf).

    Attributes:
        start: Content at the start.
        added: What the source has added since; less than 0 where a leaf wetter than its supply has given water back.
        transpired: What has transpired since.
        now: Content after the last fluid step.
    """

    start: float
    added: float
    transpired: float
    now: float

    @property
    def error(self) -> float:
        """What is missing: rounding, if all is well."""
        return self.start + self.added - self.transpired - self.now


class Fluid:
    """Runs the fluid's steps as plant time goes on.

    The steps are a division of the scene's duration that knows nothing of the frames, so that any number of
    frames sees the same history; a frame between two steps sees their linear blend in ``water_now``.

    Where the scene has a tolerance for them, a step is halved for as long as its error, which its two halves tell, is
    more than that; what it has done is undone before it is tried again. Where the error allows it, the next step is
    twice as long. Steps of any length begin where all would, were they so long.

    Once a step has changed no bit of any array, nor will the next one, until the source is cut or rewatered: they are
    skipped, and the accounts go on by what the last step has added to them. Whether a step has changed the water is
    seen while it is blended, and looked at once a frame (:meth:`check`).

    Args:
        scene: With [fluid].
        leaf: The leaf.
        state: Holds the arrays of the stages.
        stages: The bound stages of the fluid, in the order in which they run.
        watch: Where the time of each stage is counted; None for nowhere.

    Attributes:
        steps: The steps; where they adapt, the longest.
        steps_done: How many steps are behind; those skipped included.
        steps_skipped: How many of them were skipped.
        steps_repeated: How often a step was too long and taken again, shorter.
        steps_over_tolerance: How many steps were as short as can be and still too long.
        shortest_step: Of those that are behind [s].
        is_at_rest: Whether the water is the same as at the look before.
    """

    def __init__(self, scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage], watch: Stopwatch | None = None):
        self.steps = FluidSteps.of(scene)
        self.steps_done = self.steps_skipped = self.steps_repeated = self.steps_over_tolerance = 0
        self.shortest_step = self.steps.length
        self.is_at_rest = False
        self._state = state
        self._watch = watch or Stopwatch()
        self._cell_count = max(1, int(leaf.mask.sum()))
        self._water = next(stage for stage in stages if isinstance(stage, Water))
        self._stages = [stage for stage in stages if stage.rate == "fluid step"]
        self._graphs: dict[tuple[int, ...], wp.Graph] = {}
        self._start = self._content()
        self._events, self._moments = _source_events(scene)
        self._last_checked = 0
        self._is_kept = self._may_rest = self._is_resting = False
        # In longest steps, of which all parts are powers of two: no sum of them is rounded.
        self._position, self._span, self._last_span = 0.0, 1.0, 1.0
        tolerance = scene.fluid.step_tolerance
        self._error_allowed = tolerance
        self._kept_accounts: dict[str, wp.array] = {}
        if tolerance is not None:
            accounts = [name for name in (*LOSSES, *GAINS) if name in state]
            self._kept_accounts = {name: wp.empty_like(state.whole(name)) for name in accounts}
        # What solvers and rounding leave, shorter steps would not change.
        self._error_left = ROUNDING * float(np.finfo(state.precision).eps)
        if scene.water_flows and scene.fluid.scheme == "unsplit":
            self._error_left += 2.0 * scene.residual_tolerance

    def advance(self, plant_time: float, frame: int = 0) -> int:
        """Run the whole steps that plant time needs, and set ``water_now`` to that moment.

        Args:
            plant_time: Plant time since the start [s], never less than before; held to the scene's duration.
            frame: Number of the frame, for the message of an error.

        Returns:
            Number of fluid steps, skipped ones included.

        Raises:
            SimulationError: A stage failed.
        """
        passed = self.steps.passed(plant_time)
        was_resting, before = self._is_resting, self.steps_done
        if passed > self._position and self._may_rest and not self._is_resting and self._span == 1.0:
            self._try_rest(frame, passed)
        if self._is_resting:
            self._skip(passed)
        self.is_at_rest = was_resting and self._is_resting
        while self._position < passed:
            self._step(frame, passed)
        with self._watch(self._water.name):
            self._water.blend((passed - (self._position - self._last_span)) / self._last_span)
        return self.steps_done - before

    def _step(self, frame: int, passed: float) -> None:
        """Take a step on the way to a moment; where steps adapt, one whose error is allowed."""
        next_span = self._span
        if self._error_allowed is None:
            # Once a frame is enough to see whether the last step still changes anything.
            end = self._position + self._span
            if end >= passed and (end > passed or not self._is_kept):
                self._keep()
            self._run(frame)
        else:
            self._keep()
            self._take_spans_of(self._span_to_event())
            for name, kept in self._kept_accounts.items():
                wp.copy(kept, self._state.whole(name))
            while (share := self._try(frame)) > 1.0 and self._span > SHORTEST:
                self.steps_repeated += 1
                for name, before in {"water": self._state.whole("water_before"), **self._kept_accounts}.items():
                    wp.copy(self._state.whole(name), before)
                self._take_spans_of(0.5 * self._span)
            self.steps_over_tolerance += share > 1.0
            next_span = min(1.0, 2.0 * self._span) if share <= EASY_SHARE else self._span
        self.shortest_step = min(self.shortest_step, self._span * self.steps.length)
        self._position += self._span
        self._last_span = self._span
        self.steps_done += 1
        # A longer step begins where one of its length would.
        if self._position % next_span == 0.0:
            self._take_spans_of(next_span)

    def _span_to_event(self) -> float:
        """The part of the next step within which the source neither opens nor closes, unless that is too short."""
        span = self._span
        for moment in self._moments:
            ahead = moment / self.steps.length - self._position
            while SNAP < ahead < span - SNAP and span > LONGEST_ACROSS:
                span *= 0.5
        return span

    def _keep(self) -> None:
        self._water.keep()
        self._is_kept = True

    def _try(self, frame: int) -> float:
        """Take a step, and see its error over what is allowed; infinite where a solver did not come to an end."""
        from leafwarp.sim.fluid.second_order import step_error

        try:
            self._run(frame)
        except SimulationError:
            # Of the shortest step, or of what is no water, nothing else is to be had.
            if self._span <= SHORTEST or self._water.fault("water_before"):
                raise
            return math.inf
        error = max(0.0, step_error(self._state) - self._error_left)
        return error / self._error_allowed

    def _take_spans_of(self, span: float) -> None:
        """Take steps of another length from now on."""
        if span == self._span:
            return
        self._span = span
        for stage in self._stages:
            stage.set_time_step(span * self.steps.length)

    def _run(self, frame: int) -> None:
        """Run a step: as one captured graph, or stage by stage where the host takes part or the stages are timed."""
        interval = self.steps.interval(self._position, self._span)
        is_timed = self.steps_done % STEPS_PER_TIMING == 0
        stages = [] if is_timed else [stage.launches_of(interval) for stage in self._stages]
        if stages and None not in stages:
            self._replay([command for commands in stages for command in commands])
            return
        for stage in self._stages:
            try:
                with self._watch(stage.name):
                    stage.run(interval)
            except NotConverged as error:
                # Where a solver is given what is no water, it is not to blame.
                raise SimulationError(frame, stage.name, self._water.fault("water") or str(error)) from None

    def _try_rest(self, frame: int, passed: float) -> None:
        """Take the next step, and see whether it has left all as it was but the accounts, and how these grow."""
        self._is_kept = False
        before = {name: self._state.whole(name).numpy().copy() for name in self._names()}
        self._step(frame, passed)
        after = {name: self._state.whole(name).numpy() for name in before}
        accounts = [name for name in before if _is_account(name)]
        self._growth = {name: after[name] - before[name] for name in accounts}
        # A part of a step, cut short by the source, says nothing about the whole one after it.
        self._is_resting = self._last_span == 1.0 and all(
            np.array_equal(after[name].view(np.uint8), values.view(np.uint8))
            for name, values in before.items()
            if name not in accounts
        )

    def _names(self) -> list[str]:
        """The arrays that a step may change."""
        return ["water", *(spec.name for stage in self._stages for spec in stage.arrays)]

    def _skip(self, passed: float) -> None:
        """Pass over steps up to a moment, or to the next that is another; then the rest is over."""
        begun = float(math.ceil(passed))
        event = min((float(index) for index in self._events if index >= self._position), default=begun)
        count = max(0, int(min(begun, event) - self._position))
        for name, growth in self._growth.items():
            if count > 0 and growth.any():
                self._state.upload(name, self._state[name].numpy() + count * growth)
        self._position += count
        self.steps_done += count
        self.steps_skipped += count
        if event < begun:
            self.wake()

    def wake(self) -> None:
        """Compute the next steps whatever the last ones did: something else has changed the arrays."""
        self.is_at_rest = self._is_resting = self._may_rest = False

    def restart(self) -> None:
        """Begin the plant time anew, with the water as it is."""
        self._take_spans_of(1.0)
        self._position, self._last_span, self.steps_done = 0.0, 1.0, 0

    def check(self, frame: int) -> None:
        """See whether the water of the last look is sound, by what its kernel has seen; waits for the device.

        To be called once a frame: it also tells from this whether the water may have come to rest.

        Args:
            frame: Number of the frame, for the message of an error.

        Raises:
            SimulationError: It is not.
        """
        wrong, changed = self._water.last_signs()
        if wrong == self._water.looks > 0:
            raise SimulationError(frame, self._water.name, self._water.fault())
        if changed > self._last_checked:
            self.wake()
        elif self._is_kept:
            self._may_rest = True
        self._last_checked = self._water.looks
        self._is_kept = False

    def _replay(self, commands: list[Command]) -> None:
        """Run launches as a graph, captured when they are first asked for."""
        if not commands:
            return
        key = tuple(map(id, commands))
        if key not in self._graphs:
            counted = self._state.launch_count
            with wp.ScopedCapture(device=self._state.device, force_module_load=False) as capture:
                for command in commands:
                    command.run()
            self._state.launch_count = counted
            self._graphs[key] = capture.graph
        with self._watch.shared(stage.name for stage in self._stages):
            wp.capture_launch(self._graphs[key])
        self._state.launch_count += len(commands)

    def ledger(self) -> WaterLedger:
        """The account of the water up to the last fluid step."""
        return WaterLedger(
            self._start,
            self._total(GAINS),
            self._total(LOSSES),
            self._content(),
        )

    def _total(self, accounts: dict[str, float]) -> float:
        """Sum of what some accounts hold, each with its sign."""
        kept = {name: sign for name, sign in accounts.items() if name in self._state}
        return sum(sign * float(self._state[name].numpy().sum()) for name, sign in kept.items()) / self._cell_count

    def _content(self) -> float:
        return float(self._state["water"].numpy().sum(dtype=np.float64)) / self._cell_count


def _is_account(name: str) -> bool:
    return name.removeprefix(HALF_STEP) in (*LOSSES, *GAINS)


def _source_events(scene: Scene) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """When the source opens and closes.

    Returns:
        The steps that are another than the one before, as the source is then open for another time; the moments [s].
    """
    if scene.source is None or scene.source.conductance == 0.0:
        return (), ()
    from leafwarp.sim.fluid.source import Opening

    moments = (scene.source.cut_at, scene.source.rewatered_at)
    return Opening(scene).changes(), tuple(moment for moment in moments if moment is not None)
