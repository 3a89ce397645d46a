"""Moving the leaf from frame to frame by minimising a potential; what does not converge is retried in smaller steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from leafwarp.errors import SimulationError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.guards import find_fault
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.newton import Accuracy, Memory, Newton
from leafwarp.sim.implicit.relaxation import keeps_from_turning, relax, turned_back
from leafwarp.sim.implicit.stages import ImplicitMotion, PotentialMotion
from leafwarp.sim.implicit.threads import one_thread
from leafwarp.sim.launch import State
from leafwarp.sim.limits import FARTHEST_TRAVEL, MOST_STRETCH, STANDARD_GRAVITY, TORN_REMEDY, thrown, torn
from leafwarp.sim.rest_state import REST_STATE
from leafwarp.sim.settled import Settled
from leafwarp.sim.stable_step import damping_time

if TYPE_CHECKING:
    from leafwarp.sim.hold import Hold
    from leafwarp.sim.stage import Stage

# Way of a vertex in the last step, over the leaf's length, for each share of force that is left. The force is over load
# and inertia: a thousandth of the weight, left everywhere and in one direction, changes a droop by a thousandth of it.
STEP_PER_FORCE = 0.02
# Of an equilibrium, over that of a step in time, whose error the next one makes good.
REST_SHARE = 0.1
# How often a step is halved before the frame is given up.
MOST_HALVINGS = 6


class NewtonMotion(ABC):
    """What both motions share.

    What is refused leaves no trace: neither a part of a frame nor a step that is retried smaller.

    Args:
        scene: The scene.
        leaf: The leaf.
        state: The state that the stage is bound to.
        stage: The stage.
        hold: What moves the held vertices as the leaf shrinks; None where they stay.

    Attributes:
        substeps: Steps of all frames so far, those of frames that were redone included.
        largest_substeps: Most steps of a frame so far.
        retries: How often a step was redone in halves.
        unbalanced_torque: None: no momentum is lost.
        newton: The solver, with what it did so far.
        step_accuracy: When the end of a step in time counts as found.
        rest_accuracy: When an equilibrium does.
        remedy: What helps where a frame does not converge.
    """

    unbalanced_torque = None
    remedy: ClassVar[str]
    # The one at hand, and the one that a frame began with.
    factors_kept: ClassVar[int] = 2

    def __init__(self, scene: Scene, leaf: Leaf, state: State, stage: PotentialMotion, hold: Hold | None = None):
        self._scene, self._leaf, self._state, self._stage = scene, leaf, state, stage
        self._hold = hold
        force = scene.solver.force_tolerance
        self.step_accuracy = Accuracy(force, STEP_PER_FORCE * force)
        self.rest_accuracy = Accuracy(REST_SHARE * force, REST_SHARE * STEP_PER_FORCE * force)
        self.substeps = 0
        self.largest_substeps = 0
        self.retries = 0
        self.start()

    def start(self) -> None:
        """Begin anew from the pins, stiffness and masses of the moment."""
        self._pinned = self._state["pinned"].numpy().copy()
        self.newton = Newton(self._stage.potential, self._pinned, self._leaf.length)
        self._note_memory()

    def required_substeps(self, frame_duration: float) -> int:
        """Steps that a frame is begun with: one."""
        return 1

    def advance(self, frame_duration: float, frame: int) -> int:
        """Move the leaf by one frame.

        Args:
            frame_duration: Playback time of the frame [s].
            frame: Its number, for messages.

        Returns:
            The steps that the frame took.

        Raises:
            SimulationError: It does not converge, not even in the smallest steps, or the membrane does not hold. The
                state is that of the frame's start.
        """
        saved = self._copies((*self._shape, "velocity"))
        memory = self.newton.memory()
        most = max(MOST_STRETCH, self._largest_stretch())
        try:
            with one_thread():
                steps = self._advance(frame_duration)
        except NotConverged as error:
            fault = f"{error}; {self.remedy}"
        else:
            fault = self._fault(saved["position"], most)
            if fault is None:
                self.largest_substeps = max(self.largest_substeps, steps)
                return steps
        self._upload(saved)
        self.newton.recall(memory)
        raise SimulationError(frame, self._stage.name, find_fault(self._state) or fault)

    def _fault(self, start: np.ndarray, most_stretch: float) -> str | None:
        """What is wrong with a frame that began at positions [m], and what would help."""
        travel = float(np.linalg.norm(self._positions() - start, axis=1).max())
        if not travel <= FARTHEST_TRAVEL * self._leaf.length:
            return f"{thrown(travel, self._leaf.length)}; {self.remedy}"
        stretch = self._largest_stretch()
        return f"{torn(stretch)}; {TORN_REMEDY}" if not stretch <= most_stretch else None

    def settle(self) -> Settled:
        """Let the leaf come to rest under the forces of the moment; its velocities are zero afterwards.

        Raises:
            SimulationError: No equilibrium was found, or the membrane does not hold in it.
        """
        before = self.newton.effort.iterations
        try:
            with one_thread():
                found = self._rest()
        except NotConverged as error:
            fault = find_fault(self._state) or f"{error}; lower the load or raise the stiffness"
            raise SimulationError(0, "settling", fault) from None
        stretch = self._largest_stretch()
        if stretch > MOST_STRETCH:
            raise SimulationError(0, "settling", f"{torn(stretch)}; {TORN_REMEDY}")
        self._state["velocity"].zero_()
        gravity = np.linalg.norm(self._scene.motion.gravity or 0.0) or STANDARD_GRAVITY
        weight = gravity * float(self._state["mass"].numpy().mean())
        return Settled(found.residual / weight, 0.0, self.newton.effort.iterations - before, True)

    def stage_shares(self) -> dict[str, float]:
        """The time of the motion is that of its one stage."""
        return {self._stage.name: 1.0}

    @abstractmethod
    def _advance(self, duration: float) -> int:
        """Move the leaf by a playback time [s], and return the steps that it took."""

    def _largest_stretch(self) -> float:
        """Largest length of an edge over its rest length."""
        ends = self._state["position"].numpy()[self._leaf.mesh.edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return float(np.max(lengths / self._state["edge_rest_length"].numpy(), initial=0.0))

    @property
    def _shape(self) -> tuple[str, ...]:
        return ("position", "hinge_angle") if self._stage.hinged else ("position",)

    def _positions(self) -> np.ndarray:
        return self._state["position"].numpy().copy()

    def _copies(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Copies of those arrays that the state has."""
        return {name: self._state[name].numpy().copy() for name in names if name in self._state}

    def _upload(self, values: dict[str, np.ndarray]) -> None:
        for name, array in values.items():
            self._state.upload(name, array)

    def _rest(self):
        """Go to the equilibrium under the rest state of the moment."""
        self._set_times(1.0, 0.0)
        self._follow_hold()
        self._stage.prepare_rest()
        start = self._positions()
        angles = self._state["hinge_angle"].numpy().copy() if self._stage.hinged else None
        mass = self._state["mass"].numpy().copy()
        is_held = keeps_from_turning(start[self._pinned], self._leaf.length)
        memory = self.newton.memory()
        try:
            found = relax(
                self.newton,
                self._state,
                start,
                mass,
                self._leaf.length,
                self.rest_accuracy,
                is_held=is_held,
                each_step=self._stage.potential.keep_angles,
            )
        except NotConverged:
            if angles is not None:
                self._state.upload("hinge_angle", angles)
            self.newton.recall(memory)
            raise
        if not is_held:
            self._turn_back(found.positions, start, mass)
        self._finish()
        return found

    def _turn_back(self, found: np.ndarray, start: np.ndarray, mass: np.ndarray) -> None:
        """Take back what an equilibrium has turned since its start and might have turned any other way."""
        motion = self._scene.motion
        pull = np.array(motion.gravity or (0.0, 0.0, 0.0)) + motion.drag * np.array(motion.wind or (0.0, 0.0, 0.0))
        turned = turned_back(found, start, self._pinned, mass, pull)
        self._state.upload("base_position", turned)
        self.newton.carried(float(np.linalg.norm(turned - found, axis=1).max()))

    def _follow_hold(self) -> None:
        """Let the held vertices follow the rest lengths of the moment."""
        if self._hold is not None:
            self._hold.run()

    def _finish(self) -> None:
        self._stage.potential.keep_angles()
        self._stage.arrive()
        self._note_memory()

    def _note_memory(self) -> None:
        self._stage.factor_bytes = self.factors_kept * self.newton.byte_count

    def _set_times(self, step: float, damping_time: float) -> None:
        self._state.upload("time_step", np.array([step]))
        self._state.upload("damping_share", np.array([damping_time / step]))


class ImplicitEuler(NewtonMotion):
    """Backward Euler, a step a frame; a step that does not converge is taken in halves."""

    _stage: ImplicitMotion
    remedy = "raise time.fps, or lower the load, the curl or the shrinking of a frame"

    def start(self) -> None:
        """Begin anew, and fix the damping, that of explicit motion, from the stiffness and masses of the moment."""
        super().start()
        structure = self._scene.structure
        self._damping_time = 0.0
        if structure.damping > 0.0:
            self._damping_time = damping_time(structure, self._leaf.length, self._stage.bound.largest())

    def _advance(self, duration: float) -> int:
        steps, done, size = 0, 0.0, 1.0
        while done < 1.0:
            memory = self.newton.memory()
            self._set_times(size * duration, self._damping_time)
            self._follow_hold()
            self._stage.prepare_step()
            self.newton.inertia_changed()
            try:
                self.newton.minimise(self._positions(), self.step_accuracy)
            except NotConverged:
                if size <= 0.5**MOST_HALVINGS:
                    raise
                size *= 0.5
                self.retries += 1
                self.newton.recall(memory)
                continue
            self._finish()
            done += size
            steps += 1
            self.substeps += 1
        if self._hold is not None:
            self._hold.carry(duration)
        return steps


@dataclass(frozen=True)
class _Place:
    """An equilibrium, and all that the way on from it depends on.

    Attributes:
        shape: Positions [m] and, with hinges, their angles [rad].
        rest_state: What it is the equilibrium of.
        memory: Of Newton's method.
    """

    shape: dict[str, np.ndarray]
    rest_state: dict[str, np.ndarray]
    memory: Memory


class Quasistatic(NewtonMotion):
    """The equilibrium of every frame; where it is not found, the rest state is approached in parts.

    A leaf that buckles has several equilibria, and which one it is in depends on those before. Hence it follows a path
    of its own through moments of plant time that do not depend on the frames (:meth:`follow`). Every frame goes off the
    path from the last of these moments, and the path does not return from it.
    """

    factors_kept = 3
    remedy = "lower the load or the curl, or let inertia carry the leaf: motion.method = 'implicit'"

    def start(self) -> None:
        """Begin anew from the rest state of the moment; the path begins where the leaf first is in equilibrium."""
        super().start()
        self._rest_state = self._copies(REST_STATE)
        self._path: _Place | None = None
        self._left: _Place | None = None
        self._shown = self._positions()

    def settle(self) -> Settled:
        """As of every motion; the path begins there."""
        settled = super().settle()
        self._rest_state = self._copies(REST_STATE)
        self._path = self._place()
        self._shown = self._positions()
        return settled

    def follow(self, frame: int) -> int:
        """Go on along the path, to the equilibrium under the rest state of the moment.

        Args:
            frame: Number of the frame under way, for messages.

        Returns:
            The steps that it took.

        Raises:
            SimulationError: There is no equilibrium that it can come to. The state is the one before.
        """
        steps = self._leave_path(frame)
        self._path = self._place()
        return steps

    def advance(self, frame_duration: float, frame: int) -> int:
        """As of every motion; the velocity is the mean one since the frame before."""
        steps = self._leave_path(frame)
        positions = self._positions()
        self._state.upload("velocity", (positions - self._shown) / frame_duration)
        self._shown = positions
        return steps

    def _leave_path(self, frame: int) -> int:
        """Go to the equilibrium of the moment from the path's last one; the velocity stays.

        From the same place to the same rest state the way is the same: it is not gone again.
        """
        if self._path is not None and self._left is self._path and self._rests():
            return 0
        steps = self._go_off(frame)
        self._left = self._path
        return steps

    def _go_off(self, frame: int) -> int:
        before, velocity = self._place(), self._copies(("velocity",))
        if self._path is not None:
            self._go_back(self._path)
            if self._rests():
                return 0
        try:
            steps = self._approach(frame)
        except SimulationError:
            self._go_back(before)
            raise
        self._upload(velocity)
        return steps

    def _rests(self) -> bool:
        """Whether the rest state of the moment is the one that the leaf is in equilibrium with."""
        present = self._copies(REST_STATE)
        return all(np.array_equal(present[name], values) for name, values in self._rest_state.items())

    def _approach(self, frame: int) -> int:
        steps = super().advance(0.0, frame)
        self._rest_state = self._copies(REST_STATE)
        return steps

    def _advance(self, duration: float) -> int:
        before, after = self._rest_state, self._copies(REST_STATE)
        steps, done, size = 0, 0.0, 1.0
        try:
            while done < 1.0:
                part = done + size
                if part < 1.0 or steps > 0:
                    self._upload({name: start + part * (after[name] - start) for name, start in before.items()})
                try:
                    self._rest()
                except NotConverged:
                    if size <= 0.5**MOST_HALVINGS:
                        raise
                    size *= 0.5
                    self.retries += 1
                    continue
                done = part
                steps += 1
                self.substeps += 1
        finally:
            self._upload(after)
        return steps

    def _place(self) -> _Place:
        return _Place(self._copies(self._shape), self._rest_state, self.newton.memory())

    def _go_back(self, place: _Place) -> None:
        self._upload(place.shape)
        self._rest_state = place.rest_state
        self.newton.recall(place.memory)


def make_newton_motion(scene: Scene, leaf: Leaf, state: State, stages: Sequence[Stage]) -> NewtonMotion:
    """The motion of the stages of the plan's group "motion"."""
    kind = ImplicitEuler if isinstance(stages[0], ImplicitMotion) else Quasistatic
    return kind(scene, leaf, state, *stages)
