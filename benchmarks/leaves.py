"""What is made of the leaf photos of a folder: ``python -m benchmarks.leaves FOLDER -o sheet.png``.

Every photo goes through the preparation as a scene's would, anew. A table on stdout says what came of it, and one
picture shows all the overlays, to be looked at: outline, petiole base and veins have no judge but the eye.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from leafwarp.errors import InputError
from leafwarp.files import write_bytes
from leafwarp.leaf import Leaf, LeafRequest, prepare_leaf
from leafwarp.leaf.image.photo import read_photo
from leafwarp.leaf.mesh.quality import mesh_quality
from leafwarp.leaf.overlay import draw_overlay
from leafwarp.png import encode_png

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
MAPS = {"venation": "auto", "stomata": "auto", "water": "auto", "source": "auto"}
LENGTH = 0.1  # [m] of every leaf: no photo says
TILE, GAP, LINE_HEIGHT = (820, 820), 16, 26  # [pixels]
PAPER, INK, WARNING = (250, 250, 248), (35, 38, 40), (180, 30, 30)


@dataclass(frozen=True)
class Outcome:
    """What became of a photo.

    Attributes:
        photo: Its file.
        size: Its width and height in pixels; None where it could not be read.
        seconds: Wall time from the file to the ready leaf [s].
        leaf: The leaf, or None.
        refusal: Why there is none; empty where there is.
        picture: The overlay, or the photo itself, as far as it could be read.
    """

    photo: Path
    size: tuple[int, int] | None
    seconds: float
    leaf: Leaf | None
    refusal: str
    picture: np.ndarray | None


def prepare(photo: Path, vertices: int, map_size: int) -> Outcome:
    """Prepare the leaf of a photo, or take down why not.

    Args:
        photo: The file.
        vertices: Vertices aimed at.
        map_size: Cells of the maps each way.
    """
    leaf, refusal, picture = None, "", None
    begin = time.perf_counter()
    try:
        leaf = prepare_leaf(
            LeafRequest(photo, length=LENGTH, vertices=vertices, map_size=(map_size, map_size), maps=MAPS)
        )
    except InputError as error:
        refusal = str(error).removeprefix(f"{photo}: ")
    seconds = time.perf_counter() - begin
    try:
        picture = read_photo(photo)
    except InputError:
        return Outcome(photo, None, seconds, leaf, refusal, None)
    shown = picture.colour if leaf is None else draw_overlay(picture, leaf, legend=False, side=max(TILE) - 40)
    return Outcome(photo, picture.size, seconds, leaf, refusal, shown)


def euler_number(leaf: Leaf) -> int:
    """Vertices less edges plus triangles: 1 for a disc, 1 less for each hole."""
    return leaf.mesh.vertex_count - leaf.mesh.edge_count + leaf.mesh.triangle_count


def table(outcomes: list[Outcome]) -> str:
    """The outcomes in Markdown, one row a photo."""
    head = ("photo", "pixels", "confidence", "base by", "veins", "vertices", "V - E + F", "least angle", "seconds")
    rows = [head, tuple("---" if column in (0, 3) else "---:" for column in range(len(head)))]
    notes = []
    for outcome in outcomes:
        name, size = outcome.photo.name, "?" if outcome.size is None else "{} x {}".format(*outcome.size)
        if outcome.leaf is None:
            rows.append((name, size, "refused", "", "", "", "", "", f"{outcome.seconds:.2f}"))
            notes.append(f"- {name}: refused: {outcome.refusal}")
            continue
        leaf, found = outcome.leaf, outcome.leaf.findings
        split = ", ".join(f"{step} {seconds:.2f}" for step, seconds in found.seconds.items())
        rows.append(
            (
                name,
                size,
                f"{found.confidence:.2f}",
                found.base_found,
                f"{len(found.veins)} {found.vein_kind}".strip(),
                str(leaf.mesh.vertex_count),
                str(euler_number(leaf)),
                f"{mesh_quality(leaf.mesh).minimum_angle:.1f}",
                f"{outcome.seconds:.2f} ({split})" if split else f"{outcome.seconds:.2f}",
            )
        )
        notes += [f"- {name}: {note}" for note in found.notes]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([*lines, *(["", *notes] if notes else [])])


def caption(outcome: Outcome) -> str:
    """What stands over a photo on the sheet."""
    if outcome.leaf is None:
        return f"refused: {outcome.refusal}"
    found = outcome.leaf.findings
    words = f"confidence {found.confidence:.2f}; base by {found.base_found}; veins: {found.vein_kind}"
    return "; ".join((f"{words}; {outcome.seconds:.1f} s", *found.notes))


def sheet(outcomes: list[Outcome]) -> np.ndarray:
    """All overlays on one sheet, 8-bit RGB, as nearly square as the tiles allow."""
    columns = max(1, round(np.sqrt(1.3 * len(outcomes))))
    rows = -(-len(outcomes) // columns)
    cell = (TILE[0] + GAP, TILE[1] + 3 * LINE_HEIGHT + GAP)
    page = np.full((rows * cell[1] + GAP, columns * cell[0] + GAP, 3), PAPER, np.uint8)
    face = cv2.FontFace("sans")
    for index, outcome in enumerate(outcomes):
        x, y = GAP + index % columns * cell[0], GAP + index // columns * cell[1]
        cv2.putText(page, outcome.photo.name, (x, y + 18), INK, face, 20, 600)
        lines = textwrap.wrap(caption(outcome), TILE[0] // 9, max_lines=2, placeholder=" ...")
        for number, line in enumerate(lines, start=1):
            colour = WARNING if outcome.leaf is None else INK
            cv2.putText(page, line, (x, y + 18 + number * LINE_HEIGHT), colour, face, 17, 400)
        if outcome.picture is not None:
            height, width = outcome.picture.shape[:2]
            scale = min(TILE[0] / width, TILE[1] / height)
            size = (max(1, round(width * scale)), max(1, round(height * scale)))
            method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
            top = y + 3 * LINE_HEIGHT
            page[top : top + size[1], x : x + size[0]] = cv2.resize(outcome.picture, size, interpolation=method)
    return page


def main() -> int:
    """Prepare all photos of a folder; print the table, write the sheet."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.leaves", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of leaf photos")
    parser.add_argument("-o", "--output", type=Path, required=True, help="PNG of all overlays")
    parser.add_argument("--vertices", type=int, default=1700)
    parser.add_argument("--map-size", type=int, default=256)
    options = parser.parse_args()
    photos = sorted(path for path in options.folder.glob("*") if path.suffix.lower() in SUFFIXES)
    if not photos:
        print(f"{options.folder}: no photos; accepted: a folder of {', '.join(SUFFIXES)}", file=sys.stderr)
        return 2
    outcomes = []
    for photo in photos:
        outcomes.append(prepare(photo, options.vertices, options.map_size))
        print(f"{photo.name}: {outcomes[-1].refusal or 'ready'}", file=sys.stderr)
    print(table(outcomes))
    write_bytes(options.output, encode_png(sheet(outcomes)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
