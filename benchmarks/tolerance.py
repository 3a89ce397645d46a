"""Does a film with a tolerance keep it? Scenes drawn at random, each against a much finer film of the same scene.

Outlines, veins, drying rates, curls, shrinking, stiffness and weight are drawn from the ranges that the scene reference
calls usual, and so is the tolerance. The films are those that ``run`` computes, a second one included where the first
misses. The truth is a film three levels finer than the one that was kept, so with about a third of its error, which is
enough to tell whether an estimate is within a factor of three; of a fine film, two levels, with half of it. It takes
twenty times as long as the film, or eight times; one that is finer by yet another level, sixty times. What it is off by
itself is told from its distance to the film a level finer than the one that was kept, and stands beside it.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from leafwarp.errors import LeafwarpError
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.study.tolerance import Search, at_level, compute_film, error_from
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.trial import Film

SCENES = Path(__file__).parent.parent / "scenes"
TITLE = "A tolerance, asked and kept"
QUICK = "one scene at a wide tolerance, against a film two levels finer"
OPTIONS = {
    "--cases": {"type": int, "default": 10, "metavar": "N", "help": "scenes drawn at random (default: 10)"},
    "--tolerance": {"type": float, "metavar": "SHARE", "help": "of the length (default: drawn, too)"},
    "--seed": {"type": int, "default": 1, "metavar": "N", "help": "of the draw (default: 1)"},
}
TOLERANCES = (0.005, 0.02)  # least and largest that is drawn
FINER = 3  # levels, of the film that is taken for the truth ...
LEAST_FINER = 2  # ... and at least, where that would be finer than FINEST
FINEST = 5
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


def draw_scene(rng: np.random.Generator, photo: Path, tolerance: float | None) -> Scene:
    """A soft leaf, as ``new`` writes it, with figures drawn at random; so is its tolerance where none is given."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(np.log10(low), np.log10(high)))

    hours = between(12.0, 36.0)
    data = {
        "name": photo.stem,
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
    data["tolerance"] = tolerance or decades(*TOLERANCES)
    return Scene.checked(data, photo.stem)


@dataclass(frozen=True)
class Measured:
    """What a scene's film came to; errors are shares of the leaf's length.

    Attributes:
        asked: The tolerance.
        level: The level of the film that was kept.
        passes: How many films were computed in full.
        estimate: The error that the film reports of itself.
        error: Its distance to the truth.
        own_error: What the truth itself is off by, estimated.
    """

    asked: float
    level: int
    passes: int
    estimate: float
    error: float
    own_error: float

    @property
    def ratio(self) -> float:
        """The estimate over the truth."""
        return self.estimate / self.error

    def row(self, case: int) -> str:
        """As a line of the table."""
        shares = f"{self.estimate:.2%} | {self.error:.2%} | {self.own_error:.2%}"
        return f"| {case} | {self.asked:.2%} | {self.level} | {self.passes} | {shares} | {self.ratio:.2f} |"


def measure(scene: Scene, cache: Path, finer: int) -> Measured:
    """Compute what ``run`` would, and a truth that is finer by so many levels, or fewer where that is very fine."""
    search = Search(scene, cache, "cpu")

    def film(resolved: Scene) -> Film:
        return compute_film(resolved, search.watcher(prepare_scene_leaf(resolved, cache)), "cpu")

    choice = search.first()
    while choice is not None:
        ours = film(choice.scene)
        search.take(choice, ours)
        choice = search.finer()
    report = search.report()
    level = report["level"]
    finest = max(level + LEAST_FINER, min(level + finer, FINEST))
    # One level finer than ours at any rate: so it is another film.
    between, truth = film(at_level(scene, level + 1)), film(at_level(scene, finest))
    length = prepare_scene_leaf(at_level(scene, level), cache).length
    return Measured(
        asked=report["asked"],
        level=level,
        passes=len(report["passes"]),
        estimate=report["reached"],
        error=errors_of(ours, truth, length).shape,
        own_error=error_from(errors_of(between, truth, length).shape, finest, level + 1),
    )


@contextmanager
def interruptible() -> Iterator[None]:
    """Let SIGTERM end what is inside as Ctrl-C does, and Ctrl-C also in the background, where it is ignored."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows; of the scenes so far where a signal ends it."""
    cases, tolerance, finer = (1, 0.2, LEAST_FINER) if options.quick else (options.cases, options.tolerance, FINER)
    lines = [
        "| scene | asked | level | films | its own estimate | true error | of the truth itself | estimate / truth |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    found: list[Measured] = []
    ended = ""
    for case in range(cases):
        rng = np.random.default_rng([options.seed, case])
        with tempfile.TemporaryDirectory() as folder, interruptible():
            photo = Path(folder) / f"leaf_{case}.png"
            try:
                draw_photo(rng, photo)
                found.append(measure(draw_scene(rng, photo, tolerance), Path(folder), finer))
                lines.append(found[-1].row(case))
            except LeafwarpError as error:
                lines.append(f"| {case} | | | | refused: {error} | | | |")
            except KeyboardInterrupt:
                ended = f" Interrupted after {case} of {cases} scenes."
                break
        print(lines[-1], file=sys.stderr, flush=True)
    return f"{summary(found)}{ended}\n\n" + "\n".join(lines) + "\n"


def summary(found: list[Measured]) -> str:
    """How often a tolerance was kept, and how good the estimates are, in words."""
    count = len(found)
    kept = sum(one.error <= one.asked for one in found)
    surely = sum(one.error + one.own_error <= one.asked for one in found)
    close = sum(1.0 / FACTOR <= one.ratio <= FACTOR for one in found)
    median = f"{statistics.median(one.ratio for one in found):.2f}" if found else "none"
    return (
        f"The true error is within the tolerance in {kept} of {count} scenes, in {surely} also where the truth's own "
        f"error is added to it; the estimate is within a factor of {FACTOR:g} of the truth in {close} (median ratio "
        f"{median})."
    )
