"""The leaf that a scene asks for."""

from __future__ import annotations

from pathlib import Path

from leafwarp.leaf import prepare_leaf
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
    return prepare_leaf(
        scene.leaf.image,
        length=scene.leaf.length,
        pixels_per_metre=scene.leaf.pixels_per_metre,
        mask=scene.leaf.mask,
        base=scene.leaf.base,
        vertices=scene.mesh.vertices,
        map_size=scene.maps.shape if scene.map_names else None,
        maps={name: getattr(scene.maps, name) for name in scene.map_names},
        cache=cache,
    )
