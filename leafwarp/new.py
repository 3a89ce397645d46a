"""The verb ``new``: a photo becomes a scene, and a picture of what was found in the photo."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

from leafwarp.errors import InputError
from leafwarp.files import check_result, write_bytes, write_text
from leafwarp.leaf.image.photo import read_photo
from leafwarp.leaf.leaf import Findings
from leafwarp.leaf.overlay import draw_overlay
from leafwarp.leaf.request import MAP_NAMES
from leafwarp.png import encode_png
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.run import save_maps
from leafwarp.scene.file import parse_scene
from leafwarp.template import scene_text


@dataclass(frozen=True)
class NewScene:
    """What ``new`` wrote.

    Attributes:
        scene: The scene file.
        overlay: The picture of what was found.
        maps: Pictures of the maps, where they were asked for.
        findings: What was found in the photo.
    """

    scene: Path
    overlay: Path
    maps: tuple[Path, ...]
    findings: Findings


def write_new_scene(photo: Path, output: Path, length: str, overwrite: bool, maps: bool = False) -> NewScene:
    """Write a scene for a photo, with what was found in it as comments and as a picture beside it.

    Args:
        photo: Photo of a leaf.
        output: Scene file to write.
        length: Length of the leaf with its unit, such as "8 cm".
        overwrite: Replace files that are there already.
        maps: Also write the maps as pictures beside the scene.

    Raises:
        InputError: The photo holds no usable leaf, the length is none, or a file exists already.
        OutputError: A file cannot be written.
    """
    overlay = output.with_name(f"{output.stem}.overlay.png")
    pictures = [overlay, *(output.with_name(f"{output.stem}.{name}.png") for name in MAP_NAMES if maps)]
    _check_paths(photo, [output, *pictures], overwrite)
    image = Path(os.path.relpath(photo.resolve(), output.parent.resolve())).as_posix()
    # Messages name the photo as the user did.
    data = {"name": "leaf", **tomllib.loads(scene_text(photo.as_posix(), length))}
    leaf = prepare_scene_leaf(parse_scene(data, str(output), Path()), None)
    write_bytes(overlay, encode_png(draw_overlay(read_photo(photo), leaf)))
    written = tuple(save_maps(leaf, output.parent, output.stem)) if maps else ()
    write_text(output, scene_text(image, length, leaf, overlay.name))
    return NewScene(output, overlay, written, leaf.findings)


def _check_paths(photo: Path, results: list[Path], overwrite: bool) -> None:
    """Raise InputError where a file is missing, or one that is to be written is in the way."""
    if not photo.is_file():
        raise InputError(f"{photo}: {'is a folder' if photo.is_dir() else 'no such file'}; accepted: a photo of a leaf")
    folder = results[0].parent
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    try:
        str(photo.resolve()).encode()
    except UnicodeEncodeError:
        raise InputError(f"{str(photo)!a}: a scene cannot hold a name that is not UTF-8; rename the file") from None
    for path in results:
        if path.resolve() == photo.resolve():
            raise InputError(f"{path}: is the photo itself, which the result would replace; choose another -o")
        check_result(path, overwrite)
