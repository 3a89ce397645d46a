"""The leaf that a scene asks for."""

from __future__ import annotations

from pathlib import Path

from leafwarp.leaf import LeafRequest, prepare_leaf
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene


def prepare_scene_leaf(scene: Scene, cache: Path | None) -> Leaf:
    """Prepare a scene's leaf: its mesh, and the maps that the scene requires.

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
    return prepare_leaf(request, cache)
