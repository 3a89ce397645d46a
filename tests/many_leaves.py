"""Scenes of many leaves, small enough to run in a second."""

from __future__ import annotations

from pathlib import Path

from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation

VARIED = {"size": 0.3, "stiffness": 0.3, "water": 0.2, "turn": 180.0, "tilt": 30.0, "roll": 30.0}


FRAMES = 3


def changed(path: Path, **changes) -> Scene:
    plain = {"output.contact_sheet": False, "maps.size": 32}
    return load_scene(path).with_changes(plain | {key.replace("__", "."): value for key, value in changes.items()})


def computed(scene: Scene, leaf, device: str) -> tuple[Simulation, list]:
    simulation = Simulation(scene, leaf, device)
    return simulation, list(simulation.frames(FRAMES))
