"""One substep of explicit motion on the bramble's mesh: in a CPU's vector lanes, and by plain kernels.

The plain kernels are a thread a vertex or a hinge, as a GPU wants them: edge springs, hinges with the sum of their
forces, and integration, with weight and drag as the scene has them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.table2 import SCENE
from benchmarks.timing import Timing, round_robin
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.launch import State
from leafwarp.sim.motion import Motion
from leafwarp.sim.plan import make_stages

TITLE = "Structure: one substep"
QUICK = "a small mesh, few rounds"
ROUNDS = (15, 3)
OPTIONS = {"--newton": {"type": Path, "metavar": "PYTHON", "help": "an interpreter with newton"}}
QUICK_VERTICES = 200
SUBSTEPS = 64  # of a measurement
OURS = "leafwarp, 32 springs at a time, captured graph"
PLAIN, LAUNCHED = "plain kernels, captured graph", "plain kernels, launched one by one"


class PlainState(State):
    """A state whose stages take the kernels of a GPU on a CPU, too."""

    many_threads = True


class Structure:
    """The explicit motion of a leaf alone, at rest but for its weight.

    Args:
        scene: The scene.
        leaf: The leaf.
        state_type: :class:`PlainState` for plain kernels.
        precision: "float32" or "float64".
    """

    def __init__(self, scene: Scene, leaf: Leaf, state_type: type[State] = State, precision: str = "float32"):
        self.stages, _ = make_stages(scene, leaf, "motion")
        self.state = state_type([spec for stage in self.stages for spec in stage.arrays], "cpu", precision)
        for stage in self.stages:
            stage.bind(self.state)
        self.motion = Motion(scene, leaf, self.state, self.stages)
        self._duration = SUBSTEPS / self.motion.required_substeps(1.0)
        self.state.upload("time_step", np.array([1.0 / self.motion.required_substeps(1.0)]))

    def advance(self) -> int:
        """Some substeps as a frame has them, with its checks; how many."""
        return self.motion.advance(self._duration, 1)

    def launch(self) -> None:
        """One substep, launch by launch."""
        for stage in self.stages:
            if stage.rate == "substep":
                stage.run()

    @property
    def positions(self) -> np.ndarray:
        """[m], shape [vertex_count, 3]."""
        return self.state["position"].numpy()


def largest_difference(scene: Scene, leaf: Leaf) -> float:
    """Of the positions after some substeps, lanes against plain kernels in float64, as a share of the length."""
    lanes, plain = Structure(scene, leaf), Structure(scene, leaf, PlainState, "float64")
    for structure in (lanes, plain):
        structure.advance()
    return float(np.abs(lanes.positions - plain.positions).max()) / leaf.length


def measure(scene: Scene, leaf: Leaf, rounds: int) -> dict[str, Timing]:
    """Time of a substep of every contender [ms]."""
    lanes, double = Structure(scene, leaf), Structure(scene, leaf, precision="float64")
    plain, launched = Structure(scene, leaf, PlainState), Structure(scene, leaf, PlainState)
    plain_double = Structure(scene, leaf, PlainState, "float64")
    frames = {
        OURS: lanes,
        "the same, float64": double,
        PLAIN: plain,
        "the same, plain kernels, float64": plain_double,
    }
    work: dict[str, Callable[[], object]] = {name: structure.advance for name, structure in frames.items()}
    work[LAUNCHED] = launched.launch
    return round_robin(work, rounds)


def newton_substep(python: Path, soft: Scene) -> float | None:
    """Time of a substep of Newton's SemiImplicit [ms], once, by another interpreter, on the same mesh without contacts.

    Args:
        python: The interpreter.
        soft: Scene whose stiffness and gravity it gets.

    Returns:
        None where it takes longer than anybody would wait.
    """
    import subprocess
    import tempfile

    from benchmarks.peers import motion as peers

    scene = peers.make_scene("implicit")
    leaf = prepare_scene_leaf(scene, None)
    options = {"solver": "semi_implicit", "substeps": 512, "frames": peers.FPS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.npz"
        problem = peers.make_problem(scene, leaf)
        # As soft as the bramble's, so that the step is stable.
        softer = soft.structure.bending_stiffness / peers.BENDING_STIFFNESS
        problem["hinge"] = problem["hinge"] * softer
        problem["membrane_stiffness"] = np.array(soft.structure.membrane_stiffness)
        problem["gravity"] = np.array(-soft.motion.gravity[2])
        np.savez(path, **problem)
        try:
            _, seconds, _ = peers.run_peer(python, "newton_cloth.py", path, options)
        except subprocess.TimeoutExpired:
            return None
    return 1e3 * seconds / (peers.FPS * options["substeps"])


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    scene = load_scene(SCENE)
    if options.quick:
        scene = scene.with_changes({"mesh.vertices": QUICK_VERTICES})
    leaf = prepare_scene_leaf(scene, None)
    timings = measure(scene, leaf, options.rounds)
    rows = ["| substep | ms | of leafwarp's |", "|---|---:|---:|"]
    rows += [f"| {name} | {timing} | {timing.over(timings[OURS])} |" for name, timing in timings.items()]
    if options.newton:
        milliseconds = newton_substep(options.newton, scene)
        name = "Newton SemiImplicit on the same mesh, after the others"
        if milliseconds is None:
            rows.append(f"| {name}: not done | | |")
        else:
            rows.append(f"| {name} | {milliseconds:.3g} | {milliseconds / timings[OURS].median:.3g} |")
    return (
        f"Milliseconds: median (and middle half) of {options.rounds} measurements of {SUBSTEPS} substeps or more, "
        "taken in turns, a frame's checks included; ratios are taken round by round. float32 where nothing else is "
        f"said. `scenes/bramble.toml`: {leaf.mesh.vertex_count} vertices, {leaf.mesh.edge_count} edges, "
        f"{leaf.mesh.hinge_count} hinges; springs, weight and drag. After {SUBSTEPS} substeps no position differs from "
        f"that of the plain kernels in float64 by more than {largest_difference(scene, leaf):.1e} of the leaf's "
        "length.\n\n" + "\n".join(rows)
    )
