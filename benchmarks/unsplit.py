"""An unsplit step of diffusion beside a split one, in a leaf that dries.

Every scheme goes through the same moments of the scene: water transpires, the petiole feeds it or is cut off, and
diffuses. Unlike a split step, an unsplit one costs what the water's change asks for, so that a step that is repeated
from the same contents would tell nothing. Timed is the diffusion alone, in turns, step by step.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.timing import Timing
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.fluid import Fluid
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages

SCENES = Path(__file__).parent.parent / "scenes"
TITLE = "Fluid: an unsplit step beside a split one"
QUICK = "one small map, few steps"
SIZES, QUICK_SIZES = (256, 512, 1024), (64,)
ROUNDS = (16, 3)
OPTIONS = {"--sizes": {"type": int, "nargs": "+", "metavar": "CELLS", "help": f"cells across (default: {SIZES})"}}
# Steps before anything is timed: the first ones have no increment to start from.
UNTIMED = 4
SCHEMES = {
    "split": {"fluid.scheme": "split"},
    "conjugate gradients": {"fluid.scheme": "unsplit", "fluid.solver": "conjugate_gradients"},
    "factor": {"fluid.scheme": "unsplit", "fluid.solver": "factor"},
}
# Contenders of a whole film, whose every step a factor would make minutes of.
FILMED = ("split", "conjugate gradients")
# What an unsplit step should cost at most, of a split one.
LIMIT = 6


@dataclass
class Diffusion:
    """The fluid of a scene, whose diffusion is timed."""

    scene: Scene
    leaf: Leaf

    def __post_init__(self):
        stages = make_stages(self.scene, self.leaf, "fluid")[0]
        self.state = State([spec for stage in stages for spec in stage.arrays], "cpu", self.scene.solver.precision)
        for stage in stages:
            stage.bind(self.state)
        self.steps = Fluid(self.scene, self.leaf, self.state, list(stages)).steps
        self._stages = [stage for stage in stages if stage.rate == "fluid step"]
        self._diffusion = next(stage for stage in stages if "diffusion" in stage.name)

    @property
    def iterations(self) -> int:
        """Of conjugate gradients so far; 0 for other schemes."""
        return getattr(self._diffusion, "iterations", 0)

    @property
    def water(self) -> np.ndarray:
        """Relative water content, float64, shape [ny, nx]."""
        return self.state["water"].numpy().astype(np.float64)

    def step(self, index: int) -> float:
        """Do a step of the scene; the time that diffusion takes [ms]."""
        interval, spent = self.steps.interval(index), 0.0
        for stage in self._stages:
            begin = time.perf_counter()
            stage.run(interval)
            if stage is self._diffusion:
                spent = time.perf_counter() - begin
        return 1e3 * spent


def rows_of(name: str, cells: int, steps: int) -> list[str]:
    """Rows of a scene's map of so many cells across: while its source is open, and from where it is cut off."""
    scene = load_scene(SCENES / f"{name}.toml").with_changes({"maps.size": cells, "output.contact_sheet": False})
    leaf = prepare_scene_leaf(scene, None)
    schemes = {scheme: Diffusion(scene.with_changes(changes), leaf) for scheme, changes in SCHEMES.items()}
    iterated = schemes["conjugate gradients"]
    cut = round(scene.source.cut_at / iterated.steps.length)
    rows = []
    for source, first in (("open", 0), ("cut", cut - UNTIMED)):
        times: dict[str, list[float]] = {scheme: [] for scheme in schemes}
        for index in range(first, first + UNTIMED + steps):
            if index == first + UNTIMED:
                before = iterated.iterations
            for scheme, diffusion in schemes.items():
                times[scheme].append(diffusion.step(index))
        timings = {scheme: Timing(tuple(laps[UNTIMED:])) for scheme, laps in times.items()}
        split = timings["split"]
        water, other = iterated.water, schemes["factor"].water
        off = np.linalg.norm(water - other) / np.linalg.norm(other)
        rows.append(
            f"| `{name}.toml` | {cells} | {source} | {split} | {timings['conjugate gradients'].over(split)} | "
            f"{(iterated.iterations - before) / steps:.1f} | {timings['factor'].over(split)} | {off:.1e} |"
        )
    return rows


def film_row(name: str, cells: int) -> str:
    """Row of a scene's map of so many cells across: all of its steps, with what is made once for each system."""
    scene = load_scene(SCENES / f"{name}.toml").with_changes({"maps.size": cells, "output.contact_sheet": False})
    leaf = prepare_scene_leaf(scene, None)
    split, iterated = (Diffusion(scene.with_changes(SCHEMES[scheme]), leaf) for scheme in FILMED)
    count = split.steps.count
    spent = np.array([[diffusion.step(index) for diffusion in (split, iterated)] for index in range(count)])
    dearest = np.sort(spent[:, 1] / np.median(spent[:, 0]))[::-1]
    total = spent.sum(axis=0)
    return (
        f"| `{name}.toml` | {cells} | {count} | {1e-3 * total[0]:.3g} | {1e-3 * total[1]:.3g} | "
        f"{total[1] / total[0]:.3g} | {iterated.iterations / count:.2g} | {dearest[0]:.3g} | "
        f"{100 * np.mean(dearest > LIMIT):.2g} % |"
    )


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    rows = [
        "| scene | map | source | split step [ms] | conjugate gradients, of a split step | iterations a step | "
        "factor, of a split step | relative difference of the two |",
        "|---|---:|---|---:|---:|---:|---:|---:|",
    ]
    sizes = options.sizes or (QUICK_SIZES if options.quick else SIZES)
    for name in ("bramble", "cut"):
        for cells in sizes:
            rows += rows_of(name, cells, options.rounds)
    films = [
        "| scene | map | steps | split [s] | conjugate gradients [s] | of split | iterations a step | "
        f"dearest step, of a split one | steps over {LIMIT} |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
        *(film_row(name, cells) for name in (("cut",) if options.quick else ("bramble", "cut")) for cells in sizes),
    ]
    return (
        f"Median (and middle half) of {options.rounds} steps in a row, of the scene's own length, float32 (factor: "
        f"float64), after {UNTIMED} untimed ones: from its start, with the source open, and from the cut on. Ratios "
        "are taken step by step.\n\n" + "\n".join(rows) + "\n\nAll steps of the film, the dear ones after its start "
        "and the cut among them (what bounds the error is learnt then):\n\n" + "\n".join(films)
    )
