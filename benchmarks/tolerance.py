"""Does a film with a tolerance keep it? Scenes drawn at random, each against a much finer film of the same scene.

Outlines, veins, drying rates, curls, shrinking, stiffness and weight are drawn from the ranges that the scene reference
calls usual; nothing was tuned on them. The truth is a film four levels finer than the one that was chosen, so with a
quarter of its error.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from leafwarp.errors import LeafwarpError
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.quality import HIGHEST_LEVEL
from leafwarp.study.tolerance import at_level, choose_resolution
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.trial import run_trial

SCENES = Path(__file__).parent.parent / "scenes"
TITLE = "A tolerance, asked and kept"
QUICK = "one scene at a wide tolerance, against a film two levels finer"
OPTIONS = {
    "--cases": {"type": int, "default": 10, "metavar": "N", "help": "scenes drawn at random (default: 10)"},
    "--tolerance": {"type": float, "default": 0.02, "metavar": "SHARE", "help": "of the length (default: 0.02)"},
    "--seed": {"type": int, "default": 1, "metavar": "N", "help": "of the draw (default: 1)"},
}
FINER = 4  # levels, of the film that is taken for the truth
FACTOR = 3.0  # within which an estimate is to be of the truth


def draw_photo(rng: np.random.Generator, path: Path) -> None:
    """A leaf like one of those of the scenes, but of another width and with other veins, teeth and asymmetry."""
    if str(SCENES) not in sys.path:
        sys.path.insert(0, str(SCENES))
    from draw_leaves import draw, save
    from drawing.catalogue import PICTURES

    picture = PICTURES[str(rng.choice(["bramble", "cut", "still"]))]
    width = rng.uniform(0.75, 1.2)
    runs = tuple(tuple((x * width if picture.shape.ribs[1:] == () else x, y) for x, y in run)
                 for run in picture.shape.half_outline)  # fmt: skip
    shape = replace(
        picture.shape,
        seed=int(rng.integers(1000)),
        half_outline=runs,
        asymmetry=float(rng.uniform(0.0, 0.06)),
        placement=replace(picture.shape.placement, angle=float(rng.uniform(-15.0, 15.0))),
    )
    save(path, draw(replace(picture, shape=shape))[0])


def draw_scene(rng: np.random.Generator, photo: Path, tolerance: float) -> Scene:
    """A soft leaf, as ``new`` writes it, with figures drawn at random."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(np.log10(low), np.log10(high)))

    hours = between(12.0, 36.0)
    data = {
        "name": photo.stem,
        "tolerance": tolerance,
        "leaf": {"image": str(photo), "length": between(0.06, 0.15), "camber": between(0.01, 0.03)},
        "time": {"duration": 3600.0 * hours, "frames": 49},
        "fluid": {"lamina_diffusivity": decades(1e-10, 1e-9), "vein_diffusivity": decades(1e-6, 2e-5)},
        "transpiration": {"rate": between(0.03, 0.08) / 3600.0, "cuticle_rate": between(0.005, 0.02) / 3600.0},
        "source": {"conductance": decades(10.0, 80.0) / 3600.0, "cut_at": 3600.0 * hours * between(0.2, 0.9)},
        "shrink": {"curve": [[1.0, 0.0], [0.1, between(0.05, 0.25)]], "vein_resistance": between(0.2, 0.8)},
        "curl": {
            "mismatch": [[1.0, 0.0], [0.1, between(0.0, 0.015)]],
            "thickness": 2.5e-4,
            "vein_resistance": between(0.2, 0.8),
        },
        "structure": {
            "membrane_stiffness": between(2.0, 6.0),
            "bending_stiffness": decades(2e-7, 1e-6),
            "vein_stiffness": between(1.0, 5.0),
            "stiffness": [[1.0, 1.0], [0.85, between(0.5, 1.0)], [0.2, between(0.8, 1.5)]],
            "dry_mass": between(0.1, 0.2),
            "water_mass": between(0.15, 0.25),
        },
        "motion": {"gravity": [0.0, 0.0, -between(0.0, 0.005)], "drag": between(3.0, 6.0)},
    }
    return Scene.checked(data, photo.stem)


def measure(scene: Scene, cache: Path, finer: int) -> tuple[int, float, float]:
    """The level that was chosen, the error that the film reports of itself, and the true one (shares of the length)."""
    choice = choose_resolution(scene, cache, "cpu")

    def film(level: int):
        resolved = at_level(scene, level)
        return run_trial(resolved, prepare_scene_leaf(resolved, cache), choice.places, "cpu")

    ours, truth = film(choice.level), film(min(choice.level + finer, HIGHEST_LEVEL))
    length = prepare_scene_leaf(choice.scene, cache).length
    return choice.level, choice.error_of(ours, length), errors_of(ours, truth, length).shape


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    cases, tolerance, finer = (1, 0.2, 2) if options.quick else (options.cases, options.tolerance, FINER)
    lines = ["| scene | level | its own estimate | true error | estimate / truth |", "|---:|---:|---:|---:|---:|"]
    kept, close, ratios, computed = 0, 0, [], 0
    for case in range(cases):
        rng = np.random.default_rng([options.seed, case])
        with tempfile.TemporaryDirectory() as folder:
            photo = Path(folder) / f"leaf_{case}.png"
            draw_photo(rng, photo)
            try:
                level, estimate, truth = measure(draw_scene(rng, photo, tolerance), Path(folder), finer)
            except LeafwarpError as error:
                lines.append(f"| {case} | | refused: {error} | | |")
                continue
        computed += 1
        kept += truth <= tolerance
        close += 1.0 / FACTOR <= estimate / truth <= FACTOR
        ratios.append(estimate / truth)
        lines.append(f"| {case} | {level} | {estimate:.2%} | {truth:.2%} | {ratios[-1]:.2f} |")
        print(lines[-1], file=sys.stderr, flush=True)
    median = f"{statistics.median(ratios):.2f}" if ratios else "none"
    return (
        f"Asked: {tolerance:.1%} of the leaf's length. Kept in {kept} of {computed} scenes; the estimate within a "
        f"factor of {FACTOR:g} of the truth in {close} (median ratio {median}).\n\n" + "\n".join(lines) + "\n"
    )
