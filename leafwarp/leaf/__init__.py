"""Leaf photo to mesh, texture and maps.

:func:`prepare_leaf` does all of it: read the photo (``photo``), find the leaf (``segment``), its outline and
petiole base (``outline``), fill it with triangles (``triangulate``, ``mesh``), draw its maps (``maps``,
``veins``) and its texture (``texture``), and keep the result (``cache``). Importing this package loads none
of the libraries they need.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from leafwarp.errors import InputError
from leafwarp.leaf.cache import content_key, load_leaf, store_leaf
from leafwarp.leaf.leaf import Leaf, LeafMesh, MapFrame
from leafwarp.leaf.photo import read_bytes

__all__ = ["Leaf", "LeafMesh", "MapFrame", "prepare_leaf"]


def prepare_leaf(
    image: Path,
    *,
    length: float | None,
    pixels_per_metre: float | None = None,
    mask: Path | None = None,
    base: tuple[float, float] | None = None,
    vertices: int = 1707,
    map_size: tuple[int, int] | None = (256, 256),
    maps: Mapping[str, str | float | Path] = MappingProxyType({}),
    cache: Path | None = None,
) -> Leaf:
    """Turn a leaf photo into a mesh, a texture and maps.

    Args:
        image: PNG, JPEG, TIFF or WebP picture of one leaf before a plain background; opacity is honoured as
            its mask.
        length: Distance from the petiole base to the farthest point of the leaf [m]; it sets the scale.
        pixels_per_metre: Scale of the photo, where no length is given.
        mask: Picture of the same frame (any size), light on the leaf, that replaces the search for it.
        base: The petiole's end in pixels of the upright photo, x to the right and y down, that replaces the
            search.
        vertices: Number of mesh vertices, met within 1 %.
        map_size: Cells across and up (nx, ny), or None for no maps at all.
        maps: The maps wanted, among ``venation``, ``stomata``, ``water`` and ``source``: "auto", a number in
            [0, 1] (not for ``source``), or a picture of the same frame as the photo, of any size.
        cache: Folder where prepared leaves are kept by the content of all of this.

    Raises:
        InputError: A file or an argument is not accepted; the message says which and what is.
    """
    image = Path(image)
    mask = None if mask is None else Path(mask)
    requests = {} if map_size is None else _checked_maps(image, maps)
    _check_arguments(image, length, pixels_per_metre, vertices, map_size)
    picture = read_bytes(image)
    if cache is None:
        return _prepare(image, picture, length, pixels_per_metre, mask, base, vertices, map_size, requests)
    files = [path for path in (mask, *requests.values()) if isinstance(path, Path)]
    named = {name: "image" if isinstance(value, Path) else value for name, value in requests.items()}
    arguments = (length, pixels_per_metre, mask is None, base, vertices, map_size, named)
    stored = Path(cache) / f"leaf-{content_key(arguments, [picture, *map(read_bytes, files)])}.npz"
    leaf = load_leaf(stored)
    if leaf is None:
        leaf = _prepare(image, picture, length, pixels_per_metre, mask, base, vertices, map_size, requests)
        store_leaf(stored, leaf)
    return leaf


def _prepare(
    image: Path,
    picture: bytes,
    length: float | None,
    pixels_per_metre: float | None,
    mask: Path | None,
    base: tuple[float, float] | None,
    vertices: int,
    map_size: tuple[int, int] | None,
    maps: dict[str, str | float | Path],
) -> Leaf:
    """Make the leaf; arguments as for :func:`prepare_leaf`, checked."""
    from leafwarp.leaf.maps import PixelFrame, make_maps
    from leafwarp.leaf.outline import find_outline
    from leafwarp.leaf.photo import read_grey, read_photo
    from leafwarp.leaf.segment import silhouette
    from leafwarp.leaf.texture import make_texture
    from leafwarp.leaf.triangulate import triangulate

    photo = read_photo(image, picture)
    shape = silhouette(photo, None if mask is None else read_grey(mask), mask)
    outline = find_outline(photo, shape, base)
    pixel = 1.0 / pixels_per_metre if length is None else length / outline.length
    frame = PixelFrame.around(outline)
    texture = make_texture(photo, shape, outline, frame)
    cells, made = (None, {}) if map_size is None else make_maps(photo, outline, frame, map_size, maps)
    up = (pixel, -pixel)
    return Leaf(
        mesh=triangulate((outline.points - outline.base) * up, (outline.tip - outline.base) * up, vertices),
        frame=MapFrame(
            origin=(
                float(frame.left - outline.base[0]) * pixel,
                float(outline.base[1] - frame.bottom) * pixel,
            ),
            size=(frame.size[0] * pixel, frame.size[1] * pixel),
        ),
        length=outline.length * pixel,
        texture=texture,
        mask=cells,
        maps=made,
    )


def _check_arguments(
    image: Path,
    length: float | None,
    pixels_per_metre: float | None,
    vertices: int,
    map_size: tuple[int, int] | None,
) -> None:
    if length is None and pixels_per_metre is None:
        raise InputError(f"{image}: length: missing; accepted: the leaf's length [m], or pixels_per_metre")
    for name, value in (("length", length), ("pixels_per_metre", pixels_per_metre)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{image}: {name}: value {value!r} is not accepted; accepted: a number above 0")
    if isinstance(vertices, bool) or vertices != int(vertices):
        raise InputError(f"{image}: vertices: value {vertices!r} is not accepted; accepted: a whole number")
    if map_size is None:
        return
    whole = len(map_size) == 2 and all(side == int(side) and 1 <= side <= 8192 for side in map_size)
    if not whole:
        raise InputError(f"{image}: map_size: value {map_size!r} is not accepted; accepted: two numbers from 1 to 8192")


def _checked_maps(image: Path, maps: Mapping[str, str | float | Path]) -> dict[str, str | float | Path]:
    """The maps wanted, by name in a fixed order; raises InputError where a name or a value is not accepted."""
    names = ("venation", "stomata", "water", "source")
    checked = {}
    for name in (*names, *maps):
        if name not in names:
            raise InputError(f"{image}: maps: {name!r} is not accepted; accepted: {', '.join(names)}")
        if name not in maps or name in checked:
            continue
        value = maps[name]
        accepted = "'auto' or an image path" if name == "source" else "'auto', a number from 0 to 1 or an image path"
        if isinstance(value, str | Path):
            checked[name] = value if value == "auto" else Path(value)
        elif name != "source" and not isinstance(value, bool) and 0.0 <= value <= 1.0:
            checked[name] = float(value)
        else:
            raise InputError(f"{image}: maps: {name}: value {value!r} is not accepted; accepted: {accepted}")
    return checked
