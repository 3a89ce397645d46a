"""The simulation: the plan bound to arrays, advanced frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import warp as wp

from leafwarp.errors import SimulationError
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import State
from leafwarp.sim.motion import make_motion
from leafwarp.sim.pace import couplings_per_frame, path_times
from leafwarp.sim.plan import Plan, make_plan
from leafwarp.sim.rest import ShapeRest
from leafwarp.sim.settled import Settled
from leafwarp.sim.stage import Interval, Stage, bind_stage
from leafwarp.stopwatch import Stopwatch

if TYPE_CHECKING:
    from leafwarp.sim.fluid import Fluid


# Of a moment of plant time, over the duration.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Moment:
    """A moment at which the structure is told of the water, or moves on.

    Attributes:
        looks: Spans of plant time [s] since the moment before, at the ends of which the water is looked at.
        on_path: Whether a leaf without inertia goes on along its path of equilibria.
        share: Of the frame, by which the leaf moves on in the film; 0 where it does not.
    """

    looks: tuple[Interval, ...]
    on_path: bool
    share: float


class Simulation:
    """A leaf that dries.

    Two clocks run side by side. The water sees plant time: frame 1 is its start and the last frame its end. Gravity
    and inertia see playback time, 1/fps a frame.

    Args:
        scene: What to model.
        leaf: The prepared leaf.
        device: Warp device such as "cpu" or "cuda:0".

    Attributes:
        plan: The stages.
        state: Their arrays.
        couplings_per_frame: How often the water is handed to the structure within a frame.
        path_times: Moments of plant time [s] at which a leaf without inertia is in equilibrium, whatever its frames.
        watch: Wall time spent in each stage so far; the stages of a substep, which run in one graph, are "motion".
        substeps: Motion substeps of every frame so far; 0 for one whose shape is that of the frame before.
        settled: How well the leaf came to rest before the first frame; None where it was not asked to.
    """

    def __init__(self, scene: Scene, leaf: Leaf, device: str = "cpu"):
        self.scene = scene
        self.leaf = leaf
        self.couplings_per_frame = couplings_per_frame(scene)
        self.path_times = path_times(scene)
        self.substeps: list[int] = []
        self.settled: Settled | None = None
        self.plan: Plan = make_plan(scene, leaf)
        self.state = State(self.plan.arrays, device, scene.solver.precision)
        used = self.state.device  # not by self, or the watch would hold the simulation
        self.watch = Stopwatch((lambda: wp.synchronize_device(used)) if used.is_cuda else None)
        with self.watch("start"):
            # The motion's stages fill in the photographed leaf before the coupling lets it follow the water.
            for group in ("fluid", "motion", "coupling", "output"):
                for stage in self.plan.groups.get(group, ()):
                    bind_stage(stage, self.state)
            self.fluid = self._make_fluid()
            self._couple(Interval(0.0, 0.0))
            self.motion = make_motion(scene, leaf, self.state, self.plan.groups["motion"])
        self._follows = self._structure_follows()
        # Equilibria do not depend on the time that passes.
        self._rest = ShapeRest(scene, leaf) if scene.motion.method != "quasistatic" else None
        self._content: float | None = None

    def _structure_follows(self) -> bool:
        """Whether the coupling changes anything that the motion knows."""
        own = {spec.name for stage in self.plan.groups["motion"] for spec in stage.arrays}
        coupled = (stage for stage in self.plan.groups["coupling"] if stage.rate == "frame")
        return any(name in own for stage in coupled for command in stage.recorded for name in command.writes)

    def _make_fluid(self) -> Fluid | None:
        if self.scene.fluid is None:
            return None
        from leafwarp.sim.fluid import Fluid

        return Fluid(self.scene, self.leaf, self.state, self.plan.groups["fluid"], self.watch)

    def stage(self, name: str) -> Stage | None:
        """The stage of a name, or None where the scene does not ask for it."""
        return next((stage for stage in self.plan.stages if stage.name == name), None)

    def group_seconds(self, group: str) -> float:
        """Wall time spent in the stages of a group so far [s]."""
        names = {stage.name for stage in self.plan.groups[group]}
        return sum(seconds for name, seconds in self.watch.seconds.items() if name in names)

    def plant_time(self, frame: int) -> float:
        """Plant time of a frame [s]."""
        frames = self.scene.time.frames
        return self.scene.time.duration * (frame - 1) / (frames - 1) if frames > 1 else 0.0

    def _couple(self, interval: Interval) -> None:
        for stage in self.plan.groups["coupling"]:
            if stage.rate == "frame":
                with self.watch(stage.name):
                    stage.run(interval)

    def _water_changes(self, interval: Interval, frame: int) -> bool:
        """Let the water go on over a span of plant time; whether it may be another than before."""
        if self.fluid is not None:
            self.fluid.advance(interval.end, frame)
            return not self.fluid.is_at_rest
        before, self._content = self._content, self.stage("prescribed_water").content(interval.end)
        return self._content != before

    def read_frame(self, index: int) -> Frame:
        """The present state as frame ``index`` (0: the rest pose).

        Raises:
            SimulationError: It is not sound.
        """
        with self.watch("frame"):
            output = self.stage("frame")
            frame = output.read(index, self.plant_time(max(index, 1)))
            if self.fluid is not None:
                self.fluid.check(index)
            output.check(frame)
            if self._rest is not None:
                self._rest.look(index, frame.points)
            display_color = self.stage("display_color")
            return frame if display_color is None else display_color.color(frame)

    def advance(self, frame: int) -> None:
        """Go on from frame ``frame - 1`` to ``frame``.

        Raises:
            SimulationError: The frame, or a part of it, cannot be computed. The leaf is back in the shape before that;
                its water is that of the part that failed.
        """
        substeps = 0
        for moment in self.moments(frame):
            for part in moment.looks:
                if self._water_changes(part, frame):
                    self._couple(part)
                    if self._rest is not None and self._follows:
                        self._rest.wake()
            try:
                substeps += self._move(moment, frame)
            except SimulationError:
                # Of water that is none no shape can be made.
                if self.fluid is not None:
                    self.fluid.check(frame)
                raise
        self.substeps.append(substeps)

    def _move(self, moment: Moment, frame: int) -> int:
        """Let the structure follow the water to a moment, and return the substeps that it took."""
        substeps = 0
        if self._rest is not None and self._rest.is_resting:
            self.state["velocity"].zero_()
            return substeps
        with self.watch("motion"):
            if moment.on_path:
                substeps += self.motion.follow(frame)
            if moment.share > 0.0:
                substeps += self.motion.advance(moment.share / self.scene.time.fps, frame)
        return substeps

    def moments(self, frame: int) -> list[Moment]:
        """When the structure is told of the water, or moves, between the frame before and this one."""
        begin, end = self.plant_time(frame - 1), self.plant_time(frame)
        # A moment that is the frame's end but for rounding is that.
        rounding = ROUNDING * self.scene.time.duration

        def within(times: Iterable[float]) -> set[float]:
            here = (time for time in times if begin + rounding < time <= end + rounding)
            return {end if abs(time - end) <= rounding else time for time in here}

        path, coupled = within(self.path_times), within(self._coupling_times(begin, end))
        moves = {*coupled, end}
        moments, moved = [], begin
        for interval in (Interval(*span) for span in pairwise(sorted({begin, *moves, *path}))):
            looks = [interval.start, *self._turning_points(interval)]
            if interval.end in coupled or interval.end in path:
                looks.append(interval.end)
            share = 0.0
            if interval.end in moves:
                share, moved = (interval.end - moved) / (end - begin), interval.end
            spans = tuple(Interval(*span) for span in pairwise(looks))
            moments.append(Moment(spans, interval.end in path, share))
        return moments

    def _coupling_times(self, begin: float, end: float) -> Iterator[float]:
        """Moments of plant time [s] at which the structure is told of the water, from a frame on to the next."""
        asked = self.scene.solver.coupling_interval
        if asked is None:
            parts = self.couplings_per_frame
            yield from (begin + (end - begin) * part / parts for part in range(1, parts + 1))
            return
        duration = self.scene.time.duration
        interval = duration / math.ceil(duration / asked * (1.0 - ROUNDING))
        first = math.floor(begin / interval)
        yield from (interval * count for count in range(first, math.ceil(end / interval) + 1))

    def _turning_points(self, interval: Interval) -> list[float]:
        """Moments within a span of plant time [s] at which the water may be driest, where the leaf keeps a set of it.

        Between the ends of fluid steps, and between the points of a prescribed curve, the water goes straight on.
        """
        if not self.scene.keeps_a_set:
            return []
        if self.fluid is None:
            return [time for time, _ in self.scene.water.curve if interval.start < time < interval.end]
        steps = self.fluid.steps
        first, last = math.floor(steps.passed(interval.start)) + 1, math.ceil(steps.passed(interval.end))
        return [steps.interval(index).start for index in range(first, last)]

    def settle(self) -> None:
        """Let the leaf come to rest under its load, where the scene asks for it or every frame is an equilibrium."""
        if self.scene.motion.settle or self.scene.motion.method == "quasistatic":
            with self.watch("settle"):
                self.settled = self.motion.settle()

    def frames(self, last: int | None = None) -> Iterator[Frame]:
        """Compute and yield frames 1 to ``last`` (default: the scene's last)."""
        self.settle()
        yield self.read_frame(1)
        for index in range(2, (last or self.scene.time.frames) + 1):
            self.advance(index)
            yield self.read_frame(index)
