"""What the tables in physical units mean for those that the simulation reads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pydantic import ValidationError

from leafwarp.scene.fields import Table, plain_number
from leafwarp.scene.quality import QUALITIES, Resolution
from leafwarp.scene.structure import CurlTable, ShrinkTable
from leafwarp.scene.water import TranspirationTable

if TYPE_CHECKING:
    from leafwarp.scene import Scene
    from leafwarp.scene.material import MaterialTable

MOLAR_MASS_OF_WATER = 0.018015  # [kg/mol]
CELLS_PER_EDGE = 3  # of a map whose size the mesh decides


def derived_tables(scene: Scene) -> dict[str, Table | None]:
    """The tables of a scene with all that follows from [material], [air] and [stomata] filled in.

    What the scene file says itself holds.

    Raises:
        ValueError: Tables are missing or exclude each other.
    """
    tables: dict[str, Table | None] = {}
    structure = scene.structure
    if scene.material is not None:
        material = scene.material
        structure = _filled("structure", structure, material)
        tables["shrink"] = _filled("shrink", scene.shrink or ShrinkTable(), material)
        tables["curl"] = _filled("curl", scene.curl or CurlTable(), material)
        if structure.bending_stiffness == 0.0 and scene.curl is None:
            tables["curl"] = None
        tables["motion"] = scene.motion.filled(method="quasistatic")
    if structure.membrane_stiffness is None:
        raise ValueError("structure.membrane_stiffness: missing; give it, or a [material] that it follows from")
    if structure.vein_bending_stiffness is None:
        structure = structure.filled(vein_bending_stiffness=structure.vein_stiffness)
    tables["structure"] = structure
    for name, key in (("shrink", "curve"), ("curl", "mismatch")):
        table = tables.get(name, getattr(scene, name))
        if table is not None and getattr(table, key) is None:
            raise ValueError(f"{name}.{key}: missing; give it, or a [material] that it follows from")
    level = QUALITIES.get(scene.quality, QUALITIES["balanced"] if scene.tolerance is not None else None)
    if level is not None:
        tables |= _resolved(scene.model_copy(update=tables), Resolution.of(level))
    if tables.get("motion", scene.motion).method != "explicit":
        tables["solver"] = _in_double_precision(scene)
    if scene.fluid is not None:
        alone = scene.leaves is None and tables.get("solver", scene.solver).precision == "float32"
        fluid = tables.get("fluid", scene.fluid)
        tables["fluid"] = fluid.filled(solver="conjugate_gradients" if alone else "factor")
    if scene.leaves is not None:
        tables["maps"] = scene.maps.filled(size=suitable_cells(scene.mesh.vertices))
    if scene.stomata is not None or scene.air is not None:
        tables["transpiration"] = _transpiration(scene, tables["structure"].water_mass)
    return tables


def _resolved(scene: Scene, resolution: Resolution) -> dict[str, Table | None]:
    """The tables that say how finely the scene is computed, at a resolution."""
    tables: dict[str, Table] = {}
    for key, value in resolution.values(scene).items():
        name, _, key = key.partition(".")
        tables[name] = tables.get(name, getattr(scene, name)).filled(**{key: value})
    return tables


def _filled(name: str, table: Table, material: MaterialTable) -> Table:
    """A table of the scene with what follows from the material, if that is within the bounds of each key it fills."""
    values = getattr(material, name)()
    filled = table.filled(**values)
    for key, value in values.items():
        try:
            if getattr(filled, key) is value:
                type(table).model_validate({key: value})
        except ValidationError as error:
            accepted = error.errors()[0]["msg"].removeprefix("Value error, ")
            raise ValueError(
                f"{material.sources(f'{name}.{key}')}: they make {name}.{key} = {plain_number(value)}; {accepted}"
            ) from None
    return filled


def suitable_cells(vertices: int) -> int:
    """Cells across a map of one of many leaves: about three between two vertices, in whole blocks of 32."""
    across = CELLS_PER_EDGE * math.sqrt(2.0 * vertices)  # a leaf fills about half of its map
    return min(256, 32 * max(1, round(across / 32)))


def _in_double_precision(scene: Scene) -> Table:
    solver = scene.solver.filled(precision="float64")
    if solver.precision != "float64":
        raise ValueError(
            "solver.precision = 'float32': accepted with motion.method = 'implicit' or 'quasistatic': 'float64', since "
            "the rounding of a position alone would outweigh a vertex of a stiff leaf"
        )
    return solver


def _transpiration(scene: Scene, saturated_water: float) -> TranspirationTable:
    """Rates of water loss: ``g (VPD / P) M_w / W``, with the conductance ``g`` and the saturated water ``W``."""
    if scene.stomata is None or scene.air is None:
        given, missing = ("stomata", "air") if scene.air is None else ("air", "stomata")
        raise ValueError(f"[{given}] needs [{missing}]: together they say what transpires")
    if scene.transpiration is not None:
        raise ValueError("[transpiration] and [stomata] say the same; give one of them")
    if saturated_water <= 0.0:
        raise ValueError("[stomata] needs structure.water_mass above 0: without water nothing transpires")
    closure = scene.stomata.closure or (scene.material.turgor if scene.material is not None else None)
    if closure is None:
        raise ValueError("stomata.closure: missing; give it, or a [material] whose turgor it follows")
    per_conductance = scene.air.deficit / scene.air.pressure * MOLAR_MASS_OF_WATER / saturated_water
    return TranspirationTable(
        rate=scene.stomata.open_conductance * per_conductance,
        cuticle_rate=scene.stomata.minimum_conductance * per_conductance,
        closure=closure,
    )
