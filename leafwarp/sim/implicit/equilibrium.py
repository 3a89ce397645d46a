"""The equilibrium of any mesh of springs and hinges, from plain arrays: for studies that know no scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leafwarp.sim.forces import edge_tables, fill_edge_tables, fill_hinge_tables, hinge_tables
from leafwarp.sim.implicit.newton import Accuracy, Newton
from leafwarp.sim.implicit.potential import Potential
from leafwarp.sim.implicit.relaxation import keeps_from_turning, relax
from leafwarp.sim.implicit.threads import one_thread
from leafwarp.sim.launch import ArraySpec, State

# Way of a vertex in the last step, over the mesh's size.
LAST_STEP = 1e-6


@dataclass(frozen=True)
class Equilibrium:
    """A mesh at rest.

    Attributes:
        positions: [m], shape [vertex_count, 3].
        residual: Largest force left on a free vertex [N].
        iterations: Newton steps that it took.
        energy: Potential energy [J].
    """

    positions: np.ndarray
    residual: float
    iterations: int
    energy: float


def equilibrium(
    positions: np.ndarray,
    edges: np.ndarray,
    rest_lengths: np.ndarray,
    edge_stiffness: np.ndarray,
    *,
    hinges: np.ndarray | None = None,
    rest_angles: np.ndarray | None = None,
    hinge_stiffness: np.ndarray | None = None,
    masses: np.ndarray | None = None,
    pinned: np.ndarray | None = None,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    loads: np.ndarray | None = None,
    tolerance: float = 1e-6,
    device: str = "cpu",
) -> Equilibrium:
    """A stable equilibrium, reached downhill.

    A shape that is in equilibrium already but for a sideways nudge, such as a straight column under a load, is not
    left: give it a small imperfection.

    Args:
        positions: Where the descent starts [m], shape [vertex_count, 3].
        edges: Vertices of each edge, shape [edge_count, 2].
        rest_lengths: [m], shape [edge_count].
        edge_stiffness: [N/m], shape [edge_count].
        hinges: Vertices of each hinge, edge a, b and opposite c, d, shape [hinge_count, 4]; None: no bending.
        rest_angles: [rad], shape [hinge_count]; None: flat.
        hinge_stiffness: [N m/rad], shape [hinge_count]; needed with hinges.
        masses: [kg], shape [vertex_count]; None: no weight.
        pinned: Vertices that are held, shape [vertex_count]; None: none is.
        gravity: [m/s^2].
        loads: Dead loads on the vertices [N], shape [vertex_count, 3].
        tolerance: Largest force left on a free vertex, over the mean over the vertices of the load on each and a
            hundredth of its bending force; the rounding of positions is allowed for. The last step is less than a
            millionth of the mesh's size, too.
        device: Warp device.

    Raises:
        NotConverged: No equilibrium was found.
    """
    positions = np.asarray(positions, dtype=np.float64)
    count = len(positions)
    edges, hinges = np.asarray(edges, dtype=np.int32), np.asarray(() if hinges is None else hinges, dtype=np.int32)
    hinges = hinges.reshape(-1, 4)
    pinned = np.zeros(count, dtype=bool) if pinned is None else np.asarray(pinned, dtype=bool)
    potential = Potential(count, edges, hinges)
    arrays = (ArraySpec("pinned", (count,), "bool", "vertices that are held"), *edge_tables(count, len(edges)))
    if potential.hinged:
        arrays += hinge_tables(count, len(hinges))
    state = State((*arrays, *potential.arrays), device, "float64")
    potential.bind(state)
    state.upload("pinned", pinned)
    fill_edge_tables(edges, count, state)
    state.upload("edge_target_length", rest_lengths)
    state.upload("edge_strength", edge_stiffness)
    if potential.hinged:
        fill_hinge_tables(hinges, count, state)
        state.upload("hinge_target_angle", np.zeros(len(hinges)) if rest_angles is None else rest_angles)
        state.upload("hinge_strength", hinge_stiffness)
    weight = np.zeros((count, 1)) if masses is None else np.asarray(masses, dtype=np.float64)[:, None]
    dead = np.zeros((count, 3)) if loads is None else np.asarray(loads, dtype=np.float64)
    state.upload("load", weight * np.asarray(gravity, dtype=np.float64) + dead)
    length = float(np.linalg.norm(np.ptp(positions, axis=0)))
    newton = Newton(potential, pinned, length)
    with one_thread():
        found = relax(
            newton,
            state,
            positions,
            np.ones(count) if masses is None else weight[:, 0],
            length,
            Accuracy(tolerance, LAST_STEP),
            is_held=keeps_from_turning(positions[pinned], length),
            each_step=potential.keep_angles,
        )
    return Equilibrium(found.positions, found.residual, newton.effort.iterations, found.energy)
