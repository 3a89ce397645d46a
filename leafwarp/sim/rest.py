"""A shape that has come to rest, and stays so until its input changes."""

from __future__ import annotations

import math

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene

# How far a vertex may stay from where it would go in the rest of the film, over its leaf's length.
TOLERANCE = 1e-5
# Playback time for which a leaf has to keep still [s].
CALM = 2.0


class ShapeRest:
    """Sees from the frames when a leaf that has inertia has come to rest under an input that stays as it is.

    It rests once no vertex has been further than a share of :data:`TOLERANCE` from one place for :data:`CALM`
    seconds: so large a share that the leaf, if it crept on at the same speed, would stay within the tolerance until
    the end of the film. A swing so slow that it hardly moves in that time, or an equilibrium that is left later because
    it is unstable, is not seen.

    Args:
        scene: The scene.
        leaf: The leaf; of many, all have to be at rest.

    Attributes:
        is_resting: Whether the shape stays as it is.
    """

    def __init__(self, scene: Scene, leaf: Leaf):
        self._frames, self._fps = scene.time.frames, scene.time.fps
        lengths = leaf.join(lambda photo, specimen: np.full(photo.mesh.vertex_count, specimen.size * photo.length))
        self._tolerance = TOLERANCE * lengths
        self._seen = -1
        self.is_resting = False
        self._place: np.ndarray | None = None
        self._calm = 0

    def wake(self) -> None:
        """The input has changed: nothing is known of where the shape goes."""
        self.is_resting, self._place, self._calm = False, None, 0

    def look(self, frame: int, points: np.ndarray) -> None:
        """See whether the leaf has come to rest, from a frame under the same input as the one before.

        Args:
            frame: Its number.
            points: Vertices [m], shape [vertex_count, 3].
        """
        if self.is_resting or frame <= self._seen:
            return
        self._seen = frame
        if self._place is None:
            self._place, self._calm = points, 0
            return
        left = (self._frames - frame) / self._fps
        off = np.linalg.norm(points - self._place, axis=1)
        if not (off <= self._tolerance * (CALM / (CALM + left))).all():
            self._place, self._calm = points, 0
            return
        self._calm += 1
        self.is_resting = self._calm >= math.ceil(CALM * self._fps)
