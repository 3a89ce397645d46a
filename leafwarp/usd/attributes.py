"""Where a leaf lies on its stage, and which attributes of its mesh are animated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Vt

from leafwarp.errors import SimulationError
from leafwarp.frame import Frame

LEAF_PATH = Sdf.Path("/Leaf")
GEOMETRY_PATH = LEAF_PATH.AppendChild("geo")
MESH_PATH = GEOMETRY_PATH.AppendChild("leaf")
MATERIALS_PATH = LEAF_PATH.AppendChild("mtl")

SHADING_VARIANT_SET = "shading"
PHOTO = "photo"
WATER = "water"

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

    @property
    def path(self) -> Sdf.Path:
        """Path of the attribute on the stage."""
        return MESH_PATH.AppendProperty(self.name)


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
EXTENT_PATH = MESH_PATH.AppendProperty("extent")


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
    frame: Frame, attributes: tuple[AnimatedAttribute, ...], vertex_count: int, up_axis: str
) -> dict[Sdf.Path, object]:
    """The USD value of every animated attribute at one frame, the extent included.

    Args:
        frame: The frame.
        attributes: The attributes to take from it.
        vertex_count: Number of vertices of the mesh.
        up_axis: ``"Y"`` or ``"Z"``.

    Raises:
        ValueError: An array is missing or has another length than the mesh.
        SimulationError: A value is NaN or infinite: no writer passes such a frame on.
    """
    values: dict[Sdf.Path, object] = {}
    for attribute in attributes:
        array = attribute.values(frame)
        shape = (vertex_count,) if attribute.vt_array is Vt.FloatArray else (vertex_count, 3)
        if array is None or np.shape(array) != shape:
            found = "nothing" if array is None else f"shape {np.shape(array)}"
            raise ValueError(f"frame {frame.index}: {attribute.name}: {found} given, shape {shape} expected")
        if not np.isfinite(array).all():
            bad = np.count_nonzero(~np.isfinite(array).reshape(vertex_count, -1).all(axis=1))
            reason = f"{attribute.name} of {bad} of {vertex_count} vertices are not finite"
            raise SimulationError(frame.index, "usd", reason)
        if attribute.directional:
            array = turn_to_up_axis(array, up_axis)
        array = np.ascontiguousarray(array, np.float32)
        values[attribute.path] = attribute.vt_array.FromNumpy(array)
        if attribute is POINTS:
            extent = np.stack((array.min(axis=0), array.max(axis=0)))
            values[EXTENT_PATH] = Vt.Vec3fArray.FromNumpy(extent)
    return values
