"""Output stages: what the rest of the program sees of the simulation."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from leafwarp.errors import SimulationError
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.adjacency import vertex_to_slots
from leafwarp.sim.guards import find_fault
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.normals import vertex_normals

# Linear RGB of the plain ramp of water, from dry to saturated: (water content, colour).
WATER_RAMP = ((0.0, (0.23, 0.11, 0.04)), (0.5, (0.42, 0.36, 0.07)), (1.0, (0.06, 0.27, 0.04)))


class FrameOutput(Stage):
    """Normals on the device, then one copy of what a frame holds to host memory."""

    name = "frame"
    purpose = "normals, and the frame's points, velocities and water to host memory"
    rate = "output"
    host_reads = ("position", "velocity", "normal", "vertex_water")

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        vertices, triangles = leaf.mesh.vertex_count, leaf.mesh.triangle_count
        self.arrays = (
            ArraySpec("normal", (vertices,), "vector", "unit vertex normals"),
            ArraySpec("triangle_vertices", (triangles, 3), "int32", "vertices of each triangle"),
            ArraySpec("vertex_triangle_start", (vertices + 1,), "int32", "first of each vertex's triangles"),
            ArraySpec("vertex_triangles", (3 * triangles,), "int32", "triangles of each vertex"),
        )

    def bind(self, state: State) -> None:
        mesh = self.leaf.mesh
        start, slots = vertex_to_slots(mesh.triangles, mesh.vertex_count)
        state.upload("triangle_vertices", mesh.triangles)
        state.upload("vertex_triangle_start", start)
        state.upload("vertex_triangles", slots // 3)
        inputs = ["position", "triangle_vertices", "vertex_triangle_start", "vertex_triangles"]
        self.commands = [state.record(vertex_normals, mesh.vertex_count, inputs, ["normal"])]
        self._state = state

    def read(self, index: int, plant_time: float) -> Frame:
        """The present frame."""
        self.run()
        names = ("position", "normal", "velocity", "vertex_water")
        with np.errstate(over="ignore"):
            points, normals, velocities, water = (self._state[name].numpy().astype(np.float32) for name in names)
        return Frame(index, plant_time, points, normals, velocities, water)

    def check(self, frame: Frame) -> None:
        """See whether all that a frame holds are finite numbers.

        Raises:
            SimulationError: They are not.
        """
        for quantity in ("points", "velocities", "normals", "water"):
            if not np.isfinite(getattr(frame, quantity)).all():
                fault = find_fault(self._state) or f"{quantity}: not finite in float32; lower the load or the stiffness"
                raise SimulationError(frame.index, self.name, fault)


class DisplayColor(Stage):
    """A plain ramp of water from brown to green, at every vertex. It is no model of how colour ages."""

    name = "display_color"
    purpose = "vertex colours: a plain ramp of water from brown to green (on the host)"
    rate = "output"
    host_reads = ("vertex_water",)

    def color(self, frame: Frame) -> Frame:
        """The frame with its display colour."""
        contents, colors = zip(*WATER_RAMP, strict=True)
        channels = [np.interp(frame.water, contents, channel) for channel in zip(*colors, strict=True)]
        return dataclasses.replace(frame, color=np.stack(channels, axis=1).astype(np.float32))


class ContactSheetOutput(Stage):
    """A picture of eight moments: the water above, the leaf below."""

    name = "contact_sheet"
    purpose = "picture of eight moments, ray-cast (its mesh and textures are allocated by the renderer)"
    rate = "output"
    host_reads = ("position", "normal", "vertex_water")

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        if scene.fluid is not None:
            self.host_reads = (*self.host_reads, "water_now")
        self._sheet = None

    def bind(self, state: State) -> None:
        self._state = state

    def start(self, first_frame: int, last_frame: int) -> None:
        """Choose the moments among the frames that will be computed."""
        from leafwarp.render.contact_sheet import ContactSheet, choose_frames

        self._sheet = ContactSheet(self.leaf, choose_frames(first_frame, last_frame), self._state.device.alias)

    def capture(self, frame: Frame) -> None:
        """Keep the frame if it is one of the moments."""
        if self._sheet is not None and frame.index in self._sheet.frames:
            self._sheet.capture(frame, self._state["water_now"].numpy() if self.scene.fluid is not None else None)

    def save(self, path: Path) -> None:
        """Draw the picture of the captured moments."""
        if self._sheet is not None:
            self._sheet.save(path)
