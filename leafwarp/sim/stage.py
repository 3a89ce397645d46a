"""What a stage of the simulation is.

A stage is made in two steps. Its constructor sees the scene and the leaf and only *declares*: what it reads, writes
and allocates, which kernels it launches and how often. From the declarations alone comes the plan that a user can
print. ``bind`` then gets the state with all declared arrays, fills its own and records its launches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import warp as wp

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
        kernels: Generic kernels that it launches.
        reads: Names of the arrays that it reads and another stage writes.
        writes: Names of the arrays that it changes.
        arrays: The arrays that it brings into the state.
        commands: Its recorded launches, after ``bind``.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    rate: ClassVar[Rate]
    kernels: tuple[wp.Kernel, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    arrays: tuple[ArraySpec, ...] = ()

    def __init__(self, scene: Scene, leaf: Leaf):
        self.scene = scene
        self.leaf = leaf
        self.commands: list[Command] = []

    @property
    def launches(self) -> int:
        """Launches each time the stage runs."""
        return len(self.kernels)

    def bind(self, state: State) -> None:
        """Fill the stage's own arrays and record its launches."""

    def run(self, interval: Interval | None = None) -> None:
        """Do the stage's work once, over a span of plant time where it is a fluid stage."""
        for command in self.commands:
            command.run()
