"""The potential that a step of implicit motion minimises: its energy, gradient and Hessian, in float64."""

from __future__ import annotations

import numpy as np

from leafwarp.sim.implicit.potential import Potential
from leafwarp.study.verify.case import Check, near
from leafwarp.study.verify.drawn_leaf import Rig, crumpled, flat, rig_of, rotation, scene_of, strip
from leafwarp.study.verify.forces import angles_of, edge_energy, gradient, hinge_energy

STRUCTURE = {"bending_stiffness": 1e-6, "damping": 0.0}
# Roundings of sums of forces and energies; what differences of fourth order are good to at the steps below.
ROUNDING, DIFFERENCE = 1e-12, 1e-8
STEP = 2e-6  # of a difference of energies [m]
SHARE = 2e-5  # of a difference of gradients, of a random direction's length


def _crumpled_rig(device: str, amount: float) -> tuple[Rig, Potential, np.ndarray]:
    """A crumpled strip that nothing holds, its springs neither at rest nor alike, and its positions [m]."""
    leaf = strip(columns=6, jitter=0.15)
    rig = rig_of(scene_of(STRUCTURE, {"method": "implicit"}), leaf, device, "float64")
    random, mesh = np.random.default_rng(3), leaf.mesh
    positions = crumpled(leaf, amount)
    rig.put(
        pinned=np.zeros(mesh.vertex_count, bool),
        edge_target_length=rig.get("edge_rest_length") * random.uniform(0.95, 1.05, mesh.edge_count),
        edge_strength=rig.get("edge_stiffness") * random.uniform(0.5, 2.0, mesh.edge_count),
        hinge_target_angle=random.uniform(-1.0, 1.0, mesh.hinge_count),
        hinge_strength=rig.get("hinge_stiffness") * random.uniform(0.5, 2.0, mesh.hinge_count),
        # A hinge's angle is continued from the one it had; without folds beyond half a turn it may start anywhere.
        hinge_angle=angles_of(positions, mesh.hinges),
        **_pulls(mesh.vertex_count, 0.0),
    )
    return rig, rig.stage("implicit_motion").potential, positions


def _pulls(count: int, size: float) -> dict[str, np.ndarray]:
    """Inertia, goals and loads at random, none of a size of 0."""
    random = np.random.default_rng(4)
    return {
        "inertia": size * random.uniform(0.1, 1.0, count),
        "goal": 1e-2 * random.normal(size=(count, 3)),
        "load": 1e-3 * size * random.normal(size=(count, 3)),
    }


def _springs_energy(rig: Rig, positions: np.ndarray) -> float:
    """Energy of the springs, inertia and loads by NumPy [J]."""
    mesh, values = rig.leaf.mesh, {name: rig.get(name) for name in ("inertia", "goal", "load")}
    away = positions - values["goal"]
    return (
        edge_energy(positions, mesh, rig.get("edge_target_length"), rig.get("edge_strength"))
        + hinge_energy(positions, mesh, rig.get("hinge_target_angle"), rig.get("hinge_strength"))
        + 0.5 * float(values["inertia"] @ (away**2).sum(axis=1))
        - float((values["load"] * positions).sum())
    )


def _whole(potential: Potential) -> np.ndarray:
    """The Hessian of all vertices from its blocks, shape [3 vertex_count, 3 vertex_count]."""
    pattern, blocks, count = potential.pattern, potential.blocks(convex=False), potential.vertex_count
    whole = np.zeros((count, count, 3, 3))
    whole[pattern.rows, pattern.columns] = blocks
    whole[pattern.columns, pattern.rows] = blocks.transpose(0, 2, 1)
    return whole.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count)


def implicit_potential(device: str) -> list[Check]:
    """The potential of a strip crumpled little and much, pulled and loaded at random; then its springs alone."""
    checks = []
    for amount in (0.02, 0.25):
        rig, potential, positions = _crumpled_rig(device, amount)
        name = f"crumpled by {amount:g} edges: "
        rig.put(**_pulls(potential.vertex_count, 1.0))
        checks += _derivatives(name, rig, potential, positions)
        rig.put(**_pulls(potential.vertex_count, 0.0))
        checks += _invariances(name, rig, potential, positions)
    return checks


def _derivatives(name: str, rig: Rig, potential: Potential, positions: np.ndarray) -> list[Check]:
    """Energy, gradient and Hessian against NumPy's energy, and each against differences of the one before."""
    expected = _springs_energy(rig, positions)
    here = potential.evaluate(positions)
    slopes = gradient(lambda x: _springs_energy(rig, x), positions, STEP)
    # The Hessian is taken here, with the tensions that are here.
    potential.accept()
    potential.expect_tensions(np.zeros_like(positions))
    direction = np.random.default_rng(5).normal(size=positions.shape)
    direction *= 1e-2 / np.linalg.norm(direction)
    product = potential.product(direction)
    assembled = (_whole(potential) @ direction.ravel()).reshape(positions.shape)
    moved = [potential.evaluate(positions + k * SHARE * direction).gradient for k in (-2, -1, 1, 2)]
    difference = (moved[0] - 8.0 * moved[1] + 8.0 * moved[2] - moved[3]) / (12.0 * SHARE)
    return [
        near(f"{name}energy over that of the springs, less 1", 0.0, here.energy / expected - 1.0, ROUNDING),
        near(f"{name}|grad - differences of the energy| / |grad|", 0.0, _apart(here.gradient, slopes), DIFFERENCE),
        near(f"{name}|H v - differences of grad| / |H v|", 0.0, _apart(product, difference), DIFFERENCE),
        near(f"{name}|H v by blocks - H v| / |H v|", 0.0, _apart(assembled, product), ROUNDING),
    ]


def _invariances(name: str, rig: Rig, potential: Potential, positions: np.ndarray) -> list[Check]:
    """Net force and torque, and what a turn of the whole strip does."""
    here = potential.evaluate(positions)
    size = np.abs(here.gradient).sum()
    torque = np.cross(positions - positions.mean(axis=0), here.gradient).sum(axis=0)
    turn, way = rotation([0.3, 1.0, 0.2], 1.3), np.array([0.01, -0.02, 0.03])
    turned = potential.evaluate(positions @ turn.T + way)
    mesh = rig.leaf.mesh
    stressed = {key: rig.get(key) for key in ("edge_target_length", "hinge_target_angle")}
    rig.put(edge_target_length=rig.get("edge_rest_length"), hinge_target_angle=np.zeros(mesh.hinge_count))
    rig.put(hinge_angle=np.zeros(mesh.hinge_count))
    moved = potential.evaluate(flat(rig.leaf) @ turn.T + way)
    rig.put(hinge_angle=angles_of(positions, mesh.hinges), **stressed)
    largest = np.abs(here.gradient).max()
    return [
        near(f"{name}net force / sum of |F|", 0.0, np.linalg.norm(here.gradient.sum(axis=0)) / size, ROUNDING),
        near(f"{name}net torque / (sum of |F| length)", 0.0, np.linalg.norm(torque) / size / rig.leaf.length, ROUNDING),
        near(f"{name}energy after a turn, over that before, less 1", 0.0, turned.energy / here.energy - 1.0, ROUNDING),
        near(
            f"{name}forces after a turn, of the largest", 0.0, _apart(turned.gradient, here.gradient @ turn.T), ROUNDING
        ),
        near(
            f"{name}force of a flat strip moved, of a crumple's", 0.0, np.abs(moved.gradient).max() / largest, ROUNDING
        ),
    ]


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two fields over the largest value of the second."""
    return float(np.abs(one - other).max() / np.abs(other).max())
