"""What the leaf lies on: paper or card with uneven light, the leaf's shadow and the camera's grain."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .raster import blur, linear, noise


@dataclass(frozen=True)
class Backdrop:
    """A sheet behind the leaf. Lengths in pixels, strengths as shares of the sheet's own light."""

    colour: str
    texture: float = 0.012
    falloff: float = 0.10  # light lost from the upper left to the lower right corner
    vignette: float = 0.05
    shadow: float = 0.58
    lift: float = 11.0  # shadow's offset
    grain: float = 0.45  # in 8-bit levels


def sheet(backdrop: Backdrop, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Linear-light RGB of the bare sheet."""
    height, width = size
    y, x = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    light = 1.0 - backdrop.falloff * (0.45 * x + 0.55 * y)
    light -= backdrop.vignette * 2.0 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)
    texture = 0.6 * noise(size, 2.5, rng) + 0.5 * noise(size, 7.0, rng) + 0.5 * noise(size, 60.0, rng)
    light = light * (1.0 + backdrop.texture * texture)
    return light[..., None].astype(np.float32) * linear(backdrop.colour)


def shadow(coverage: np.ndarray, lift: float) -> np.ndarray:
    """Share of light that the leaf keeps from the sheet: tight beside the leaf, wide and faint beyond."""
    total = np.zeros_like(coverage)
    for offset, sigma, share in ((0.25, 0.3, 0.30), (0.8, 0.8, 0.40), (1.6, 2.2, 0.30)):
        move = np.float32([[1, 0, 0.85 * offset * lift], [0, 1, offset * lift]])
        moved = cv2.warpAffine(coverage, move, coverage.shape[::-1], flags=cv2.INTER_LINEAR)
        total += share * blur(moved, sigma * lift)
    return total


def compose(leaf: np.ndarray, coverage: np.ndarray, backdrop: Backdrop, rng: np.random.Generator) -> np.ndarray:
    """Linear-light picture of a leaf with the given coverage on its backdrop."""
    ground = sheet(backdrop, coverage.shape, rng)
    shade = backdrop.shadow * shadow(coverage, backdrop.lift)[..., None]
    ground = ground * (1.0 - shade * np.array([1.0, 0.98, 0.93], np.float32))
    return ground + (leaf - ground) * coverage[..., None]


def grain(picture: np.ndarray, strength: float, rng: np.random.Generator) -> np.ndarray:
    """The 8-bit picture with faint grey noise."""
    levels = np.round(strength * rng.standard_normal(picture.shape[:2]))[..., None]
    return np.clip(picture.astype(np.float32) + levels, 0, 255).astype(np.uint8)
