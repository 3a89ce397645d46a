"""The structure in plain NumPy float64, written from the formulas, and simulations of it to compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import State
from leafwarp.sim.motion import Motion
from leafwarp.sim.plan import make_stages

# Largest error of a float32 result next to its largest value: some tens of roundings of differences of
# positions.
ROUNDING = {"float32": 2e-4, "float64": 1e-11}


@dataclass
class Rig:
    """A leaf's structure on a device, without water."""

    scene: Scene
    leaf: Leaf
    state: State
    stages: list

    def stage(self, name: str):
        return next(stage for stage in self.stages if stage.name == name)

    def put(self, **arrays) -> None:
        for name, values in arrays.items():
            self.state.upload(name, np.asarray(values))

    def get(self, name: str) -> np.ndarray:
        values = self.state[name].numpy()
        return values.astype(np.float64) if values.dtype.kind == "f" else values

    def forces(self, *names: str) -> np.ndarray:
        """Forces of the named stages together [N]; edge springs come first or the force starts from zero."""
        self.state["force"].zero_()
        for name in names:
            self.stage(name).run()
        return self.get("force")

    def motion(self) -> Motion:
        return Motion(self.scene, self.leaf, self.state, self.stages)


def rig_of(scene: Scene, leaf: Leaf, device: str, precision: str) -> Rig:
    stages, _ = make_stages(scene, leaf, "motion")
    state = State([spec for stage in stages for spec in stage.arrays], device, precision)
    for stage in stages:
        stage.bind(state)
    return Rig(scene, leaf, state, stages)


def angle_of(a, b, c, d) -> float:
    """Signed dihedral angle from the directions of the two triangles in the plane across the edge."""
    axis = (b - a) / np.linalg.norm(b - a)
    first = (c - a) - np.dot(c - a, axis) * axis
    second = (d - a) - np.dot(d - a, axis) * axis
    # How far the continuation of the first triangle is turned about the edge to become the second.
    return float(np.arctan2(np.dot(axis, np.cross(second, -first)), np.dot(-first, second)))


def edge_energy(positions, mesh, rest, stiffness) -> float:
    lengths = np.linalg.norm(positions[mesh.edges[:, 0]] - positions[mesh.edges[:, 1]], axis=1)
    return float(0.5 * np.sum(stiffness * (lengths - rest) ** 2))


def hinge_energy(positions, mesh, rest, stiffness) -> float:
    angles = np.array([angle_of(*positions[hinge]) for hinge in mesh.hinges])
    return float(0.5 * np.sum(stiffness * (angles - rest) ** 2))


def gradient(function, positions, step: float) -> np.ndarray:
    """Central difference of a scalar function of the positions, of fourth order."""
    result = np.zeros_like(positions)
    for index in np.ndindex(*positions.shape):
        values = []
        for k in (-2, -1, 1, 2):
            moved = positions.copy()
            moved[index] += k * step
            values.append(function(moved))
        result[index] = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
    return result


def stiffness_matrix(forces, positions, step: float) -> np.ndarray:
    """Minus the derivative of the forces by the positions, by central differences."""
    columns = []
    for index in np.ndindex(*positions.shape):
        ends = []
        for sign in (1.0, -1.0):
            moved = positions.copy()
            moved[index] += sign * step
            ends.append(forces(moved).ravel())
        columns.append(-(ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T


def total_torque(positions, forces) -> np.ndarray:
    return np.cross(positions - positions.mean(axis=0), forces).sum(axis=0)


def rotation(axis, angle: float) -> np.ndarray:
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def crumpled(leaf: Leaf, amount: float, seed: int = 0) -> np.ndarray:
    """Positions of a leaf shaken by a share of its mean edge length, in all directions."""
    mesh = leaf.mesh
    flat = np.column_stack((mesh.positions, np.zeros(mesh.vertex_count)))
    along = mesh.positions[mesh.edges[:, 0]] - mesh.positions[mesh.edges[:, 1]]
    spacing = np.linalg.norm(along, axis=1).mean()
    return flat + amount * spacing * np.random.default_rng(seed).uniform(-1, 1, flat.shape)
