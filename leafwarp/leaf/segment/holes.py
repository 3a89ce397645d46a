"""True holes of a leaf, through which the background shows."""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.segment.background import Background, colour_distance
from leafwarp.leaf.segment.candidates import LEAST_THRESHOLD
from leafwarp.leaf.segment.pieces import pieces_of
from leafwarp.leaf.segment.shadow import DARKER

HOLE_SHARE = 0.001  # of the leaf; less is dirt or glare
CORE = 0.2  # least share of a hole that is plainly background; glare has less
SHADED = 0.7  # least share of a hole over deep shadow that is lit background or dark; a lesion is paler in part
SHARP = 0.5  # step at a hole's rim, of colour as a share of the leaf's contrast or, beside deep shadow, of lightness


def find_holes(lab: np.ndarray, inside: np.ndarray, background: Background) -> np.ndarray | None:
    """Holes of a filled leaf through which the background shows, shape as the leaf's, or None.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        inside: The leaf, holes filled.
        background: The background's colours.
    """
    import cv2

    distance = colour_distance(lab, background.shades(0.3))
    least = max(1.4 * background.grain, LEAST_THRESHOLD)
    contrast = float(np.median(distance[inside]))
    if contrast < 1.5 * least:
        return None
    kernel = np.ones((5, 5), np.uint8)
    deep = cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    light = min(float(np.median(lab[inside][:, 0])), float(np.median(background.colours[:, 0])))
    # Beneath a leaf lies its shadow: dark parts count with a hole, but do not make one.
    dark = lab[..., 0] < DARKER * light
    lit = colour_distance(lab, background.shades(0.5))
    step = _range(distance, kernel) / contrast
    edge = np.maximum(step, _range(np.ascontiguousarray(lab[..., 0]), kernel) / light)
    least_area = max(HOLE_SHARE * np.count_nonzero(inside), 12)
    holes = np.zeros_like(inside)
    for level in (0.5 * (least + contrast), 1.2 * least):  # the second parts a hole from glare beside it
        seen = cv2.morphologyEx((((distance < level) | dark) & deep).astype(np.uint8), cv2.MORPH_OPEN, kernel[:3, :3])
        labels, areas = pieces_of(seen > 0)
        core = np.bincount(labels[lit < least], minlength=len(areas))
        shaded = np.bincount(labels[dark], minlength=len(areas))
        plain = core > CORE * areas
        # Of a hole over deep shadow the lit part is small beside it, but still as large as a hole.
        deeply = (core >= least_area) & (core + shaded > SHADED * areas)
        for label in np.nonzero((areas >= least_area) & (plain | deeply))[0]:
            piece = labels == label
            rim = piece & (cv2.erode(seen, kernel[:3, :3]) == 0)
            sharpness = np.median((step if plain[label] else edge)[rim])
            if sharpness > SHARP and not (piece & holes).any():
                holes |= piece
    return holes if holes.any() else None


def _range(channel: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Greatest difference of a channel within a kernel."""
    import cv2

    return cv2.dilate(channel, kernel) - cv2.erode(channel, kernel)
