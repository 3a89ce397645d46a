"""When the structure has to be told of the water, beside at the frames."""

from __future__ import annotations

import math
from itertools import pairwise

from leafwarp.scene import Scene

# Change of the rest lengths at a time. As a shock, several times as much folds soft triangles over.
MOST_STRAIN = 0.005
# Equilibria on the path of a leaf without inertia.
PATH_LENGTH = 24


def couplings_per_frame(scene: Scene) -> int:
    """Couplings a frame, so that explicit motion sees no jump of the rest lengths: 1 unless frames are hours apart.

    An estimate from the steepest part of the shrink's curve and the mean speed at which water is lost. Motions that
    find the end of a step by minimising need no more than one.
    """
    frames = scene.time.frames
    if scene.motion.method != "explicit" or not scene.shrinks or frames == 1:
        return 1
    curve = scene.shrink.curve
    most = max(1.0, scene.shrink.along_veins)
    slope = most * max(abs((b - a) / (to - at)) for (at, a), (to, b) in pairwise(curve))
    lost = min(1.0, _speed(scene) * scene.time.duration / (frames - 1))
    values = [value for _, value in curve]
    return max(1, math.ceil(min(slope * lost, most * (max(values) - min(values))) / MOST_STRAIN))


def path_times(scene: Scene) -> tuple[float, ...]:
    """Moments of plant time [s] at which a leaf without inertia is in equilibrium, whatever the frames are.

    They make up the path on which it passes buckles.
    """
    if scene.motion.method != "quasistatic" or scene.time.frames == 1:
        return ()
    return tuple(scene.time.duration * index / PATH_LENGTH for index in range(1, PATH_LENGTH + 1))


def _speed(scene: Scene) -> float:
    """Largest mean rate at which the scene's water can change [1/s]."""
    if scene.water is not None:
        return max((abs((b - a) / (to - at)) for (at, a), (to, b) in pairwise(scene.water.curve)), default=0.0)
    loss = 0.0 if scene.transpiration is None else scene.transpiration.rate
    fills = scene.source is not None and (scene.source.rewatered_at is not None or scene.maps.water != "auto")
    gain = scene.source.conductance if fills else 0.0
    return max(loss, gain)
