"""How the leaf is held at its petiole's base while it shrinks."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim import material
from leafwarp.sim.blocks import blocks, shares
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels import hold


class Hold(Stage):
    """Lets the held vertices follow the rest lengths around them. What moves the leaf runs it whenever these change."""

    name = "hold"
    purpose = "the held tissue at the petiole's base shrinks as the leaf around it does"
    rate = "frame"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._vertices = np.flatnonzero(material.pinned_vertices(leaf, scene.motion))
        starts = np.array([own.start for own in leaf.vertex_slices])
        self._leaves = np.searchsorted(starts, self._vertices, side="right") - 1
        edges = leaf.mesh.edges
        touching = np.flatnonzero(np.isin(edges, self._vertices).any(axis=1))
        own = np.searchsorted(starts, edges[touching, 0], side="right") - 1
        order = np.argsort(own, kind="stable")
        self._edges = touching[order]
        self._edge_start = np.searchsorted(own[order], np.arange(len(starts) + 1))
        held, springs = len(self._vertices), len(self._edges)
        self.arrays = (
            ArraySpec("held_vertices", (held,), "int32", "vertices that are held"),
            ArraySpec("held_leaves", (held,), "int32", "the leaf of each"),
            ArraySpec("held_start", (held,), "vector", "where they are in the photo's shape [m]"),
            ArraySpec("held_edge_start", (len(starts) + 1,), "int32", "where each leaf's springs start"),
            ArraySpec("held_edges", (springs,), "int32", "springs that touch held vertices, leaf by leaf"),
            ArraySpec("held_rest_length", (springs,), "real", "their rest lengths in the photo's shape [m]"),
        )

    def launches_in(self, substeps: int) -> int:
        explicit = self.scene.motion.method == "explicit"
        return 1 + sum(len(shares(size)) for size in blocks(substeps)) if explicit else 1

    def bind(self, state: State) -> None:
        state.upload("held_vertices", self._vertices)
        state.upload("held_leaves", self._leaves)
        state.upload("held_start", material.start_positions(self.scene, self.leaf)[self._vertices])
        state.upload("held_edge_start", self._edge_start)
        state.upload("held_edges", self._edges)
        lengths = material.edge_lengths(self.leaf.mesh, material.rest_positions(self.scene, self.leaf))
        state.upload("held_rest_length", lengths[self._edges])
        springs = ["held_edge_start", "held_edges", "held_rest_length", "edge_rest_length"]
        inputs = ["held_vertices", "held_leaves", "held_start", "pinned", *springs]
        self.commands = [state.record(hold.hold, len(self._vertices), inputs, ["position"])]
