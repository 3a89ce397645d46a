"""Two clocks: does the length of the film decide the shape in which a leaf comes to rest?

Leaves of random type, mesh and curl dry through films of different frames and fps; after the last frame each settles.
Without inertia (quasistatic) the frames are moments on one way; with it (implicit) a leaf may swing past a buckle into
another shape. All are compared with the quasistatic film of 49 frames.
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.presets import PRESETS
from leafwarp.sim.simulation import Simulation

TITLE = "Two clocks"
QUICK = "one leaf, one short film"
SCENE = Path(__file__).parent.parent / "scenes" / "tree.toml"
OPTIONS = {"--leaves": {"type": int, "default": 24, "metavar": "N", "help": "leaves drawn at random (default: 24)"}}
REFERENCE = ("quasistatic", 49, 24)
FILMS = (
    ("quasistatic", 25, 24),
    ("quasistatic", 97, 60),
    ("implicit", 25, 24),
    ("implicit", 49, 24),
    ("implicit", 97, 24),
    ("implicit", 121, 60),
)
# Largest mismatch; the presets have 0.01 and 0.015.
MISMATCHES = (0.02, 0.06)
SAME = 0.005  # of the leaf's length


def draw(rng: np.random.Generator, most_mismatch: float) -> Scene:
    """A leaf in SI units."""
    return load_scene(SCENE).with_changes(
        {
            "material.preset": str(rng.choice(list(PRESETS))),
            "material.mismatch": round(float(rng.uniform(0.0, most_mismatch)), 4),
            "mesh.vertices": int(rng.integers(120, 500)),
            "maps.size": 64,
            "output.contact_sheet": False,
            "output.display_color": False,
        }
    )


def settled_shape(scene: Scene, leaf: Leaf, film: tuple[str, int, int]) -> np.ndarray:
    """Where the vertices come to rest after a film's last frame [m], shape [vertex_count, 3]."""
    method, frames, fps = film
    changes = {"motion.method": method, "time.frames": frames, "time.fps": fps}
    simulation = Simulation(scene.with_changes(changes), leaf)
    for _ in simulation.frames():
        pass
    simulation.motion.settle()
    return simulation.state["position"].numpy().copy()


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    leaves, films, reference, mismatches = options.leaves, FILMS, REFERENCE, MISMATCHES
    if options.quick:
        leaves, films, reference, mismatches = 1, (("implicit", 3, 24),), ("quasistatic", 2, 24), MISMATCHES[:1]
    rows = [
        "| curl: mismatch up to | motion | frames | fps | within 0.5 % of the length | median distance | largest |",
        "|---:|---|---:|---:|---:|---:|---:|",
    ]
    for most in mismatches:
        rng = np.random.default_rng(11)
        distances: dict[tuple, list[float]] = {film: [] for film in films}
        for _ in range(leaves):
            scene = draw(rng, most)
            leaf = prepare_scene_leaf(scene, None)
            expected = settled_shape(scene, leaf, reference)
            for film in films:
                off = np.linalg.norm(settled_shape(scene, leaf, film) - expected, axis=1).max()
                distances[film].append(off / leaf.length)
        for film, found in distances.items():
            same = sum(distance < SAME for distance in found)
            rows.append(
                f"| {most} | {film[0]} | {film[1]} | {film[2]} | {same} of {leaves} | "
                f"{statistics.median(found):.2%} | {max(found):.2%} |"
            )
    return (
        f"Largest distance of a vertex from where it comes to rest after the quasistatic film of {reference[1]} "
        "frames, over the leaf's length: leaves of `scenes/tree.toml` with a random preset, curl and mesh of 120 to "
        "500 vertices.\n\n" + "\n".join(rows)
    )
