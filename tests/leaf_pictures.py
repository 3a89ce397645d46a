"""Drawn leaf pictures of known shape for the tests of the leaf preparation."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 420, 560
CENTRE, AXES = (210.0, 230.0), (120.0, 190.0)  # [pixels]
BASE = (216.0, 520.0)  # the petiole's end
TIP = (210.0, 40.0)
PETIOLE_WIDTH = 9.0
BACKGROUND, LAMINA, VEIN = (236, 233, 226), (62, 118, 48), (178, 200, 130)
FINE = 8  # supersampling


def blade_outline(teeth: int = 0, depth: float = 0.0) -> np.ndarray:
    """Corners of an elliptic blade with so many teeth of a depth relative to the radius, shape [count, 2]."""
    angle = np.linspace(0.0, 2.0 * np.pi, 2400, endpoint=False)
    radius = 1.0 + (depth * np.abs(np.sin(0.5 * teeth * angle)) if teeth else 0.0)
    return np.column_stack([CENTRE[0] + AXES[0] * radius * np.cos(angle), CENTRE[1] + AXES[1] * radius * np.sin(angle)])


def true_length(teeth: int = 0, depth: float = 0.0) -> float:
    """Distance from the base to the farthest point of the drawn blade [pixels]."""
    return float(np.linalg.norm(blade_outline(teeth, depth) - BASE, axis=1).max())


def petiole_outline() -> np.ndarray:
    """Corners of the petiole, from inside the blade to its flat end, shape [4, 2]."""
    half = 0.5 * PETIOLE_WIDTH
    return np.array([[205.0, 400.0], [215.0, 400.0], [BASE[0] + half, BASE[1]], [BASE[0] - half, BASE[1]]])


def coverage(*polygons: np.ndarray) -> np.ndarray:
    """Share of each pixel that the polygons cover, shape [HEIGHT, WIDTH]."""
    fine = np.zeros((HEIGHT * FINE, WIDTH * FINE), np.uint8)
    for polygon in polygons:
        cv2.fillPoly(fine, [np.rint(polygon * FINE * 16 - 8).astype(np.int32)], 255, shift=4)
    return cv2.resize(fine.astype(np.float64), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) / 255.0


def vein_lines() -> list[np.ndarray]:
    """A midrib and five pairs of secondaries, each as its two ends."""
    lines = [np.array([BASE, (210.0, 60.0)])]
    for height in (140, 195, 250, 305, 360):
        reach = 0.8 * AXES[0] * np.sqrt(1.0 - ((height - 45 - CENTRE[1]) / AXES[1]) ** 2)
        lines += [np.array([(210.0, height), (210.0 + side * reach, height - 45.0)]) for side in (-1, 1)]
    return lines


def draw_leaf(teeth: int = 0, depth: float = 0.0, petiole: bool = True, veins: bool = True) -> np.ndarray:
    """A leaf on grainy paper with a soft shadow, 8-bit RGB, shape [HEIGHT, WIDTH, 3]."""
    random = np.random.default_rng(7)
    polygons = [blade_outline(teeth, depth)] + ([petiole_outline()] if petiole else [])
    cover = coverage(*polygons)[..., None]
    shadow = cv2.GaussianBlur(np.roll(cover[..., 0], (6, 5), (0, 1)), (0, 0), 5.0)[..., None]
    paper = np.array(BACKGROUND) * (1.0 - 0.25 * shadow) * np.linspace(1.0, 0.94, WIDTH)[None, :, None]
    lamina = np.broadcast_to(np.array(LAMINA, float), (HEIGHT, WIDTH, 3)).copy()
    if veins:
        for number, line in enumerate(vein_lines()):
            ends = np.rint(line * 16 - 8).astype(int).tolist()
            cv2.line(lamina, *ends, VEIN, 5 if number == 0 else 2, cv2.LINE_8, 4)
        lamina = cv2.GaussianBlur(lamina, (0, 0), 0.7)
    picture = paper * (1.0 - cover) + lamina * cover + random.normal(0.0, 1.5, (HEIGHT, WIDTH, 1))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def write_image(path: Path, pixels: np.ndarray) -> Path:
    """Write RGB, RGBA or grey pixels of any depth by the file's suffix."""
    code = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    stored = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, code[pixels.shape[2]])
    assert cv2.imwrite(str(path), stored)
    return path
