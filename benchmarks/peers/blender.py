"""Blender's cloth on the problem of :mod:`benchmarks.peers`: ``PYTHON blender.py PROBLEM.npz RESULT.npz OPTIONS``.

Runs in an interpreter that has Blender's module ``bpy``, and needs nothing of this project.

Blender's springs have the stiffness ``tension / mean edge length`` and its hinges ``0.1 * bending * edge length``
(source/blender/simulation/intern/implicit_blender.cc and blenkernel/intern/cloth.cc, version 4.5), from which the two
settings follow. All its vertices weigh the same. Its solver takes forces as small as a leaf's for none (the leaf hangs
in the air), so all masses and stiffnesses are given in units in which a vertex weighs what it does by default.
"""

import json
import sys
import time

import bpy
import numpy as np

DEFAULT_MASS = 0.3  # [kg] of a vertex


def build(problem: dict, quality: int, frames: int) -> bpy.types.Object:
    """The leaf as a cloth object in an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("leaf")
    mesh.from_pydata(problem["positions"].tolist(), [], problem["triangles"].tolist())
    leaf = bpy.data.objects.new("leaf", mesh)
    scene = bpy.context.scene
    scene.collection.objects.link(leaf)
    leaf.vertex_groups.new(name="pinned").add(np.flatnonzero(problem["pinned"]).tolist(), 1.0, "REPLACE")
    scene.gravity = (0.0, 0.0, -float(problem["gravity"]))
    scene.render.fps = int(problem["fps"])
    scene.frame_end = frames + 1
    cloth = leaf.modifiers.new("cloth", "CLOTH")
    settings = cloth.settings
    settings.quality = quality
    settings.mass = DEFAULT_MASS
    unit = DEFAULT_MASS / problem["masses"].mean()
    settings.bending_model = "ANGULAR"
    for name in ("tension", "compression", "shear"):
        setattr(settings, f"{name}_stiffness", float(unit * problem["spring"] * problem["edge_length"]))
    settings.bending_stiffness = float(unit * problem["hinge"] / (0.1 * problem["edge_length"]))
    settings.vertex_group_mass = "pinned"
    settings.air_damping = 1.0
    cloth.collision_settings.use_collision = False
    cloth.point_cache.frame_start = 1
    cloth.point_cache.frame_end = frames + 1
    return leaf


def main() -> None:
    """Simulate, time the frames after the first, and store the last positions."""
    problem = dict(np.load(sys.argv[1]))
    options = json.loads(sys.argv[3])
    frames = options["frames"]
    leaf = build(problem, options["quality"], frames)
    scene = bpy.context.scene
    scene.frame_set(1)
    begin = time.perf_counter()
    for frame in range(2, frames + 2):
        scene.frame_set(frame)
    seconds = time.perf_counter() - begin
    evaluated = leaf.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    positions = np.empty(3 * len(evaluated.vertices))
    evaluated.vertices.foreach_get("co", positions)
    np.savez(sys.argv[2], positions=positions.reshape(-1, 3), seconds=seconds, version=bpy.app.version_string)


main()
