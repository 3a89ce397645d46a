"""The leaf, or the leaves, that a scene asks for."""

from __future__ import annotations

from pathlib import Path

from leafwarp.leaf import LeafRequest, prepare_leaf
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.scene.leaf import LeafTable


def prepare_scene_leaf(scene: Scene, cache: Path | None) -> Leaf:
    """Prepare a scene's leaf, or all of its leaves as one: the mesh, and the maps that the scene requires.

    Args:
        scene: The scene.
        cache: Folder of leaves prepared before; None to prepare anew.

    Raises:
        InputError: A photo or a map cannot be used.
    """
    photos = [prepare_leaf(_request(scene, table), cache) for table in scene.photos]
    if scene.leaves is None:
        return photos[0]
    from leafwarp.leaf.arrange import arrange_leaves

    return arrange_leaves(scene.leaves, photos, scene.photos)


def _request(scene: Scene, table: LeafTable) -> LeafRequest:
    return LeafRequest(
        table.image,
        length=table.length,
        pixels_per_metre=table.pixels_per_metre,
        mask=table.mask,
        rect=table.rect,
        base=table.base,
        holes=table.holes,
        vertices=scene.mesh.vertices,
        follow_veins=scene.mesh.follow_veins,
        map_size=scene.maps.shape if scene.map_names else None,
        maps={name: getattr(scene.maps, name) for name in scene.map_names},
        fine_venation=scene.flow_has_veins,
        seed=table.seed,
        texture_limit=scene.output.texture_limit,
    )
