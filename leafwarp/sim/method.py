"""How the leaf moves where a quality or a tolerance leaves that open: by explicit steps, unless implicit ones take less
time.

Explicit motion takes the more substeps a frame the finer and the stiffer the mesh is; implicit motion takes one,
whose cost for each vertex hardly depends on either. As measured on the shipped scenes (benchmarks/RESULTS.md), the two
take equally long where explicit motion needs about :data:`MOST_SUBSTEPS` of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.scene.quality import motion_is_open
from leafwarp.sim.stable_step import damping_time, step_limit

# Explicit substeps a frame above which implicit motion takes less time; as :func:`expected_substeps` counts them.
MOST_SUBSTEPS = 400
# Of the squared frequencies of a regular mesh, whose triangles are drawn from a photo and so are not all regular:
# of its edges, over stiffness / (mass edge^2), and of its hinges, over bending stiffness / (mass edge^4).
EDGE_FREQUENCY, HINGE_FREQUENCY = 12.0, 85.0


def expected_substeps(scene: Scene, leaf: Leaf, vertices: int) -> float:
    """Substeps a frame that explicit motion of the saturated leaf is expected to take, within a factor of two.

    Of triangles with edges ``e`` between ``n`` vertices on an area ``A``, ``e^2 = 2 A / (sqrt(3) n)``, the fastest
    oscillation has ``omega^2 = 12 E h / (sigma e^2) + 85 D / (sigma e^4)`` for a membrane stiffness ``E h``, a bending
    stiffness ``D`` and a mass ``sigma`` an area, those of the veins.

    Args:
        scene: The scene.
        leaf: Its leaf, on any mesh.
        vertices: Of the mesh that it moves on.
    """
    structure = scene.structure
    factor = float(np.interp(1.0, *zip(*structure.stiffness_factor, strict=True)))
    membrane = structure.membrane_stiffness * max(1.0, structure.vein_stiffness)
    bending = (structure.bending_stiffness or 0.0) * max(1.0, structure.vein_bending_stiffness)
    area = float(leaf.mesh.vertex_areas.sum())
    squared_edge = 2.0 * area / (math.sqrt(3.0) * vertices)
    mass = squared_edge * (structure.dry_mass + structure.water_mass)
    squared_frequency = factor * (EDGE_FREQUENCY * membrane + HINGE_FREQUENCY * bending / squared_edge) / mass
    damping = damping_time(structure, leaf.length, squared_frequency)
    step = scene.solver.substep * step_limit(squared_frequency, damping, scene.motion.drag)
    return 1.0 / (scene.time.fps * step) if step > 0.0 else math.inf


def fitting_method(scene: Scene, leaf: Leaf, vertices: int) -> str:
    """The value of ``motion.method`` that takes the least time; the scene's own where it may not be another.

    Args:
        scene: The scene.
        leaf: Its leaf, on any mesh.
        vertices: Of the mesh that it moves on.
    """
    if not motion_is_open(scene):
        return scene.motion.method
    return "implicit" if expected_substeps(scene, leaf, vertices) > MOST_SUBSTEPS else "explicit"


def with_fitting_method(scene: Scene, leaf: Leaf, say: Callable[[str], None] = lambda text: None) -> Scene:
    """The scene with its motion decided, where a quality or a tolerance leaves that open.

    Args:
        scene: The scene.
        leaf: Its leaf.
        say: Tells the user of another motion than the usual one.
    """
    if not scene.method_is_open:
        return scene
    method = fitting_method(scene, leaf, scene.mesh.vertices)
    if method != scene.motion.method:
        substeps = expected_substeps(scene, leaf, scene.mesh.vertices)
        say(f"motion.method = '{method}': explicit motion would take about {substeps:.2g} substeps a frame, and longer")
    return scene.with_changes({"motion.method": method})
