"""The motion of the leaf: how many substeps a frame takes, running them, and never letting a blow-up
through."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.blocks import BLOCK, blocks, shares
from leafwarp.sim.forces import Air, PaperBending
from leafwarp.sim.guards import find_fault
from leafwarp.sim.launch import Command, State
from leafwarp.sim.limits import FARTHEST_TRAVEL, MOST_STRETCH, STANDARD_GRAVITY, TORN_REMEDY, thrown, torn
from leafwarp.sim.settled import Settled
from leafwarp.sim.stable_step import StableStep, damping_time, step_limit
from leafwarp.sim.stage import Stage

if TYPE_CHECKING:
    from leafwarp.sim.hold import Hold
    from leafwarp.sim.implicit.motion import NewtonMotion
    from leafwarp.sim.ramp import Ramp

REPLAYS = 5
# Settling: substeps between two looks at the kinetic energy, and at most in all.
SETTLING_BLOCK = 32
SETTLING_SUBSTEPS = 2**17


@dataclass(frozen=True)
class _Fault:
    """What is wrong with a span of motion, and what would help; whether a number is not one."""

    what: str
    remedy: str
    is_not_finite: bool = False


class _Following:
    """What follows the water within a span of playback time: the ramp of the structure's parameters, and the hold that
    these move; nothing where a scene has neither."""

    def __init__(self, ramp: Ramp | None, hold: Hold | None):
        self._ramp, self._hold = ramp, hold

    @property
    def is_any(self) -> bool:
        return self._ramp is not None

    def remember(self) -> None:
        """Take the parameters of the moment for those that the next span begins with."""
        if self._ramp is not None:
            self._ramp.remember()

    def aim(self) -> None:
        """Take the parameters of the moment for those that the span ends with."""
        if self._ramp is not None:
            self._ramp.aim()

    def begin(self, substeps: int) -> None:
        """Begin the span, or begin it anew."""
        if self._ramp is not None:
            self._ramp.begin(substeps)

    def go_to(self, middle: float) -> None:
        """Go on to the middle of a share of a block, within the block's graph."""
        if self._ramp is not None:
            self._ramp.ramp_to(middle).run()
            self._run_hold()

    def leave(self, size: int) -> None:
        """Leave a block behind, within its graph."""
        if self._ramp is not None:
            self._ramp.passing(size).run()

    def end(self) -> None:
        """Go on to the span's end."""
        if self._ramp is not None:
            self._ramp.end()
            self._run_hold()

    def arrive(self, duration: float) -> None:
        """Leave the span behind, with nothing wrong in it."""
        self.remember()
        if self._hold is not None:
            self._hold.carry(duration)

    def _run_hold(self) -> None:
        if self._hold is not None:
            self._hold.run()


_NOTHING = _Following(None, None)


class Motion:
    """Moves the structure from frame to frame by small steps.

    The substeps of a frame are the fewest that are safe; they are decided between frames
    from the stiffness and masses of the moment. After the frame its step is checked against the new geometry.
    If it was too long, or a vertex is not finite or has been thrown, the frame is redone with twice the
    substeps.

    Args:
        scene: The scene.
        leaf: The leaf.
        state: The state that all stages are bound to.
        stages: The stages; those of the rate "substep" are run in the order given, and the
            :class:`~leafwarp.sim.stable_step.StableStep` among them is run by this object alone.

    Attributes:
        substeps: Substeps of all frames so far, those of frames that were redone included.
        largest_substeps: Most substeps of a frame so far.
        retries: How often a frame was redone.
        unbalanced_torque: Largest torque at the end of a frame that the paper's bending left unbalanced
            [N m]; None where the scene does not bend that way.
        newton: None: explicit motion solves nothing.
    """

    newton = None

    def __init__(self, scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage]):
        self._state = state
        # Of each leaf; most scenes have one.
        self._lengths = leaf.join(lambda photo, specimen: np.array([specimen.size * photo.length]))
        self._slices = leaf.vertex_slices
        self._drag = scene.motion.drag
        self._structure = scene.structure
        # Neither many leaves nor the paper's bending move in any other way.
        only_explicit = scene.leaves is not None or scene.structure.bending == "paper"
        self._other_method = "" if only_explicit else ", or take motion.method = 'quasistatic' or 'implicit'"
        self._maximum = scene.solver.maximum_substeps
        self._substep = scene.solver.substep
        self._stages = [stage for stage in stages if stage.rate == "substep"]
        self._guard = next(stage for stage in stages if isinstance(stage, StableStep))
        self._paper = next((stage for stage in stages if isinstance(stage, PaperBending)), None)
        by_name = {stage.name: stage for stage in stages}
        self._following = _Following(by_name.get("ramp"), by_name.get("hold"))
        self._gravity = math.hypot(*(scene.motion.gravity or (0.0, 0.0, 0.0))) or STANDARD_GRAVITY
        # Still air only slows the leaf on its way to rest; wind is a load, and its drag brings it to rest.
        self._windy = scene.motion.wind is not None and scene.motion.drag > 0.0
        self._settling = [stage for stage in self._stages if self._windy or not isinstance(stage, Air)]
        self._graphs: dict[tuple, tuple[wp.Graph, int]] = {}
        self.substeps = 0
        self.largest_substeps = 0
        self.retries = 0
        self.unbalanced_torque = None if self._paper is None else 0.0
        for power in range(BLOCK.bit_length()):
            self._graph(2**power, self._stages, self._following)
        self.start()

    def start(self) -> None:
        """Begin anew from the stiffness and masses of the moment, which fix the damping."""
        # Leaves share it: that of the shortest suits the steps of all.
        shortest = float(self._lengths.min())
        self._damping_time = damping_time(self._structure, shortest, self._guard.largest_squared_frequency())
        self._state.upload("damping_time", np.array([self._damping_time]))
        self._limit_before = self._limit()
        self._following.remember()

    def required_substeps(self, frame_duration: float) -> int | float:
        """The fewest substeps that are safe for a frame now; infinite where no step is.

        Args:
            frame_duration: Playback time of the frame [s].
        """
        # From the parameters that the frame begins with to those that it ends with.
        limit = self._substep * float(np.min([self._limit_before, self._limit()]))
        least = frame_duration / limit if limit > 0.0 else math.inf
        return max(1, math.ceil(least)) if math.isfinite(least) else math.inf

    def advance(self, frame_duration: float, frame: int) -> int:
        """Move the leaf by one frame.

        Args:
            frame_duration: Playback time of the frame [s].
            frame: Its number, for messages.

        Returns:
            The substeps that the frame took at last.

        Raises:
            SimulationError: The frame needs more substeps than the scene allows, or goes wrong even with the
                most. The state is that of the frame's start.
        """
        needed = self.required_substeps(frame_duration)
        if needed > self._maximum:
            fault = find_fault(self._state) or self._refusal(needed, frame_duration)
            raise SimulationError(frame, "motion", fault)
        self._following.aim()
        used = self._advance_checked(frame_duration, needed, self._maximum, frame, self._stages, self._following)
        self._following.arrive(frame_duration)
        self.largest_substeps = max(self.largest_substeps, used)
        if self._paper is not None:
            torque = float(np.linalg.norm(self._paper.net_torque()))
            self.unbalanced_torque = max(self.unbalanced_torque, torque)
        return used

    def settle(self, tolerance: float = 1e-3) -> Settled:
        """Let the leaf come to rest under the forces of the moment; its velocities are zero afterwards.

        Dynamic relaxation by the forces of the motion but the drag of still air: when the kinetic energy
        has passed a peak the leaf is stopped, near the bottom of the swing (Cundall 1976); in wind, the drag
        alone brings it to rest. It has come to rest when it is let go and, for a quarter of the period of a
        pendulum of its length, its kinetic energy does not reach that of a pendulum that swings by
        ``tolerance`` of its length. (Forces say less: rounding of the positions alone leaves a good part of a
        vertex's weight on it, back and forth from vertex to vertex.)

        Args:
            tolerance: Swing that counts as rest, as a share of the leaf's length.

        Raises:
            SimulationError: As :meth:`advance`, with frame 0.
        """
        velocity = self._state["velocity"]
        mass = self._state["mass"].numpy().astype(np.float64)
        pendulum = np.array([mass[own].sum() for own in self._slices]) * self._gravity * self._lengths
        with np.errstate(over="ignore"):  # hardly any gravity: it swings for ever
            quarter = 0.5 * math.pi * np.sqrt(self._lengths / self._gravity)
        most = max(SETTLING_BLOCK, self._maximum)
        before, calm, swing = (np.zeros(len(pendulum)) for _ in range(3))
        substeps = 0
        velocity.zero_()
        while (calm < quarter).any() and substeps < SETTLING_SUBSTEPS:
            limit = self._substep * self._limit()
            if not limit > 0.0:
                fault = find_fault(self._state) or self._refusal(math.inf, math.inf)
                raise SimulationError(0, "settling", fault)
            duration = min(SETTLING_BLOCK * limit, 0.1 * quarter.min())
            substeps += self._advance_checked(duration, SETTLING_BLOCK, most, 0, self._settling, _NOTHING)
            energy = self._kinetic_energy(mass)
            now = np.sqrt(energy / pendulum)
            is_calm = now <= tolerance
            swing = np.where(is_calm & (calm > 0.0), np.maximum(swing, now), now)
            calm = np.where(is_calm, calm + duration, 0.0)
            if not self._windy:
                has_peaked = ~is_calm & (energy < before)
                self._stop(has_peaked)
                energy[has_peaked] = 0.0
            before = energy
        velocity.zero_()
        return Settled(self._residual(), float(swing.max()), substeps, bool((calm >= quarter).all()))

    def _kinetic_energy(self, mass: np.ndarray) -> np.ndarray:
        """Twice the kinetic energy of each leaf [J], from the vertices' masses [kg]; shape [leaf_count]."""
        velocity = self._state["velocity"].numpy().astype(np.float64)
        return np.array([mass[own] @ np.square(velocity[own]).sum(axis=1) for own in self._slices])

    def _stop(self, chosen: np.ndarray) -> None:
        """Take the speed from the chosen leaves."""
        if not chosen.any():
            return
        velocity = self._state["velocity"].numpy().copy()
        for index in np.flatnonzero(chosen):
            velocity[self._slices[index]] = 0.0
        self._state.upload("velocity", velocity)

    def stage_shares(self) -> dict[str, float]:
        """Share of each stage in the time of a substep, with sum 1.

        The substeps run in graphs that cannot be looked into, so each stage is replayed alone; the leaf is put back
        afterwards. What runs every few substeps alone is not counted.
        """
        self._guard.save()
        self._state.upload("time_step", np.zeros(1))
        seconds: dict[str, float] = {}
        counted = self._state.launch_count
        for stage in self._stages:
            graph, _ = self._graph(BLOCK, [stage], _NOTHING)
            laps = []
            for _ in range(REPLAYS):
                begin = time.perf_counter()
                wp.capture_launch(graph)
                wp.synchronize_device(self._state.device)
                laps.append(time.perf_counter() - begin)
            seconds[stage.name] = min(laps)
        self._state.launch_count = counted
        self._guard.restore()
        total = sum(seconds.values())
        return {name: value / total for name, value in seconds.items()}

    def _limit(self) -> float:
        return step_limit(self._guard.largest_squared_frequency(), self._damping_time, self._drag)

    def _advance_checked(
        self, duration: float, substeps: int, most: int, frame: int, stages: list[Stage], following: _Following
    ) -> int:
        """Run a span of playback time, redone with twice the substeps until nothing is wrong with it."""
        self._guard.save()
        self._stretch_before = self._guard.largest_stretch()
        while True:
            following.begin(substeps)
            self._run_substeps(substeps, duration / substeps, stages, following)
            following.end()
            limit = self._limit()
            fault = self._fault(duration / substeps, limit)
            if fault is None:
                self._limit_before = limit
                return substeps
            self._guard.restore()
            # More substeps are of no use to what was wrong before.
            wrong = find_fault(self._state) if fault.is_not_finite else None
            if wrong is not None:
                raise SimulationError(frame, "motion", wrong)
            if substeps >= most:
                reason = f"{fault.what} with {substeps} substeps, and no more than {most} are allowed; {fault.remedy}"
                raise SimulationError(frame, "motion", reason)
            substeps = min(2 * substeps, most)
            self.retries += 1

    def _run_substeps(self, count: int, step: float, stages: list[Stage], following: _Following) -> None:
        """Run substeps by replaying graphs of blocks of them.

        The length of a step lies in an array, not in the graphs: they serve every frame.
        """
        self._state.upload("time_step", np.array([step]))
        self.substeps += count
        for size in blocks(count):
            graph, launches = self._graph(size, stages, following)
            wp.capture_launch(graph)
            self._state.launch_count += launches

    def _graph(self, count: int, stages: list[Stage], following: _Following) -> tuple[wp.Graph, int]:
        """The graph of this many substeps, and its launches; captured when first asked for."""
        key = (count, following.is_any, *(stage.name for stage in stages))
        if key not in self._graphs:
            before, rounds = self._state.launch_count, self._rounds(stages)
            with wp.ScopedCapture(device=self._state.device, force_module_load=False) as capture:
                for substeps, middle in shares(count) if following.is_any else [(count, 0.0)]:
                    following.go_to(middle)
                    for launches in rounds:
                        for command in launches * substeps:
                            command.run()
                following.leave(count)
            self._graphs[key] = capture.graph, self._state.launch_count - before
            self._state.launch_count = before
        return self._graphs[key]

    def _rounds(self, stages: list[Stage]) -> list[list[Command]]:
        """Launches of a substep, in rounds: a few substeps for one group of leaves, which stays in the cache, then for
        the next."""
        groups = {len(stage.parts) for stage in stages}
        if len(groups) > 1 or groups == {0}:
            return [[command for stage in stages for command in stage.launches_of()]]
        parts = zip(*(stage.parts for stage in stages), strict=True)
        return [[command for commands in group for command in commands] for group in parts]

    def _fault(self, step: float, limit: float) -> _Fault | None:
        """What is wrong with the span that was just run, in steps of a length, and that is safe now [s]."""
        travel = self._guard.travel()
        if not np.isfinite(travel).all():
            return _Fault("a position or a speed is not a finite number", self._remedy(), is_not_finite=True)
        farthest = np.maximum.reduceat(travel, [own.start for own in self._slices])
        worst = int(np.argmax(farthest / self._lengths))
        if farthest[worst] > FARTHEST_TRAVEL * self._lengths[worst]:
            return _Fault(f"{thrown(farthest[worst], self._lengths[worst])},", self._remedy())
        stretch = self._guard.largest_stretch()
        if math.isnan(stretch):
            return _Fault("the stretch of an edge is not a number", self._remedy(), is_not_finite=True)
        if stretch > max(MOST_STRETCH, self._stretch_before):
            return _Fault(torn(stretch), TORN_REMEDY)
        if not step <= limit:
            safe = f", which needs steps of {self._substep * limit:.3g} s," if limit > 0.0 else ""
            return _Fault(f"the step of {step:.3g} s became too long for the deformed mesh{safe}", self._remedy())
        return None

    def _residual(self) -> float:
        """Largest force on a free vertex at rest where it is, over the mean weight of a vertex."""
        for stage in self._stages[:-1]:
            stage.run()
        force = np.linalg.norm(self._state["force"].numpy().astype(np.float64), axis=1)
        weight = self._gravity * self._state["mass"].numpy().astype(np.float64).mean()
        return float(np.max(force, initial=0.0, where=~self._state["pinned"].numpy()) / weight)

    def _refusal(self, needed: float, duration: float) -> str:
        if not math.isfinite(needed):
            return "no step is short enough for the stiffness and masses of this scene; " + self._remedy()
        found = f"needs {needed:.6g} substeps, more than solver.maximum_substeps = {self._maximum}"
        return f"{found}: steps of {duration / needed:.3g} s would do; {self._remedy()}"

    def _remedy(self) -> str:
        squared_frequency = self._guard.largest_squared_frequency()
        if self._drag > self._damping_time * squared_frequency + 2.0 * math.sqrt(max(squared_frequency, 0.0)):
            return "lower motion.drag, or raise time.fps"
        return (
            "lower structure.membrane_stiffness (explicit motion wants 2 to 20 N/m) or bending_stiffness, "
            "raise time.fps or solver.maximum_substeps" + self._other_method
        )


def make_motion(scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage]) -> Motion | NewtonMotion:
    """The motion that a scene asks for.

    Args:
        scene: The scene.
        leaf: The leaf.
        state: The state that the stages are bound to.
        stages: The stages of the plan's group "motion".
    """
    if scene.motion.method == "explicit":
        return Motion(scene, leaf, state, stages)
    from leafwarp.sim.implicit.motion import make_newton_motion

    return make_newton_motion(scene, leaf, state, stages)
