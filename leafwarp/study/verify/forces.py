"""Forces of the springs against their energy, their momentum and rigid motions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leafwarp.leaf.leaf import LeafMesh
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.study.verify.case import Check, near
from leafwarp.study.verify.drawn_leaf import Rig, crumpled, flat, leaf_of, rig_of, rotation, scene_of, strip

# Largest error of a result next to its largest value: some tens of roundings of differences of positions.
ROUNDING = {"float32": 2e-4, "float64": 1e-11}
# The same where a finite difference is the reference, which is itself good to 1e-9 (lengths) and 1e-8 (angles).
DIFFERENCE = {
    "edge_springs": {"float32": 2e-4, "float64": 1e-9},
    "angular_springs": {"float32": 2e-4, "float64": 1e-8},
}
SPRINGS = {"edge_springs": "edge springs", "angular_springs": "angular springs"}


def _shaken(device: str, precision: str, amount: float = 0.25, damping_time: float = 0.0) -> tuple[Rig, np.ndarray]:
    """A crumpled strip that moves, and its positions as the precision holds them [m]."""
    scene = scene_of({"bending_stiffness": 1e-6, "damping": 0.1})
    rig = rig_of(scene, strip(columns=6, jitter=0.15), device, precision)
    count = rig.leaf.mesh.vertex_count
    rig.put(position=crumpled(rig.leaf, amount), velocity=np.random.default_rng(1).normal(size=(count, 3)))
    rig.put(damping_time=[damping_time])
    return rig, rig.get("position")


def angles_of(positions: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Signed angle of each hinge [rad] from the directions of its two triangles in the plane across the edge."""
    a, b, c, d = np.moveaxis(positions[hinges], 1, 0)
    axis = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    first, second = ((side - a) - ((side - a) * axis).sum(axis=1)[:, None] * axis for side in (c, d))
    # How far the continuation of the first triangle is turned about the edge to become the second.
    return np.arctan2((axis * np.cross(second, -first)).sum(axis=1), (-first * second).sum(axis=1))


def edge_energy(positions: np.ndarray, mesh: LeafMesh, rest: np.ndarray, stiffness: np.ndarray) -> float:
    """Energy of the edge springs, ``k/2 (L - l)^2`` [J]."""
    lengths = np.linalg.norm(np.subtract(*positions[mesh.edges.T]), axis=1)
    return float(0.5 * np.sum(stiffness * (lengths - rest) ** 2))


def hinge_energy(positions: np.ndarray, mesh: LeafMesh, rest: np.ndarray, stiffness: np.ndarray) -> float:
    """Energy of the angular springs, ``k/2 (theta - theta0)^2`` [J]."""
    return float(0.5 * np.sum(stiffness * (angles_of(positions, mesh.hinges) - rest) ** 2))


def gradient(function: Callable[[np.ndarray], float], positions: np.ndarray, step: float) -> np.ndarray:
    """Central difference of a scalar function of the positions, of fourth order."""
    result = np.zeros_like(positions)
    for index in np.ndindex(*positions.shape):
        values = []
        for k in (-2, -1, 1, 2):
            moved = positions.copy()
            moved[index] += k * step
            values.append(function(moved))
        result[index] = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
    return result


def force_gradient(device: str) -> list[Check]:
    """Edge springs crumpled, and angular springs with rest angles of up to 1 rad crumpled little and much."""
    checks = []
    for precision in ROUNDING:
        for stage, energy, kind, amount, step in (
            ("edge_springs", edge_energy, "edge_rest_length", 0.25, 1e-5),
            ("angular_springs", hinge_energy, "hinge_rest_angle", 0.02, 2e-6),
            ("angular_springs", hinge_energy, "hinge_rest_angle", 0.3, 2e-6),
        ):
            rig, positions = _shaken(device, precision, amount)
            mesh = rig.leaf.mesh
            if kind == "hinge_rest_angle":
                rig.put(hinge_rest_angle=np.random.default_rng(2).uniform(-1, 1, mesh.hinge_count))
            rest, stiffness = rig.get(kind), rig.get(kind.split("_")[0] + "_stiffness")
            expected = -gradient(lambda x, e=energy, m=mesh, r=rest, k=stiffness: e(x, m, r, k), positions, step)
            error = np.abs(rig.forces(stage) - expected).max() / np.abs(expected).max()
            name = f"{SPRINGS[stage]} crumpled by {amount:g} edges, {precision}: |F + grad E| / |F|"
            checks.append(near(name, 0.0, error, DIFFERENCE[stage][precision]))
    return checks


def momentum(device: str) -> list[Check]:
    """Springs and their damping on a crumpled strip that moves at random."""
    checks = []
    for precision in ROUNDING:
        rig, positions = _shaken(device, precision, damping_time=1e-3)
        # Roundings of the forces, which do not all point the same way.
        tolerance = 1e-2 * ROUNDING[precision]
        for stage, name in SPRINGS.items():
            forces = rig.forces(stage)
            size = np.abs(forces).sum()
            force = np.linalg.norm(forces.sum(axis=0)) / size
            torque = np.linalg.norm(np.cross(positions - positions.mean(axis=0), forces).sum(axis=0))
            checks.append(near(f"{name}, {precision}: net force / sum of |F|", 0.0, force, tolerance))
            torque /= size * rig.leaf.length
            checks.append(near(f"{name}, {precision}: net torque / (sum of |F| length)", 0.0, torque, tolerance))
    return checks


def rigid_motion(device: str) -> list[Check]:
    """A strip turned, moved and spinning; and the forces of a crumpled one before and after a turn."""
    checks = []
    for precision, tolerance in ROUNDING.items():
        rig, positions = _shaken(device, precision, damping_time=1e-2)
        crumpled_forces = {stage: rig.forces(stage) for stage in SPRINGS}
        turn = rotation([0.3, 1.0, 0.2], 1.3)
        rig.put(position=positions @ turn.T, velocity=rig.get("velocity") @ turn.T)
        turned = {stage: rig.forces(stage) for stage in SPRINGS}
        turn_more = rotation([1.0, 2.0, -0.5], 2.1)
        rig.put(position=flat(rig.leaf) @ turn_more.T + np.array([0.01, -0.02, 0.03]))
        rig.put(velocity=np.cross([3.0, -1.0, 2.0], rig.get("position")) + np.array([0.1, 0.2, 0.3]))
        for stage, name in SPRINGS.items():
            before = crumpled_forces[stage] @ turn.T
            error = np.abs(turned[stage] - before).max() / np.abs(before).max()
            checks.append(near(f"{name}, {precision}: forces after a turn, of the largest", 0.0, error, tolerance))
            moved = np.abs(rig.forces(stage)).max() / np.abs(before).max()
            checks.append(near(f"{name}, {precision}: force of a rigid motion, of a crumple's", 0.0, moved, tolerance))
    return checks


def fold_angle(device: str) -> list[Check]:
    """Two triangles folded step by step; measured by the angular springs' kernel."""
    height, side = 0.75**0.5, 1e-2
    mesh = mesh_from_triangles(
        side * np.array([[0, 0], [1, 0], [0.5, height], [0.5, -height]]), np.array([[0, 1, 2], [1, 0, 3]])
    )
    checks = []
    for precision, rounding in ROUNDING.items():
        rig = rig_of(scene_of({"bending_stiffness": 1e-6, "damping": 0.0}), leaf_of(mesh), device, precision)
        angles = np.linspace(-3.14, 3.14, 41)
        error = np.abs([_measured_angle(rig, angle) - angle for angle in angles]).max()
        tolerance = 0.1 * rounding
        checks.append(near(f"{precision}: measured less true fold, -3.14 to 3.14 rad", 0.0, error, tolerance))
        for name, center in (("flat", 0.0), ("a quarter turn", np.pi / 2), ("nearly half a turn", 3.0)):
            jump = 0.0
            for sign in (1.0, -1.0):
                steps = sign * center + 1e-3 * np.linspace(-1, 1, 21)
                measured = [_measured_angle(rig, angle) for angle in steps]
                jump = max(jump, np.abs(np.diff(measured) - np.diff(steps)).max())
            checks.append(near(f"{precision}: jump through {name}, up and down [rad]", 0.0, jump, tolerance))
    return checks


def _measured_angle(rig: Rig, angle: float) -> float:
    """What the kernel says of a fold [rad]: each triangle turned up by half of it about their edge."""
    positions = flat(rig.leaf)
    for vertex in (2, 3):
        y = positions[vertex, 1]
        positions[vertex, 1:] = y * np.cos(angle / 2), abs(y) * np.sin(angle / 2)
    rig.put(position=positions, hinge_angle=[0.0])
    rig.stage("angular_springs").run()
    return float(rig.get("hinge_angle")[0])
