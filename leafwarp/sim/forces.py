"""The stages of the structure: what pushes the vertices, and what moves them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf, LeafMesh
from leafwarp.scene import Scene
from leafwarp.sim import material
from leafwarp.sim.adjacency import vertex_to_slots
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.spring_blocks import SpringBlocks
from leafwarp.sim.stage import Stage
from leafwarp_kernels import (
    angular_springs,
    edge_springs,
    external_forces,
    hinge_gather,
    integration,
    paper_bending,
)


def vertex_arrays(mesh: LeafMesh) -> tuple[ArraySpec, ...]:
    """What every motion knows of the vertices."""
    vertices = mesh.vertex_count
    return (
        ArraySpec("position", (vertices,), "vector", "vertex positions [m]"),
        ArraySpec("velocity", (vertices,), "vector", "vertex velocities [m/s]"),
        ArraySpec("mass", (vertices,), "real", "vertex masses [kg]"),
        ArraySpec("pinned", (vertices,), "bool", "vertices that are held"),
        ArraySpec("time_step", (1,), "real", "length of a step [s]"),
    )


def edge_arrays(mesh: LeafMesh) -> tuple[ArraySpec, ...]:
    """The edge springs, and those of every vertex."""
    vertices, edges = mesh.vertex_count, mesh.edge_count
    return (
        ArraySpec("edge_rest_length", (edges,), "real", "rest length of each edge spring [m]", padded=True),
        ArraySpec("edge_stiffness", (edges,), "real", "stiffness of each edge spring [N/m]", padded=True),
        *edge_tables(vertices, edges),
    )


def edge_tables(vertices: int, edges: int) -> tuple[ArraySpec, ...]:
    """Which vertices the edges join, and which edges the vertices have."""
    return (
        ArraySpec("edge_vertices", (edges, 2), "int32", "vertices of each edge spring"),
        ArraySpec("vertex_edge_start", (vertices + 1,), "int32", "where each vertex's edges start"),
        ArraySpec("vertex_edges", (2 * edges,), "int32", "edges at each vertex"),
        ArraySpec("vertex_neighbors", (2 * edges,), "int32", "vertex at the other end of each of them"),
    )


def hinge_arrays(mesh: LeafMesh) -> tuple[ArraySpec, ...]:
    """The angular springs, and those of every vertex."""
    vertices, hinges = mesh.vertex_count, mesh.hinge_count
    return (
        ArraySpec("hinge_rest_angle", (hinges,), "real", "rest angle of each angular spring [rad]", padded=True),
        ArraySpec("hinge_stiffness", (hinges,), "real", "stiffness of each angular spring [N m/rad]", padded=True),
        *hinge_tables(vertices, hinges),
    )


def hinge_tables(vertices: int, hinges: int) -> tuple[ArraySpec, ...]:
    """Which vertices the hinges have, and which hinges the vertices have."""
    return (
        ArraySpec("hinge_angle", (hinges,), "real", "angle of each angular spring, continued [rad]", padded=True),
        ArraySpec("hinge_vertices", (hinges, 4), "int32", "vertices of each hinge: edge a, b, opposite c, d"),
        ArraySpec("vertex_hinge_start", (vertices + 1,), "int32", "where each vertex's hinge forces start"),
        ArraySpec("vertex_hinge_slots", (4 * hinges,), "int32", "places of the forces on each vertex"),
    )


def fill_vertices(scene: Scene, leaf: Leaf, state: State) -> None:
    """Put the vertices where the photo has them, with the masses of the start."""
    structure = scene.structure
    # A leaf whose water flows starts out saturated, until its water is first sampled.
    water = 1.0 if scene.water is None else scene.water.curve[0][1]
    state.upload("position", material.start_positions(scene, leaf))
    state.upload("mass", material.vertex_mass(leaf.mesh, structure.dry_mass, structure.water_mass, water))
    state.upload("pinned", material.pinned_vertices(leaf, scene.motion))


def fill_edges(scene: Scene, leaf: Leaf, state: State) -> None:
    """Fill the edge springs' arrays: at rest in the photo's shape."""
    state.upload("edge_rest_length", material.edge_lengths(leaf.mesh, material.rest_positions(scene, leaf)))
    state.upload("edge_stiffness", material.edge_stiffness(leaf.mesh, material.membrane_stiffness(scene, leaf)))
    fill_edge_tables(leaf.mesh.edges, leaf.mesh.vertex_count, state)


def fill_edge_tables(edges: np.ndarray, vertex_count: int, state: State) -> None:
    """Fill the edge springs' tables."""
    start, places = vertex_to_slots(edges, vertex_count)
    state.upload("edge_vertices", edges)
    state.upload("vertex_edge_start", start)
    state.upload("vertex_edges", places // 2)
    state.upload("vertex_neighbors", edges[:, ::-1].ravel()[places])


def fill_hinges(scene: Scene, leaf: Leaf, state: State) -> None:
    """Fill the angular springs' arrays: at rest in the photo's shape."""
    rest = material.dihedral_angles(leaf.mesh, material.rest_positions(scene, leaf))
    state.upload("hinge_rest_angle", rest)
    state.upload("hinge_angle", rest)
    state.upload("hinge_stiffness", material.hinge_stiffness(leaf.mesh, material.bending_stiffness(scene, leaf)))
    fill_hinge_tables(leaf.mesh.hinges, leaf.mesh.vertex_count, state)


def fill_hinge_tables(hinges: np.ndarray, vertex_count: int, state: State) -> None:
    """Fill the angular springs' tables."""
    start, places = vertex_to_slots(hinges, vertex_count)
    state.upload("hinge_vertices", hinges)
    state.upload("vertex_hinge_start", start)
    state.upload("vertex_hinge_slots", places)


def bends_by_gradient(scene: Scene, leaf: Leaf) -> bool:
    """Whether the motion has the stage of the angular springs."""
    return scene.has_angular_springs and scene.structure.bending == "gradient" and leaf.mesh.hinge_count > 0


def _joined(*launches: list[list[Command]]) -> list[list[Command]]:
    """Launches of one kind after the other, group by group."""
    return [[command for commands in group for command in commands] for group in zip(*launches, strict=True)]


class _OfVertices(Stage):
    """A stage that does the same for every vertex."""

    rate = "substep"

    def record_vertices(
        self, state: State, kernel: wp.Kernel, inputs: Sequence[object], outputs: Sequence[str]
    ) -> None:
        """Record the launches of a kernel; names are those of arrays over the vertices."""

        def of_group(argument: object, own: slice) -> object:
            return state[argument][own] if isinstance(argument, str) else argument

        # A GPU wants them all at once.
        groups = (slice(0, self.leaf.mesh.vertex_count),) if state.many_threads else self.leaf.vertex_groups
        self.set_parts(
            [
                [
                    state.record(
                        kernel,
                        own.stop - own.start,
                        [of_group(argument, own) for argument in inputs],
                        [of_group(argument, own) for argument in outputs],
                    )
                ]
                for own in groups
            ]
        )


class EdgeSprings(Stage):
    """Forces along the edges. The first of the force stages: it overwrites the force.

    On a CPU the angular springs come with the edges that they lie on; then this stage computes those of the margin, and
    the next one overwrites the force.
    """

    name = "edge_springs"
    purpose = "pull of the edges toward their rest lengths (Eq. 3)"
    rate = "substep"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.arrays = (
            ArraySpec("force", (leaf.mesh.vertex_count,), "vector", "force on each vertex [N]"),
            ArraySpec("damping_time", (1,), "real", "damping of springs over their stiffness [s]"),
            *edge_arrays(leaf.mesh),
        )

    def bind(self, state: State) -> None:
        fill_edges(self.scene, self.leaf, state)
        if not state.many_threads:
            self.set_parts(self._record_blocks(state))
            return
        self.commands = [
            state.record(
                edge_springs.edge_spring_forces,
                self.leaf.mesh.vertex_count,
                inputs=[
                    "position",
                    "velocity",
                    "vertex_edge_start",
                    "vertex_edges",
                    "vertex_neighbors",
                    "edge_rest_length",
                    "edge_stiffness",
                    "damping_time",
                ],
                outputs=["force"],
            )
        ]

    def _record_blocks(self, state: State) -> list[list[Command]]:
        """The launches for a CPU, without what the angular springs do for the edges that they lie on."""
        hinged = bends_by_gradient(self.scene, self.leaf)
        blocks = SpringBlocks(self.leaf.mesh, hinged, self.leaf.vertex_groups)
        edges = blocks.record_edges(self, state)
        return edges if hinged else _joined(edges, blocks.record_sum(self, state))


class _Hinges(Stage):
    """What the two kinds of bending share: the hinges, the forces on their vertices, and the sum of these."""

    rate = "substep"
    kernel: ClassVar[wp.Kernel]
    in_lanes: ClassVar[bool] = False  # on a CPU

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.arrays = hinge_arrays(leaf.mesh)

    def bind(self, state: State) -> None:
        fill_hinges(self.scene, self.leaf, state)
        if state.many_threads or not self.in_lanes:
            self.commands = self._record(state)
        else:
            self.set_parts(self._record_blocks(state))

    def _record(self, state: State) -> list[Command]:
        """The launches: the forces of every hinge, then their sums."""
        mesh = self.leaf.mesh
        force = ArraySpec("hinge_force", (4 * mesh.hinge_count,), "vector", "forces of each hinge [N]")
        self.add_array(state, force)
        return [
            state.record(
                self.kernel,
                mesh.hinge_count,
                inputs=[
                    "position",
                    "velocity",
                    "hinge_vertices",
                    *self._own(),
                    "hinge_rest_angle",
                    "hinge_stiffness",
                    "damping_time",
                ],
                outputs=["hinge_angle", "hinge_force"],
            ),
            state.record(
                hinge_gather.gather_hinge_forces,
                mesh.vertex_count,
                inputs=["vertex_hinge_start", "vertex_hinge_slots", "hinge_force"],
                outputs=["force"],
            ),
        ]

    def _own(self) -> tuple[str, ...]:
        """Inputs that only this kind of bending has."""
        return ()


class AngularSprings(_Hinges):
    """Bending by the gradient of the angular springs' energy; conserves momentum."""

    name = "angular_springs"
    purpose = "bending of the hinges toward their rest angles (Alg. 1 and 2, energy gradient)"
    kernel = angular_springs.angular_spring_forces
    in_lanes = True

    def _record_blocks(self, state: State) -> list[list[Command]]:
        blocks = SpringBlocks(self.leaf.mesh, hinged=True, groups=self.leaf.vertex_groups)
        return _joined(blocks.record_hinges(self, state), blocks.record_sum(self, state))


class PaperBending(_Hinges):
    """Bending as the paper prints it; loses angular momentum, and says how much."""

    name = "paper_bending"
    purpose = "the paper's push on the two opposite vertices (Eq. 4), with the edge's reaction"
    kernel = paper_bending.paper_bending_forces

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        hinges = leaf.mesh.hinge_count
        self.arrays += (
            ArraySpec("hinge_arm", (hinges,), "real", "mean height of each hinge's triangles at rest [m]"),
            ArraySpec("hinge_torque", (hinges,), "vector", "torque that each hinge leaves unbalanced [N m]"),
        )

    def bind(self, state: State) -> None:
        state.upload("hinge_arm", material.hinge_height(self.leaf.mesh))
        super().bind(state)
        self._state = state
        self._diagnosis = state.record(
            hinge_gather.hinge_torque,
            self.leaf.mesh.hinge_count,
            inputs=["position", "hinge_vertices", "hinge_force"],
            outputs=["hinge_torque"],
        )

    def _own(self) -> tuple[str, ...]:
        return ("hinge_arm",)

    def net_torque(self) -> np.ndarray:
        """Torque that the last forces leave unbalanced: the leaf's angular momentum changes by it a second [N m]."""
        self._diagnosis.run()
        return self._state["hinge_torque"].numpy().astype(np.float64).sum(axis=0)


class Gravity(_OfVertices):
    """Weight."""

    name = "gravity"
    purpose = "weight of the vertices"

    def bind(self, state: State) -> None:
        gravity = state.vector(*self.scene.motion.gravity)
        self.record_vertices(state, external_forces.add_gravity, ["mass", gravity], ["force"])


class Air(_OfVertices):
    """Drag of air that stands still or blows."""

    name = "air"
    purpose = "drag toward the speed of the air"

    def bind(self, state: State) -> None:
        wind = state.vector(*(self.scene.motion.wind or (0.0, 0.0, 0.0)))
        drag = state.real(self.scene.motion.drag)
        self.record_vertices(state, external_forces.add_air_drag, ["velocity", "mass", wind, drag], ["force"])


class Integration(_OfVertices):
    """Newton's second law. The last stage of a substep."""

    name = "integration"
    purpose = "speed and position of the vertices (symplectic Euler)"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.arrays = vertex_arrays(leaf.mesh)

    def bind(self, state: State) -> None:
        fill_vertices(self.scene, self.leaf, state)
        inputs = ["force", "mass", "pinned", state["time_step"]]
        self.record_vertices(state, integration.integrate, inputs, ["position", "velocity"])
