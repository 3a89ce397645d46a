"""What the plan tells of implicit motion, against what happens."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from leafwarp.errors import SimulationError
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.launch import State
from leafwarp.sim.motion import make_motion
from meshes import scene_of, strip
from structure_reference import rig_of

FRAME = 1.0 / 24.0
SHEET = {"membrane_stiffness": 1e4, "bending_stiffness": 3e-5}
MEMBRANE = {"membrane_stiffness": 1e4}


def moving(method, structure, motion, device):
    rig = rig_of(scene_of(structure, {"method": method} | motion), strip(columns=8, jitter=0.2), device, "float64")
    return rig, rig.stages[0]


class Traffic:
    """Which arrays of a state the host reads and writes from now on, other than by launches."""

    def __init__(self, monkeypatch, state):
        self.reads, self.writes, self._state = set(), set(), state
        names = {state[name].ptr: name for name in state.names}
        upload, numpy, zero, copy = State.upload, wp.array.numpy, wp.array.zero_, wp.copy

        def noted(kept, function, place):
            def run(*arguments, **options):
                kept.update(names[a.ptr] for a in arguments[place : place + 1] if a.ptr in names)
                return function(*arguments, **options)

            return run

        def noted_upload(target, name, values):
            self.writes.add(name)
            upload(target, name, values)

        monkeypatch.setattr(State, "upload", noted_upload)
        monkeypatch.setattr(wp.array, "numpy", noted(self.reads, numpy, 0))
        monkeypatch.setattr(wp.array, "zero_", noted(self.writes, zero, 0))
        monkeypatch.setattr(wp, "copy", noted(self.writes, noted(self.reads, copy, 1), 0))

    def change(self, name, values):
        """Fill an array as another stage would, unnoted."""
        before = set(self.writes)
        self._state.upload(name, values)
        self.writes.intersection_update(before)


@pytest.mark.parametrize("structure", [SHEET, MEMBRANE], ids=["sheet", "membrane"])
@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_the_host_touches_what_the_plan_says(device, method, structure, monkeypatch):
    load = {"gravity": [0.0, 0.0, -9.81]} if structure is SHEET else {"gravity": [9.81, 0.0, 0.0]}
    rig, stage = moving(method, structure, load | {"clamp": True}, device)
    lengths = rig.get("edge_rest_length")
    with monkeypatch.context() as patched:
        traffic = Traffic(patched, rig.state)
        motion = make_motion(rig.scene, rig.leaf, rig.state, rig.stages)
        motion.settle()
        motion.advance(FRAME, 1)
        traffic.change("edge_rest_length", 0.99 * lengths)
        _fail_once(patched, method, motion)
        motion.advance(FRAME, 2)
        traffic.change("edge_rest_length", 0.9 * lengths)
        patched.setattr("leafwarp.sim.implicit.newton.MOST_ITERATIONS", 1)
        patched.setattr("leafwarp.sim.implicit.relaxation.MOST_STEPS", 1)
        with pytest.raises(SimulationError):
            motion.advance(FRAME, 3)
    assert traffic.reads == set(stage.host_reads)
    assert traffic.writes == set(stage.host_writes)


def _fail_once(patched, method, motion):
    """Let the next frame be taken in parts."""
    module = "leafwarp.sim.implicit.motion"
    from leafwarp.sim.implicit.relaxation import relax

    tries, find = [], motion.newton.minimise if method == "implicit" else relax

    def stubborn(*arguments, **options):
        tries.append(0)
        if len(tries) == 1:
            raise NotConverged("too far")
        return find(*arguments, **options)

    if method == "implicit":
        patched.setattr(motion.newton, "minimise", stubborn)
    else:
        patched.setattr(f"{module}.relax", stubborn)


@pytest.mark.parametrize("structure", [SHEET, MEMBRANE], ids=["sheet", "membrane"])
@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_the_fewest_launches_of_a_frame_are_those_of_the_plan(device, method, structure):
    """Where nothing moves, backward Euler takes one Newton step, and an equilibrium is one at sight."""
    rig, stage = moving(method, structure, {}, device)
    motion = make_motion(rig.scene, rig.leaf, rig.state, rig.stages)
    before, steps = rig.state.launch_count, motion.newton.effort.iterations
    motion.advance(FRAME, 1)
    assert rig.state.launch_count - before == stage.launches
    assert motion.newton.effort.iterations - steps == (1 if method == "implicit" else 0)
    start = rig.get("position")
    rig.put(position=start + 1e-4 * np.random.default_rng(0).normal(size=start.shape) * ~rig.get("pinned")[:, None])
    before = rig.state.launch_count
    motion.advance(FRAME, 2)
    assert rig.state.launch_count - before > stage.launches
