"""Leaf photo to mesh, texture and maps.

:func:`prepare_leaf` does all of it: read the photo (``image``), find the leaf in it (``segment``), its outline and
petiole base (``shape``) and its veins (``venation``), fill it with triangles (``mesh``), draw its maps (``maps``) and
its texture (``texture``), and keep the result (``cache``). ``overlay`` draws what was found. Importing this package
loads none of the libraries they need.
"""

from __future__ import annotations

from pathlib import Path

from leafwarp.leaf.cache import content_key, load_leaf, store_leaf
from leafwarp.leaf.image.photo import read_bytes
from leafwarp.leaf.leaf import Findings, Leaf, LeafMesh, MapFrame
from leafwarp.leaf.request import LeafRequest
from leafwarp.stopwatch import Stopwatch

__all__ = ["Findings", "Leaf", "LeafMesh", "LeafRequest", "MapFrame", "prepare_leaf"]


def prepare_leaf(request: LeafRequest, cache: Path | None = None) -> Leaf:
    """Turn a leaf photo into a mesh, a texture and maps.

    Args:
        request: The photo, and what is wanted of it.
        cache: Folder where prepared leaves are kept by the content of all of this; None to make it anew.

    Raises:
        InputError: A file or an argument is not accepted; the message says which and what is.
    """
    request.check()
    picture = read_bytes(request.image)
    if cache is None:
        return _prepare(request, picture)
    arguments = sorted((name, str(value)) for name, value in vars(request).items() if name != "image")
    stored = Path(cache) / f"leaf-{content_key(arguments, [picture, *map(read_bytes, request.pictures)])}.npz"
    leaf = load_leaf(stored)
    if leaf is None:
        leaf = _prepare(request, picture)
        store_leaf(stored, leaf)
    return leaf


def _prepare(request: LeafRequest, picture: bytes) -> Leaf:
    from leafwarp.leaf.image.photo import read_grey, read_photo
    from leafwarp.leaf.maps.cells import is_finer
    from leafwarp.leaf.maps.make import fine_venation, make_maps
    from leafwarp.leaf.maps.pixel_frame import PixelFrame
    from leafwarp.leaf.mesh.triangulate import fill_leaf
    from leafwarp.leaf.segment.silhouette import silhouette
    from leafwarp.leaf.shape.outline import find_outline
    from leafwarp.leaf.texture import make_texture
    from leafwarp.leaf.venation.veins import Branch, Venation, find_venation

    watch = Stopwatch()
    with watch("read"):
        photo = read_photo(request.image, picture)
        mask = None if request.mask is None else read_grey(request.mask)
    with watch("segment"):
        shape = silhouette(photo, mask, request.mask, request.rect)
    with watch("outline"):
        outline = find_outline(photo, shape, request.base)
    pixel = 1.0 / request.pixels_per_metre if request.length is None else request.length / outline.length
    frame = PixelFrame.around(outline)
    with watch("veins"):
        venation = Venation([], "")
        if request.needs_veins:
            venation = find_venation(photo, outline, request.vein_kind, request.seed)
    with watch("maps"):
        cells, maps, fine = None, {}, None
        if request.map_size is not None:
            wanted, around = request.wanted_maps, (photo, outline, frame, request.map_size)
            if isinstance(wanted.get("venation"), str | Path):
                fine = fine_venation(*around, wanted["venation"], venation.branches, request.seed)
            cells, maps = make_maps(*around, wanted, venation.branches, request.seed, fine)
    with watch("texture"):
        fill_holes = request.holes == "fill"
        texture = make_texture(photo, shape, outline, frame, request.texture_limit, cut_holes=fill_holes)
    with watch("mesh"):
        up = (pixel, -pixel)
        filled = fill_leaf(
            (outline.points - outline.base) * up,
            (outline.tip - outline.base) * up,
            request.vertices,
            holes=() if fill_holes else [(hole - outline.base) * up for hole in outline.holes],
            veins=[Branch((b.points - outline.base) * up, b.flow) for b in venation.branches]
            if request.follow_veins
            else (),
        )
    corner = ((frame.left, frame.bottom) - outline.base) * up
    return Leaf(
        mesh=filled.mesh,
        frame=MapFrame(tuple(map(float, corner)), (frame.size[0] * pixel, frame.size[1] * pixel)),
        length=outline.length * pixel,
        texture=texture,
        mask=cells,
        maps=maps,
        fine_venation=fine if fine is not None and request.fine_venation and is_finer(fine, cells.shape) else None,
        findings=Findings(
            outline=outline.points,
            base=tuple(map(float, outline.base)),
            photo_size=photo.size,
            base_found=outline.base_found,
            pixel=pixel,
            confidence=shape.confidence,
            notes=shape.notes,
            veins=tuple((branch.points, branch.flow) for branch in venation.branches),
            vein_kind=venation.kind,
            seconds=watch.seconds,
        ),
    )
