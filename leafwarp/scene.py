"""The scene: what a user may ask for, validated, in SI units, immutable.

Every table of the TOML file is one model below. A table that is left out is a thing that is not modelled: no kernel
is compiled, no array allocated and nothing launched for it (see :mod:`leafwarp.sim.plan`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, model_validator

from leafwarp.errors import InputError
from leafwarp.quantity import quantity

Time = quantity("time")
Length = quantity("length")
Rate = quantity("rate")
Diffusivity = quantity("diffusivity")
Integer = Annotated[int, Strict()]
Switch = Annotated[bool, Strict()]
Number = Annotated[float, Strict()]
Share = Annotated[Number, Field(ge=0.0, le=1.0)]
# Far beyond any leaf, and well within single precision.
Component = Annotated[Number, Field(ge=-1e9, le=1e9)]
Vector = tuple[Component, Component, Component]


def _sorted_curve(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    points = tuple(sorted(points))
    contents = [y for y, _ in points]
    if contents[0] < 0.0 or contents[-1] > 1.0:
        raise ValueError("the first number of each pair is a relative water content in [0, 1]")
    if len(set(contents)) < len(contents):
        raise ValueError("two points have the same water content")
    return points


# Piecewise linear in the relative water content y, constant beyond its ends.
Curve = Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1, max_length=64), AfterValidator(_sorted_curve)]


def _varies(curve: tuple[tuple[float, float], ...]) -> bool:
    return len({value for _, value in curve}) > 1


def _within(low: float, high: float, what: str) -> AfterValidator:
    def check(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for _, value in curve:
            if not low <= value <= high:
                raise ValueError(f"{what} {value:g} is not in [{low:g}, {high:g}]")
        return curve

    return AfterValidator(check)


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LeafTable(_Table):
    """The photo and its scale."""

    image: Path = Field(description="Photo of the leaf (PNG, JPEG, TIFF, WebP), relative to the scene file.")
    mask: Path | None = Field(None, description="Image that is bright on the leaf; replaces the segmentation.")
    rect: tuple[Component, Component, Component, Component] | None = Field(
        None,
        description="Left, top, width and height [pixel of the photo, x right, y down] of the part in which to look "
        "for the leaf.",
    )
    base: tuple[Component, Component] | None = Field(
        None, description="Petiole base [pixel of the photo, x right, y down]; replaces the detection."
    )
    length: Annotated[Length, Field(ge=1e-4, le=100.0)] | None = Field(
        None, description="Distance from the petiole base to the farthest point of the leaf [m]."
    )
    pixels_per_metre: Number | None = Field(
        None, ge=1.0, le=1e8, description="Scale of the photo [pixel/m]; instead of length."
    )
    holes: Literal["fill", "keep"] = Field(
        "fill",
        description="fill: holes of the leaf are transparent in its texture; keep: they are holes of the mesh.",
    )
    camber: Number = Field(
        0.01,
        ge=0.0,
        le=0.5,
        description="Height of a smooth imperfection of the flat leaf, as a share of its length; it decides which way "
        "the leaf buckles.",
    )
    seed: Integer = Field(
        0, ge=0, lt=2**31, description="Seed of the camber, and of veins and stomata that are made up."
    )

    @model_validator(mode="after")
    def _one_scale(self) -> LeafTable:
        if (self.length is None) == (self.pixels_per_metre is None):
            raise ValueError("give either 'length' or 'pixels_per_metre'")
        return self


class MeshTable(_Table):
    """The triangle mesh."""

    vertices: Integer = Field(1707, ge=30, le=200_000, description="Number of vertices aimed at.")
    follow_veins: Switch = Field(False, description="Main veins become edges of the mesh.")


class MapsTable(_Table):
    """The maps that the fluid lives on. Each is "auto" or an image that covers the same picture as the photo."""

    size: tuple[Integer, Integer] | Integer = Field(
        256, description="Cells of the map: one number for a square one, or [width, height]."
    )
    venation: Literal["auto", "photo", "pinnate", "palmate", "parallel"] | Path = Field(
        "auto",
        description="Flow capacity, 0 (lamina) to 1 (midrib): an image, or the veins that the photo shows, or made-up "
        "ones; auto takes those of the photo where it shows them.",
    )
    stomata: Literal["auto"] | Path = Field("auto", description="Density of stomata, 0 to 1.")
    water: Literal["auto"] | Share | Path = Field(
        "auto", description="Relative water content at the start: an image, a number, or auto (saturated)."
    )
    source: Literal["auto"] | Path = Field("auto", description="Where water enters; auto is the petiole base.")

    @model_validator(mode="after")
    def _size_range(self) -> MapsTable:
        for cells in self.shape:
            if not 1 <= cells <= 8192:
                raise ValueError(f"size {cells} is not in [1, 8192] cells")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Cells (width, height)."""
        return (self.size, self.size) if isinstance(self.size, int) else self.size


class TimeTable(_Table):
    """Two clocks: plant time, which the water sees, and playback time, which gravity and inertia see."""

    duration: Annotated[Time, Field(gt=0.0, le=1e12)] = Field(
        description="Plant time from the first frame to the last [s]."
    )
    frames: Integer = Field(240, ge=1, le=1_000_000, description="Number of frames.")
    fps: Number = Field(24.0, ge=0.01, le=1000.0, description="Frames a second of playback.")


class FluidTable(_Table):
    """Water that flows (paper, Sec. III-A)."""

    step: Annotated[Time, Field(gt=0.0)] = Field(60.0, description="Fluid step in plant time [s]; chosen for accuracy.")
    scheme: Literal["split", "unsplit"] = Field(
        "split",
        description="split: rows, then columns, line by line (the paper). unsplit: both at once, without the "
        "splitting error.",
    )
    solver: Literal["factor", "conjugate_gradients"] = Field(
        "factor",
        description="How the unsplit scheme solves a step. factor: a sparse factor, made once, on the host (much the "
        "faster on a CPU). conjugate_gradients: preconditioned with line solves, all on the device.",
    )
    lamina_diffusivity: Annotated[Diffusivity, Field(ge=0.0)] = Field(
        1e-9, description="Diffusivity of water between the veins [m^2/s] (artistic)."
    )
    vein_diffusivity: Annotated[Diffusivity, Field(ge=0.0)] = Field(
        1e-7, description="Diffusivity of water along a vein of capacity 1 [m^2/s] (artistic)."
    )
    tolerance: Number = Field(
        1e-5, gt=0.0, lt=1.0, description="Relative residual at which the unsplit scheme stops (float64: its square)."
    )


class WaterTable(_Table):
    """Water that is prescribed: the same everywhere, a function of plant time. Excludes [fluid]."""

    curve: Annotated[tuple[tuple[Time, Share], ...], Field(min_length=1, max_length=64)] = Field(
        description="Points [plant time, relative water content], linear in between."
    )

    @model_validator(mode="after")
    def _rising_times(self) -> WaterTable:
        times = [t for t, _ in self.curve]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("the times of 'curve' must rise")
        return self


class TranspirationTable(_Table):
    """Water lost through the leaf's surface."""

    rate: Annotated[Rate, Field(ge=0.0)] = Field(
        description="Share of the saturated leaf's water lost a second, averaged over the leaf [1/s]."
    )
    cuticle_rate: Annotated[Rate, Field(ge=0.0)] = Field(
        0.0, description="The part of it that leaves everywhere alike, stomata or not [1/s]."
    )

    @model_validator(mode="after")
    def _cuticle_is_a_part(self) -> TranspirationTable:
        if self.cuticle_rate > self.rate:
            raise ValueError(
                f"cuticle_rate {self.cuticle_rate:g} is more than rate {self.rate:g}, of which it is a part"
            )
        return self


class SourceTable(_Table):
    """Water that enters through the petiole."""

    conductance: Annotated[Rate, Field(ge=0.0)] = Field(
        description="Share of the saturated leaf's water that enters a second for a difference of 1 [1/s]."
    )
    supply: Share = Field(
        1.0, description="Relative water content of the supply; a leaf wetter than it gives water back."
    )
    cut_at: Annotated[Time, Field(ge=0.0)] | None = Field(
        None, description="Plant time at which the leaf is severed and the source ends [s]."
    )


class ShrinkTable(_Table):
    """Rest lengths that follow the water."""

    curve: Annotated[Curve, _within(-0.5, 0.95, "a shrink of")] = Field(
        description="Points [relative water content, share of the length lost]."
    )
    vein_resistance: Share = Field(0.0, description="Share of the shrinking that a vein of capacity 1 resists.")


class CurlTable(_Table):
    """Rest angles that follow the water: one side of the leaf shrinks more than the other."""

    mismatch: Annotated[Curve, _within(-1.0, 1.0, "a mismatch of")] = Field(
        description="Points [relative water content, strain between the two sides]; positive bends toward the "
        "photographed side."
    )
    thickness: Annotated[Length, Field(ge=1e-7, le=1.0)] = Field(2.5e-4, description="Thickness of the lamina [m].")
    vein_resistance: Share = Field(0.0, description="Share of the curling that a vein of capacity 1 resists.")


class StructureTable(_Table):
    """The mass-spring mesh (paper, Sec. III-B)."""

    membrane_stiffness: Annotated[quantity("membrane stiffness"), Field(ge=0.0, le=1e12)] = Field(
        description="Young's modulus times thickness [N/m]. Explicit motion wants a soft membrane: 2 to 20."
    )
    bending_stiffness: Annotated[quantity("bending stiffness"), Field(ge=0.0, le=1e9)] | None = Field(
        None, description="Bending stiffness of the lamina [N m]; left out: no angular springs."
    )
    bending: Literal["gradient", "paper"] = Field(
        "gradient",
        description="Force of the angular springs: the gradient of their energy, which conserves momentum, or the "
        "paper's push on two vertices, which does not.",
    )
    vein_stiffness: Number = Field(
        1.0, ge=0.0, le=1e6, description="Stiffness of a vein of capacity 1 over the lamina's."
    )
    stiffness: Annotated[Curve, _within(0.0, 1e6, "a stiffness factor of")] = Field(
        ((0.0, 1.0),), description="Points [relative water content, factor on every stiffness]."
    )
    dry_mass: Annotated[quantity("mass per area"), Field(ge=1e-6, le=1e6)] = Field(
        0.05, description="Mass of the dry leaf [kg/m^2]."
    )
    water_mass: Annotated[quantity("mass per area"), Field(ge=0.0, le=1e6)] = Field(
        0.25, description="Mass of the water of the saturated leaf [kg/m^2]."
    )
    damping: Number = Field(
        0.05, ge=0.0, le=1.0, description="Damping ratio of the mesh's fastest oscillation, along springs and hinges."
    )


class MotionTable(_Table):
    """What moves the leaf, and where it is held."""

    gravity: Vector | None = Field(None, description="Acceleration of gravity [m/s^2], z up; left out: none.")
    drag: Number = Field(2.0, ge=0.0, le=1e6, description="Rate at which still air takes up the leaf's speed [1/s].")
    wind: Vector | None = Field(
        None, description="Speed of the air [m/s], which drags the leaf along; left out: still air."
    )
    pin_radius: Annotated[Length, Field(ge=0.0)] | None = Field(
        None, description="Vertices this near the petiole base are held [m]; left out: 3 % of the leaf's length."
    )
    clamp: Switch = Field(False, description="Also hold the first row of triangles past the pins (the direction, too).")
    settle: Switch = Field(False, description="Let the leaf come to rest under gravity before the first frame.")


class SolverTable(_Table):
    """How the scene is computed."""

    precision: Literal["float32", "float64"] = Field("float32", description="Numbers of the fluid and the structure.")
    maximum_substeps: Integer = Field(
        8192, ge=1, le=2**20, description="Motion substeps a frame beyond which a scene is refused."
    )


class OutputTable(_Table):
    """What is written beside the animated points and the water."""

    contact_sheet: Switch = Field(False, description="A picture of eight moments, water above and leaf below.")
    display_color: Switch = Field(False, description="Vertex colours: a plain ramp of water from brown to green.")
    texture_limit: Annotated[int, Strict(), Field(ge=16, le=65536)] | None = Field(
        None, description="Longest side of the texture [pixel]; default: as fine as the photo."
    )
    up_axis: Literal["Y", "Z"] = Field("Z", description="Up axis of the USD.")


class Scene(_Table):
    """A whole scene. Lengths in metres, times in seconds, after validation."""

    name: str = Field(
        "leaf", pattern=r"^[A-Za-z0-9_.-]+$", description="Name of the outputs; default: the file's name."
    )
    leaf: LeafTable
    mesh: MeshTable = MeshTable()
    maps: MapsTable = MapsTable()
    time: TimeTable
    fluid: FluidTable | None = None
    water: WaterTable | None = None
    transpiration: TranspirationTable | None = None
    source: SourceTable | None = None
    shrink: ShrinkTable | None = None
    curl: CurlTable | None = None
    structure: StructureTable
    motion: MotionTable = MotionTable()
    solver: SolverTable = SolverTable()
    output: OutputTable = OutputTable()

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        if (self.fluid is None) == (self.water is None):
            raise ValueError("give either [fluid] (water that flows) or [water] (water that is prescribed)")
        if self.fluid is None:
            for table in ("transpiration", "source"):
                if getattr(self, table) is not None:
                    raise ValueError(f"[{table}] needs [fluid]: with [water] the water is prescribed")
        if self.curl is not None and not self.has_angular_springs:
            raise ValueError("[curl] needs structure.bending_stiffness: without angular springs nothing can curl")
        if "bending" in self.structure.model_fields_set and self.structure.bending_stiffness is None:
            raise ValueError(
                "structure.bending needs structure.bending_stiffness: there are no angular springs without"
            )
        if self.motion.wind is not None and self.motion.drag == 0.0:
            raise ValueError("motion.wind needs motion.drag above 0: air without drag moves nothing")
        if self.motion.settle and not self.has_weight and self.motion.wind is None:
            raise ValueError(
                "motion.settle needs motion.gravity or motion.wind: without a load the leaf is at rest already"
            )
        for name in ("venation", "stomata", "water", "source"):
            if name in self.maps.model_fields_set and name not in self.map_names:
                raise ValueError(f"maps.{name} is given, but nothing in this scene depends on that map")
        return self

    @property
    def water_flows(self) -> bool:
        """Whether water flows within the leaf."""
        return self.fluid is not None and max(self.fluid.lamina_diffusivity, self.fluid.vein_diffusivity) > 0.0

    @property
    def residual_tolerance(self) -> float:
        """Relative residual at which the unsplit scheme stops, in the scene's precision."""
        tolerance = self.fluid.tolerance
        return tolerance if self.solver.precision == "float32" else tolerance**2

    @property
    def flow_has_veins(self) -> bool:
        """Whether water flows along veins faster or slower than between them."""
        return self.fluid is not None and self.fluid.vein_diffusivity != self.fluid.lamina_diffusivity

    @property
    def structure_has_veins(self) -> bool:
        """Whether veins shrink, curl or resist otherwise than the lamina."""
        return (
            self.structure.vein_stiffness != 1.0
            or (self.shrinks and self.shrink.vein_resistance > 0.0)
            or (self.curls and self.curl.vein_resistance > 0.0)
        )

    @property
    def shrinks(self) -> bool:
        """Whether rest lengths depend on the water."""
        return self.shrink is not None and _varies(self.shrink.curve)

    @property
    def curls(self) -> bool:
        """Whether rest angles depend on the water."""
        return self.curl is not None and _varies(self.curl.mismatch)

    @property
    def has_weight(self) -> bool:
        """Whether gravity pulls."""
        return self.motion.gravity is not None and any(self.motion.gravity)

    @property
    def stiffness_varies(self) -> bool:
        """Whether the springs' stiffness depends on the water."""
        return _varies(self.structure.stiffness)

    @property
    def has_angular_springs(self) -> bool:
        """Whether the scene asks for resistance to bending."""
        return bool(self.structure.bending_stiffness)

    @property
    def map_names(self) -> tuple[str, ...]:
        """The maps that the scene requires; empty if nothing varies over the leaf."""
        stomata = self.transpiration is not None and self.transpiration.rate > self.transpiration.cuticle_rate
        wanted = {
            "venation": self.flow_has_veins or self.structure_has_veins,
            "stomata": stomata,
            "water": self.fluid is not None,
            "source": self.source is not None and self.source.conductance > 0.0,
        }
        return tuple(name for name, is_wanted in wanted.items() if is_wanted)

    def with_changes(self, changes: Mapping[str, Any]) -> Scene:
        """A copy with other values, keys dotted: ``scene.with_changes({"maps.size": 128, "fluid.step": 30.0})``."""
        data = self.model_dump(exclude_unset=True)
        for key, value in changes.items():
            put_value(data, key, value)
        return Scene.model_validate(data)


def put_value(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested tables.

    Raises:
        InputError: A part of the key is a value already, not a table.
    """
    *tables, last = key.split(".")
    for name in tables:
        data = data.setdefault(name, {})
        if not isinstance(data, dict):
            raise InputError(f"--set {key}: '{name}' is a value, not a table")
    data[last] = value
