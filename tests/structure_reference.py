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
    "rig_of",
    "rotation",
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
