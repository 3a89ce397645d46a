"""The longest safe step of the motion, and the way back from a frame that went wrong."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf, LeafMesh
from leafwarp.scene import Scene
from leafwarp.scene.structure import StructureTable
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels import stable_step

# Length of the wave whose damping ratio `structure.damping` is, as a share of the leaf's: meshes of a thousand vertices
# and more show it.
DAMPED_WAVE = 1.0 / 40.0

_EDGE_INPUTS = [
    "position",
    "mass",
    "pinned",
    "vertex_edge_start",
    "vertex_edges",
    "vertex_neighbors",
    "edge_rest_length",
    "edge_stiffness",
]


def step_limit(squared_frequency: float, damping_time: float, drag: float) -> float:
    """The step beyond which symplectic Euler with explicit damping is unstable [s].

    A mode of frequency ``omega``, damped by ``c v`` with ``c = tau omega^2 + drag``, is stable as long as
    ``omega^2 dt^2 + 2 c dt < 4``. Infinite where nothing limits it.

    Args:
        squared_frequency: Largest ``omega^2`` [1/s^2].
        damping_time: Damping of springs over their stiffness ``tau`` [s].
        drag: Damping that does not depend on the springs [1/s].
    """
    if math.isinf(squared_frequency):
        return 0.0
    damping = damping_time * squared_frequency + drag
    rate = damping + math.sqrt(damping * damping + 4.0 * squared_frequency)
    return 4.0 / rate if rate != 0.0 else math.inf


class FrequencyBound:
    """Bound of the mesh's squared frequencies where it is.

    Args:
        mesh: The mesh.
        hinged: Whether it resists bending.

    Attributes:
        arrays: What it brings into the state.
        commands: Its launches, after :meth:`bind`.
    """

    def __init__(self, mesh: LeafMesh, hinged: bool):
        self._vertex_count, self._hinge_count = mesh.vertex_count, mesh.hinge_count if hinged else 0
        self.commands: list[Command] = []
        self.arrays = (
            ArraySpec(
                "squared_frequency",
                (mesh.vertex_count,),
                "real",
                "bound of the squared frequency at each vertex [1/s^2]",
            ),
        )
        if self._hinge_count > 0:
            slots = (4 * self._hinge_count,)
            self.arrays += (
                ArraySpec("hinge_row", slots, "vector", "each hinge's share of its vertices' bounds [N/m]^1/2"),
                ArraySpec("hinge_tension", slots, "real", "the part of it that its bending makes [N/m]"),
            )

    def bind(self, state: State) -> None:
        """Record the launches."""
        self._state = state
        if self._hinge_count == 0:
            self.commands = [
                state.record(stable_step.edge_frequencies, self._vertex_count, _EDGE_INPUTS, ["squared_frequency"])
            ]
            return
        self.commands = [
            state.record(
                stable_step.hinge_bounds,
                self._hinge_count,
                ["position", "hinge_vertices", "hinge_angle", "hinge_rest_angle", "hinge_stiffness"],
                ["hinge_row", "hinge_tension"],
            ),
            state.record(
                stable_step.edge_and_hinge_frequencies,
                self._vertex_count,
                [*_EDGE_INPUTS, "vertex_hinge_start", "vertex_hinge_slots", "hinge_row", "hinge_tension"],
                ["squared_frequency"],
            ),
        ]

    def largest(self) -> float:
        """Largest bound over all vertices [1/s^2], evaluated now; not a number where the mesh is not finite."""
        for command in self.commands:
            command.run()
        return float(np.max(self._state["squared_frequency"].numpy()))


def damping_time(structure: StructureTable, length: float, squared_frequency: float) -> float:
    """The damping time of springs ``tau = 2 zeta / omega`` [s]; 0 where nothing oscillates.

    ``omega`` is that of a wave in the saturated lamina, :data:`DAMPED_WAVE` of the leaf's length long, so the same for
    every mesh; without a membrane, that of the mesh's fastest oscillation. That one is never damped by more than twice
    the ratio, so that explicit steps stay long on meshes with short edges or stiff hinges.

    Args:
        structure: Its stiffness, masses and damping ratio ``zeta``.
        length: Of the leaf [m].
        squared_frequency: Bound of the mesh's fastest ``omega^2`` [1/s^2].
    """
    if not squared_frequency > 0.0 or structure.damping == 0.0:
        return 0.0
    fastest = math.sqrt(squared_frequency)
    stiffness = structure.membrane_stiffness * float(np.interp(1.0, *zip(*structure.stiffness_factor, strict=True)))
    speed = math.sqrt(stiffness / (structure.dry_mass + structure.water_mass))
    wave = 2.0 * math.pi * speed / (DAMPED_WAVE * length) or fastest
    return 2.0 * structure.damping / max(0.5 * fastest, wave)


class StableStep(Stage):
    """Bound of the mesh's squared frequencies, from which the substeps follow; and the frame's start, to go
    back to.

    :class:`leafwarp.sim.motion.Motion` runs it before and after each frame.
    """

    name = "stable_step"
    purpose = "bound of the mesh's frequencies, from which the substeps follow; check of each frame"
    rate = "frame"
    host_writes = ("position", "velocity")

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._hinged = scene.has_angular_springs and leaf.mesh.hinge_count > 0
        vertices, hinges = leaf.mesh.vertex_count, leaf.mesh.hinge_count
        self._bound = FrequencyBound(leaf.mesh, self._hinged)
        self.arrays = (
            *self._bound.arrays,
            ArraySpec("travel", (vertices,), "real", "how far each vertex went in the frame [m]"),
            ArraySpec("edge_stretch", (leaf.mesh.edge_count,), "real", "length of each edge over its rest length"),
            ArraySpec("saved_position", (vertices,), "vector", "positions at the frame's start [m]"),
            ArraySpec("saved_velocity", (vertices,), "vector", "velocities at the frame's start [m/s]"),
        )
        if self._hinged:
            self.host_writes += ("hinge_angle",)
            self.arrays += (
                ArraySpec("saved_hinge_angle", (hinges,), "real", "hinge angles at the frame's start [rad]"),
            )

    @property
    def launches(self) -> int:
        """Launches a frame that is not redone: bound and stretch before and after it, and the way gone."""
        return 2 * len(self.commands) + 3

    def bind(self, state: State) -> None:
        self._state = state
        self._bound.bind(state)
        self.commands = self._bound.commands
        self._travel: Command = state.record(
            stable_step.travel,
            self.leaf.mesh.vertex_count,
            inputs=["position", "velocity", "saved_position"],
            outputs=["travel"],
        )
        self._stretch: Command = state.record(
            stable_step.edge_stretch,
            self.leaf.mesh.edge_count,
            inputs=["position", "edge_vertices", "edge_rest_length"],
            outputs=["edge_stretch"],
        )
        names = ("position", "velocity", "hinge_angle") if self._hinged else ("position", "velocity")
        self._saved = [(state[name], state[f"saved_{name}"]) for name in names]

    def run(self, interval: Interval | None = None) -> None:
        """Evaluate the bound at the present positions and stiffness."""
        super().run(interval)

    def largest_squared_frequency(self) -> float:
        """Largest bound over all vertices [1/s^2], evaluated now; not a number where the mesh is not finite."""
        return self._bound.largest()

    def travel(self) -> np.ndarray:
        """How far each vertex went since :meth:`save` [m], shape [vertex_count]; not finite where a position or a
        velocity is not."""
        self._travel.run()
        return self._state["travel"].numpy()

    def largest_stretch(self) -> float:
        """Largest length of an edge over its rest length."""
        self._stretch.run()
        return float(np.max(self._state["edge_stretch"].numpy()))

    def save(self) -> None:
        """Remember the positions, velocities and hinge angles."""
        for array, saved in self._saved:
            wp.copy(saved, array)

    def restore(self) -> None:
        """Go back to what was remembered."""
        for array, saved in self._saved:
            wp.copy(array, saved)
