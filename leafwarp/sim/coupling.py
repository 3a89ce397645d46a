"""The coupling step (paper, Sec. III-C): the only place that reads the water and writes the structure.

Once a frame, or more often, the water is sampled at the middle of every spring, and rest lengths, rest angles,
stiffness and mass follow it through the scene's response curves. Nothing travels to host memory here.

======================  ==========================================================================
points                  where they lie on the map
======================  ==========================================================================
``edge``                midpoint of the spring's two vertices
``hinge``               midpoint of the two vertices opposite to the edge
``vertex``              the vertex itself (mass, and the water that is written out)
======================  ==========================================================================
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.specimen import Specimen, once_a_photo
from leafwarp.scene import Curve, Scene
from leafwarp.sim import material
from leafwarp.sim.launch import ArraySpec, State, padded_shape
from leafwarp.sim.sampling import sampling_stencils, smooth_over_leaf
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.response import respond_in_proportion, respond_to_change, respond_with_set
from leafwarp_kernels.sampling import sample_map


def watered_points(scene: Scene) -> tuple[str, ...]:
    """The kinds of points at which the scene needs the water."""
    edge = scene.shrinks or scene.stiffness_varies
    hinge = scene.has_angular_springs and (scene.curls or scene.stiffness_varies)
    return ("edge",) * edge + ("hinge",) * hinge + ("vertex",)


def veined_points(scene: Scene) -> tuple[str, ...]:
    """The kinds of points at which the structure needs the venation."""
    edge = scene.structure.vein_stiffness != 1.0 or (scene.shrinks and scene.shrink.vein_resistance > 0.0)
    bends = scene.structure.vein_bending_stiffness != 1.0 or (scene.curls and scene.curl.vein_resistance > 0.0)
    return ("edge",) * edge + ("hinge",) * (bends and scene.has_angular_springs)


def point_uv(leaf: Leaf, points: str) -> np.ndarray:
    """Map coordinates of all points of a kind ("edge", "hinge" or "vertex"), shape [count, 2]."""
    ends = {"edge": leaf.mesh.edges, "hinge": leaf.mesh.hinges[:, 2:]}
    return leaf.uv if points == "vertex" else leaf.uv[ends[points]].mean(axis=1)


def _point_count(leaf: Leaf, points: str) -> int:
    mesh = leaf.mesh
    return {"edge": mesh.edge_count, "hinge": mesh.hinge_count, "vertex": mesh.vertex_count}[points]


class Stencils(Stage):
    """Tables of the cells around every sampled point."""

    name = "stencils"
    purpose = "map cells and weights around every sampled point, off-leaf cells left out"
    rate = "start"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        needed = set(veined_points(scene)) | (set(watered_points(scene)) if scene.fluid else set())
        self.points = tuple(p for p in ("edge", "hinge", "vertex") if p in needed)
        self.arrays = tuple(
            spec
            for p in self.points
            for spec in (
                ArraySpec(
                    f"{p}_stencil_cells", (_point_count(leaf, p), 4), "int32", "padded map's cells around each point"
                ),
                ArraySpec(f"{p}_stencil_weights", (_point_count(leaf, p), 4), "real", "their weights, with sum 1"),
            )
        )

    def bind(self, state: State) -> None:
        whole = padded_shape(self.leaf.mask.shape)
        for points in self.points:
            stencils = once_a_photo(
                lambda photo, points=points: sampling_stencils(point_uv(photo, points), photo.mask, photo.frame.size)
            )

            def cells(photo: Leaf, specimen: Specimen, stencils=stencils) -> np.ndarray:
                rows, columns = np.unravel_index(stencils(photo, specimen)[0], photo.mask.shape)
                row, column = specimen.corner
                return np.ravel_multi_index((row + rows, column + columns), whole)

            weights = self.leaf.join(lambda photo, specimen, stencils=stencils: stencils(photo, specimen)[1])
            state.upload(f"{points}_stencil_cells", self.leaf.join(cells))
            state.upload(f"{points}_stencil_weights", weights)


class _Sampling(Stage):
    """Samples one map at some kinds of points."""

    quantity: ClassVar[str]
    map_name: ClassVar[str]

    def __init__(self, scene: Scene, leaf: Leaf, points: tuple[str, ...]):
        super().__init__(scene, leaf)
        self.points = points
        self.arrays = _sample_specs(leaf, points, self.quantity)

    def bind(self, state: State) -> None:
        values = state.whole(self.map_name).flatten()
        self.commands = [
            state.record(
                sample_map,
                _point_count(self.leaf, p),
                [values, f"{p}_stencil_cells", f"{p}_stencil_weights"],
                [f"{p}_{self.quantity}"],
            )
            for p in self.points
        ]
        self.run()


def _sample_specs(leaf: Leaf, points: tuple[str, ...], quantity: str) -> tuple[ArraySpec, ...]:
    meaning = {"water": "relative water content at each point", "venation": "flow capacity at each point"}[quantity]
    return tuple(ArraySpec(f"{p}_{quantity}", (_point_count(leaf, p),), "real", meaning) for p in points)


class SampleVenation(_Sampling):
    """Venation at the springs, smoothed to the edge length first: a thin vein must not be hit or missed by luck."""

    name = "sample_venation"
    purpose = "venation at the middle of every spring"
    rate = "start"
    quantity = "venation"
    map_name = "venation"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf, veined_points(scene))
        spec = ArraySpec("venation", leaf.mask.shape, "real", "flow capacity, smoothed to the edge length", padded=True)
        self.arrays = (spec, *self.arrays)

    def bind(self, state: State) -> None:
        state.upload("venation", self.leaf.tile(once_a_photo(_smooth_venation)))
        super().bind(state)


def _smooth_venation(leaf: Leaf) -> np.ndarray:
    """Venation smoothed to half of the mean edge length, shape [ny, nx]."""
    ends = leaf.mesh.positions[leaf.mesh.edges]
    half_edge = 0.5 * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
    height, width = leaf.mask.shape
    radius = (half_edge * width / leaf.frame.size[0], half_edge * height / leaf.frame.size[1])
    return smooth_over_leaf(leaf.maps["venation"], leaf.mask, radius)


class SampleWater(_Sampling):
    """Water at the springs and vertices, from the fluid's map."""

    name = "sample_water"
    purpose = "water at the middle of every spring and at every vertex"
    rate = "frame"
    quantity = "water"
    map_name = "water_now"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf, watered_points(scene))


class PrescribedWater(Stage):
    """Water that the scene prescribes, the same everywhere: no map, no fluid."""

    name = "prescribed_water"
    purpose = "the same prescribed water at every spring and vertex"
    rate = "frame"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.points = watered_points(scene)
        self.arrays = _sample_specs(leaf, self.points, "water")
        self.host_writes = tuple(spec.name for spec in self.arrays)

    def content(self, plant_time: float) -> float:
        """The prescribed relative water content at a plant time [s]."""
        times, contents = zip(*self.scene.water.curve, strict=True)
        return float(np.interp(plant_time, times, contents))

    def bind(self, state: State) -> None:
        self._samples = [state[name] for name in self.host_writes]
        self.run(Interval(0.0, 0.0))

    def run(self, interval: Interval | None = None) -> None:
        for samples in self._samples:
            samples.fill_(self.content(interval.end))


class _Response(Stage, ABC):
    """Makes one parameter of the structure follow the water at some points through a response curve."""

    rate = "frame"
    parameter: ClassVar[str]
    points: ClassVar[str]
    plastic_set = 0.0

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        count, name = _point_count(leaf, self.points), self.parameter
        self.arrays = (
            *_curve_specs(name, self.curve()),
            ArraySpec(f"{name}_gain", (count,), "real", f"change of {name} for a change of 1 of its response"),
            ArraySpec(f"{name}_start", (count,), "real", f"{name} of the photographed leaf"),
            ArraySpec(f"{name}_response_start", (count,), "real", f"response of {name} to the water at the start"),
        )
        if self.plastic_set > 0.0:
            meaning = f"largest change so far of the response of {name}"
            self.arrays += (ArraySpec(f"{name}_peak", (count,), "real", meaning),)

    @abstractmethod
    def curve(self) -> Curve:
        """The response curve."""

    @abstractmethod
    def start_and_gain(self, water: np.ndarray, venation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The parameter at the start and its gain, from water at the start and venation; all [point_count]."""

    def bind(self, state: State) -> None:
        name, samples = self.parameter, f"{self.points}_water"
        start, gain = self.start_and_gain(state[samples].numpy(), _venation(state, self.points))
        curve = _upload_curve(state, name, self.curve())
        count = len(start)
        inputs = [samples, *curve, f"{name}_response_start", f"{name}_gain", f"{name}_start"]
        # The start's response is what the kernel itself makes of it, with a gain of 1 and all else 0, so that no change
        # is exactly none: a compiler may round the same curve differently in another kernel.
        state.upload(f"{name}_gain", np.ones(count))
        state.record(respond_to_change, count, inputs, [f"{name}_response_start"]).run()
        state.upload(f"{name}_gain", gain)
        state.upload(f"{name}_start", start)
        if self.plastic_set > 0.0:
            inputs, outputs = [*inputs, state.real(self.plastic_set)], [f"{name}_peak", name]
            self.commands = [state.record(respond_with_set, count, inputs, outputs)]
        else:
            self.commands = [state.record(respond_to_change, count, inputs, [name])]


def _curve_specs(name: str, curve: Curve) -> tuple[ArraySpec, ...]:
    return (
        ArraySpec(f"{name}_curve_water", (len(curve),), "real", f"water contents of the response curve of {name}"),
        ArraySpec(f"{name}_curve_value", (len(curve),), "real", f"values of the response curve of {name}"),
    )


def _upload_curve(state: State, name: str, curve: Curve) -> tuple[str, str]:
    contents, values = zip(*curve, strict=True)
    state.upload(f"{name}_curve_water", np.array(contents))
    state.upload(f"{name}_curve_value", np.array(values))
    return f"{name}_curve_water", f"{name}_curve_value"


class RestLengths(_Response):
    """Edge springs shorten as the leaf dries, along the veins by another share than across them; veins resist."""

    name = "rest_lengths"
    purpose = "rest lengths of the edge springs from the water (shrink)"
    parameter = "edge_rest_length"
    points = "edge"

    @property
    def plastic_set(self) -> float:
        return self.scene.shrink.plastic_set

    def curve(self) -> Curve:
        return self.scene.shrink.curve

    def start_and_gain(self, water: np.ndarray, venation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lengths = material.edge_lengths(self.leaf.mesh, material.rest_positions(self.scene, self.leaf))
        gain = -lengths * (1.0 - self.scene.shrink.vein_resistance * venation)
        return lengths, gain * self._share_across() if self.scene.shrinks_along_veins else gain

    def _share_across(self) -> np.ndarray:
        """Shrinking of each edge over that across the veins, shape [edge_count].

        ``sin^2 phi + a cos^2 phi`` at the angle ``phi`` to the veins, which shrink by the ratio ``a`` along themselves;
        the mean of both where no direction is sure.
        """
        from leafwarp.sim.vein_direction import edge_alignment

        along = self.scene.shrink.along_veins
        return 0.5 * (1.0 + along) - 0.5 * (1.0 - along) * self.leaf.join(once_a_photo(edge_alignment))


class RestAngles(_Response):
    """Angular springs bend as one side of the leaf shrinks more than the other."""

    name = "rest_angles"
    purpose = "rest angles of the angular springs from the water (curl)"
    parameter = "hinge_rest_angle"
    points = "hinge"

    @property
    def plastic_set(self) -> float:
        return self.scene.curl.plastic_set

    def curve(self) -> Curve:
        return self.scene.curl.mismatch

    def start_and_gain(self, water: np.ndarray, venation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angles = material.dihedral_angles(self.leaf.mesh, material.rest_positions(self.scene, self.leaf))
        curvature_per_mismatch = 1.5 / self.scene.curl.thickness
        bend = curvature_per_mismatch * material.hinge_span(self.leaf.mesh)
        return angles, bend * (1.0 - self.scene.curl.vein_resistance * venation)


class Mass(_Response):
    """A drying leaf gets lighter."""

    name = "mass"
    purpose = "mass of every vertex from its water"
    parameter = "mass"
    points = "vertex"

    def curve(self) -> Curve:
        return ((0.0, 0.0), (1.0, 1.0))

    def start_and_gain(self, water: np.ndarray, venation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        structure, areas = self.scene.structure, self.leaf.mesh.vertex_areas
        return (structure.dry_mass + structure.water_mass * water) * areas, structure.water_mass * areas


def _venation(state: State, points: str) -> np.ndarray:
    """Venation at points of a kind; 0 where the scene does not need it."""
    name = f"{points}_venation"
    return state[name].numpy() if name in state else np.zeros(1)


class Stiffness(Stage):
    """Veins are stiffer than lamina; turgor and drying change both. Set once where the water does not matter."""

    name = "stiffness"
    purpose = "stiffness of the springs from venation and water"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.springs = ("edge", "hinge") if scene.has_angular_springs else ("edge",)
        self.rate = "frame" if scene.stiffness_varies else "start"
        if scene.stiffness_varies:
            self.arrays = (
                *_curve_specs("stiffness", scene.structure.stiffness_factor),
                *(
                    ArraySpec(f"{s}_stiffness_gain", (_point_count(leaf, s),), "real", "stiffness at a response of 1")
                    for s in self.springs
                ),
            )

    def bind(self, state: State) -> None:
        scene, leaf, structure = self.scene, self.leaf, self.scene.structure
        lamina = {"edge": material.edge_stiffness(leaf.mesh, material.membrane_stiffness(scene, leaf))}
        if "hinge" in self.springs:
            lamina["hinge"] = material.hinge_stiffness(leaf.mesh, material.bending_stiffness(scene, leaf))
        curve = _upload_curve(state, "stiffness", structure.stiffness_factor) if self.scene.stiffness_varies else ()
        for s in self.springs:
            over_lamina = structure.vein_bending_stiffness if s == "hinge" else structure.vein_stiffness
            venation = _venation(state, s) if over_lamina != 1.0 else 0.0
            gain = lamina[s] * (1.0 + (over_lamina - 1.0) * venation)
            if not curve:
                state.upload(f"{s}_stiffness", gain * structure.stiffness_factor[0][1])
                continue
            state.upload(f"{s}_stiffness_gain", gain)
            inputs = [f"{s}_water", *curve, f"{s}_stiffness_gain"]
            self.commands.append(state.record(respond_in_proportion, len(gain), inputs, [f"{s}_stiffness"]))
