"""Small fluids for tests: drawn maps instead of a photo, and float64 references of the diffusion step."""

from __future__ import annotations

import numpy as np

from leafwarp.study.verify.drawn_fluid import (
    STAGES,
    Sample,
    diffusion_sample,
    ellipse,
    exchange_matrices,
    make_sample,
    make_scene,
    random_diffusivity,
)

__all__ = [
    "SCHEMES",
    "Sample",
    "diffusion_sample",
    "ellipse",
    "exchange_matrices",
    "make_sample",
    "make_scene",
    "petiole_leaf",
    "random_diffusivity",
    "stage_name",
]

SCHEMES = tuple(STAGES)


def stage_name(scheme: str) -> str:
    return STAGES[scheme]


def petiole_leaf(count: int, direction: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A round blade with a midrib on a thin petiole, drawn from its foot along x, y or the diagonal.

    Returns:
        The mask, and the maps of venation (the petiole and its midrib) and source (the petiole's foot).
    """
    centre = (np.arange(count) + 0.5) / count - 0.5
    x, y = np.meshgrid(centre, centre)
    angle = np.radians({"x": 0.0, "diagonal": 45.0, "y": 90.0}[direction])
    along = x * np.cos(angle) + y * np.sin(angle) + 0.4
    across = np.abs(y * np.cos(angle) - x * np.sin(angle))
    petiole = (across < 0.04) & (along >= 0.0) & (along < 0.6)
    mask = petiole | (np.hypot(along - 0.6, across) < 0.25)
    midrib = (along < 0.75) * np.clip((0.04 - across) * count + 0.5, 0.0, 1.0)
    return mask, {"venation": midrib * mask, "source": (petiole & (along < 0.06)).astype(float)}
