"""The leaf, or the leaves, that a scene asks for."""

from __future__ import annotations

from pathlib import Path

from leafwarp.leaf import LeafRequest, prepare_leaf
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene


def prepare_scene_leaf(scene: Scene, cache: Path | None) -> Leaf:
    """Prepare a scene's leaf, or all of its leaves as one: the mesh, and the maps that the scene requires.

    Args:
        scene: The scene.
        cache: Folder of leaves prepared before; None to prepare anew.

    Raises:
        InputError: The photo or a map cannot be used.
    """
    request = LeafRequest(
        scene.leaf.image,
        length=scene.leaf.length,
        pixels_per_metre=scene.leaf.pixels_per_metre,
        mask=scene.leaf.mask,
        rect=scene.leaf.rect,
        base=scene.leaf.base,
        holes=scene.leaf.holes,
        vertices=scene.mesh.vertices,
        follow_veins=scene.mesh.follow_veins,
        map_size=scene.maps.shape if scene.map_names else None,
        maps={name: getattr(scene.maps, name) for name in scene.map_names},
        seed=scene.leaf.seed,
        texture_limit=scene.output.texture_limit,
    )
    leaf = prepare_leaf(request, cache)
    if scene.leaves is None:
        return leaf
    from leafwarp.leaf.arrange import make_specimens
    from leafwarp.leaf.leaves import gather_leaves

    specimens = make_specimens(scene.leaves, leaf)
    return gather_leaves([leaf], [0] * len(specimens), specimens)
