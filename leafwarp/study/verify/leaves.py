"""Whole leaves, simulated as a scene asks for: their curl, droop and shrinking."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.mesh.triangulate import fill_leaf
from leafwarp.scene import Scene
from leafwarp.sim.simulation import Simulation
from leafwarp.study.verify.beams import POISSON, curvature_along
from leafwarp.study.verify.case import Check, near, near_share
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of

LENGTH, WIDTH = 0.1, 0.05  # [m]
THICKNESS = 1.5e-4  # [m]
MODULUS = 4e8  # [Pa]
MIDVEIN = 6e-3  # width of the midvein [m]: some edges, or the lamina's own curl between its hinges bends it, too
CELLS = (64, 128)  # rows and columns of the maps
MESHES = (500, 1700, 8000)
MESH_TOLERANCE = {500: 0.10, 1700: 0.04}
STRUCTURE = {
    "membrane_stiffness": MODULUS * THICKNESS,
    "bending_stiffness": MODULUS * THICKNESS**3 / (12.0 * (1.0 - POISSON**2)),
    "vein_stiffness": 3.0,
    "dry_mass": 0.05,
    "water_mass": 0.15,
}
STIFF_MIDVEIN = {"vein_stiffness": 10.0, "vein_bending_stiffness": 50.0}


@cache
def blade(vertices: int) -> Leaf:
    """An ovate blade along x with a midvein that tapers off toward the tip."""
    s = 0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, 200)))
    half = s**0.6 * (1.0 - s) ** 0.8
    half *= 0.5 * WIDTH / half.max()
    right, left = np.column_stack((LENGTH * s, -half)), np.column_stack((LENGTH * s, half))
    outline = np.concatenate([right, left[-2:0:-1]])
    mesh = fill_leaf(outline, np.array([LENGTH, 0.0]), vertices).mesh
    leaf = leaf_of(mesh, LENGTH)
    (rows, columns), (left_edge, low), (width, height) = CELLS, leaf.frame.origin, leaf.frame.size
    x = left_edge + (np.arange(columns) + 0.5) / columns * width
    y = low + (np.arange(rows) + 0.5) / rows * height
    edge = np.interp(x / LENGTH, s, half)
    mask = np.abs(y)[:, None] < np.maximum(edge, 1.01 * height / rows)[None, :]
    taper = np.clip(3.0 - 3.0 * x / LENGTH, 0.0, 1.0)[None, :]
    midvein = np.clip(1.0 + (0.5 * MIDVEIN * taper - np.abs(y)[:, None]) * rows / height, 0.0, 1.0)
    return leaf_of(mesh, LENGTH, mask=mask, maps={"venation": np.where(mask, midvein, 0.0)})


def _scene(
    frames: int = 2, load: dict[str, Any] | None = None, structure: dict[str, float] | None = None, **tables: Any
) -> Scene:
    """A quasistatic scene of the blade that dries from saturation to nothing, alike everywhere.

    Args:
        frames: Number of frames.
        load: Further keys of [motion].
        structure: Further keys of [structure].
        tables: Further tables.
    """
    return scene_of(
        None if "material" in tables else STRUCTURE | (structure or {}),
        {"method": "quasistatic", "pin_radius": 0.1 * LENGTH} | (load or {}),
        leaf={"length": LENGTH, "camber": 0.01},
        time={"duration": 1.0, "frames": frames},
        water={"curve": [[0.0, 1.0], [1.0, 0.0]]},
        **tables,
    )


def _curl(curvature: float, vein_resistance: float) -> dict[str, Any]:
    """The table of a curl of the dry lamina to a curvature of two free layers [1/m]."""
    mismatch = curvature * THICKNESS / 1.5
    return {"mismatch": [[0.0, mismatch], [1.0, 0.0]], "thickness": THICKNESS, "vein_resistance": vein_resistance}


def midvein_curl(device: str) -> list[Check]:
    """The blade rolls up about its midvein: ``(1 + nu) 1.5 de/h`` across, since it cannot bend along."""
    largest, frames = 40.0, 6
    leaf = blade(4000)
    scene = _scene(frames, structure=STIFF_MIDVEIN, curl=_curl(largest, 1.0))
    x, y = leaf.mesh.positions.T
    # Half of the lamina, but for what the midvein and the margin disturb.
    inside = (np.abs(x - 0.5 * LENGTH) < 0.2 * LENGTH) & (y > 0.12 * WIDTH) & (y < 0.36 * WIDTH)
    frames_points = [frame.points.astype(float) for frame in Simulation(scene, leaf, device).frames()]
    across = np.array([curvature_along(leaf.mesh.positions, points, inside)[1] for points in frames_points])
    across -= across[0]
    free = largest * np.linspace(0.0, 1.0, frames)
    slope = (free @ across) / (free @ free)
    checks = [
        near(f"mismatch {100 * k * THICKNESS / 1.5:.2g} %: curvature / that of the largest", k / largest, got, 0.02)
        for k, got in zip(free[1:], across[1:] / (slope * largest), strict=True)
    ]
    return [*checks, near_share("curvature / (1.5 de/h)", 1.0 + POISSON, slope, 0.1)]


@cache
def droop_and_curl(vertices: int, device: str) -> tuple[float, float]:
    """Drop of the tip under gravity, and root mean square height of the dry blade without it, over its length."""
    leaf = blade(vertices)
    tip = int(np.argmax(leaf.mesh.positions[:, 0]))
    drooping = Simulation(_scene(load={"gravity": (0.0, 0.0, -9.81), "settle": True}), leaf, device)
    drooping.settle()
    drop = -float(drooping.read_frame(1).points[tip, 2]) / LENGTH
    curled = Simulation(_scene(frames=4, curl=_curl(15.0, 0.5)), leaf, device)
    heights = [frame.points[:, 2].astype(float) for frame in curled.frames()][-1]
    areas = leaf.mesh.vertex_areas
    return drop, float(np.sqrt((heights**2 @ areas) / areas.sum()) / LENGTH)


def mesh_independence(device: str) -> list[Check]:
    """The same blade on coarser meshes."""
    fine = droop_and_curl(MESHES[-1], device)
    checks = []
    for vertices, tolerance in MESH_TOLERANCE.items():
        names = ("drop of the tip / length", "height of the curl / length")
        for name, expected, got in zip(names, fine, droop_and_curl(vertices, device), strict=True):
            checks.append(near_share(f"{vertices} against {MESHES[-1]} vertices: {name}", expected, got, tolerance))
    return checks


def area_loss(device: str) -> list[Check]:
    """A leaf of the default material, saturated, and dried altogether."""
    leaf = blade(1700)
    simulation = Simulation(_scene(frames=6, material={}), leaf, device)
    areas = [_surface(frame.points.astype(float), leaf.mesh.triangles) for frame in simulation.frames()]
    return [near("share of the area that is lost", 0.22, 1.0 - areas[-1] / areas[0], 0.08)]


def _surface(points: np.ndarray, triangles: np.ndarray) -> float:
    """Area of a surface [m^2]."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
