"""Sweeps over the number of steps: what many of them lose or gain."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.sim.stable_step import StableStep, step_limit
from leafwarp.study.stability.point import Finding, Trial, decades
from leafwarp.study.stability.water import PRECISIONS, SCHEMES
from leafwarp.study.verify.drawn_fluid import Sample, ellipse, make_sample
from leafwarp.study.verify.drawn_leaf import leaf_of, rig_of, scene_of
from leafwarp.study.verify.forces import edge_energy

STEPS_AT_A_TIME = 1000
# A step of the motion over the longest that is stable: at that one the energy of a step swings by as much as itself.
SHARE = 0.05
# What may be lost of the energy or the momenta: what symplectic Euler does not keep of the energy, and a float32's
# roundings of a million steps, which add up at random.
KEPT = {"float32": 1e-2, "float64": 1e-4}
# The same of the water: a rounding of the account's float64 in each of a million steps; and of the contents.
CONTENT_KEPT = {"float32": 1e-5, "float64": 1e-10}
# Power of ten of the most steps of each scheme within some seconds.
MOST_STEPS = {"split": 5, "unsplit": 4, "iterated": 3}


def two_triangles(side: float = 0.01) -> Leaf:
    """Two equilateral triangles that share an edge [m]."""
    corners = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.75**0.5], [0.5, -(0.75**0.5)]]
    return leaf_of(mesh_from_triangles(side * np.array(corners), np.array([[0, 1, 2], [1, 0, 3]])))


class Ringing:
    """Two free triangles that ring, flap and turn without damping, by the stages of explicit motion.

    Args:
        device: Warp device.
        precision: "float32" or "float64".

    Attributes:
        steps: Steps done.
    """

    def __init__(self, device: str, precision: str):
        scene = scene_of({"membrane_stiffness": 5.0, "bending_stiffness": 1e-7, "damping": 0.0})
        self._rig = rig = rig_of(scene, two_triangles(), device, precision)
        guard = next(stage for stage in rig.stages if isinstance(stage, StableStep))
        self._step = SHARE * step_limit(guard.largest_squared_frequency(), 0.0, 0.0)
        velocity = 0.3 * np.random.default_rng(2).uniform(-1.0, 1.0, (4, 3))
        mass = rig.get("mass")
        velocity -= mass @ velocity / mass.sum()
        rig.put(pinned=np.zeros(4, bool), velocity=velocity, time_step=[self._step])
        self._moving = [stage for stage in rig.stages if stage.rate == "substep"]
        with wp.ScopedCapture(device=rig.state.device, force_module_load=False) as capture:
            for _ in range(STEPS_AT_A_TIME):
                self._do_step()
        self._graph = capture.graph
        self.steps = 0
        self._start = self._measure()

    def _do_step(self) -> None:
        for stage in self._moving:
            stage.run()

    def run_to(self, steps: int) -> Finding:
        """Go on to a number of steps, and see what has changed since the start, as a share."""
        while self.steps + STEPS_AT_A_TIME <= steps:
            wp.capture_launch(self._graph)
            self.steps += STEPS_AT_A_TIME
        while self.steps < steps:
            self._do_step()
            self.steps += 1
        position, velocity = self._rig.get("position"), self._rig.get("velocity")
        if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
            return Finding(0.0, ("a position or a speed is not a finite number",))
        speeds = self._rig.get("mass") * np.linalg.norm(velocity, axis=1)
        # Momenta over those of all vertices together.
        sizes = (self._start[0], speeds.sum(), speeds.sum() * self._rig.leaf.length)
        changes = (now - before for now, before in zip(self._measure(), self._start, strict=True))
        return Finding(max(float(np.linalg.norm(c)) / size for c, size in zip(changes, sizes, strict=True)))

    def _measure(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy [J], momentum [kg m/s] and angular momentum about the centre of mass [kg m^2/s].

        The energy is what symplectic Euler keeps to second order in the step: half a step times the power of the
        springs' forces, and the sum of both kinds (Hairer, Lubich and Wanner 2006, IX.3).
        """
        rig, mesh = self._rig, self._rig.leaf.mesh
        position, velocity, mass = rig.get("position"), rig.get("velocity"), rig.get("mass")
        force = rig.forces("edge_springs", "angular_springs")
        bend = rig.get("hinge_angle") - rig.get("hinge_rest_angle")
        energy = edge_energy(position, mesh, rig.get("edge_rest_length"), rig.get("edge_stiffness"))
        energy += 0.5 * float(rig.get("hinge_stiffness") @ np.square(bend))
        energy += 0.5 * float(mass @ np.square(velocity).sum(axis=1) + self._step * np.vdot(force, velocity))
        momentum = mass[:, None] * velocity
        arm = position - mass @ position / mass.sum()
        return energy, momentum.sum(axis=0), np.cross(arm, momentum).sum(axis=0)


def motion_steps(device: str) -> Iterator[Trial]:
    """Two free triangles keep their energy and momenta; each number goes on from the one before."""
    for precision in PRECISIONS:
        ringing = Ringing(device, precision)
        for steps in decades(range(7)):
            yield Trial("explicit", precision, steps, KEPT[precision], partial(ringing.run_to, int(steps)))


def drying_leaf(scheme: str, precision: str, device: str, steps: float) -> Sample:
    """A small leaf that transpires and is fed, with steps of a minute for a whole scene."""
    mask = ellipse(10, 8)
    foot = np.zeros(mask.shape)
    foot[np.argwhere(mask)[0, 0], np.argwhere(mask)[0, 1]] = 1.0
    tables = {
        "fluid": {"step": 60.0, "scheme": scheme, "lamina_diffusivity": 1e-7, "vein_diffusivity": 1e-7},
        "source": {"conductance": 2e-4},
        "transpiration": {"rate": 1e-4, "cuticle_rate": 1e-4},
        "time": {"duration": 60.0 * steps, "frames": 2},
    }
    water = np.where(mask, np.random.default_rng(7).random(mask.shape), 0.0)
    return make_sample(tables, mask, {"water": water, "source": foot}, (0.08, 0.1), device, precision)


def _account(sample: Sample, steps: int) -> Finding:
    """Go on to a number of steps; what the ledger misses, over the water that has moved."""
    sample.fluid.advance(60.0 * steps, frame=2)
    faults = () if np.isfinite(sample.water).all() else ("a content is not a finite number",)
    low, high = sample.leaf_water.min(), sample.leaf_water.max()
    if not -1e-5 <= low <= high <= 1.0 + 1e-5:
        faults += (f"contents of {low:.9g} to {high:.9g}",)
    ledger = sample.fluid.ledger()
    return Finding(abs(ledger.error) / (ledger.start + ledger.added), faults)


def fluid_steps(device: str) -> Iterator[Trial]:
    """The account of a leaf's water closes after any number of steps; each number goes on from the one before."""
    for scheme, most in MOST_STEPS.items():
        for precision in PRECISIONS:
            sample = drying_leaf(scheme, precision, device, 10.0**most)
            for steps in decades(range(most + 1)):
                call = partial(_account, sample, int(steps))
                yield Trial(SCHEMES[scheme], precision, steps, CONTENT_KEPT[precision], call)
