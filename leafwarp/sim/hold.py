"""How the leaf is held at its petiole's base while it shrinks."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim import material
from leafwarp.sim.blocks import count_shares
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels import hold


class Hold(Stage):
    """Lets the held vertices follow the rest lengths around them. What moves the leaf runs it whenever these change
    from those of the first frame, and has it :meth:`carry` the velocities at the end of a span of playback time;
    quasistatic motion makes the velocities of all vertices itself."""

    name = "hold"
    purpose = "the held tissue at the petiole's base shrinks as the leaf around it does"
    rate = "frame"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._vertices = np.flatnonzero(material.pinned_vertices(leaf, scene.motion))
        starts = np.array([*(own.start for own in leaf.vertex_slices), leaf.mesh.vertex_count])
        self._vertex_start = np.searchsorted(self._vertices, starts)
        touching = np.flatnonzero(np.isin(leaf.mesh.edges, self._vertices).any(axis=1))
        self._springs = touching[np.argsort(leaf.mesh.edges[touching, 0], kind="stable")]
        self._spring_start = np.searchsorted(leaf.mesh.edges[self._springs, 0], starts)
        self._carries = scene.motion.method != "quasistatic"
        held, springs, leaves = len(self._vertices), len(self._springs), len(leaf.vertex_slices)
        self.arrays = (
            ArraySpec("held_vertices", (held,), "int32", "vertices that are held, leaf by leaf"),
            ArraySpec("held_vertex_start", (leaves + 1,), "int32", "where each leaf's start"),
            ArraySpec("held_position_start", (held,), "vector", "where they are in the photo's shape [m]"),
            ArraySpec("held_springs", (springs,), "int32", "springs that touch held vertices, leaf by leaf"),
            ArraySpec("held_spring_start", (leaves + 1,), "int32", "where each leaf's start"),
            ArraySpec("held_rest_length", (springs,), "real", "their rest lengths in the photo's shape [m]"),
        )
        if self._carries:
            self.arrays += (
                ArraySpec("held_position_before", (held,), "vector", "where they were a span of playback before [m]"),
                ArraySpec("held_duration", (1,), "real", "length of that span [s]"),
            )

    def launches_in(self, substeps: int) -> int:
        within = count_shares(substeps) if self.scene.motion.method == "explicit" else 0
        return within + 1 + self._carries

    def bind(self, state: State) -> None:
        self._state = state
        mesh, start = self.leaf.mesh, material.start_positions(self.scene, self.leaf)
        state.upload("held_vertices", self._vertices)
        state.upload("held_vertex_start", self._vertex_start)
        state.upload("held_position_start", start[self._vertices])
        state.upload("held_springs", self._springs)
        state.upload("held_spring_start", self._spring_start)
        lengths = material.edge_lengths(mesh, material.rest_positions(self.scene, self.leaf))
        state.upload("held_rest_length", lengths[self._springs])
        vertices = ["held_vertex_start", "held_vertices", "held_position_start", "pinned"]
        springs = ["held_spring_start", "held_springs", "held_rest_length", "edge_rest_length"]
        self.commands = [state.record(hold.hold, len(self._vertex_start) - 1, [*vertices, *springs], ["position"])]
        if self._carries:
            state.upload("held_position_before", start[self._vertices])
            inputs = ["held_vertices", "pinned", "position", "held_duration"]
            self._carry = state.record(hold.carry, len(self._vertices), inputs, ["held_position_before", "velocity"])

    def carry(self, duration: float) -> None:
        """Give the held vertices the velocity that they had over a span of playback time [s]."""
        self._state.upload("held_duration", np.array([duration]))
        self._carry.run()
