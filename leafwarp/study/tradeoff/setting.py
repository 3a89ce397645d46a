"""What a user may choose to trade speed for accuracy, as keys of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.scene.quality import QUALITIES, Resolution
from leafwarp.sim.method import fitting_method

# Cells across of the finest map, and vertices of the coarsest and of the finest mesh, that are tried unasked.
MOST_CELLS = 1024
LEAST_CELLS = 16
VERTICES = (60, 30_000)
MAP_FACTORS = (0.25, 0.5, 2.0, 4.0)
STEP_FACTORS = (0.25, 4.0, 16.0)
# Of steps of second order; and the longest of those that adapt to a tolerance, over the plant time.
SECOND_ORDER_FACTORS = (1.0, 4.0, 16.0)
LONGEST = 1.0 / 16.0
STEP_TOLERANCES = (1e-2, 1e-3)
VERTEX_FACTORS = (0.125, 0.25, 0.5, 2.0)
# Of the plant time between two frames.
COUPLING_FACTORS = (4.0, 16.0)
SUBSTEPS = (0.225, 0.45, 0.9)
FORCE_TOLERANCES = (1e-4, 1e-3, 1e-2, 1e-1)
SCHEMES = ("split", "unsplit")
METHODS = ("explicit", "implicit", "quasistatic")
PRECISIONS = ("float32", "float64")


@dataclass(frozen=True)
class Setting:
    """Choices that leave the leaf, its material and its weather alone. None: this scene has no such choice.

    Attributes:
        map_size: Cells (width, height).
        fluid_step: In plant time [s].
        scheme: "split" or "unsplit".
        order: Of the fluid step, 1 or 2.
        step_tolerance: Error that a fluid step may have, where steps adapt; ``fluid_step`` is the longest.
        vertices: Vertices of the mesh that are aimed at.
        angular_springs: Whether the leaf resists bending, and curls.
        motion: "explicit", "implicit" or "quasistatic".
        coupling_interval: Plant time between two couplings [s]; None: as the scene's frames ask.
        substep: Substep over the stable one (explicit motion).
        force_tolerance: Force left on a vertex (the others).
        precision: "float32" or "float64".
    """

    map_size: tuple[int, int] | None
    fluid_step: float | None
    scheme: str | None
    order: int | None
    step_tolerance: float | None
    vertices: int
    angular_springs: bool
    motion: str
    coupling_interval: float | None
    substep: float | None
    force_tolerance: float | None
    precision: str

    @classmethod
    def of(cls, scene: Scene) -> Setting:
        """A scene's own."""
        explicit = scene.motion.method == "explicit"
        return cls(
            map_size=scene.maps.shape if scene.map_names else None,
            fluid_step=None if scene.fluid is None else min(scene.fluid.step, scene.time.duration),
            scheme=scene.fluid.scheme if scene.water_flows else None,
            order=None if scene.fluid is None else scene.fluid.order,
            step_tolerance=None if scene.fluid is None else scene.fluid.step_tolerance,
            vertices=scene.mesh.vertices,
            angular_springs=scene.has_angular_springs,
            motion=scene.motion.method,
            coupling_interval=scene.solver.coupling_interval,
            substep=scene.solver.substep if explicit else None,
            force_tolerance=None if explicit else scene.solver.force_tolerance,
            precision=scene.solver.precision,
        )

    def with_(self, **choices: Any) -> Setting:
        """The same with other choices. Another motion brings the tolerance that is its own."""
        changed = replace(self, **choices)
        if changed.motion == "explicit":
            return replace(changed, substep=changed.substep or 0.9, force_tolerance=None)
        tolerance = changed.force_tolerance or 1e-3
        # What minimises a potential knows double precision alone.
        return replace(changed, substep=None, force_tolerance=tolerance, precision="float64")

    def apply(self, scene: Scene) -> Scene:
        """The scene computed with this setting."""
        own = Setting.of(scene)
        changes = {KEYS[name]: getattr(self, name) for name in self.varied(own) if name in KEYS}
        for name in ("substep", "force_tolerance"):
            if getattr(self, name) is None:
                changes.pop(KEYS[name], None)
        if own.angular_springs and not self.angular_springs:
            changes |= {"structure.bending_stiffness": 0.0, "curl": None}
        return scene.with_changes(changes)

    def varied(self, base: Setting) -> tuple[str, ...]:
        """Names of the choices that are not those of another setting."""
        return tuple(field.name for field in fields(self) if getattr(self, field.name) != getattr(base, field.name))

    @property
    def cells(self) -> int:
        """Cells of the map; 1 where there is none."""
        return 1 if self.map_size is None else self.map_size[0] * self.map_size[1]

    def scaled_map(self, factor: float) -> Setting:
        """With so many times the cells across."""
        if self.map_size is None:
            return self
        return self.with_(map_size=tuple(max(1, round(cells * factor)) for cells in self.map_size))

    def as_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    def in_words(self, base: Setting) -> str:
        """How it departs from another, as a person would write it in a scene file."""
        words = []
        for name in self.varied(base):
            value = getattr(self, name)
            if name == "angular_springs":
                words.append("angular springs" if value else "no angular springs")
            elif name == "map_size":
                words.append(f"maps.size = {list(value)}")
            elif value is not None:
                # Of another motion, its own tolerance goes without saying.
                is_implied = name in ("substep", "force_tolerance", "precision") and self.motion != base.motion
                if not is_implied:
                    words.append(f"{KEYS[name]} = {value:g}" if isinstance(value, float) else f"{KEYS[name]} = {value}")
        return ", ".join(words) or "as written"


KEYS = {
    "map_size": "maps.size",
    "fluid_step": "fluid.step",
    "scheme": "fluid.scheme",
    "order": "fluid.order",
    "step_tolerance": "fluid.step_tolerance",
    "vertices": "mesh.vertices",
    "motion": "motion.method",
    "coupling_interval": "solver.coupling_interval",
    "substep": "solver.substep",
    "force_tolerance": "solver.force_tolerance",
    "precision": "solver.precision",
}


def preset_settings(scene: Scene, leaf: Leaf) -> dict[str, Setting]:
    """The scene's setting with each quality in place of what it says itself, by name.

    Args:
        scene: The scene.
        leaf: Its leaf, by which a quality decides how it moves.
    """
    presets = {}
    for name, level in QUALITIES.items():
        resolution, own = Resolution.of(level), Setting.of(scene)
        method = fitting_method(scene, leaf, resolution.vertices)
        preset = own.with_(vertices=resolution.vertices, motion=method)
        if own.map_size is not None:
            preset = preset.with_(map_size=(resolution.cells, resolution.cells))
        if own.fluid_step is not None:
            preset = preset.with_(fluid_step=scene.time.duration / resolution.fluid_steps)
        presets[name] = preset.with_(scheme=own.scheme and "unsplit")
    return presets


def single_changes(scene: Scene) -> Iterator[Setting]:
    """The scene's own setting with one choice changed at a time; of the fluid, its map and step for each scheme."""
    base = Setting.of(scene)
    duration, frames = scene.time.duration, scene.time.frames
    schemes = SCHEMES if base.scheme is not None else (base.scheme,)
    for scheme in schemes:
        fluid = base.with_(scheme=scheme)
        yield fluid
        if base.map_size is not None:
            for factor in MAP_FACTORS:
                finer = fluid.scaled_map(factor)
                if LEAST_CELLS <= max(finer.map_size) <= max(MOST_CELLS, *base.map_size):
                    yield finer
        if base.fluid_step is not None:
            for factor in STEP_FACTORS:
                yield fluid.with_(fluid_step=min(factor * base.fluid_step, duration))
            for factor in SECOND_ORDER_FACTORS:
                yield fluid.with_(fluid_step=min(factor * base.fluid_step, duration), order=2, step_tolerance=None)
            if scheme != "split" and not scene.keeps_a_set:
                adaptive = fluid.with_(fluid_step=LONGEST * duration, order=2)
                yield from (adaptive.with_(step_tolerance=tolerance) for tolerance in STEP_TOLERANCES)
    fewest, most = VERTICES
    for factor in VERTEX_FACTORS:
        vertices = round(factor * base.vertices)
        if fewest <= vertices <= max(most, base.vertices):
            yield base.with_(vertices=vertices)
    if base.angular_springs:
        yield base.with_(angular_springs=False)
    if scene.structure.bending != "paper":
        yield from (base.with_(motion=motion) for motion in METHODS if motion != base.motion)
    if frames > 2:
        yield from (base.with_(coupling_interval=factor * duration / (frames - 1)) for factor in COUPLING_FACTORS)
    if base.motion == "explicit":
        yield from (base.with_(substep=substep) for substep in SUBSTEPS)
        yield from (base.with_(precision=precision) for precision in PRECISIONS)
    else:
        yield from (base.with_(force_tolerance=tolerance) for tolerance in FORCE_TOLERANCES)
