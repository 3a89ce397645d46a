"""One simulated second of this project's motion and of other programs', and how well the leaf settles."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.sim import material
from leafwarp.sim.implicit.equilibrium import equilibrium
from leafwarp.sim.simulation import Simulation

HERE = Path(__file__).parent
SCENES = HERE.parent.parent / "scenes"
TITLE = "Motion beside other programs"
OPTIONS = {
    "--blender": {"type": Path, "metavar": "PYTHON", "help": "an interpreter with bpy 4.5"},
    "--newton": {"type": Path, "metavar": "PYTHON", "help": "an interpreter with newton"},
}
FPS = 24
GRAVITY = 9.81  # [m/s^2]
MASS_PER_AREA = 0.2  # [kg/m^2]
MEMBRANE_STIFFNESS = 1e4  # [N/m] 50 MPa at 0.2 mm
BENDING_STIFFNESS = 3.66e-5  # [N m] of the same
SETTLED_AFTER = 10  # [s] of playback
PATIENCE = 500.0  # [s] for one run of a peer, its compiler included
# A leaf that is further away than this from where it should be, in its lengths, is no leaf any more.
LOST = 2.0


@dataclass(frozen=True)
class Row:
    """One program with its settings.

    Attributes:
        name: Of both.
        seconds: Wall time of a simulated second.
        error: RMS distance of the settled shape from the equilibrium, over the leaf's length; None if it blew up.
    """

    name: str
    seconds: float
    error: float | None


def make_scene(method: str) -> Scene:
    """The problem as a scene whose water does not change."""
    return Scene.model_validate(
        {
            "leaf": {"image": SCENES / "bramble.png", "length": 0.12, "camber": 0.01},
            "mesh": {"vertices": 1707},
            "time": {"duration": 3600.0, "frames": 1 + FPS * SETTLED_AFTER, "fps": FPS},
            "water": {"curve": [[0.0, 1.0]]},
            "structure": {
                "membrane_stiffness": MEMBRANE_STIFFNESS,
                "bending_stiffness": BENDING_STIFFNESS,
                "dry_mass": MASS_PER_AREA,
                "water_mass": 0.0,
            },
            "motion": {"method": method, "gravity": [0.0, 0.0, -GRAVITY], "drag": 2.0, "clamp": True},
        }
    )


def make_problem(scene: Scene, leaf: Leaf) -> dict[str, np.ndarray]:
    """The same for programs that know one stiffness for all springs and one for all hinges."""
    positions = material.rest_positions(scene, leaf)
    return {
        "positions": positions,
        "triangles": leaf.mesh.triangles,
        "pinned": material.pinned_vertices(leaf, scene.motion),
        "gravity": np.array(GRAVITY),
        "fps": np.array(FPS),
        "masses": MASS_PER_AREA * leaf.mesh.vertex_areas,
        "mass_per_area": np.array(MASS_PER_AREA),
        "spring": material.edge_stiffness(leaf.mesh, MEMBRANE_STIFFNESS).mean(),
        "hinge": material.hinge_stiffness(leaf.mesh, BENDING_STIFFNESS).mean(),
        "edge_length": material.edge_lengths(leaf.mesh, positions).mean(),
        "membrane_stiffness": np.array(MEMBRANE_STIFFNESS),
    }


def at_rest(leaf: Leaf, problem: dict[str, np.ndarray], springs: np.ndarray, hinges: np.ndarray, masses: np.ndarray):
    """Equilibrium of a network on the leaf's mesh [m], shape [vertex_count, 3]."""
    start = problem["positions"]
    found = equilibrium(
        start,
        leaf.mesh.edges,
        material.edge_lengths(leaf.mesh, start),
        springs,
        hinges=leaf.mesh.hinges,
        rest_angles=material.dihedral_angles(leaf.mesh, start),
        hinge_stiffness=hinges,
        masses=masses,
        pinned=problem["pinned"],
        gravity=(0.0, 0.0, -GRAVITY),
    )
    return found.positions


def distance(shape: np.ndarray, reference: np.ndarray, length: float) -> float | None:
    """RMS distance over the length; None for a leaf that is lost."""
    gap = float(np.sqrt(np.square(shape - reference).sum(axis=1).mean())) / length
    return gap if gap < LOST else None


def ours(leaf: Leaf, problem: dict[str, np.ndarray]) -> Iterator[Row]:
    """This project's implicit and quasistatic motion."""
    mesh = leaf.mesh
    springs = material.edge_stiffness(mesh, MEMBRANE_STIFFNESS)
    hinges = material.hinge_stiffness(mesh, BENDING_STIFFNESS)
    reference = at_rest(leaf, problem, springs, hinges, problem["masses"])
    for method in ("implicit", "quasistatic"):
        simulation = Simulation(make_scene(method), leaf)
        begin = time.perf_counter()
        for frame in range(2, FPS + 2):
            simulation.advance(frame)
        seconds = time.perf_counter() - begin
        for frame in range(FPS + 2, FPS * SETTLED_AFTER + 2):
            simulation.advance(frame)
        shape = simulation.read_frame(1).points.astype(np.float64)
        yield Row(f"leafwarp, {method}", seconds, distance(shape, reference, leaf.length))


def run_peer(python: Path, script: str, problem: Path, options: dict) -> tuple[np.ndarray, float, str]:
    """Positions, wall time and version that a script in another interpreter finds.

    Raises:
        subprocess.TimeoutExpired: It takes longer than anybody would wait.
    """
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.npz"
        command = [str(python), str(HERE / script), str(problem), str(result), json.dumps(options)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
        if not result.is_file():
            sys.exit(f"{' '.join(command)}: no result\n{done.stderr[-2000:]}")
        found = np.load(result)
        return found["positions"], float(found["seconds"]), str(found["version"])


def blender(python: Path, leaf: Leaf, problem: dict[str, np.ndarray], path: Path) -> Iterator[Row]:
    """Blender's cloth."""
    count = leaf.mesh.vertex_count
    reference = at_rest(
        leaf,
        problem,
        np.full(leaf.mesh.edge_count, problem["spring"]),
        np.full(leaf.mesh.hinge_count, problem["hinge"]),
        np.full(count, problem["masses"].mean()),
    )
    for quality in (5, 20, 80):
        try:
            _, seconds, version = run_peer(python, "blender.py", path, {"quality": quality, "frames": FPS})
        except subprocess.TimeoutExpired:
            yield Row(f"Blender cloth, quality {quality}: not done", PATIENCE, None)
            continue
        frames = FPS * SETTLED_AFTER if quality < 80 else FPS
        shape, _, _ = run_peer(python, "blender.py", path, {"quality": quality, "frames": frames})
        after = f", after {frames // FPS} s" if frames != FPS * SETTLED_AFTER else ""
        yield Row(
            f"Blender {version} cloth, quality {quality}{after}", seconds, distance(shape, reference, leaf.length)
        )


# The fewest substeps, in powers of two, with which the semi-implicit solver does not blow up; no number that was tried
# helps XPBD.
NEWTON = (
    {"solver": "semi_implicit", "substeps": 8192},
    {"solver": "xpbd", "substeps": 64, "iterations": 10},
    {"solver": "vbd", "substeps": 10, "iterations": 10},
)


def newton(python: Path, leaf: Leaf, problem: dict[str, np.ndarray], path: Path) -> Iterator[Row]:
    """Newton's cloth solvers, one second only: they take long."""
    springs = material.edge_stiffness(leaf.mesh, MEMBRANE_STIFFNESS)
    hinges = material.hinge_stiffness(leaf.mesh, BENDING_STIFFNESS)
    reference = at_rest(leaf, problem, springs, hinges, problem["masses"])
    for options in NEWTON:
        name = ", ".join(f"{value} {key}" for key, value in options.items() if key != "solver")
        label = f"Newton {options['solver']}, {name}, after 1 s"
        try:
            shape, seconds, _ = run_peer(python, "newton_cloth.py", path, options | {"frames": FPS})
        except subprocess.TimeoutExpired:
            yield Row(f"{label}: not done", PATIENCE, None)
            continue
        yield Row(label, seconds, distance(shape, reference, leaf.length))


def table(rows: list[Row]) -> str:
    """The rows as Markdown, with their time over that of Blender at quality 5 where it ran."""
    unit = next((row.seconds for row in rows if "quality 5" in row.name), None)
    lines = [
        "| program | wall time of a simulated second [s] | of Blender's, quality 5 | "
        "error of the settled shape, of the leaf's length |",
        "|---|---:|---:|---:|",
    ]
    for row in rows:
        error = "lost" if row.error is None else f"{100.0 * row.error:.2g} %"
        ratio = "" if unit is None else f"{row.seconds / unit:.2g}"
        lines.append(f"| {row.name} | {row.seconds:.2g} | {ratio} | {error} |")
    return "\n".join(lines)


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows; all programs that are there run one after the other."""
    scene = make_scene("implicit")
    with tempfile.TemporaryDirectory() as folder:
        leaf = prepare_scene_leaf(scene, None)
        problem, path = make_problem(scene, leaf), Path(folder) / "problem.npz"
        np.savez(path, **problem)
        rows = list(ours(leaf, problem))
        if options.blender:
            rows += blender(options.blender, leaf, problem, path)
        if options.newton:
            rows += newton(options.newton, leaf, problem, path)
    return (
        f"The bramble's mesh ({leaf.mesh.vertex_count} vertices), clamped at its base, under its own weight: E h = "
        f"{MEMBRANE_STIFFNESS:g} N/m, bending stiffness {BENDING_STIFFNESS:g} N m, {MASS_PER_AREA:g} kg/m². One "
        f"simulated second at {FPS} frames a second from the flat shape; the settled shape after {SETTLED_AFTER} s, "
        f"where nothing else is said, against the equilibrium of the program's own network.\n\n{table(rows)}"
    )
