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

    Args:
        scene: With [fluid].
        leaf: The leaf.
        state: Holds the arrays of the stages.
        stages: The bound stages of the fluid, in the order in which they run.
        watch: Where the time of each stage is counted; None for nowhere.
    """

    def __init__(self, scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage], watch: Stopwatch | None = None):
        self.steps = FluidSteps.of(scene)
        self.steps_done = 0
        self._state = state
        self._watch = watch or Stopwatch()
        self._cell_count = max(1, int(leaf.mask.sum()))
        self._water = next(stage for stage in stages if isinstance(stage, Water))
        self._stages = [stage for stage in stages if stage.rate == "fluid step"]
        self._graphs: dict[tuple[int, ...], wp.Graph] = {}
        self._start = self._content()

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
        for index in range(self.steps_done, begun):
            if index == begun - 1 and share < 1.0:
                self._water.keep()
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

    def check(self, frame: int) -> None:
        """See whether the water of the last look is sound, by what its kernel has seen; waits for the device.

        Args:
            frame: Number of the frame, for the message of an error.

        Raises:
            SimulationError: It is not.
        """
        wrong, _ = self._water.last_signs()
        if wrong == self._water.looks > 0:
            raise SimulationError(frame, self._water.name, self._water.fault())

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
            self._total("added_by_source_x", "added_by_source_y"),
            self._total("transpired"),
            self._content(),
        )

    def _total(self, *names: str) -> float:
        total = sum(float(self._state[name].numpy().sum()) for name in names if name in self._state)
        return total / self._cell_count

    def _content(self) -> float:
        return float(self._state["water"].numpy().sum(dtype=np.float64)) / self._cell_count
