"""One setting of the trade, computed: the whole drying on the user's leaf, fluid and structure."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.simulation import Simulation

# Frames at which settings are compared.
SAMPLED_FRAMES = 25
HIGHEST_SUBSTEPS = 2**20
HIGHEST_FPS = 1000.0


@dataclass(frozen=True)
class Setting:
    """What a user may choose to trade speed for accuracy.

    Attributes:
        map_size: Cells (width, height).
        step: Fluid step in plant time [s].
        scheme: "split" or "unsplit".
        precision: "float32" or "float64".
    """

    map_size: tuple[int, int]
    step: float
    scheme: str
    precision: str

    @property
    def cells_across(self) -> int:
        """Cells in the longer direction."""
        return max(self.map_size)

    def coarsened(self, map_factor: int = 1, step_factor: float = 1.0) -> Setting:
        """The same with a coarser map and a longer step."""
        size = tuple(max(1, round(cells / map_factor)) for cells in self.map_size)
        return replace(self, map_size=size, step=self.step * step_factor)

    def __str__(self) -> str:
        width, height = self.map_size
        return f"{width}x{height} {self.scheme} {self.precision} step {self.step:g} s"


@dataclass(frozen=True)
class Trial:
    """What was computed with a setting.

    Attributes:
        setting: The setting.
        points: Vertex positions [m], shape [frame_count, vertex_count, 3].
        water: Relative water content at the vertices, shape [frame_count, vertex_count].
        seconds: Wall time of each group of stages [s].
        fluid_steps: Number of fluid steps.
        fluid_step: Their length in plant time [s].
        substeps: Motion substeps in all.
        ledger_error: Water that the ledger misses, in contents of the saturated leaf.
    """

    setting: Setting
    points: np.ndarray
    water: np.ndarray
    seconds: Mapping[str, float]
    fluid_steps: int
    fluid_step: float
    substeps: int
    ledger_error: float

    @property
    def total_seconds(self) -> float:
        """Wall time in all [s]."""
        return sum(self.seconds.values())


class OutOfTime(Exception):
    """A trial was given up because its time was over; holds the seconds that it took."""

    def __init__(self, seconds: float):
        super().__init__(f"{seconds:.1f} s")
        self.seconds = seconds


def film_seconds(scene: Scene) -> float:
    """Playback time of the scene's film [s]."""
    return max(scene.time.frames - 1, 1) / scene.time.fps


def trial_scene(scene: Scene, playback: float) -> Scene:
    """The scene of all trials: the whole plant time, few frames, nothing drawn.

    Args:
        scene: The user's scene.
        playback: Playback time [s] in which the leaf dries. A film shorter than the scene's costs fewer
            motion substeps; inertia counts for more in it.
    """
    frames = max(2, min(SAMPLED_FRAMES, scene.time.frames))
    fps = min((frames - 1) / playback, HIGHEST_FPS)
    longer = max(1.0, scene.time.fps / fps)
    substeps = scene.solver.maximum_substeps
    return scene.with_changes(
        {
            "time.frames": frames,
            "time.fps": fps,
            "output.contact_sheet": False,
            "output.display_color": False,
            "solver.maximum_substeps": min(HIGHEST_SUBSTEPS, math.ceil(substeps * longer)),
        }
    )


def with_setting(scene: Scene, setting: Setting) -> Scene:
    """The scene computed with a setting."""
    return scene.with_changes(
        {
            "maps.size": setting.map_size,
            "fluid.step": setting.step,
            "fluid.scheme": setting.scheme,
            "solver.precision": setting.precision,
        }
    )


def run_trial(scene: Scene, leaf: Leaf, setting: Setting, device: str, deadline: float = np.inf) -> Trial:
    """Compute a setting.

    Args:
        scene: From :func:`trial_scene`.
        leaf: The leaf with maps of the setting's size.
        setting: The setting.
        device: Warp device.
        deadline: Reading of ``time.perf_counter`` after which no further frame is begun.

    Raises:
        OutOfTime: The deadline passed.
        SimulationError: The setting cannot be computed.
    """
    begin = time.perf_counter()
    simulation = Simulation(with_setting(scene, setting), leaf, device)
    points, water = [], []
    for frame in simulation.frames():
        points.append(frame.points)
        water.append(frame.water)
        if time.perf_counter() > deadline and frame.index < scene.time.frames:
            raise OutOfTime(time.perf_counter() - begin)
    return Trial(
        setting=setting,
        points=np.stack(points),
        water=np.stack(water),
        seconds={
            **{name: simulation.watch.seconds.get(name, 0.0) for name in ("start", "settle", "motion", "frame")},
            **{group: simulation.group_seconds(group) for group in ("fluid", "coupling")},
        },
        fluid_steps=simulation.fluid.steps_done,
        fluid_step=simulation.fluid.steps.length,
        substeps=sum(simulation.substeps),
        ledger_error=simulation.fluid.ledger().error,
    )
