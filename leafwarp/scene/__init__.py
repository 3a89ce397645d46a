"""The scene: what a user may ask for, validated, in SI units, immutable.

Every table of the TOML file is one model. A table that is left out is a thing that is not modelled: no kernel
is compiled, no array allocated and nothing launched for it (see :mod:`leafwarp.sim.plan`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from leafwarp.errors import InputError
from leafwarp.scene.derived import derived_tables
from leafwarp.scene.explain import explain
from leafwarp.scene.fields import Bounds, Curve, Fraction, Table, plain_number, varies
from leafwarp.scene.leaf import MOST_CELLS, LeafTable, MapsTable, MeshTable
from leafwarp.scene.leaves import LeavesTable
from leafwarp.scene.material import MaterialTable
from leafwarp.scene.quality import QUALITIES, motion_is_open
from leafwarp.scene.running import OutputTable, SolverTable, TimeTable
from leafwarp.scene.structure import MOST_SHRINK, CurlTable, MotionTable, ShrinkTable, StructureTable
from leafwarp.scene.water import AirTable, FluidTable, SourceTable, StomataTable, TranspirationTable, WaterTable

# Cells of the maps of all leaves together: a square of the most that one map may have each way.
MOST_ATLAS_CELLS = MOST_CELLS**2
MOST_COUPLINGS = 10_000_000

__all__ = ["Curve", "MotionTable", "Scene", "put_value"]


def _or_a_list(schema: dict[str, Any]) -> None:
    """In the JSON Schema: a table may be written more than once."""
    one = dict(schema)
    schema.clear()
    schema["anyOf"] = [one, {"type": "array", "items": one, "minItems": 1}]


class Scene(Table):
    """A whole scene. Lengths in metres, times in seconds, after validation."""

    name: str = Field(
        "leaf", pattern=r"^[A-Za-z0-9_.-]+$", description="Name of the outputs; default: the file's name."
    )
    quality: Literal[tuple(QUALITIES)] | None = Field(
        None,
        description="draft, balanced or final: decides mesh.vertices, maps.size, fluid.step, fluid.scheme and "
        "motion.method where they are left out. Default: each has its own default.",
    )
    tolerance: Annotated[Fraction, Bounds(1e-4, 0.5, "", "a string may say %: '1 %'")] | None = Field(
        None,
        description="Error of the shape that is accepted, as a share of the leaf's length; instead of quality: run "
        "finds by coarse films what it takes, and reports the error that it reached.",
    )
    leaf: LeafTable = Field(json_schema_extra=_or_a_list)
    leaves: LeavesTable | None = None
    mesh: MeshTable = MeshTable()
    maps: MapsTable = MapsTable()
    time: TimeTable
    fluid: FluidTable | None = None
    water: WaterTable | None = None
    transpiration: TranspirationTable | None = None
    source: SourceTable | None = None
    shrink: ShrinkTable | None = None
    curl: CurlTable | None = None
    material: MaterialTable | None = None
    air: AirTable | None = None
    stomata: StomataTable | None = None
    structure: StructureTable = StructureTable()
    motion: MotionTable = MotionTable()
    solver: SolverTable = SolverTable()
    output: OutputTable = OutputTable()
    _where: str = PrivateAttr("")  # what messages call the scene

    @model_validator(mode="before")
    @classmethod
    def _several_photos(cls, data: Any) -> Any:
        """[[leaf]] written more than once: one leaf of each photo, or as many as [leaves] says."""
        if not isinstance(data, Mapping) or not isinstance(data.get("leaf"), list) or not data["leaf"]:
            return data
        first, *further = data["leaf"]
        leaves = data.get("leaves", {})
        if isinstance(leaves, Mapping) and further and "photos" in leaves:
            raise ValueError("leaves.photos: further photos are given by [[leaf]], too; accepted: one of the two")
        if isinstance(leaves, Mapping) and "photos" not in leaves:
            leaves = {"count": 1 + len(further), **leaves, "photos": further}
        return {**data, "leaf": first, "leaves": leaves}

    @model_validator(mode="after")
    def _derived(self) -> Scene:
        self.__dict__.update(derived_tables(self))
        return self

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        if self.quality is not None and self.tolerance is not None:
            raise ValueError(f"quality = '{self.quality}' and tolerance = {self.tolerance:g}: accepted: one of the two")
        for name in ("quality", "tolerance"):
            if getattr(self, name) is not None and self.leaves is not None:
                raise ValueError(f"{name}: accepted without [leaves]: it is measured on one leaf")
        interval = self.solver.coupling_interval
        if interval is not None and self.time.duration / interval > MOST_COUPLINGS:
            raise ValueError(
                f"solver.coupling_interval = {interval:g} s: {self.time.duration / interval:.3g} of them fill "
                f"time.duration = {self.time.duration:g} s; accepted: at most {MOST_COUPLINGS:.3g}, an interval of "
                f"{self.time.duration / MOST_COUPLINGS:.3g} s or more"
            )
        if (self.fluid is None) == (self.water is None):
            raise ValueError("give either [fluid] (water that flows) or [water] (water that is prescribed)")
        if self.fluid is None:
            for table in ("stomata", "transpiration", "source"):
                if getattr(self, table) is not None:
                    raise ValueError(f"[{table}] needs [fluid]: with [water] the water is prescribed")
        if self.fluid is not None and self.fluid.step_tolerance is not None and self.keeps_a_set:
            raise ValueError(
                f"fluid.step_tolerance = {self.fluid.step_tolerance:g}: accepted without plastic_set, which looks at "
                "the water after every step and so needs to know them beforehand"
            )
        if self.shrinks:
            lost = max(1.0, self.shrink.along_veins) * max(value for _, value in self.shrink.curve)
            if lost > MOST_SHRINK * (1.0 + 1e-12):  # along_veins is a quotient, of [material]
                raise ValueError(
                    f"{self._shown('shrink', 'along_veins')}: the leaf would lose {lost:.0%} of its length along the "
                    f"veins; accepted: at most {MOST_SHRINK:.0%}"
                )
        if self.curl is not None and not self.has_angular_springs:
            raise ValueError("[curl] needs structure.bending_stiffness: without angular springs nothing can curl")
        if "bending" in self.structure.model_fields_set and self.structure.bending_stiffness is None:
            raise ValueError(
                "structure.bending needs structure.bending_stiffness: there are no angular springs without"
            )
        if self.structure.bending == "paper" and self.motion.method != "explicit":
            raise ValueError(
                f"structure.bending = 'paper': accepted with motion.method = 'explicit', not '{self.motion.method}': "
                "the paper's push on two vertices has no energy, and so no equilibrium to look for"
            )
        if self.motion.wind is not None and self.motion.drag == 0.0:
            raise ValueError("motion.wind needs motion.drag above 0: air without drag moves nothing")
        if self.motion.settle and not self.has_weight and self.motion.wind is None:
            raise ValueError(
                "motion.settle needs motion.gravity or motion.wind: without a load the leaf is at rest already"
            )
        if self.leaves is not None:
            self._check_leaves()
        for name in ("venation", "stomata", "water", "source"):
            if name in self.maps.model_fields_set and name not in self.map_names:
                raise ValueError(f"maps.{name} is given, but nothing in this scene depends on that map")
        return self

    def _check_leaves(self) -> None:
        if self.motion.method != "explicit":
            origin = "" if "method" in self.motion.model_fields_set else " (from [material])"
            raise ValueError(
                f"motion.method = '{self.motion.method}'{origin}: accepted with [leaves]: 'explicit', since the others "
                "look for one equilibrium of all leaves at once"
            )
        if self.leaves.water > 0.0 and self.fluid is None:
            raise ValueError("leaves.water needs [fluid]: with [water] the water is prescribed")
        if self.water_flows and self.fluid.scheme == "unsplit" and self.fluid.solver == "conjugate_gradients":
            raise ValueError(
                "fluid.solver = 'conjugate_gradients': accepted with [leaves]: 'factor', which accounts for each "
                "leaf's water alone"
            )
        for name, value in self.maps:
            if self.leaves.photos and isinstance(value, Path):
                raise ValueError(f"maps.{name}: an image is accepted with one photo; here are {len(self.photos)}")
        cells = math.prod(self.maps.shape) * self.leaves.count if self.map_names else 0
        if cells > MOST_ATLAS_CELLS:
            size = math.isqrt(MOST_ATLAS_CELLS // self.leaves.count)
            raise ValueError(
                f"maps.size = {list(self.maps.shape)} and leaves.count = {self.leaves.count} make {cells:.3g} cells; "
                f"accepted: at most {MOST_ATLAS_CELLS:.3g}, a size of {size} or less"
            )

    def _shown(self, table: str, key: str) -> str:
        """A key and its number; where it is not given, with the keys of [material] that it follows from."""
        values = getattr(self, table)
        shown = f"{table}.{key} = {plain_number(getattr(values, key))}"
        if self.material is None or key in values.model_fields_set:
            return shown
        return f"{shown} (from {self.material.sources(f'{table}.{key}')})"

    @property
    def photos(self) -> tuple[LeafTable, ...]:
        """What the scene says of each photo."""
        return (self.leaf, *(() if self.leaves is None else self.leaves.photos))

    @property
    def water_flows(self) -> bool:
        """Whether water flows within the leaf."""
        return self.fluid is not None and max(self.fluid.lamina_diffusivity, self.fluid.vein_diffusivity) > 0.0

    @property
    def residual_tolerance(self) -> float:
        """Error of an unsplit step that is accepted, relative to the contents, in the scene's precision."""
        tolerance = self.fluid.tolerance
        return tolerance if self.solver.precision == "float32" else tolerance**2

    @property
    def flow_has_veins(self) -> bool:
        """Whether water flows along veins faster or slower than between them."""
        return self.fluid is not None and self.fluid.vein_diffusivity != self.fluid.lamina_diffusivity

    @property
    def structure_has_veins(self) -> bool:
        """Whether veins are stiffer or shrink or curl less than the lamina."""
        return (
            self.veins_are_stiffer
            or (self.shrinks and self.shrink.vein_resistance > 0.0)
            or (self.curls and self.curl.vein_resistance > 0.0)
        )

    @property
    def veins_are_stiffer(self) -> bool:
        """Whether veins are stiffer or softer than the lamina."""
        bends = self.has_angular_springs and self.structure.vein_bending_stiffness != 1.0
        return bends or self.structure.vein_stiffness != 1.0

    @property
    def shrinks(self) -> bool:
        """Whether rest lengths depend on the water."""
        return self.shrink is not None and varies(self.shrink.curve)

    @property
    def shrinks_along_veins(self) -> bool:
        """Whether rest lengths depend on the direction of the veins."""
        return self.shrinks and self.shrink.along_veins != 1.0

    @property
    def curls(self) -> bool:
        """Whether rest angles depend on the water."""
        return self.curl is not None and varies(self.curl.mismatch)

    @property
    def method_is_open(self) -> bool:
        """Whether a quality or a tolerance decides how the leaf moves, once the leaf is known."""
        return (self.quality is not None or self.tolerance is not None) and motion_is_open(self)

    @property
    def has_weight(self) -> bool:
        """Whether gravity pulls."""
        return self.motion.gravity is not None and any(self.motion.gravity)

    @property
    def stiffness_varies(self) -> bool:
        """Whether the springs' stiffness depends on the water."""
        return varies(self.structure.stiffness_factor)

    @property
    def has_angular_springs(self) -> bool:
        """Whether the scene asks for resistance to bending."""
        return bool(self.structure.bending_stiffness)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is accepted but unusual, one line each."""
        from leafwarp.scene.warnings import warnings_of

        return warnings_of(self)

    @property
    def map_names(self) -> tuple[str, ...]:
        """The maps that the scene requires; empty if nothing varies over the leaf."""
        stomata = self.transpiration is not None and self.transpiration.rate > self.transpiration.cuticle_rate
        wanted = {
            "venation": self.flow_has_veins or self.structure_has_veins or self.shrinks_along_veins,
            "stomata": stomata,
            "water": self.fluid is not None,
            "source": self.source is not None and self.source.conductance > 0.0,
        }
        return tuple(name for name, is_wanted in wanted.items() if is_wanted)

    @property
    def keeps_a_set(self) -> bool:
        """Whether some of the greatest shrinking or curling so far stays."""
        return (self.shrinks and self.shrink.plastic_set > 0.0) or (self.curls and self.curl.plastic_set > 0.0)

    @classmethod
    def checked(cls, data: Mapping[str, Any], where: str) -> Scene:
        """The scene of nested tables, or one line that says what is wrong with them.

        Args:
            data: Tables and keys as in a scene file.
            where: What messages call the scene, usually its file's name; empty: the scene's own name.

        Raises:
            InputError: With key, value and what is accepted.
        """
        try:
            scene = cls.model_validate(data)
        except ValidationError as error:
            raise InputError(f"{where or data.get('name', 'scene')}: {explain(error, cls)}") from None
        scene._where = where
        return scene

    def with_changes(self, changes: Mapping[str, Any]) -> Scene:
        """A copy with other values, keys dotted: ``scene.with_changes({"maps.size": 128, "fluid.step": 30.0})``.

        Of several photos, ``leaf`` is the first.

        Raises:
            InputError: With key, value and what is accepted.
        """
        data = self.model_dump(exclude_unset=True)
        for key, value in changes.items():
            put_value(data, key, value)
        return Scene.checked(data, self._where)


def put_value(data: dict[str, Any], key: str, value: Any, where: str = "") -> None:
    """Set a dotted key in nested tables; in each of those that are written more than once, such as [[leaf]].

    Args:
        data: The tables, changed in place.
        key: The key.
        value: Its new value.
        where: What a message calls the place that the key comes from.

    Raises:
        InputError: A part of the key is a value already, not a table.
    """
    *tables, last = key.split(".")
    places = [data]
    for name in tables:
        found = [place.setdefault(name, {}) for place in places]
        # [[leaf]] written more than once: each of its tables.
        places = [one for each in found for one in (each if isinstance(each, list) and each else [each])]
        if not all(isinstance(place, dict) for place in places):
            raise InputError(f"{where}{key}: '{name}' is a value, not a table; accepted: table.key")
    for place in places:
        place[last] = value
