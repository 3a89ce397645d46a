"""The coarsest resolution that keeps a scene's error within its tolerance, found by films that are coarser still.

A level of resolution (:mod:`leafwarp.scene.quality`) changes the size of the cells, that of the edges and the fluid
step together. Errors are taken to fall with the power :data:`ORDER` of that size, ``e ~ 2^(-ORDER level / 2)``.
Richardson's extrapolation would take the errors of two films to point the same way, ``e_fine = d / (r - 1)`` for a
distance of ``d`` and errors of a ratio of ``r``. Those of two meshes do so only in part: with a correlation ``c``

    d^2 = e_coarse^2 + e_fine^2 - 2 c e_coarse e_fine,  so  e_fine = d / sqrt(1 + r^2 - 2 c r).

Films are computed ever finer until one is near enough to tell how fine the film must be. That one is then held
against the finest of the others. Where it misses the tolerance, the coarse film that is next to it is computed, too: a
leaf that came to rest in another shape on a coarse mesh misleads, and to find out takes about a third of the time. If
it still misses, it is computed again, finer, and was itself a coarse film. Most films never come to that, so nothing
is spent on it beforehand; a coarse film more before every film would make all of them a third slower, and would not
see what the film itself turns out to be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
from leafwarp.sim.method import with_fitting_method
from leafwarp.sim.simulation import Simulation
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.surface import sample_points
from leafwarp.study.tradeoff.trial import Film, Sampler, sampled_frames

# The levels of the first two coarse films.
FIRST_LEVELS = (1, 2)
# Of the errors, and the correlation of those of two films: what fits the distances of the films of levels 0 to 5 of 28
# random scenes (benchmarks/tolerance.py, seeds 11 and 12). They lie within a factor of 1.43 of it (standard deviation
# of the logarithm); with first order, which map and step are of in theory, within 1.47 to 1.55.
ORDER, CORRELATION = 1.5, 0.65
# The error to aim at, over the tolerance: an estimate may be too low.
AIM = 0.6
# A film is aimed at that is finer by this many levels than the one before it, at most; it takes about eight times
# the work.
FARTHEST = 2
# How often a film is computed at most, each time finer.
MOST_PASSES = 3


@dataclass(frozen=True)
class Choice:
    """A resolution that was chosen.

    Attributes:
        scene: The scene at that resolution.
        level: Its level.
        values: The keys that it decided.
        expected: Error of the shape that is expected, as a share of the leaf's length.
    """

    scene: Scene
    level: int
    values: dict[str, Any]
    expected: float


@dataclass(frozen=True)
class Pass:
    """A film of a choice.

    Attributes:
        choice: The choice.
        reached: Estimated error of its shape, as a share of the leaf's length; None of part of a film.
    """

    choice: Choice
    reached: float | None

    def report(self) -> dict[str, Any]:
        """Level and errors as plain data."""
        return {"level": self.choice.level, "expected": self.choice.expected, "reached": self.reached}


def at_level(scene: Scene, level: int) -> Scene:
    """A scene at a level of resolution; what it says itself stands."""
    return scene.with_changes(Resolution.of(level).values(scene))


def remaining(levels: int) -> float:
    """Share of an error that remains on a film that is finer by so many levels."""
    return 2.0 ** (-ORDER * levels / 2)


def error_from(distance: float, level: int, other: int) -> float:
    """Error of a film, told from its distance to one of another level.

    Args:
        distance: How far they lie apart.
        level: Level of the film.
        other: Level of the other one.
    """
    ratio = 1.0 / remaining(level - other)
    return distance / math.sqrt(1.0 + ratio**2 - 2.0 * CORRELATION * ratio)


def estimated_error(films: Mapping[int, Film], level: int, length: float) -> float:
    """Estimated error of the shape of a film, as a share of the leaf's length, from the finest one of the others.

    Args:
        films: Two films or more, by their levels.
        level: Level of the film.
        length: Length of the leaf [m].
    """
    other = max(other for other in films if other != level)
    return error_from(errors_of(films[level], films[other], length).shape, level, other)


class Search:
    """Finds the coarsest resolution that keeps a scene's tolerance.

    Args:
        scene: A scene with a tolerance.
        cache: Folder of prepared leaves.
        device: Warp device.
        say: Tells the user.
        look: Called after every frame of a coarse film; may raise.

    Attributes:
        scene: The scene, its motion decided.
    """

    def __init__(
        self,
        scene: Scene,
        cache: Path | None,
        device: str,
        say: Callable[[str], None] = lambda text: None,
        look: Callable[[], None] = lambda: None,
    ):
        leaf = prepare_scene_leaf(at_level(scene, FIRST_LEVELS[0]), cache)
        # All films move alike, or their distances would tell of that.
        scene = with_fitting_method(scene, leaf, say)
        self.scene, self._cache, self._device, self._say, self._look = scene, cache, device, say, look
        self._places, self._length = sample_points(leaf.mesh), leaf.length
        self._films: dict[int, Film] = {}
        self._coarse: list[int] = []
        self._passes: list[Pass] = []
        self._failure: str | None = None

    def first(self) -> Choice:
        """Choose a resolution from films that are coarser by a few levels.

        Raises:
            SimulationError: A coarse film cannot be computed.
        """
        for level in FIRST_LEVELS:
            self._add_coarse(level)
        while True:
            last = self._coarse[-1]
            found = self._error(last)
            self._say(f"coarse film of level {last}: its shape is off by about {100.0 * found:.2g} % of the length")
            wanted = self._level_for(found, last)
            if wanted <= last + FARTHEST or last + FARTHEST >= HIGHEST_LEVEL:
                return self._choice(min(wanted, HIGHEST_LEVEL), found, last)
            self._add_coarse(last + 1)

    def watcher(self, leaf: Leaf) -> Watcher:
        """What looks at a film of the scene on a leaf of its."""
        return Watcher(self.scene, leaf, self._places)

    def take(self, choice: Choice, film: Film | None) -> None:
        """Take in the film of a choice; None of one that is not whole, which nothing can be told of."""
        if film is not None:
            self._films[choice.level] = film
        self._passes.append(Pass(choice, None if film is None else self._error(choice.level)))

    def finer(self) -> Choice | None:
        """Choose anew where the last film misses the tolerance; None where it does not, or no finer one is to be had.

        Raises:
            SimulationError: A coarse film cannot be computed.
        """
        choice, reached = self._passes[-1].choice, self._passes[-1].reached
        level, asked = choice.level, self.scene.tolerance
        if reached is None or reached <= asked or level >= HIGHEST_LEVEL or len(self._passes) >= MOST_PASSES:
            return None
        if level > 0 and level - 1 not in self._films:
            self._add_coarse(level - 1)
            reached = self._error(level)
            self._passes[-1] = Pass(choice, reached)
            if reached <= asked:
                return None
        finer = self._choice(min(self._level_for(reached, level), level + FARTHEST, HIGHEST_LEVEL), reached, level)
        self._say(
            f"film of level {level}: its shape is off by about {100.0 * reached:.2g} % of the length, more than "
            f"{100.0 * asked:.2g} %: once more at level {finer.level}; it stays until the finer one is whole"
        )
        return finer

    def fail(self, reason: str) -> None:
        """Take note that a finer film cannot be computed."""
        if self._passes[-1].reached is None:
            self._passes.pop()
        self._failure = reason
        self._say(f"a finer film cannot be computed: {reason}; the one before it is kept")

    def report(self) -> dict[str, Any]:
        """What was asked, expected and reached, as plain data; errors as shares of the leaf's length."""
        last = self._passes[-1]
        return {
            "asked": self.scene.tolerance,
            **last.report(),
            "resolution": last.choice.values,
            "coarse_levels": sorted(self._coarse),
            "passes": [one.report() for one in self._passes],
            "failure": self._failure,
        }

    def _add_coarse(self, level: int) -> None:
        scene = at_level(self.scene, level)
        try:
            film = compute_film(scene, self.watcher(prepare_scene_leaf(scene, self._cache)), self._device, self._look)
        except SimulationError as error:
            raise SimulationError(error.frame, f"coarse film for tolerance: {error.stage}", error.reason) from None
        self._films[level] = film
        self._coarse.append(level)

    def _error(self, level: int) -> float:
        return estimated_error(self._films, level, self._length)

    def _level_for(self, error: float, level: int) -> int:
        """The level at which an error that is known at another falls to what is aimed at."""
        if error <= 0.0:
            return 0
        return max(0, level + math.ceil(math.log(AIM * self.scene.tolerance / error, remaining(1))))

    def _choice(self, level: int, error: float, known: int) -> Choice:
        """A level, where the error at another one is known."""
        values = Resolution.of(level).values(self.scene)
        return Choice(self.scene.with_changes(values), level, values, error * remaining(level - known))


class Watcher:
    """Looks at a film as it is computed.

    Args:
        scene: The scene.
        leaf: The leaf of the film.
        places: Points of the leaf at which films are compared [m], shape [point_count, 2].
    """

    def __init__(self, scene: Scene, leaf: Leaf, places: np.ndarray):
        self.leaf = leaf
        self._sampler = Sampler(leaf, places)
        self._wanted = sampled_frames(scene)
        self._points: list[np.ndarray] = []
        self._water: list[np.ndarray] = []

    def look(self, simulation: Simulation, frame: Frame) -> None:
        """Take a frame into account."""
        if frame.index in self._wanted:
            self._points.append(self._sampler.points(frame.points))
            self._water.append(self._sampler.water(simulation, frame.water))

    def film(self) -> Film | None:
        """What was seen; None of a film that is not whole."""
        if len(self._points) < len(self._wanted):
            return None
        return Film(np.stack(self._points), np.stack(self._water))


def compute_film(scene: Scene, watcher: Watcher, device: str, look: Callable[[], None] = lambda: None) -> Film:
    """Compute a scene for its film alone.

    Args:
        scene: The scene, at a resolution.
        watcher: What looks at it.
        device: Warp device.
        look: Called after every frame; may raise.

    Raises:
        SimulationError: The scene cannot be computed so.
    """
    simulation = Simulation(scene, watcher.leaf, device)
    for frame in simulation.frames():
        watcher.look(simulation, frame)
        look()
    return watcher.film()
