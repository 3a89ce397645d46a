"""What the coupling sets of the structure, and what of it a scene lets follow the water."""

from __future__ import annotations

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene

REST_STATE = ("edge_rest_length", "hinge_rest_angle", "edge_stiffness", "hinge_stiffness", "mass")


def following(scene: Scene, leaf: Leaf) -> dict[str, int]:
    """Names among :data:`REST_STATE` of what follows the water, and how many there are of each."""
    mesh = leaf.mesh
    hinges = mesh.hinge_count if scene.has_angular_springs else 0
    counts = (
        scene.shrinks * mesh.edge_count,
        scene.curls * hinges,
        scene.stiffness_varies * mesh.edge_count,
        scene.stiffness_varies * hinges,
        (scene.structure.water_mass > 0.0) * mesh.vertex_count,
    )
    return {name: count for name, count in zip(REST_STATE, counts, strict=True) if count > 0}
