"""How finely a scene is computed, as one number: the level of its map, its mesh and its fluid steps together.

From a level to the next but one, cells and edges become half as long and fluid steps half as long. The error of the
shape falls to about a third by that (:data:`leafwarp.study.tolerance.ORDER`). Water flows by the unsplit scheme, whose
error falls with the map where that of the split one rises with it.

Where a tolerance is asked for, fluid steps look after themselves: they are of second order, and each is halved until
its two halves tell an error that leaves the tolerance to what they cannot see, the map and the mesh.

How the leaf moves is left open as well, and decided by what it takes on the leaf (:mod:`leafwarp.sim.method`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leafwarp.scene import Scene

# Levels of the presets, on the front of speed and accuracy of the shipped scenes (benchmarks/presets.py).
QUALITIES = {"draft": 0, "balanced": 2, "final": 4}
HIGHEST_LEVEL = 7
# Fluid steps of a film with a tolerance: the fewest in the whole plant time, and the error of the water that each may
# have, over the tolerance of the shape, which is off by a fraction of what the water is.
FEWEST_STEPS = 40
STEP_SHARE = 0.1
# Keys that a quality or a tolerance decides where the scene leaves them out.
DECIDED = ("mesh.vertices", "maps.size", "fluid.step", "fluid.scheme")
# Keys with which a scene chooses between explicit and implicit motion itself.
SAYS_HOW_IT_MOVES = ("motion.method", "solver.precision", "solver.substep", "solver.maximum_substeps")


@dataclass(frozen=True)
class Resolution:
    """How finely a scene is computed.

    Attributes:
        cells: Of the map, across.
        vertices: Of the mesh.
        fluid_steps: In the whole plant time, where they do not adapt.
    """

    cells: int
    vertices: int
    fluid_steps: int

    @classmethod
    def of(cls, level: int) -> Resolution:
        """The resolution of a level, 0 to :data:`HIGHEST_LEVEL`."""
        finer = 2.0 ** (level / 2)
        return cls(round(96 * finer), round(160 * finer**2), round(40 * finer))

    def values(self, scene: Scene) -> dict[str, Any]:
        """What it makes of the keys of :data:`DECIDED` that the scene leaves out and has a use for."""
        values: dict[str, Any] = {"mesh.vertices": self.vertices}
        if scene.map_names:
            values["maps.size"] = self.cells
        if scene.fluid is not None:
            values |= {"fluid.step": scene.time.duration / self.fluid_steps, "fluid.scheme": "unsplit"}
        if _steps_adapt(scene):
            values |= {
                "fluid.step": scene.time.duration / FEWEST_STEPS,
                "fluid.order": 2,
                "fluid.step_tolerance": STEP_SHARE * scene.tolerance,
            }
        return {key: value for key, value in values.items() if not _is_given(scene, key)}


def _steps_adapt(scene: Scene) -> bool:
    """Whether a tolerance decides the length of each fluid step: where the scene says nothing of steps itself, water
    does not flow by the split scheme, and no set is kept of what it was at the end of known steps."""
    if scene.tolerance is None or scene.fluid is None or scene.keeps_a_set:
        return False
    if _is_given(scene, "fluid.scheme") and scene.fluid.scheme == "split":
        return False
    return not any(_is_given(scene, f"fluid.{name}") for name in ("step", "order", "step_tolerance"))


def motion_is_open(scene: Scene) -> bool:
    """Whether explicit motion may be exchanged for implicit motion where that takes less time: where the scene says
    nothing of its motion, nor anything that one of them alone has or can do."""
    if scene.motion.method != "explicit" or scene.structure.bending == "paper":
        return False
    if scene.leaves is not None or scene.motion.wind is not None:
        return False
    return not any(_is_given(scene, key) for key in SAYS_HOW_IT_MOVES)


def _is_given(scene: Scene, key: str) -> bool:
    table, _, name = key.partition(".")
    return name in getattr(scene, table).model_fields_set
