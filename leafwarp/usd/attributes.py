"""Which attributes of a leaf's mesh are animated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Vt

from leafwarp.errors import SimulationError
from leafwarp.frame import Frame
from leafwarp.usd.prims import LeafPrim

UP_AXES = ("Y", "Z")


@dataclass(frozen=True)
class AnimatedAttribute:
    """One attribute of the mesh that has a value at rest and one at every frame.

    Attributes:
        name: Property name on the mesh.
        type_name: Its USD type.
        vt_array: The array class of that type; ``FromNumpy`` copies a contiguous float32 array in one go.
        values: What it shows of a frame: float32, shape [count, 3] or [count].
        directional: Whether the values are points or directions in space, which turn with the up axis.
        interpolation: Primvar interpolation, or None where the attribute has none.
        documentation: What the values mean, with their unit; None where the USD schema says it.
    """

    name: str
    type_name: Sdf.ValueTypeName
    vt_array: type
    values: Callable[[Frame], np.ndarray | None]
    directional: bool = False
    interpolation: str | None = None
    documentation: str | None = None

    def path(self, leaf: LeafPrim) -> Sdf.Path:
        """Path of the attribute of a leaf on the stage."""
        return leaf.mesh.AppendProperty(self.name)


POINTS = AnimatedAttribute(
    "points", Sdf.ValueTypeNames.Point3fArray, Vt.Vec3fArray, lambda frame: frame.points, directional=True
)
NORMALS = AnimatedAttribute(
    "normals",
    Sdf.ValueTypeNames.Normal3fArray,
    Vt.Vec3fArray,
    lambda frame: frame.normals,
    directional=True,
    interpolation="vertex",
)
VELOCITIES = AnimatedAttribute(
    "velocities",
    Sdf.ValueTypeNames.Vector3fArray,
    Vt.Vec3fArray,
    lambda frame: frame.velocities,
    directional=True,
)
WATER_CONTENT = AnimatedAttribute(
    "primvars:water",
    Sdf.ValueTypeNames.FloatArray,
    Vt.FloatArray,
    lambda frame: frame.water,
    interpolation="vertex",
    documentation="Relative water content: 1 is saturated, 0 is bone dry.",
)
DISPLAY_COLOR = AnimatedAttribute(
    "primvars:displayColor",
    Sdf.ValueTypeNames.Color3fArray,
    Vt.Vec3fArray,
    lambda frame: frame.color,
    interpolation="vertex",
    documentation="A plain ramp of primvars:water from green (wet) to brown (dry), linear RGB; "
    "a picture of the water, not a model of how a leaf's colour ages.",
)
EXTENT = "extent"


def animated_attributes(display_color: bool) -> tuple[AnimatedAttribute, ...]:
    """The animated attributes of a scene; the extent, which follows from the points, goes with them."""
    attributes = (POINTS, NORMALS, VELOCITIES, WATER_CONTENT)
    return (*attributes, DISPLAY_COLOR) if display_color else attributes


def turn_to_up_axis(vectors: np.ndarray, up_axis: str) -> np.ndarray:
    """Points or directions of the z-up world in the stage's axes: (x, y, z) is (x, z, -y) when y is up."""
    if up_axis == "Z":
        return vectors
    return vectors[:, (0, 2, 1)] * np.array([1.0, 1.0, -1.0], vectors.dtype)


def frame_values(
    frame: Frame, attributes: tuple[AnimatedAttribute, ...], leaves: Sequence[LeafPrim], up_axis: str
) -> dict[Sdf.Path, object]:
    """The USD value of every animated attribute of every leaf at one frame, the extent included.

    Args:
        frame: The frame.
        attributes: The attributes to take from it.
        leaves: The leaves, in the order of the frame's arrays.
        up_axis: ``"Y"`` or ``"Z"``.

    Raises:
        ValueError: An array is missing or has another length than the meshes together.
        SimulationError: A value is NaN or infinite: no writer passes such a frame on.
    """
    values: dict[Sdf.Path, object] = {}
    for attribute in attributes:
        array = _checked(frame, attribute, leaves[-1].vertices.stop)
        if attribute.directional:
            array = turn_to_up_axis(array, up_axis)
        array = np.ascontiguousarray(array, np.float32)
        for leaf in leaves:
            own = array[leaf.vertices]
            values[attribute.path(leaf)] = attribute.vt_array.FromNumpy(own)
            if attribute is POINTS:
                extent = np.stack((own.min(axis=0), own.max(axis=0)))
                values[leaf.mesh.AppendProperty(EXTENT)] = Vt.Vec3fArray.FromNumpy(extent)
    return values


def _checked(frame: Frame, attribute: AnimatedAttribute, vertex_count: int) -> np.ndarray:
    """An attribute's array of all leaves, if it has their length and is finite."""
    array = attribute.values(frame)
    shape = (vertex_count,) if attribute.vt_array is Vt.FloatArray else (vertex_count, 3)
    if array is None or np.shape(array) != shape:
        found = "nothing" if array is None else f"shape {np.shape(array)}"
        raise ValueError(f"frame {frame.index}: {attribute.name}: {found} given, shape {shape} expected")
    if not np.isfinite(array).all():
        bad = np.count_nonzero(~np.isfinite(array).reshape(vertex_count, -1).all(axis=1))
        reason = f"{attribute.name} of {bad} of {vertex_count} vertices are not finite"
        raise SimulationError(frame.index, "usd", reason)
    return array
