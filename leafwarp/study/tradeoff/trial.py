"""One setting of the trade, computed: the scene's whole film, sampled at points that no mesh or map decides."""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.compilation import Compilation
from leafwarp.sim.sampling import sampling_stencils
from leafwarp.sim.simulation import Simulation
from leafwarp.study.tradeoff.surface import find_places

# Frames at which settings are compared, spread over the film.
SAMPLED_FRAMES = 25


@dataclass(frozen=True)
class Film:
    """What is compared.

    Attributes:
        points: Positions [m] of the sampled points of the leaf, shape [frame_count, point_count, 3].
        water: Relative water content there, shape [frame_count, point_count].
    """

    points: np.ndarray
    water: np.ndarray


@dataclass(frozen=True)
class Trial(Film):
    """What was computed with a setting, and what it took.

    Attributes:
        start_seconds: Wall time until the first frame began, kernels being loaded: arrays, factors, settling [s].
        fluid_seconds: Wall time of the fluid and the coupling [s].
        motion_seconds: Wall time of the motion [s].
        frame_seconds: Wall time of handing out every frame [s].
        fluid_steps: Number of fluid steps.
        motion_substeps: Substeps of the motion in all.
        ledger_error: Water that the ledger misses, in contents of the saturated leaf; 0 where it is prescribed.
        peak_memory: Largest memory of the process that computed it [byte]; 0 where it is not known.
        vertices: Vertices of the mesh.
    """

    start_seconds: float
    fluid_seconds: float
    motion_seconds: float
    frame_seconds: float
    fluid_steps: int
    motion_substeps: int
    ledger_error: float
    peak_memory: int
    vertices: int

    @property
    def seconds(self) -> float:
        """Wall time of the film, without what is done once before it [s]."""
        return self.fluid_seconds + self.motion_seconds + self.frame_seconds

    def save(self, path: Path) -> None:
        """Write it to a file, whole or not at all."""
        part = path.with_name(f".{path.name}.part")
        with part.open("wb") as file:
            np.savez(file, **{field.name: getattr(self, field.name) for field in fields(self)})
        part.replace(path)

    @classmethod
    def load(cls, path: Path) -> Trial | None:
        """Read a file that :meth:`save` wrote; None where there is none, or none of this version."""
        try:
            with np.load(path, allow_pickle=False) as file:
                values = {field.name: file[field.name] for field in fields(cls)}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            return None
        return cls(**{name: value if value.ndim else value.item() for name, value in values.items()})


def sampled_frames(scene: Scene) -> list[int]:
    """Numbers of the frames at which settings are compared."""
    count = min(SAMPLED_FRAMES, scene.time.frames)
    return sorted({round(frame) for frame in np.linspace(1, scene.time.frames, count)})


def film_seconds(scene: Scene) -> float:
    """Playback time of a scene's film [s]."""
    return max(scene.time.frames - 1, 1) / scene.time.fps


def run_trial(scene: Scene, leaf: Leaf, places: np.ndarray, device: str) -> Trial:
    """Compute a scene.

    Args:
        scene: The scene, with a setting applied.
        leaf: Its leaf.
        places: Points of the photographed leaf [m], shape [point_count, 2].
        device: Warp device.

    Raises:
        SimulationError: The scene cannot be computed so.
    """
    sampler = Sampler(leaf, places)
    with Compilation(scene, device) as compilation:
        compilation.wait()
    begin = time.perf_counter()
    simulation = Simulation(scene, leaf, device)
    simulation.settle()
    start = time.perf_counter() - begin
    wanted = sampled_frames(scene)
    points, water = [], []
    for index in range(1, scene.time.frames + 1):
        if index > 1:
            simulation.advance(index)
        frame = simulation.read_frame(index)
        if index in wanted:
            points.append(sampler.points(frame.points))
            water.append(sampler.water(simulation, frame.water))
    seconds = {name: simulation.watch.seconds.get(name, 0.0) for name in ("motion", "frame")}
    fluid = simulation.fluid
    return Trial(
        points=np.stack(points).astype(np.float32),
        water=np.stack(water).astype(np.float32),
        start_seconds=start,
        fluid_seconds=simulation.group_seconds("fluid") + simulation.group_seconds("coupling"),
        motion_seconds=seconds["motion"],
        frame_seconds=seconds["frame"],
        fluid_steps=0 if fluid is None else fluid.steps_done,
        motion_substeps=sum(simulation.substeps),
        ledger_error=0.0 if fluid is None else fluid.ledger().error,
        peak_memory=0,
        vertices=leaf.mesh.vertex_count,
    )


class Sampler:
    """Reads shape and water at points of the leaf.

    Args:
        leaf: The leaf.
        places: The points [m], in the photographed leaf, shape [point_count, 2].
    """

    def __init__(self, leaf: Leaf, places: np.ndarray):
        self._mesh = leaf.mesh
        self._places = find_places(leaf.mesh, places)
        self._stencils = None
        if leaf.mask is not None:
            self._stencils = sampling_stencils(leaf.frame.uv(places), leaf.mask, leaf.frame.size)

    def points(self, positions: np.ndarray) -> np.ndarray:
        return self._places.sample(self._mesh, positions.astype(np.float64))

    def water(self, simulation: Simulation, at_vertices: np.ndarray) -> np.ndarray:
        """The water of the map; where there is none, it is the same everywhere."""
        if simulation.fluid is None:
            return self._places.sample(self._mesh, at_vertices.astype(np.float64))
        cells, weights = self._stencils
        return (simulation.state["water_now"].numpy().reshape(-1)[cells] * weights).sum(axis=1)
