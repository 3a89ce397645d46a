"""The stages of implicit and quasistatic motion: their arrays, and the launches at the start and end of a step."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.forces import edge_arrays, fill_edges, fill_hinges, fill_vertices, hinge_arrays, vertex_arrays
from leafwarp.sim.implicit.potential import Potential
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.rest_state import REST_STATE
from leafwarp.sim.stable_step import FrequencyBound
from leafwarp.sim.stage import Stage
from leafwarp_kernels import implicit_step

_READS = ("position", "velocity", "pinned", "mass", "edge_rest_length", "edge_stiffness")
_WRITES = ("position", "velocity", "time_step", "damping_share", "inertia", "goal")


class PotentialMotion(Stage):
    """What both motions share: the structure, its potential, and what a step leaves behind.

    :class:`leafwarp.sim.implicit.motion.NewtonMotion` runs it.

    Attributes:
        potential: The potential of springs, load and inertia.
    """

    rate = "frame"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        mesh = leaf.mesh
        self.hinged = scene.has_angular_springs and mesh.hinge_count > 0
        hinges = mesh.hinges if self.hinged else np.zeros((0, 4), dtype=np.int32)
        self.potential = Potential(mesh.vertex_count, mesh.edges, hinges)
        # What Newton's method and the checks of a frame look at (those of one that is refused at all of the structure),
        # and what they put there or, after a frame that is refused, back.
        of_hinges = ("hinge_rest_angle", "hinge_stiffness") if self.hinged else ()
        self.host_reads = (*_READS, *of_hinges, *self.potential.host_reads)
        self.host_writes = (*_WRITES, *self.potential.host_writes)
        self.arrays = (
            *vertex_arrays(mesh),
            *edge_arrays(mesh),
            *(hinge_arrays(mesh) if self.hinged else ()),
            ArraySpec("damping_share", (1,), "real", "damping time of the springs over the step"),
            *self.potential.arrays,
        )
        self.factor_bytes = 0

    @property
    def host_bytes(self) -> int:
        return self.factor_bytes

    def bind(self, state: State) -> None:
        fill_vertices(self.scene, self.leaf, state)
        fill_edges(self.scene, self.leaf, state)
        if self.hinged:
            fill_hinges(self.scene, self.leaf, state)
        self.potential.bind(state)
        mesh, motion = self.leaf.mesh, self.scene.motion
        self._gravity = state.vector(*(motion.gravity or (0.0, 0.0, 0.0)))
        self._wind = state.vector(*(motion.wind or (0.0, 0.0, 0.0)))
        springs = ["edge_vertices", "edge_rest_length", "edge_stiffness", "damping_share"]
        self._springs = [
            state.record(
                implicit_step.damp_edges,
                mesh.edge_count,
                ["position", *springs],
                ["edge_target_length", "edge_strength"],
            )
        ]
        if self.hinged:
            self._springs.append(
                state.record(
                    implicit_step.damp_hinges,
                    mesh.hinge_count,
                    ["hinge_angle", "hinge_rest_angle", "hinge_stiffness", "damping_share"],
                    ["hinge_target_angle", "hinge_strength"],
                )
            )
        self._arrival = state.record(
            implicit_step.arrive,
            mesh.vertex_count,
            ["base_position", "pinned", "time_step"],
            ["position", "velocity"],
        )
        self._hang = state.record(
            implicit_step.hang,
            mesh.vertex_count,
            ["mass", self._gravity, self._wind, state.real(motion.drag)],
            ["load"],
        )

    def prepare_springs(self) -> None:
        """Take over rest shape and stiffness, with damping about the present shape."""
        for command in self._springs:
            command.run()

    def prepare_rest(self) -> None:
        """Take over rest shape, stiffness and load for an equilibrium."""
        self.prepare_springs()
        self._hang.run()

    def arrive(self) -> None:
        """Take over the positions that were found last, and the velocity that leads there."""
        self._arrival.run()


class ImplicitMotion(PotentialMotion):
    """Backward Euler: inertia, weight, drag and all springs at once, at the end of the step."""

    name = "implicit_motion"
    purpose = (
        "motion by backward Euler: Newton's method (launches: of one step), with a factor of the Hessian on the host"
    )

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        if scene.structure.damping > 0.0:
            self.bound = FrequencyBound(leaf.mesh, self.hinged)
            self.arrays += self.bound.arrays
            self.host_reads += ("squared_frequency",)

    @property
    def launches(self) -> int:
        """Launches of a frame that is found in one Newton step with a new factor; every further step adds its own."""
        found = self.potential.evaluation_launches + self.potential.step_launches
        return len(self._springs) + 1 + found + 1

    def bind(self, state: State) -> None:
        super().bind(state)
        if self.scene.structure.damping > 0.0:
            self.bound.bind(state)
        drag = state.real(self.scene.motion.drag)
        self._prediction: Command = state.record(
            implicit_step.predict,
            self.leaf.mesh.vertex_count,
            ["position", "velocity", "mass", self._gravity, self._wind, drag, "time_step"],
            ["inertia", "goal", "load"],
        )

    def prepare_step(self) -> None:
        """Take over everything that a step starts from."""
        self.prepare_springs()
        self._prediction.run()


class QuasistaticMotion(PotentialMotion):
    """The equilibrium of every frame, and of moments of plant time that do not depend on the frames."""

    name = "quasistatic_motion"
    purpose = "equilibrium of the frame: Newton's method (launches: of none), with a factor of the Hessian on the host"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        rest_state = REST_STATE if self.hinged else [name for name in REST_STATE if "hinge" not in name]
        self.host_reads += tuple(rest_state)
        self.host_writes += tuple(rest_state)

    @property
    def launches(self) -> int:
        """Launches of a frame in which nothing changes; every Newton step adds its own."""
        return len(self._springs) + 1 + self.potential.evaluation_launches + 1
