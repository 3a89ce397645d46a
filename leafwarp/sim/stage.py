"""What a stage of the simulation is.

A stage is made in two steps. Its constructor sees the scene and the leaf and only *declares* what it
allocates and how often it runs. ``bind`` then gets the state with all declared arrays, fills its own and records its
launches; what these read and write is known from then on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import ArraySpec, Command, State

Rate = Literal["start", "fluid step", "frame", "substep", "output"]


@dataclass(frozen=True)
class Interval:
    """A span of plant time [s]."""

    start: float
    end: float

    @property
    def length(self) -> float:
        return self.end - self.start


class Stage:
    """One step of the simulation, run once at the start, or per fluid step, frame, motion substep or output.

    Attributes:
        name: Name in the plan and in the report.
        purpose: One line for the plan.
        rate: How often it runs.
        host_reads: Names of the arrays that it reads other than by its launches.
        host_writes: Names of the arrays that it changes other than by its launches.
        arrays: The arrays that it brings into the state.
        commands: The recorded launches that ``run`` runs, after ``bind``.
        parts: The same by groups of leaves (:attr:`~leafwarp.leaf.leaf.Leaf.vertex_groups`), where the stage can run
            for one group after the other; empty where it cannot.
        recorded: All launches that it recorded, after :func:`bind_stage`.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    rate: ClassVar[Rate]
    host_reads: tuple[str, ...] = ()
    host_writes: tuple[str, ...] = ()
    recorded: tuple[Command, ...] = ()
    arrays: tuple[ArraySpec, ...] = ()

    def __init__(self, scene: Scene, leaf: Leaf):
        self.scene = scene
        self.leaf = leaf
        self.commands: list[Command] = []
        self.parts: list[list[Command]] = []

    @property
    def host_bytes(self) -> int:
        """Memory that the stage holds beside the arrays, once it is bound [byte]."""
        return 0

    @property
    def launches(self) -> int:
        """Launches each time the stage runs, once it is bound."""
        return len(self.commands)

    def launches_in(self, substeps: int) -> int:
        """The same where so many motion substeps are taken at a time, for a stage that takes part in them by blocks."""
        return self.launches

    def add_array(self, state: State, spec: ArraySpec) -> None:
        """Bring another array into the state, in :meth:`bind`, which is the first to know the device."""
        state.add(spec)
        self.arrays += (spec,)

    def bind(self, state: State) -> None:
        """Fill the stage's own arrays and record its launches."""

    def set_time_step(self, seconds: float) -> None:
        """Take fluid steps of another length [s] from now on, where it is a fluid stage; once it is bound."""

    def set_parts(self, parts: list[list[Command]]) -> None:
        """Take launches by groups of leaves."""
        self.parts = parts
        self.commands = [command for part in parts for command in part]

    def launches_of(self, interval: Interval | None = None) -> Sequence[Command] | None:
        """Make ready for a run, and say which launches it consists of; None where the host takes part in it.

        Args:
            interval: Span of plant time, where it is a fluid stage.
        """
        return self.commands

    def run(self, interval: Interval | None = None) -> None:
        """Do the stage's work once, over a span of plant time where it is a fluid stage."""
        for command in self.launches_of(interval):
            command.run()


def bind_stage(stage: Stage, state: State) -> None:
    """Bind a stage, and note which launches it recorded."""
    before = len(state.recorded)
    stage.bind(state)
    stage.recorded = tuple(state.recorded[before:])
