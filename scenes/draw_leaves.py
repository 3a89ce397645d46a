"""Draws the leaf pictures of the scenes: python scenes/draw_leaves.py [NAME ...] [--output DIR] [--veins]."""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from drawing.background import compose, grain
from drawing.catalogue import PICTURES, Picture
from drawing.leaves import LeafFields
from drawing.raster import encode
from drawing.shading import paint_leaf

# Scenes whose water enters along the whole petiole, by a source map that is drawn, too: NAME_source.png.
PETIOLE_SOURCES = ("cut",)


def draw(picture: Picture) -> tuple[np.ndarray, np.ndarray]:
    """The picture, uint8 RGB [height, width, 3], and its true mask of main veins, uint8 [height, width].

    The vein mask holds the midrib or ribs, the secondaries and their branches, antialiased: not the network.
    """
    fields = LeafFields(picture.shape)
    leaf = paint_leaf(fields, picture.palette)
    covered = np.maximum(fields.lamina, fields.petiole)
    light = compose(leaf, covered, picture.backdrop, fields.rng)
    veins = np.max([fields.veins(order) for order in range(3)], axis=0)
    return grain(encode(light), picture.backdrop.grain, fields.rng), np.round(255.0 * veins).astype(np.uint8)


def save(path: Path, image: np.ndarray) -> None:
    """Writes a PNG; colour images are RGB."""
    image = image[..., ::-1] if image.ndim == 3 else image
    path.write_bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 7])[1].tobytes())


def main() -> None:
    """Draws the pictures named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Draw the leaf pictures of the scenes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one or more of {', '.join(PICTURES)} (default: all)")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent, help="folder for the PNG files")
    parser.add_argument("--veins", action="store_true", help="also write each leaf's true vein mask, NAME_veins.png")
    arguments = parser.parse_args()
    for name in arguments.names:
        if name not in PICTURES:
            parser.error(f"no picture is called {name!r}; accepted: {', '.join(PICTURES)}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or PICTURES:
        image, veins = draw(PICTURES[name])
        save(arguments.output / f"{name}.png", image)
        if name in PETIOLE_SOURCES:
            petiole = LeafFields(PICTURES[name].shape).petiole
            save(arguments.output / f"{name}_source.png", np.round(255.0 * petiole).astype(np.uint8))
        if arguments.veins:
            save(arguments.output / f"{name}_veins.png", veins)


if __name__ == "__main__":
    main()
