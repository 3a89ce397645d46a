"""When the structure has to be told of the water, beside at the frames."""

from __future__ import annotations

import math
from itertools import pairwise

from leafwarp.scene import Curve, Scene

# Change of the rest lengths at a time. As a shock, several times as much folds soft triangles over.
MOST_STRAIN = 0.005
# The same of the strain between a leaf's two sides, from one equilibrium to the next: 0.3 rad of a leaf
# 400 times as long as it is thick.
MOST_MISMATCH = 5e-4
# Equilibria on the path of a leaf without inertia, and what a leaf whose stiffness changes with the water takes.
LONGEST_PATH = 24


def couplings_per_frame(scene: Scene) -> int:
    """Couplings a frame, so that explicit motion sees no large change of the rest lengths at a time: 1 unless
    frames are hours apart.

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
    # The curve may be steeper than any number, and no water lost.
    strain = min(slope * lost, most * _range(curve)) if lost > 0.0 else 0.0
    return max(1, math.ceil(strain / MOST_STRAIN))


def path_times(scene: Scene) -> tuple[float, ...]:
    """Moments of plant time [s] at which a leaf without inertia is in equilibrium, whatever the frames are.

    They make up the path on which it passes buckles: as many as the scene's curves ask for, up to
    :data:`LONGEST_PATH`.
    """
    if scene.motion.method != "quasistatic" or scene.time.frames == 1:
        return ()
    strain = _range(scene.shrink.curve) * max(1.0, scene.shrink.along_veins) if scene.shrinks else 0.0
    mismatch = _range(scene.curl.mismatch) if scene.curls else 0.0
    count = max(1, math.ceil(strain / MOST_STRAIN), math.ceil(mismatch / MOST_MISMATCH))
    count = LONGEST_PATH if scene.stiffness_varies else min(count, LONGEST_PATH)
    return tuple(scene.time.duration * index / count for index in range(1, count + 1))


def _range(curve: Curve) -> float:
    values = [value for _, value in curve]
    return max(values) - min(values)


def _speed(scene: Scene) -> float:
    """Largest mean rate at which the scene's water can change [1/s]."""
    if scene.water is not None:
        return max((abs((b - a) / (to - at)) for (at, a), (to, b) in pairwise(scene.water.curve)), default=0.0)
    loss = 0.0 if scene.transpiration is None else scene.transpiration.rate
    fills = scene.source is not None and (scene.source.rewatered_at is not None or scene.maps.water != "auto")
    gain = scene.source.conductance if fills else 0.0
    return max(loss, gain)
