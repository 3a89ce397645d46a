"""Scenes of leaves stated in SI units."""

from __future__ import annotations

from leafwarp.scene import Scene
from leafwarp.scene.material import MaterialTable
from leafwarp.scene.water import AirTable, StomataTable
from meshes import scene_of

TABLES = {"material": MaterialTable, "air": AirTable, "stomata": StomataTable}
SI_KEYS = {f"{name}.{key}" for name, table in TABLES.items() for key in table.model_fields}

SI_SCENE = """
[leaf]
image = "leaf.png"
length = "12 cm"
[time]
duration = "48 h"
[fluid]
[air]
temperature = "25 degC"
relative_humidity = 0.5
[stomata]
open_conductance = "200 mmol/m2/s"
[material]
"""


def material_scene(**material) -> Scene:
    return scene_of(material=material)
