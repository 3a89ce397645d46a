"""Leaves of a known shape instead of a photo's, and their springs bound to a device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from leafwarp.leaf.leaf import Leaf, LeafMesh, MapFrame
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.scene import Scene
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages
from leafwarp.sim.stage import Stage


def leaf_of(mesh: LeafMesh, length: float | None = None, **maps: Any) -> Leaf:
    """A leaf on a mesh; its base is the origin. Without maps unless ``mask`` and ``maps`` are given."""
    reach = np.hypot(*mesh.positions.T).max() if length is None else length
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return Leaf(mesh, MapFrame(tuple(low), tuple(high - low)), float(reach), np.zeros((2, 2, 3), np.uint8), **maps)


def scene_of(structure: dict | None = None, motion: dict | None = None, **tables: dict) -> Scene:
    """A scene with prescribed, constant water (unless ``fluid`` is given) and a plain membrane (unless ``material``
    is); the tables add to or replace plain ones."""
    data = {
        "leaf": {"image": "leaf.png", "length": 0.1, "camber": 0.0},
        "time": {"duration": 1.0},
        "water": {"curve": [[0.0, 1.0]]},
        "structure": ({} if "material" in tables else {"membrane_stiffness": 5.0}) | (structure or {}),
        "motion": {"drag": 0.0} | (motion or {}),
    }
    if "fluid" in tables:
        del data["water"]
    for name, table in tables.items():
        data[name] = data.get(name, {}) | table
    return Scene.model_validate(data)


def strip_triangles(
    length: float = 0.1,
    width: float = 0.02,
    columns: int = 20,
    jitter: float = 0.0,
    seed: int = 0,
    rows: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and triangles of a strip along x from the origin, nearly equilateral, with flat ends.

    Args:
        length: Extent along x [m].
        width: Extent along y, centred on the x axis [m].
        columns: Edges along the strip.
        jitter: How far inner vertices are moved at random, as a share of the edge length.
        seed: Seed of the jitter.
        rows: Rows of triangles, an even number; default: so that they are nearly equilateral.
    """
    spacing = length / columns
    rows = rows or max(2, 2 * round(width / (spacing * 0.75**0.5) / 2))
    positions, index = [], {}
    for j in range(rows + 1):
        xs = [i * spacing for i in range(columns + 1)]
        if j % 2 != (rows // 2) % 2:
            xs = [0.0, *((i + 0.5) * spacing for i in range(columns)), length]
        for i, x in enumerate(xs):
            index[j, i] = len(positions)
            positions.append((x, (j / rows - 0.5) * width))
    triangles = []
    for j in range(rows):
        low, high = ([index[k, i] for i in range(columns + 2) if (k, i) in index] for k in (j, j + 1))
        a = b = 0
        while a < len(low) - 1 or b < len(high) - 1:
            step_low = a < len(low) - 1 and (
                b == len(high) - 1 or positions[low[a + 1]][0] <= positions[high[b + 1]][0]
            )
            if step_low:
                triangles.append((low[a], low[a + 1], high[b]))
                a += 1
            else:
                triangles.append((low[a], high[b + 1], high[b]))
                b += 1
    positions = np.array(positions)
    inner = (positions[:, 0] > 0) & (positions[:, 0] < length) & (np.abs(positions[:, 1]) < 0.499 * width)
    random = np.random.default_rng(seed)
    positions[inner] += jitter * spacing * random.uniform(-1.0, 1.0, (inner.sum(), 2))
    return positions, np.array(triangles)


def strip(**shape: float) -> Leaf:
    """A leaf in the shape of :func:`strip_triangles`."""
    positions, triangles = strip_triangles(**shape)
    return leaf_of(mesh_from_triangles(positions, triangles), shape.get("length", 0.1))


STIFFNESS = {"edge_springs": "edge_stiffness", "angular_springs": "hinge_stiffness"}


@dataclass
class Rig:
    """A leaf's springs on a device, without water."""

    scene: Scene
    leaf: Leaf
    state: State
    stages: tuple[Stage, ...]

    def stage(self, name: str) -> Stage:
        """The stage of a name."""
        return next(stage for stage in self.stages if stage.name == name)

    def put(self, **arrays: Any) -> None:
        """Fill arrays of the state."""
        for name, values in arrays.items():
            self.state.upload(name, np.asarray(values))

    def get(self, name: str) -> np.ndarray:
        """An array of the state; real numbers as float64."""
        values = self.state[name].numpy()
        return values.astype(np.float64) if values.dtype.kind == "f" else values

    def forces(self, *names: str) -> np.ndarray:
        """Forces of the named stages together [N].

        On a CPU both springs of an edge are computed together: the kind that is not asked for has no stiffness
        meanwhile.
        """
        present = [stage.name for stage in self.stages if stage.name in STIFFNESS]
        kept = {}
        if not set(names).isdisjoint(present):
            kept = {STIFFNESS[name]: self.get(STIFFNESS[name]) for name in present if name not in names}
            names = (*present, *(name for name in names if name not in present))
        self.put(**{name: np.zeros_like(values) for name, values in kept.items()})
        self.state["force"].zero_()
        for name in names:
            self.stage(name).run()
        self.put(**kept)
        return self.get("force")


def rig_of(scene: Scene, leaf: Leaf, device: str, precision: str) -> Rig:
    """The springs of a scene's explicit motion, bound to a device."""
    stages, _ = make_stages(scene, leaf, "motion")
    state = State([spec for stage in stages for spec in stage.arrays], device, precision)
    for stage in stages:
        stage.bind(state)
    return Rig(scene, leaf, state, stages)


def flat(leaf: Leaf) -> np.ndarray:
    """The leaf's positions in the plane z = 0 [m], shape [vertex_count, 3]."""
    return np.column_stack((leaf.mesh.positions, np.zeros(leaf.mesh.vertex_count)))


def crumpled(leaf: Leaf, amount: float, seed: int = 0) -> np.ndarray:
    """Positions of a leaf shaken by a share of its mean edge length, in all directions [m]."""
    along = np.subtract(*leaf.mesh.positions[leaf.mesh.edges.T])
    spacing = np.linalg.norm(along, axis=1).mean()
    return flat(leaf) + amount * spacing * np.random.default_rng(seed).uniform(-1, 1, (leaf.mesh.vertex_count, 3))


def rotation(axis: Any, angle: float) -> np.ndarray:
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
