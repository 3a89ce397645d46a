"""The fluid as the frame loop sees it: advance to a moment of plant time, and account for the water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.steps import FluidSteps, NotConverged
from leafwarp.sim.fluid.water import Water
from leafwarp.sim.launch import Command, State
from leafwarp.sim.stage import Stage
from leafwarp.stopwatch import Stopwatch

# Arrays that count what has left and entered.
ACCOUNTS = ("transpired", "added_by_source_x", "added_by_source_y")
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
        steps: The steps.
        steps_done: How many of them are behind; those skipped included.
        steps_skipped: How many of them were skipped.
        is_at_rest: Whether the water is the same as at the look before.
    """

    def __init__(self, scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage], watch: Stopwatch | None = None):
        self.steps = FluidSteps.of(scene)
        self.steps_done = self.steps_skipped = 0
        self.is_at_rest = False
        self._state = state
        self._watch = watch or Stopwatch()
        self._cell_count = max(1, int(leaf.mask.sum()))
        self._water = next(stage for stage in stages if isinstance(stage, Water))
        self._stages = [stage for stage in stages if stage.rate == "fluid step"]
        self._graphs: dict[tuple[int, ...], wp.Graph] = {}
        self._start = self._content()
        self._events = _source_events(scene)
        self._last_checked = 0
        self._is_kept = self._may_rest = self._is_resting = False

    def advance(self, plant_time: float, frame: int = 0) -> int:
        """Run the whole steps that plant time needs, and set ``water_now`` to that moment.

        Args:
            plant_time: Plant time since the start [s], never less than before; held to the scene's duration.
            frame: Number of the frame, for the message of an error.

        Returns:
            Number of fluid steps run.

        Raises:
            SimulationError: A stage failed.
        """
        begun, share = self.steps.locate(plant_time)
        count = max(0, begun - self.steps_done)
        was_resting = self._is_resting
        if count > 0 and self._may_rest and not self._is_resting:
            self._try_rest(frame)
        if self._is_resting:
            self._skip(begun)
        self.is_at_rest = was_resting and self._is_resting
        for index in range(self.steps_done, begun):
            # Once a frame is enough to see whether the last step still changes anything.
            if index == begun - 1 and (share < 1.0 or not self._is_kept):
                self._water.keep()
                self._is_kept = True
            self._step(index, frame)
        with self._watch(self._water.name):
            self._water.blend(share)
        return count

    def _step(self, index: int, frame: int) -> None:
        """Run a step: as one captured graph, or stage by stage where the host takes part or the stages are timed."""
        interval = self.steps.interval(index)
        stages = [] if index % STEPS_PER_TIMING == 0 else [stage.launches_of(interval) for stage in self._stages]
        if stages and None not in stages:
            self._replay([command for commands in stages for command in commands])
        else:
            for stage in self._stages:
                try:
                    with self._watch(stage.name):
                        stage.run(interval)
                except NotConverged as error:
                    # Where a solver is given what is no water, it is not to blame.
                    raise SimulationError(frame, stage.name, self._water.fault("water") or str(error)) from None
        self.steps_done = index + 1

    def _try_rest(self, frame: int) -> None:
        """Run the next step, and see whether it has left all as it was but the accounts, and how these grow."""
        self._water.keep()
        self._is_kept = True
        before = {name: self._state.whole(name).numpy().copy() for name in self._names()}
        self._step(self.steps_done, frame)
        after = {name: self._state.whole(name).numpy() for name in before}
        accounts = [name for name in before if name in ACCOUNTS]
        self._growth = {name: after[name] - before[name] for name in accounts}
        self._is_resting = all(
            np.array_equal(after[name].view(np.uint8), values.view(np.uint8))
            for name, values in before.items()
            if name not in accounts
        )

    def _names(self) -> list[str]:
        """The arrays that a step may change."""
        return ["water", *(spec.name for stage in self._stages for spec in stage.arrays)]

    def _skip(self, begun: int) -> None:
        """Pass over steps up to this one, or to the next that is another; then the rest is over."""
        event = min((index for index in self._events if index >= self.steps_done), default=begun)
        count = max(0, min(begun, event) - self.steps_done)
        for name, growth in self._growth.items():
            if count > 0 and growth.any():
                self._state.upload(name, self._state[name].numpy() + count * growth)
        self.steps_done += count
        self.steps_skipped += count
        if event < begun:
            self.wake()

    def wake(self) -> None:
        """Compute the next steps whatever the last ones did: something else has changed the arrays."""
        self.is_at_rest = self._is_resting = self._may_rest = False

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
            self._total(*(name for name in ACCOUNTS if name != "transpired")),
            self._total("transpired"),
            self._content(),
        )

    def _total(self, *names: str) -> float:
        total = sum(float(self._state[name].numpy().sum()) for name in names if name in self._state)
        return total / self._cell_count

    def _content(self) -> float:
        return float(self._state["water"].numpy().sum(dtype=np.float64)) / self._cell_count


def _source_events(scene: Scene) -> tuple[int, ...]:
    """The steps that are another than the one before, as the source is then open for another time."""
    if scene.source is None or scene.source.conductance == 0.0:
        return ()
    from leafwarp.sim.fluid.source import Opening

    return Opening(scene).changes()
