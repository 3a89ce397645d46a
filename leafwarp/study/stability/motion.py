"""Sweeps of the motion: stiffness, load, shape, size and place of a leaf, for each method."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.sim import material
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.equilibrium import equilibrium
from leafwarp.sim.limits import FARTHEST_TRAVEL
from leafwarp.sim.motion import make_motion
from leafwarp.sim.simulation import Simulation
from leafwarp.study.stability.point import Finding, Trial, decades
from leafwarp.study.verify.drawn_leaf import Rig, crumpled, flat, leaf_of, rig_of, scene_of, strip_triangles
from leafwarp.study.verify.forces import angles_of, edge_energy

# Implicit and quasistatic motion are always of float64.
METHODS = (("explicit", "float32"), ("explicit", "float64"), ("implicit", "float64"), ("quasistatic", "float64"))
MOVING = METHODS[:3]
# Largest error of a shape that counts as none, as a share of the leaf's length.
VISIBLE = 0.01
FPS = 24.0
FRAMES = 4
LENGTH, WIDTH = 0.1, 0.02  # of the strip [m]
# A soft membrane, as explicit motion wants it, under a gravity that goes with its bending stiffness.
MEMBRANE, BENDING = 5.0, 1e-5  # [N/m], [N m]
GRAVITY, STANDARD_GRAVITY = 0.1, 9.81  # [m/s^2]
STIFF_MEMBRANE = 1000.0  # [N/m]: bears its own weight


@cache
def _strip(length: float = LENGTH) -> Leaf:
    """The strip of 35 vertices, for a length of 0.1 m 2 cm wide."""
    positions, triangles = strip_triangles(LENGTH, WIDTH, columns=10)
    return leaf_of(mesh_from_triangles(length / LENGTH * positions, triangles), length)


def _rig(
    method: str, precision: str, device: str, leaf: Leaf, structure: dict[str, Any], motion: dict[str, Any]
) -> Rig:
    scene = scene_of(structure, {"method": method} | motion, leaf={"length": leaf.length}, time={"fps": FPS})
    return rig_of(scene, leaf, device, precision)


def _play(rig: Rig, *, settle: bool) -> None:
    """Let the leaf come to rest, where asked to, and move on for some frames."""
    motion = make_motion(rig.scene, rig.leaf, rig.state, rig.stages)
    if settle:
        motion.settle()
    for frame in range(1, FRAMES + 1):
        motion.advance(1.0 / FPS, frame)


def _faults(rig: Rig, start: np.ndarray) -> tuple[str, ...]:
    """What no frame may be, given where it began [m]."""
    position, velocity = rig.get("position"), rig.get("velocity")
    if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
        return ("a position or a speed is not a finite number",)
    length = rig.leaf.length
    # A leaf that is held swings within its length; one that starts crumpled, within what it was crumpled by, too.
    bound = FARTHEST_TRAVEL * max(length, float(np.linalg.norm(start - start.mean(axis=0), axis=1).max()))
    farthest = float(np.linalg.norm(position - start, axis=1).max())
    faults = () if farthest <= bound else (f"a vertex is {farthest:.3g} m off, on a leaf of {length:.3g} m",)
    pinned = rig.get("pinned").astype(bool)
    if not np.array_equal(position[pinned], start[pinned]):
        faults += ("a vertex that is held has moved",)
    return faults


def _off_rest(rig: Rig, shift: np.ndarray | float = 0.0) -> tuple[float, str]:
    """Way to the nearest equilibrium downhill, in float64, as a share of the length, and why it is not known.

    Args:
        rig: A leaf in some shape.
        shift: How far it has been moved as a whole [m].
    """
    scene, mesh = rig.scene, rig.leaf.mesh
    rest = material.rest_positions(scene, rig.leaf)
    shape = rig.get("position") - shift
    try:
        found = equilibrium(
            shape,
            mesh.edges,
            material.edge_lengths(mesh, rest),
            material.edge_stiffness(mesh, scene.structure.membrane_stiffness),
            hinges=mesh.hinges,
            rest_angles=material.dihedral_angles(mesh, rest),
            hinge_stiffness=material.hinge_stiffness(mesh, scene.structure.bending_stiffness),
            masses=rig.get("mass"),
            pinned=rig.get("pinned").astype(bool),
            gravity=scene.motion.gravity,
            tolerance=1e-8,
            device=str(rig.state.device),
        ).positions
    except NotConverged as error:
        return math.inf, f"no equilibrium is known to compare with: {error}"
    return float(np.linalg.norm(shape - found, axis=1).max() / rig.leaf.length), ""


def _at_rest(rig: Rig, shift: np.ndarray | float = 0.0) -> Finding:
    """Settle a leaf, play some frames, and see how far off its equilibrium it is.

    Args:
        rig: The leaf.
        shift: How far it is moved as a whole first [m].
    """
    rig.put(position=flat(rig.leaf) + shift)
    start = rig.get("position")  # as the precision holds it
    _play(rig, settle=True)
    if faults := _faults(rig, start):
        return Finding(0.0, faults)
    error, note = _off_rest(rig, shift)
    return Finding(error, (), note)


def _trials(
    values: Iterable[float],
    compute: Callable[[float, str, str], Finding],
    methods: tuple[tuple[str, str], ...] = METHODS,
    tolerance: float = VISIBLE,
) -> Iterator[Trial]:
    """A trial for every method and number; compute takes them in the order number, method, precision."""
    for method, precision in methods:
        for value in values:
            call = partial(compute, value, method, precision)
            yield Trial(method, precision, value, tolerance, call)


def stiffness(device: str) -> Iterator[Trial]:
    """A clamped strip under its own weight, from far too soft to far too stiff."""

    def hang(factor: float, method: str, precision: str) -> Finding:
        structure = {"membrane_stiffness": MEMBRANE * factor, "bending_stiffness": BENDING * factor}
        load = {"gravity": [0.0, 0.0, -GRAVITY], "clamp": True, "drag": 2.0}
        return _at_rest(_rig(method, precision, device, _strip(), structure, load))

    return _trials(decades([-9, -7, *range(-5, 6), 7, 9]), hang)


def gravity(device: str) -> Iterator[Trial]:
    """A clamped strip under more and more weight."""

    def hang(load: float, method: str, precision: str) -> Finding:
        structure = {"membrane_stiffness": STIFF_MEMBRANE, "bending_stiffness": BENDING}
        motion = {"gravity": [0.0, 0.0, -STANDARD_GRAVITY * load], "clamp": True, "drag": 2.0}
        return _at_rest(_rig(method, precision, device, _strip(), structure, motion))

    return _trials(decades(range(-3, 4)), hang)


def leaf_length(device: str) -> Iterator[Trial]:
    """The clamped strip at any size, with the stiffness that makes it hang alike: all lengths in proportion."""

    def hang(length: float, method: str, precision: str) -> Finding:
        size = length / LENGTH
        structure = {"membrane_stiffness": MEMBRANE * size, "bending_stiffness": BENDING * size**3}
        motion = {"gravity": [0.0, 0.0, -GRAVITY], "clamp": True, "drag": 2.0}
        return _at_rest(_rig(method, precision, device, _strip(length), structure, motion))

    return _trials(decades(range(-4, 3)), hang)


def distance(device: str) -> Iterator[Trial]:
    """The clamped strip away from the origin, about which the simulation computes a leaf."""

    def hang(way: float, method: str, precision: str) -> Finding:
        structure = {"membrane_stiffness": MEMBRANE, "bending_stiffness": BENDING}
        motion = {"gravity": [0.0, 0.0, -GRAVITY], "clamp": True, "drag": 2.0}
        rig = _rig(method, precision, device, _strip(), structure, motion)
        return _at_rest(rig, shift=np.array([0.6, 0.0, 0.8]) * way)

    return _trials(decades(range(-3, 4)), hang)


def sliver(device: str) -> Iterator[Trial]:
    """Two triangles, of which one is flatter and flatter, hanging from one end of their edge."""
    edge = 0.01

    def hang(height: float, method: str, precision: str) -> Finding:
        positions = edge * np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.8], [0.5, -height]])
        leaf = leaf_of(mesh_from_triangles(positions, np.array([[0, 1, 2], [1, 0, 3]])))
        structure = {"membrane_stiffness": MEMBRANE, "bending_stiffness": 1e-7}
        motion = {"gravity": [0.0, -STANDARD_GRAVITY, 0.0], "drag": 2.0}
        return _at_rest(_rig(method, precision, device, leaf, structure, motion))

    return _trials((1e-9, 1e-6, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0), hang)


def mass_ratio(device: str) -> Iterator[Trial]:
    """A free strip whose vertices move at random: whatever their masses, it goes straight on as a whole."""

    def fly(ratio: float, method: str, precision: str) -> Finding:
        structure = {"membrane_stiffness": MEMBRANE, "bending_stiffness": 1e-6}
        rig = _rig(method, precision, device, _strip(), structure, {})
        count = rig.leaf.mesh.vertex_count
        random = np.random.default_rng(5)
        mass = rig.get("mass")
        mass[::3] *= ratio
        rig.put(mass=mass, pinned=np.zeros(count, bool), velocity=0.02 * random.normal(size=(count, 3)))
        start, velocity, mass = rig.get("position"), rig.get("velocity"), rig.get("mass")[:, None]
        momentum = (mass * velocity).sum(axis=0)
        expected = (mass * start).sum(axis=0) / mass.sum() + momentum / mass.sum() * FRAMES / FPS
        _play(rig, settle=False)
        off = np.linalg.norm((mass * rig.get("position")).sum(axis=0) / mass.sum() - expected) / rig.leaf.length
        lost = np.linalg.norm((mass * rig.get("velocity")).sum(axis=0) - momentum)
        error = max(off, lost / (mass * np.linalg.norm(velocity, axis=1, keepdims=True)).sum())
        return Finding(float(error), _faults(rig, start))

    return _trials(decades(range(0, 7)), fly, MOVING, tolerance=1e-3)


def crumple(device: str) -> Iterator[Trial]:
    """A strip that is let go from a crumpled, then tangled shape: it may not gain energy."""

    def unfold(amount: float, method: str, precision: str) -> Finding:
        structure = {"membrane_stiffness": MEMBRANE, "bending_stiffness": 1e-6}
        rig = _rig(method, precision, device, _strip(), structure, {})
        start = crumpled(rig.leaf, amount)
        pinned = rig.get("pinned").astype(bool)
        start[pinned] = flat(rig.leaf)[pinned]
        rig.put(position=start)
        start = rig.get("position")
        before = _energy(rig, angles_of(start, rig.leaf.mesh.hinges))
        _play(rig, settle=False)
        after = _energy(rig, rig.get("hinge_angle"))
        return Finding(max(0.0, after / before - 1.0), _faults(rig, start))

    return _trials(decades(range(-4, 3)), unfold)


def _energy(rig: Rig, angles: np.ndarray) -> float:
    """Of the springs and of the motion [J], with the angles of the hinges [rad]."""
    velocity = rig.get("velocity")
    moving = 0.5 * float(rig.get("mass") @ np.square(velocity).sum(axis=1))
    bent = 0.5 * float(rig.get("hinge_stiffness") @ np.square(angles - rig.get("hinge_rest_angle")))
    lengths, strength = rig.get("edge_rest_length"), rig.get("edge_stiffness")
    return moving + bent + edge_energy(rig.get("position"), rig.leaf.mesh, lengths, strength)


def _dried(method: str, precision: str, device: str, curve: list[list[float]]) -> Finding:
    """A flat strip dries in 12 frames, shrinks in its plane by the response curve's value at 0, and rests for 12."""
    leaf, left = _strip(), 1.0 - curve[0][1]
    scene = scene_of(
        {"membrane_stiffness": MEMBRANE, "bending_stiffness": 1e-6},
        {"method": method, "pin_radius": 0.0, "drag": 2.0},
        leaf={"length": LENGTH},
        time={"duration": 1.0, "frames": 25, "fps": FPS},
        water={"curve": [[0.0, 1.0], [0.5, 0.0]]},
        solver={"precision": precision},
    ).with_changes({"shrink.curve": curve})
    points = np.stack([frame.points.astype(np.float64) for frame in Simulation(scene, leaf, device).frames()])
    if not np.isfinite(points).all():
        return Finding(0.0, ("a position is not a finite number",))
    reach = np.linalg.norm(points, axis=2).max()
    faults = () if reach <= FARTHEST_TRAVEL * LENGTH else (f"a vertex is {reach:.3g} m away",)
    off = np.linalg.norm(points[-1] - left * flat(leaf), axis=1).max()
    return Finding(float(off / (left * LENGTH)), faults)


def rest_length(device: str) -> Iterator[Trial]:
    """A flat strip that shrinks in its plane, steadily over 12 frames; scenes accept a twentieth at the least."""

    def shrink(left: float, method: str, precision: str) -> Finding:
        return _dried(method, precision, device, [[0.0, 1.0 - left], [1.0, 0.0]])

    return _trials((0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.99), shrink)


def curve_width(device: str) -> Iterator[Trial]:
    """A flat strip that shrinks by a fifth while the water falls by the width of the curve, a twelfth a frame."""

    def shrink(width: float, method: str, precision: str) -> Finding:
        # Between the contents of two frames where it is narrow.
        high = max(width, 0.47 + width / 2)
        return _dried(method, precision, device, [[high - width, 0.2], [high, 0.0]])

    return _trials(decades([-12, -9, -7, -5, -3, -2, -1, 0]), shrink)
