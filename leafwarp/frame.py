"""What writers see of the simulation: one frame, in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Frame:
    """The leaf at one frame.

    Attributes:
        index: Frame number, the integer time code in the USD; 0 is the rest pose.
        plant_time: Plant time since the start [s].
        points: Vertex positions [m], shape [vertex_count, 3], float32.
        normals: Unit vertex normals on the photographed side, shape [vertex_count, 3], float32.
        velocities: Vertex velocities [m/s of playback time], shape [vertex_count, 3], float32.
        water: Relative water content at the vertices, in [0, 1], shape [vertex_count], float32.
        color: Display colour at the vertices, linear RGB in [0, 1], shape [vertex_count, 3], float32,
            or None where the scene does not ask for one.
    """

    index: int
    plant_time: float
    points: np.ndarray
    normals: np.ndarray
    velocities: np.ndarray
    water: np.ndarray
    color: np.ndarray | None = None
