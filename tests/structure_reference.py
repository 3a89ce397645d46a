"""The structure in plain NumPy float64, written from the formulas, and simulations of it to compare with."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.motion import Motion
from leafwarp.study.verify import drawn_leaf
from leafwarp.study.verify.drawn_leaf import crumpled, rotation
from leafwarp.study.verify.forces import ROUNDING, gradient

__all__ = [
    "ROUNDING",
    "Rig",
    "angle_of",
    "crumpled",
    "gradient",
    "hinge_angles",
    "hinge_gradient",
    "rig_of",
    "rotation",
    "spring_gradient",
    "stiffness_matrix",
    "total_torque",
]


class Rig(drawn_leaf.Rig):
    """A leaf's structure on a device, which can move."""

    def motion(self) -> Motion:
        return Motion(self.scene, self.leaf, self.state, self.stages)


def rig_of(scene: Scene, leaf: Leaf, device: str, precision: str) -> Rig:
    return Rig(**vars(drawn_leaf.rig_of(scene, leaf, device, precision)))


def angle_of(a, b, c, d) -> float:
    """Signed dihedral angle from the directions of the two triangles in the plane across the edge."""
    axis = (b - a) / np.linalg.norm(b - a)
    first = (c - a) - np.dot(c - a, axis) * axis
    second = (d - a) - np.dot(d - a, axis) * axis
    # How far the continuation of the first triangle is turned about the edge to become the second.
    return float(np.arctan2(np.dot(axis, np.cross(second, -first)), np.dot(-first, second)))


def _rises(positions, hinges):
    """Unit vectors along the hinges' edges, and what of the opposite vertices' places lies across them."""
    a, b, c, d = np.moveaxis(positions[hinges], 1, 0)
    axis = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    return axis, *(side - np.sum(side * axis, axis=1, keepdims=True) * axis for side in (c - a, d - a))


def hinge_angles(positions, hinges) -> np.ndarray:
    """:func:`angle_of` of many hinges [rad], shape [hinge_count]."""
    axis, first, second = _rises(positions, hinges)
    return np.arctan2(np.sum(axis * np.cross(second, -first), axis=1), np.sum(-first * second, axis=1))


def spring_gradient(positions, edges, strength, target) -> np.ndarray:
    """Gradient of the edges' energy ``k/2 (L - l)^2`` [N], shape [vertex_count, 3]."""
    along = positions[edges[:, 0]] - positions[edges[:, 1]]
    length = np.linalg.norm(along, axis=1)
    pull = (strength * (length - target) / length)[:, None] * along
    total = np.zeros_like(positions)
    np.add.at(total, edges[:, 0], pull)
    np.add.at(total, edges[:, 1], -pull)
    return total


def hinge_gradient(positions, hinges, strength, target) -> np.ndarray:
    """Gradient of the hinges' energy ``k/2 (theta - theta0)^2`` [N], shape [vertex_count, 3].

    The angle changes with each opposite vertex by one over its height, along the normal; what the edge's own vertices
    get is what leaves neither force nor torque.
    """
    a, b, c, d = np.moveaxis(positions[hinges], 1, 0)
    axis, first, second = _rises(positions, hinges)
    on_c = np.cross(axis, first) / np.sum(first * first, axis=1, keepdims=True)
    on_d = np.cross(second, axis) / np.sum(second * second, axis=1, keepdims=True)
    torque = np.cross(c - a, on_c) + np.cross(d - a, on_d)
    on_b = np.cross(axis, torque) / np.linalg.norm(b - a, axis=1, keepdims=True)
    moment = strength * (hinge_angles(positions, hinges) - target)
    parts = np.stack([-(on_b + on_c + on_d), on_b, on_c, on_d], axis=1) * moment[:, None, None]
    total = np.zeros_like(positions)
    np.add.at(total, hinges, parts)
    return total


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
