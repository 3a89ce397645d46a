"""How finely a scene is computed, as one number: the level of its map, its mesh and its fluid steps together.

From a level to the next but one, cells and edges become half as long and fluid steps half as long: all errors are of
first order, so each is halved. Water flows by the unsplit scheme, whose error falls with the map where that of the
split one rises with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leafwarp.scene import Scene

# Levels of the presets, on the front of speed and accuracy of the shipped scenes (benchmarks/presets.py).
QUALITIES = {"draft": 0, "balanced": 2, "final": 4}
HIGHEST_LEVEL = 7
# Keys that a quality or a tolerance decides where the scene leaves them out.
DECIDED = ("mesh.vertices", "maps.size", "fluid.step", "fluid.scheme")


@dataclass(frozen=True)
class Resolution:
    """How finely a scene is computed.

    Attributes:
        cells: Of the map, across.
        vertices: Of the mesh.
        fluid_steps: In the whole plant time.
    """

    cells: int
    vertices: int
    fluid_steps: int

    @classmethod
    def of(cls, level: int) -> Resolution:
        """The resolution of a level, 0 to :data:`HIGHEST_LEVEL`."""
        finer = 2.0 ** (level / 2)
        return cls(round(96 * finer), round(150 * finer**2), round(40 * finer))

    def values(self, scene: Scene) -> dict[str, Any]:
        """What it makes of the keys of :data:`DECIDED` that the scene leaves out and has a use for."""
        values: dict[str, Any] = {"mesh.vertices": self.vertices}
        if scene.map_names:
            values["maps.size"] = self.cells
        if scene.fluid is not None:
            values |= {"fluid.step": scene.time.duration / self.fluid_steps, "fluid.scheme": "unsplit"}
        return {key: value for key, value in values.items() if not _is_given(scene, key)}


def _is_given(scene: Scene, key: str) -> bool:
    table, _, name = key.partition(".")
    return name in getattr(scene, table).model_fields_set
