"""Edge and angular springs in blocks of lanes: their tables and their launches on a CPU."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import LeafMesh
from leafwarp.sim.adjacency import vertex_to_slots
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.spring_lanes import edge_and_hinge_forces, edge_forces, sum_spring_forces

# Components of the forces of a block: x, y and z on each vertex.
HINGE_COMPONENTS = 12
EDGE_COMPONENTS = 6


def hinge_edges(mesh: LeafMesh) -> np.ndarray:
    """The edge that each hinge lies on, shape [hinge_count]."""
    keys = mesh.edges.astype(np.int64) @ (mesh.vertex_count, 1)
    order = np.argsort(keys)
    wanted = np.sort(mesh.hinges[:, :2], axis=1).astype(np.int64) @ (mesh.vertex_count, 1)
    return order[np.searchsorted(keys, wanted, sorter=order)]


def in_blocks(values: np.ndarray, missing: int) -> np.ndarray:
    """Integers of elements as blocks of lanes.

    Args:
        values: Shape [element_count, component].
        missing: What the lanes of the last block that have no element hold.

    Returns:
        Shape [block, component, lane], int32.
    """
    count, components = values.shape
    padded = np.full((-(-count // LANES) * LANES, components), missing, np.int32)
    padded[:count] = values
    return np.ascontiguousarray(padded.reshape(-1, LANES, components).transpose(0, 2, 1))


class SpringBlocks:
    """The springs of a mesh: hinges with the edges that they lie on, and edges without a hinge.

    The stage of the edge springs records the edges without a hinge; that of the angular springs, where there is one,
    records the others. The last of them sums the forces on the vertices.

    Args:
        mesh: The mesh.
        hinged: Whether there are angular springs; without them no edge has a hinge.
        groups: Vertices of the groups of leaves; the launches of each are recorded apart.
    """

    def __init__(self, mesh: LeafMesh, hinged: bool, groups: Sequence[slice]):
        self._vertex_count = mesh.vertex_count
        self._groups = groups
        self._hinges = mesh.hinges if hinged else mesh.hinges[:0]
        self._hinge_edges = hinge_edges(mesh) if hinged else np.zeros(0, np.int64)
        self._bare = np.setdiff1d(np.arange(mesh.edge_count), self._hinge_edges)
        self._edges = mesh.edges[self._bare]
        self._hinge_blocks, self._edge_blocks = (-(-len(e) // LANES) for e in (self._hinges, self._edges))
        self._blocks_of_hinges, self._blocks_of_edges = (
            _group_blocks(springs, groups) for springs in (self._hinges, self._edges)
        )

    def record_edges(self, stage: Stage, state: State) -> list[list[Command]]:
        """Record the forces of the edges without a hinge."""
        rows = self._hinge_blocks * HINGE_COMPONENTS + self._edge_blocks * EDGE_COMPONENTS
        stage.add_array(state, ArraySpec("spring_force", (rows, LANES), "real", "forces of blocks of springs [N]"))
        if self._edge_blocks == 0:
            return [[] for _ in self._groups]
        tables = [state[name] for name in self._add_tables(stage, state, "edge", self._edges, self._bare)]
        springs = ["edge_rest_length", "edge_stiffness", "damping_time"]
        force = self._force(state)[self._hinge_blocks * HINGE_COMPONENTS :].reshape((-1, EDGE_COMPONENTS))

        def record(own: slice) -> list[Command]:
            inputs = ["position", "velocity", *(table[own] for table in tables), *springs]
            return [state.record(edge_forces, own.stop - own.start, inputs, [force[own]])]

        return [record(own) if own.stop > own.start else [] for own in self._blocks_of_edges]

    def record_hinges(self, stage: Stage, state: State) -> list[list[Command]]:
        """Record the forces of the hinges and of the edges that they lie on."""
        tables = [state[name] for name in self._add_tables(stage, state, "hinge", self._hinges, self._hinge_edges)]
        angles = [state.lanes(name) for name in ("hinge_rest_angle", "hinge_stiffness", "hinge_angle")]
        force = self._force(state)[: self._hinge_blocks * HINGE_COMPONENTS].reshape((-1, HINGE_COMPONENTS))

        def record(own: slice) -> list[Command]:
            rest_angle, stiffness, angle = (array[own] for array in angles)
            springs = ["edge_rest_length", "edge_stiffness", rest_angle, stiffness, "damping_time"]
            inputs = ["position", "velocity", *(table[own] for table in tables), *springs]
            return [state.record(edge_and_hinge_forces, own.stop - own.start, inputs, [angle, force[own]])]

        return [record(own) for own in self._blocks_of_hinges]

    def record_sum(self, stage: Stage, state: State) -> list[list[Command]]:
        """Record the sum of all forces on each vertex."""
        begin = self._hinge_blocks * HINGE_COMPONENTS
        places = [_places(self._hinges, HINGE_COMPONENTS, 0), _places(self._edges, EDGE_COMPONENTS, begin)]
        corners = np.concatenate([self._hinges.ravel(), self._edges.ravel()])
        start, order = vertex_to_slots(corners[:, None], self._vertex_count)
        places = np.concatenate(places)[order]
        stage.add_array(
            state, ArraySpec("vertex_place_start", start.shape, "int32", "where each vertex's forces start")
        )
        stage.add_array(state, ArraySpec("vertex_places", places.shape, "int32", "places of the forces on each vertex"))
        state.upload("vertex_place_start", start)
        state.upload("vertex_places", places)
        spring_force = state["spring_force"].flatten()

        def record(own: slice) -> list[Command]:
            inputs = [state["vertex_place_start"][own.start : own.stop + 1], "vertex_places", spring_force]
            return [state.record(sum_spring_forces, own.stop - own.start, inputs, [state["force"][own]])]

        return [record(own) for own in self._groups]

    def _add_tables(
        self, stage: Stage, state: State, kind: str, corners: np.ndarray, edges: np.ndarray
    ) -> tuple[str, str]:
        corners, edges = in_blocks(corners, 0), in_blocks(edges[:, None], -1)[:, 0]
        names = (f"{kind}_block_corners", f"{kind}_block_edges")
        stage.add_array(state, ArraySpec(names[0], corners.shape, "int32", f"vertices of each block of {kind}s"))
        stage.add_array(state, ArraySpec(names[1], edges.shape, "int32", f"edge springs of each block of {kind}s"))
        state.upload(names[0], corners)
        state.upload(names[1], edges)
        return names

    def _force(self, state: State) -> wp.array:
        return state.lanes("spring_force")[:, 0]


def _group_blocks(springs: np.ndarray, groups: Sequence[slice]) -> list[slice]:
    """Blocks of the springs of each group.

    Args:
        springs: Vertices of each spring, group after group, shape [spring_count, corners].
        groups: Vertices of the groups.
    """
    counts = [int(np.count_nonzero(springs[:, 0] < own.stop)) for own in groups]
    if any(count % LANES for count in counts[:-1]):
        raise ValueError(f"springs of groups end at {counts}: all but the last must be multiples of {LANES}")
    ends = [-(-count // LANES) for count in counts]
    return list(map(slice, [0, *ends], ends))


def _places(corners: np.ndarray, components: int, first_row: int) -> np.ndarray:
    """Where the x of the force on each corner lies in the flattened forces, in the order of the corners."""
    block, lane = np.divmod(np.arange(len(corners)), LANES)
    row = first_row + components * block[:, None] + 3 * np.arange(corners.shape[1])
    return (row * LANES + lane[:, None]).ravel()
