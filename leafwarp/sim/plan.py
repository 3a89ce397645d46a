"""The plan: the stages that a scene requires, in order, and those left out, with the reason.

A stage's module is imported only if the scene asks for the stage; its arrays and launches follow from its
declarations. Nothing outside the plan is compiled, allocated or launched.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import ArraySpec
from leafwarp.sim.rest_state import following
from leafwarp.sim.stage import Stage

GROUPS = ("fluid", "coupling", "motion", "output")


@dataclass(frozen=True)
class _Candidate:
    """A stage that a scene may ask for: where it lives and why it would be left out (None: it is needed)."""

    group: str
    name: str
    place: str
    left_out: Callable[[Scene, Leaf], str | None]


def _always(scene: Scene, leaf: Leaf) -> str | None:
    return None


def _needs(wanted: Callable[[Scene], Any], reason: str) -> Callable[[Scene, Leaf], str | None]:
    return lambda scene, leaf: None if wanted(scene) else reason


def _stiffness_left_out(scene: Scene, leaf: Leaf) -> str | None:
    factors = {factor for _, factor in scene.structure.stiffness_factor}
    plain = factors == {1.0} and not scene.veins_are_stiffer
    return "stiffness is the same everywhere and at every water content" if plain else None


def _diffusion_left_out(scheme: str, solver: str | None = None) -> Callable[[Scene, Leaf], str | None]:
    def reason(scene: Scene, leaf: Leaf) -> str | None:
        if scene.fluid is None:
            return _PRESCRIBED
        if not scene.water_flows:
            return "both diffusivities are 0"
        if scene.fluid.scheme != scheme:
            return f"fluid.scheme is {scene.fluid.scheme}"
        return None if solver in (None, scene.fluid.solver) else f"fluid.solver is {scene.fluid.solver}"

    return reason


def _samples_maps(scene: Scene) -> bool:
    return scene.fluid is not None or scene.structure_has_veins


def _moves(method: str) -> Callable[[Scene, Leaf], str | None]:
    return lambda scene, leaf: None if scene.motion.method == method else f"motion.method is {scene.motion.method}"


def _explicitly(left_out: Callable[[Scene, Leaf], str | None]) -> Callable[[Scene, Leaf], str | None]:
    """What is a stage of its own in explicit motion only: the others minimise all forces' potential at once."""
    return lambda scene, leaf: _moves("explicit")(scene, leaf) or left_out(scene, leaf)


def _bending_left_out(scene: Scene, leaf: Leaf, how: str) -> str | None:
    if not scene.has_angular_springs:
        return "no structure.bending_stiffness, or it is 0"
    if leaf.mesh.hinge_count == 0:
        return "no two triangles of the mesh share an edge"
    return None if scene.structure.bending == how else f"structure.bending is {scene.structure.bending}"


def _ramp_left_out(scene: Scene, leaf: Leaf) -> str | None:
    return None if following(scene, leaf) else "nothing of the structure follows the water"


_FLUID, _COUPLING = "leafwarp.sim.fluid", "leafwarp.sim.coupling"
_FORCES, _OUTPUT = "leafwarp.sim.forces", "leafwarp.sim.output"
_IMPLICIT = "leafwarp.sim.implicit.stages"
_FLAT_SHRINK = "no [shrink], or its curve is flat"
_PRESCRIBED = "water is prescribed by [water]"


def _one_order(scene: Scene, leaf: Leaf) -> str | None:
    if scene.fluid is None:
        return _PRESCRIBED
    return None if scene.fluid.order == 2 else "fluid.order is 1"


CANDIDATES: tuple[_Candidate, ...] = (
    _Candidate("fluid", "half_steps", f"{_FLUID}:HalfSteps", _one_order),
    _Candidate("fluid", "transpiration", f"{_FLUID}:Transpiration",
               _needs(lambda s: s.transpiration and s.transpiration.rate > 0.0, "nothing transpires")),
    _Candidate("fluid", "source", f"{_FLUID}:Source",
               _needs(lambda s: s.source and s.source.conductance > 0.0, "no water enters")),
    _Candidate("fluid", "split_diffusion", f"{_FLUID}:SplitDiffusion", _diffusion_left_out("split")),
    _Candidate("fluid", "factored_diffusion", f"{_FLUID}:FactoredDiffusion", _diffusion_left_out("unsplit", "factor")),
    _Candidate("fluid", "unsplit_diffusion", f"{_FLUID}:UnsplitDiffusion",
               _diffusion_left_out("unsplit", "conjugate_gradients")),
    _Candidate("fluid", "extrapolation", f"{_FLUID}:Extrapolation", _one_order),
    _Candidate("fluid", "water", f"{_FLUID}:Water", _needs(lambda s: s.fluid, _PRESCRIBED)),
    _Candidate("coupling", "stencils", f"{_COUPLING}:Stencils",
               _needs(_samples_maps, "no map is sampled: water is prescribed and veins are not told apart")),
    _Candidate("coupling", "sample_venation", f"{_COUPLING}:SampleVenation",
               _needs(lambda s: s.structure_has_veins, "the structure does not tell veins from lamina")),
    _Candidate("coupling", "sample_water", f"{_COUPLING}:SampleWater", _needs(lambda s: s.fluid, _PRESCRIBED)),
    _Candidate("coupling", "prescribed_water", f"{_COUPLING}:PrescribedWater",
               _needs(lambda s: s.water, "the water flows ([fluid])")),
    _Candidate("coupling", "rest_lengths", f"{_COUPLING}:RestLengths",
               _needs(lambda s: s.shrinks, _FLAT_SHRINK)),
    _Candidate("coupling", "rest_angles", f"{_COUPLING}:RestAngles",
               _needs(lambda s: s.curls, "no [curl], or its mismatch is flat")),
    _Candidate("coupling", "stiffness", f"{_COUPLING}:Stiffness", _stiffness_left_out),
    _Candidate("coupling", "mass", f"{_COUPLING}:Mass",
               _needs(lambda s: s.structure.water_mass > 0.0, "structure.water_mass is 0")),
    _Candidate("motion", "implicit_motion", f"{_IMPLICIT}:ImplicitMotion", _moves("implicit")),
    _Candidate("motion", "quasistatic_motion", f"{_IMPLICIT}:QuasistaticMotion", _moves("quasistatic")),
    _Candidate("motion", "stable_step", "leafwarp.sim.stable_step:StableStep", _explicitly(_always)),
    _Candidate("motion", "ramp", "leafwarp.sim.ramp:Ramp", _explicitly(_ramp_left_out)),
    _Candidate("motion", "hold", "leafwarp.sim.hold:Hold", _needs(lambda s: s.shrinks, _FLAT_SHRINK)),
    _Candidate("motion", "edge_springs", f"{_FORCES}:EdgeSprings", _explicitly(_always)),
    _Candidate("motion", "angular_springs", f"{_FORCES}:AngularSprings",
               _explicitly(lambda s, leaf: _bending_left_out(s, leaf, "gradient"))),
    _Candidate("motion", "paper_bending", f"{_FORCES}:PaperBending",
               _explicitly(lambda s, leaf: _bending_left_out(s, leaf, "paper"))),
    _Candidate("motion", "gravity", f"{_FORCES}:Gravity",
               _explicitly(_needs(lambda s: s.has_weight, "no motion.gravity, or none in any direction"))),
    _Candidate("motion", "air", f"{_FORCES}:Air",
               _explicitly(_needs(lambda s: s.motion.drag > 0.0, "motion.drag is 0"))),
    _Candidate("motion", "integration", f"{_FORCES}:Integration", _explicitly(_always)),
    _Candidate("output", "frame", f"{_OUTPUT}:FrameOutput", _always),
    _Candidate("output", "display_color", f"{_OUTPUT}:DisplayColor",
               _needs(lambda s: s.output.display_color, "output.display_color is off")),
    _Candidate("output", "contact_sheet", f"{_OUTPUT}:ContactSheetOutput",
               _needs(lambda s: s.output.contact_sheet, "output.contact_sheet is off")),
)  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """The stages of one scene on one leaf.

    Attributes:
        scene: The scene.
        leaf: The leaf.
        groups: Stages in order, by group: "fluid", "coupling", "motion", "output".
        left_out: Name of each stage that is not built, and why.
    """

    scene: Scene
    leaf: Leaf
    groups: dict[str, tuple[Stage, ...]]
    left_out: dict[str, str]

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All stages in order."""
        return tuple(stage for group in self.groups.values() for stage in group)

    @property
    def arrays(self) -> tuple[ArraySpec, ...]:
        """Every array of the simulation."""
        return tuple(spec for stage in self.stages for spec in stage.arrays)

    @property
    def byte_count(self) -> int:
        """Memory of all arrays [byte]."""
        return sum(spec.byte_count(self.scene.solver.precision) for spec in self.arrays)

    def describe(
        self, runs_per_frame: dict[str, float], motions_per_frame: float = 1.0, substeps: int = 1
    ) -> list[dict[str, Any]]:
        """The stages as plain data, for people and programs; they must be bound.

        What a stage reads and writes are the arguments of its launches, but for tables that it alone knows.

        Args:
            runs_per_frame: How often a stage of each rate runs in a frame, on average.
            motions_per_frame: The same of a motion that takes a frame at a time.
            substeps: How many it takes at a time.
        """
        precision = self.scene.solver.precision
        reads = {stage.name: _names(stage.host_reads, *(c.reads for c in stage.recorded)) for stage in self.stages}
        writes = {stage.name: _names(stage.host_writes, *(c.writes for c in stage.recorded)) for stage in self.stages}
        moving = {stage.name for stage in self.groups["motion"] if stage.rate == "frame"}
        owner = {spec.name: stage.name for stage in self.stages for spec in stage.arrays}

        def others(name: str, traffic: dict[str, tuple[str, ...]], stage: Stage) -> bool:
            return any(name in names for other, names in traffic.items() if other != stage.name)

        return [
            {
                "name": stage.name,
                "purpose": stage.purpose,
                "rate": stage.rate,
                "reads": [n for n in reads[stage.name] if owner[n] != stage.name or others(n, writes, stage)],
                "writes": [n for n in writes[stage.name] if owner[n] != stage.name or others(n, reads, stage)],
                "kernels": sorted({c.kernel_name for c in stage.recorded}),
                "arrays": [spec.name for spec in stage.arrays],
                "bytes": sum(spec.byte_count(precision) for spec in stage.arrays),
                "host_bytes": stage.host_bytes,
                "launches_per_frame": stage.launches_in(substeps)
                * (motions_per_frame if stage.name in moving else runs_per_frame[stage.rate]),
            }
            for stage in self.stages
        ]


def _names(*groups: tuple[str, ...]) -> tuple[str, ...]:
    """All names of some groups, each once."""
    return tuple(dict.fromkeys(name for group in groups for name in group))


def make_stages(scene: Scene, leaf: Leaf, group: str) -> tuple[tuple[Stage, ...], dict[str, str]]:
    """The stages of one group that a scene requires, declared but not yet bound to any array.

    Args:
        scene: The scene.
        leaf: The leaf.
        group: "fluid", "coupling", "motion" or "output".

    Returns:
        The stages in order, and the name of each that is left out with the reason.
    """
    stages: list[Stage] = []
    left_out: dict[str, str] = {}
    for candidate in CANDIDATES:
        if candidate.group != group:
            continue
        reason = candidate.left_out(scene, leaf)
        if reason is not None:
            left_out[candidate.name] = reason
            continue
        module, _, name = candidate.place.partition(":")
        stages.append(getattr(importlib.import_module(module), name)(scene, leaf))
    return tuple(stages), left_out


def make_plan(scene: Scene, leaf: Leaf) -> Plan:
    """The stages that a scene requires, declared but not yet bound to any array."""
    made = {group: make_stages(scene, leaf, group) for group in GROUPS}
    left_out = {name: reason for _, reasons in made.values() for name, reason in reasons.items()}
    return Plan(scene, leaf, {group: stages for group, (stages, _) in made.items()}, left_out)
