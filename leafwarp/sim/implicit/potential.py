"""The potential of a mesh on the device: its energy, gradient, Hessian times a direction, and Hessian in blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from leafwarp.sim.implicit.pattern import BlockPattern, block_pattern
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp_kernels import edge_hessian, potential, stiffness_blocks

_EDGES = ("vertex_edge_start", "vertex_edges", "vertex_neighbors")
_AROUND = ("vertex_hinge_start", "vertex_hinge_slots")
_HINGES = ("hinge_vertices", "hinge_base_angle", "hinge_target_angle", "hinge_strength")
_RESULTS = ("gradient", "vertex_energy", "force_magnitude", "acting_force")


@dataclass(frozen=True)
class Evaluation:
    """The potential somewhere.

    Attributes:
        positions: Where [m], shape [vertex_count, 3].
        energy: [J].
        energy_size: Sum of the magnitudes of the vertices' shares of it [J].
        gradient: [N], shape [vertex_count, 3]; zero where a vertex is held.
        mean_force: Mean over the vertices of the sum of the magnitudes of all forces on each [N].
        mean_action: Mean over the vertices of the magnitudes of load and inertia on each, and a hundredth of that of
            its bending force [N]: what the forces that are left are judged by.
    """

    positions: np.ndarray
    energy: float
    energy_size: float
    gradient: np.ndarray
    mean_force: float
    mean_action: float

    @property
    def residual(self) -> float:
        """Largest force left on a vertex [N]."""
        return float(np.sqrt(np.square(self.gradient).sum(axis=1).max(initial=0.0)))


class Potential:
    """What a step minimises, as a function of the positions.

    The state must be of float64 and hold ``pinned`` and the tables of edges and hinges (:mod:`leafwarp.sim.forces`)
    besides the arrays declared here.

    Args:
        vertex_count: Number of vertices.
        edges: Vertices of each edge, shape [edge_count, 2].
        hinges: Vertices of each hinge, shape [hinge_count, 4]; none for a mesh without bending.

    Attributes:
        arrays: What it brings into the state.
        host_reads: Names of the arrays that it reads on the host or copies from.
        host_writes: Names of the arrays that it fills from the host or copies to, but for tables.
        pattern: Where the blocks of its Hessian lie.
    """

    def __init__(self, vertex_count: int, edges: np.ndarray, hinges: np.ndarray):
        hinges = np.asarray(hinges, dtype=np.int32).reshape(-1, 4)
        self.vertex_count, self._edge_count, self._hinge_count = vertex_count, len(edges), len(hinges)
        self.pattern: BlockPattern = block_pattern(vertex_count, np.asarray(edges), hinges)
        count, edge_count, hinge_count, blocks = vertex_count, len(edges), len(hinges), self.pattern.count
        self.arrays = (
            ArraySpec("trial_position", (count,), "vector", "positions tried [m]"),
            ArraySpec("base_position", (count,), "vector", "positions at which the Hessian is taken [m]"),
            ArraySpec("inertia", (count,), "real", "pull of each vertex toward its goal [N/m]"),
            ArraySpec("goal", (count,), "vector", "where each vertex would go on its own [m]"),
            ArraySpec("load", (count,), "vector", "load of each vertex [N]"),
            ArraySpec("gradient", (count,), "vector", "derivative of the potential by the positions [N]"),
            ArraySpec("vertex_energy", (count,), "real", "each vertex's share of the potential [J]"),
            ArraySpec("force_magnitude", (count,), "real", "magnitudes of the forces on each vertex together [N]"),
            ArraySpec("acting_force", (count,), "real", "what the forces left on each vertex are judged by [N]"),
            ArraySpec("direction", (count,), "vector", "a step, or what the Hessian is to be multiplied by [m]"),
            ArraySpec("product", (count,), "vector", "the Hessian times that [N]"),
            ArraySpec("edge_target_length", (edge_count,), "real", "rest lengths with damping [m]"),
            ArraySpec("edge_strength", (edge_count,), "real", "stiffness of edges with damping [N/m]"),
            ArraySpec("edge_tension", (edge_count,), "real", "tension of each edge, as the Hessian has it [N]"),
            ArraySpec("edge_block", (edge_count, 3), "vector", "Hessian of each edge [N/m]"),
            ArraySpec("block", (blocks, 3), "vector", "blocks of the Hessian [N/m]"),
            ArraySpec("block_row", (blocks,), "int32", "row of each block"),
            ArraySpec("block_is_diagonal", (blocks,), "bool", "whether it is on the diagonal"),
            ArraySpec("block_edge_start", (blocks + 1,), "int32", "where each block's edges start"),
            ArraySpec("block_edges", (3 * edge_count,), "int32", "edges of each block"),
        )
        if self.hinged:
            self.arrays += (
                ArraySpec("hinge_trial_angle", (hinge_count,), "real", "angles at the positions tried [rad]"),
                ArraySpec("hinge_base_angle", (hinge_count,), "real", "angles where the Hessian is taken [rad]"),
                ArraySpec("hinge_target_angle", (hinge_count,), "real", "rest angles with damping [rad]"),
                ArraySpec("hinge_strength", (hinge_count,), "real", "stiffness of hinges with damping [N m/rad]"),
                ArraySpec("hinge_gradient", (4 * hinge_count,), "vector", "gradient or product of each hinge [N]"),
                ArraySpec("hinge_block", (10 * hinge_count, 3), "vector", "Hessian of each hinge [N/m]"),
                ArraySpec("block_hinge_start", (blocks + 1,), "int32", "where each block's hinge blocks start"),
                ArraySpec("block_hinge_slots", (10 * hinge_count,), "int32", "hinge blocks of each block"),
            )

        self.host_reads = (*_RESULTS, "product", "block", "edge_strength", "inertia", "edge_tension", "trial_position")
        self.host_writes = ("trial_position", "base_position", "direction", "edge_tension")
        if self.hinged:
            self.host_reads += ("hinge_angle", "hinge_trial_angle", "hinge_base_angle")
            self.host_writes += ("hinge_base_angle", "hinge_angle")

    @property
    def evaluation_launches(self) -> int:
        """Launches of an evaluation."""
        return len(self._gradient_commands)

    @property
    def step_launches(self) -> int:
        """Launches of a Newton step with a new factor that is not corrected: blocks, tensions, evaluation."""
        return len(self._block_commands[False]) + 1 + self.evaluation_launches

    @property
    def hinged(self) -> bool:
        """Whether the mesh resists bending."""
        return self._hinge_count > 0

    def bind(self, state: State) -> None:
        """Fill the tables and record the launches."""
        pattern = self.pattern
        state.upload("block_row", pattern.rows)
        state.upload("block_is_diagonal", pattern.rows == pattern.columns)
        state.upload("block_edge_start", pattern.edge_start)
        state.upload("block_edges", pattern.edges)
        if self.hinged:
            state.upload("block_hinge_start", pattern.hinge_start)
            state.upload("block_hinge_slots", pattern.hinge_slots)
        self._state = state
        self._gradient_commands = self._record_gradient(state)
        self._tension_command = state.record(
            edge_hessian.edge_tensions,
            self._edge_count,
            ["base_position", "direction", "edge_vertices", "edge_target_length", "edge_strength"],
            ["edge_tension"],
        )
        self._excess_command = state.record(
            edge_hessian.excess_gradient,
            self.vertex_count,
            ["base_position", "direction", "trial_position", *_EDGES, "edge_strength", "pinned"],
            ["product"],
        )
        self._product_commands = self._record_product(state)
        self._block_commands = [self._record_blocks(state, convex) for convex in (False, True)]

    def _record_gradient(self, state: State) -> list[Command]:
        springs = ["edge_target_length", "edge_strength", "inertia", "goal", "load", "pinned"]
        of_edges = state.record(
            potential.membrane_gradient, self.vertex_count, ["trial_position", *_EDGES, *springs], _RESULTS
        )
        if not self.hinged:
            return [of_edges]
        from leafwarp_kernels import hinge_potential

        springs = ["hinge_target_angle", "hinge_strength"]
        return [
            of_edges,
            state.record(
                hinge_potential.hinge_potential,
                self._hinge_count,
                ["trial_position", "hinge_vertices", *springs, "hinge_angle"],
                ["hinge_trial_angle", "hinge_gradient"],
            ),
            state.record(
                hinge_potential.add_hinge_gradients,
                self.vertex_count,
                [*_AROUND, "hinge_gradient", "hinge_trial_angle", *springs, "pinned"],
                _RESULTS,
            ),
        ]

    def _record_product(self, state: State) -> list[Command]:
        springs = ["edge_strength", "edge_tension", "inertia", "pinned"]
        of_edges = state.record(
            edge_hessian.membrane_product,
            self.vertex_count,
            ["base_position", "direction", *_EDGES, *springs],
            ["product"],
        )
        if not self.hinged:
            return [of_edges]
        from leafwarp_kernels import hinge_hessian

        # The gradient has been summed by then, so that its hinges' array serves the products, too.
        return [
            of_edges,
            state.record(
                hinge_hessian.hinge_products,
                self._hinge_count,
                ["base_position", "direction", *_HINGES],
                ["hinge_gradient"],
            ),
            state.record(
                hinge_hessian.add_hinge_products,
                self.vertex_count,
                [*_AROUND, "hinge_gradient", "pinned"],
                ["product"],
            ),
        ]

    def _record_blocks(self, state: State, convex: bool) -> list[Command]:
        of_edges = [
            state.record(
                edge_hessian.edge_blocks,
                self._edge_count,
                ["base_position", "edge_vertices", "edge_strength", "edge_tension", convex],
                ["edge_block"],
            ),
            state.record(
                stiffness_blocks.membrane_blocks,
                self.pattern.count,
                ["block_row", "block_is_diagonal", "block_edge_start", "block_edges", "edge_block", "inertia"],
                ["block"],
            ),
        ]
        if not self.hinged:
            return of_edges
        from leafwarp_kernels import hinge_hessian

        return [
            *of_edges,
            state.record(
                hinge_hessian.hinge_blocks,
                self._hinge_count,
                ["base_position", *_HINGES, convex],
                ["hinge_block"],
            ),
            state.record(
                hinge_hessian.add_hinge_blocks,
                self.pattern.count,
                ["block_hinge_start", "block_hinge_slots", "hinge_block"],
                ["block"],
            ),
        ]

    def evaluate(self, positions: np.ndarray) -> Evaluation:
        """Energy and gradient at positions [m], shape [vertex_count, 3]."""
        self._state.upload("trial_position", positions)
        for command in self._gradient_commands:
            command.run()
        gradient, energy, magnitude, acting = (self._state[name].numpy() for name in _RESULTS)
        total, size = float(energy.sum()), float(np.abs(energy).sum())
        return Evaluation(positions, total, size, gradient.copy(), float(magnitude.mean()), float(acting.mean()))

    def largest_stiffness(self) -> float:
        """Largest stiffness of an edge and largest inertia together [N/m]."""
        return float(self._state["edge_strength"].numpy().max() + self._state["inertia"].numpy().max())

    def accept(self) -> None:
        """Take the Hessian from now on where the potential was last evaluated."""
        wp.copy(self._state["base_position"], self._state["trial_position"])
        if self.hinged:
            wp.copy(self._state["hinge_base_angle"], self._state["hinge_trial_angle"])

    def keep_angles(self) -> None:
        """Let the hinges' angles go on from those where the Hessian is taken."""
        if self.hinged:
            wp.copy(self._state["hinge_angle"], self._state["hinge_base_angle"])

    def tensions(self) -> np.ndarray:
        """The tensions that the Hessian has [N], shape [edge_count]."""
        return self._state["edge_tension"].numpy().copy()

    def put_tensions(self, tensions: np.ndarray) -> None:
        """Let the Hessian have tensions [N], shape [edge_count]."""
        self._state.upload("edge_tension", tensions)

    def expect_tensions(self, step: np.ndarray) -> None:
        """Let the Hessian have the tensions that a step is to lead to, to first order; shape [vertex_count, 3]."""
        self._state.upload("direction", step)
        self._tension_command.run()

    def excess(self, step: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """What the edges pull [N] because positions stretch them by other than a step does to first order.

        Args:
            step: From where the Hessian is taken, shape [vertex_count, 3].
            positions: [m], shape [vertex_count, 3].
        """
        self._state.upload("direction", step)
        self._state.upload("trial_position", positions)
        self._excess_command.run()
        return self._state["product"].numpy().copy()

    def product(self, direction: np.ndarray) -> np.ndarray:
        """The Hessian times a direction, both of shape [vertex_count, 3].

        Args:
            direction: Zero where a vertex is held.
        """
        self._state.upload("direction", direction)
        for command in self._product_commands:
            command.run()
        return self._state["product"].numpy().copy()

    def blocks(self, convex: bool) -> np.ndarray:
        """The Hessian's blocks in the order of the pattern, shape [block_count, 3, 3].

        Args:
            convex: Whether to leave out what is not positive of each spring.
        """
        for command in self._block_commands[convex]:
            command.run()
        return self._state["block"].numpy()
