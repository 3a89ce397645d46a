"""The coarsest resolution that keeps a scene's error within its tolerance, found by films that are coarser still.

Errors are taken to be of first order in the size of a cell and an edge and in the fluid step, which a level of
resolution (:mod:`leafwarp.scene.quality`) changes together. Two films whose levels differ by two then differ by the
error of the finer one (Richardson). What the film itself turned out to be off by is estimated in the same way, from its
distance to the last of the coarse ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from leafwarp.errors import SimulationError
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.scene.quality import HIGHEST_LEVEL, Resolution
from leafwarp.sim.simulation import Simulation
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.surface import sample_points
from leafwarp.study.tradeoff.trial import Film, Sampler, run_trial, sampled_frames

# The levels of the first two films.
FIRST_LEVELS = (0, 2)
# The error to aim at, over the tolerance: an estimate may be too low.
AIM = 0.6
# A film is aimed at that is finer by this many levels than the last pilot, at most.
FARTHEST = 2


@dataclass(frozen=True)
class Pilot:
    """A coarse film.

    Attributes:
        level: Its level of resolution.
        film: What it looked like.
    """

    level: int
    film: Film


@dataclass(frozen=True)
class Choice:
    """A resolution that was chosen, and what is known of its error.

    Attributes:
        scene: The scene at that resolution.
        level: Its level.
        values: The keys that it decided.
        expected: Error of the shape that is expected, as a share of the leaf's length.
        pilots: The coarse films.
        places: Points of the leaf at which they are compared [m], shape [point_count, 2].
    """

    scene: Scene
    level: int
    values: dict[str, Any]
    expected: float
    pilots: tuple[Pilot, ...]
    places: np.ndarray

    def error_of(self, film: Film, length: float) -> float:
        """Estimated error of the shape of the film of this choice, as a share of the leaf's length.

        It is told from the pilot that is nearest to it in level; where the pilots are finer, from the coarsest of them.

        Args:
            film: The film.
            length: Length of the leaf [m].
        """
        other = min((p for p in self.pilots if p.level != self.level), key=lambda p: abs(p.level - self.level))
        difference = errors_of(film, other.film, length).shape
        finer = finer_error(difference, abs(self.level - other.level))
        return finer if other.level < self.level else finer + difference

    def watcher(self, leaf: Leaf) -> Watcher:
        """What looks at the film of this choice, on its leaf."""
        return Watcher(self, leaf)


def at_level(scene: Scene, level: int) -> Scene:
    """A scene at a level of resolution; what it says itself stands."""
    return scene.with_changes(Resolution.of(level).values(scene))


def finer_error(difference: float, levels: int) -> float:
    """Error of the finer of two films of first order.

    Args:
        difference: How far they lie apart.
        levels: By how many levels they differ.
    """
    return difference / (2.0 ** (levels / 2) - 1.0)


def choose_resolution(
    scene: Scene, cache: Path | None, device: str, say: Callable[[str], None] = lambda text: None
) -> Choice:
    """Find the coarsest resolution whose error is expected to be within the scene's tolerance.

    Args:
        scene: A scene with a tolerance.
        cache: Folder of prepared leaves.
        device: Warp device.
        say: Tells the user.

    Raises:
        SimulationError: A coarse film cannot be computed.
    """
    places: np.ndarray | None = None
    length = 0.0
    pilots: list[Pilot] = []

    def run(level: int) -> None:
        nonlocal places, length
        coarse = at_level(scene, level)
        leaf = prepare_scene_leaf(coarse, cache)
        if places is None:
            places, length = sample_points(leaf.mesh), leaf.length
        try:
            pilots.append(Pilot(level, run_trial(coarse, leaf, places, device)))
        except SimulationError as error:
            raise SimulationError(error.frame, f"coarse film for tolerance: {error.stage}", error.reason) from None

    def error() -> float:
        last = pilots[-1]
        # Levels that are but one apart differ by little more than what is not of first order.
        before = max((p for p in pilots if p.level <= last.level - 2), key=lambda p: p.level)
        return finer_error(errors_of(before.film, last.film, length).shape, last.level - before.level)

    for level in FIRST_LEVELS:
        run(level)
    while True:
        last, found = pilots[-1].level, error()
        wanted = _level_for(found, last, AIM * scene.tolerance)
        say(f"coarse film of level {last}: its shape is off by about {100.0 * found:.2g} % of the length")
        if wanted <= last + FARTHEST or last + FARTHEST >= HIGHEST_LEVEL:
            level = min(wanted, HIGHEST_LEVEL)
            expected = found * 2.0 ** ((last - level) / 2)
            values = Resolution.of(level).values(scene)
            return Choice(scene.with_changes(values), level, values, expected, tuple(pilots), places)
        run(min(max(last + 1, wanted - FARTHEST), last + FARTHEST))


def _level_for(error: float, level: int, wanted: float) -> int:
    """The level at which an error that is known at another falls to what is wanted."""
    if error <= 0.0:
        return FIRST_LEVELS[0]
    return max(FIRST_LEVELS[0], level + math.ceil(2.0 * math.log2(error / wanted)))


class Watcher:
    """Looks at the film as it is computed, and says at its end how far it is off.

    Args:
        choice: What was chosen.
        leaf: The leaf of the film.
    """

    def __init__(self, choice: Choice, leaf: Leaf):
        self._choice, self._length = choice, leaf.length
        self._sampler = Sampler(leaf, choice.places)
        self._wanted = sampled_frames(choice.scene)
        self._points: list[np.ndarray] = []
        self._water: list[np.ndarray] = []

    def look(self, simulation: Simulation, frame: Frame) -> None:
        """Take a frame into account."""
        if frame.index in self._wanted:
            self._points.append(self._sampler.points(frame.points))
            self._water.append(self._sampler.water(simulation, frame.water))

    def error(self) -> float | None:
        """Estimated error of the shape, as a share of the leaf's length; None of a film that is not whole."""
        if len(self._points) < len(self._wanted):
            return None
        return self._choice.error_of(Film(np.stack(self._points), np.stack(self._water)), self._length)

    def report(self) -> dict[str, Any]:
        """What was asked, expected and reached, as plain data; errors as shares of the leaf's length."""
        choice = self._choice
        return {
            "asked": choice.scene.tolerance,
            "expected": choice.expected,
            "reached": self.error(),
            "level": choice.level,
            "pilot_levels": [pilot.level for pilot in choice.pilots],
            "resolution": choice.values,
        }
