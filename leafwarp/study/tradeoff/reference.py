"""The converged computation that all settings are held against, found by refining what changes the result the most."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from leafwarp.errors import LeafwarpError
from leafwarp.scene import Scene
from leafwarp.sim.pace import couplings_per_frame
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.setting import Setting
from leafwarp.study.tradeoff.trial import Trial
from leafwarp.study.tradeoff.worker import OutOfTime

# Where the search begins: cells across, and fluid steps; the mesh is the scene's own.
FIRST_CELLS = 128
FIRST_STEPS = 60  # of second order
TIGHT_FORCE_TOLERANCE = 1e-4
# Of the water's error beside the shape's.
WATER_WEIGHT = 0.1
# A refinement that changes neither water nor shape by more than this is the last of its kind.
CONVERGED = 5e-4
# What the search begins with may take so long, whatever the budget [s].
PATIENCE = 10.0
# Below this a finer mesh or map is not tried: rounding, and the samples, decide.
FINEST = {"map": 4096, "mesh": 200_000, "step": 1_000_000, "coupling": 1_000_000}


@dataclass(frozen=True)
class Refinement:
    """What refining one thing by a factor of two changed, or moving implicitly in place of explicitly.

    Attributes:
        kind: "map", "step", "mesh", "coupling" or "motion".
        coarse: The setting before.
        fine: The setting after.
        water: Relative L2 distance of the water of both.
        shape: Root mean square distance of the shapes, as a share of the leaf's length.
    """

    kind: str
    coarse: Setting
    fine: Setting
    water: float
    shape: float

    @property
    def size(self) -> float:
        """What decides which refinement comes next: the shape, which everything acts on."""
        return self.shape + WATER_WEIGHT * self.water

    def as_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@dataclass(frozen=True)
class Reference:
    """The converged computation.

    Attributes:
        setting: Its setting.
        trial: What was computed.
        refinements: All that were made, in order.
    """

    setting: Setting
    trial: Trial
    refinements: tuple[Refinement, ...]

    @property
    def last(self) -> dict[str, Refinement]:
        """The last refinement of each kind."""
        return {refinement.kind: refinement for refinement in self.refinements}

    @property
    def own_water_error(self) -> float:
        """Sum of the last changes of each kind, each the error that is left where errors are of first order."""
        return sum(refinement.water for refinement in self.last.values())

    @property
    def own_shape_error(self) -> float:
        """The same of the shape."""
        return sum(refinement.shape for refinement in self.last.values())

    @property
    def is_converged(self) -> bool:
        """Whether each kind of refinement changes less the further it goes."""
        kinds: dict[str, list[float]] = {}
        for refinement in self.refinements:
            kinds.setdefault(refinement.kind, []).append(refinement.size)
        return all(sizes[-1] <= max(sizes[0], CONVERGED) for sizes in kinds.values())


def errors_fall_with_the_step(errors: Mapping[Setting, float], slack: float) -> bool:
    """Whether no setting is closer to the reference than that with the shortest fluid step, as it must be if the
    reference is right.

    Where a reference is far from converged, one more refinement may change little and say nothing; settings finer than
    it then move away from it. In between, errors of step and map of opposite signs may cancel.

    Args:
        errors: Water error of each setting; those that differ by nothing but the step are compared.
        slack: By how much the error of the shortest step may be above that of another.
    """
    families: dict[Setting, dict[float, float]] = {}
    for setting, error in errors.items():
        if setting.fluid_step is not None:
            families.setdefault(replace(setting, fluid_step=None), {})[setting.fluid_step] = error
    for family in families.values():
        if family[min(family)] > min(family.values()) + slack:
            return False
    return True


def first_setting(scene: Scene) -> Setting:
    """Where the search begins: coarse, but unsplit and of second order, in double precision, with a tight tolerance."""
    own = Setting.of(scene)
    first = own.with_(
        scheme=own.scheme and "unsplit",
        order=own.order and 2,
        step_tolerance=None,
        precision="float64",
        force_tolerance=own.force_tolerance and min(own.force_tolerance, TIGHT_FORCE_TOLERANCE),
        coupling_interval=_default_coupling(scene),
    )
    if own.fluid_step is not None:
        first = first.with_(fluid_step=scene.time.duration / FIRST_STEPS)
    if own.map_size is not None:
        first = first.scaled_map(min(1.0, FIRST_CELLS / max(own.map_size)))
    return first


def _default_coupling(scene: Scene) -> float | None:
    intervals = (scene.time.frames - 1) * couplings_per_frame(scene)
    return scene.time.duration / intervals if intervals > 0 else None


def refine(setting: Setting, kind: str, factor: float = 2.0) -> Setting | None:
    """A setting with one thing finer by a factor, or coarser by one below 1; None where this scene has no such thing.

    A mesh with twice the vertices has edges shorter by a root of two: of it, four times the vertices.
    """
    if kind == "map":
        finer = setting.scaled_map(factor)
        return finer if finer != setting and max(finer.map_size) <= FINEST["map"] else None
    if kind == "step":
        return None if setting.fluid_step is None else setting.with_(fluid_step=setting.fluid_step / factor)
    if kind == "coupling":
        interval = setting.coupling_interval
        return None if interval is None else setting.with_(coupling_interval=interval / factor)
    vertices = round(setting.vertices * factor**2)
    return setting.with_(vertices=vertices) if 30 <= vertices <= FINEST["mesh"] else None


KINDS = ("map", "step", "mesh", "coupling")


def find_reference(
    scene: Scene,
    length: float,
    run: Callable[[Setting, float], Trial],
    predict: Callable[[Setting], float],
    left: Callable[[], float],
    say: Callable[[str], None],
) -> Reference:
    """Refine, again and again, what changes the result the most, for as long as the time lasts.

    Where explicit motion on a finer mesh takes longer than that, implicit motion takes its place; what this changes is
    one more part of the reference's own error.

    Args:
        scene: The scene.
        length: Length of the leaf [m].
        run: Computes a setting within a wall time [s].
        predict: Wall time that a setting is expected to take [s].
        left: Wall time that is left for this [s].
        say: Tells the user.

    Raises:
        LeafwarpError: Not even the first setting can be computed.
    """
    own, setting = Setting.of(scene), first_setting(scene)
    trial = run(setting, math.inf)
    may_change_motion = own.motion == "explicit" and scene.structure.bending != "paper"
    refinements: list[Refinement] = []
    sizes: dict[str, float] = {}

    def compare(kind: str, coarse: Setting, before: Trial, fine: Setting, after: Trial) -> None:
        errors = errors_of(before, after, length)
        refinements.append(Refinement(kind, coarse, fine, errors.water, errors.shape))
        what = "implicit motion"
        if kind in KINDS:
            sizes[kind], what = refinements[-1].size, f"twice as fine a {kind}"
        say(f"{what}: water changes by {errors.water:.2g}, shape by {errors.shape:.2g} of the length")

    def implicit_in_its_place() -> Setting | None:
        """The setting with implicit motion, if then a finer mesh can be paid."""
        implicit = setting.with_(motion="implicit", force_tolerance=TIGHT_FORCE_TOLERANCE)
        known = own.with_(motion="implicit")  # it tells what such motion costs on this scene, and is asked for later
        if predict(known) > left():
            return None
        try:
            run(known, left())
        except (OutOfTime, LeafwarpError):
            return None
        return implicit if predict(implicit) + predict(refine(implicit, "mesh")) <= left() else None

    for kind in KINDS:
        coarse = refine(setting, kind, 0.5)
        if kind == "coupling" and coarse is not None and predict(refine(setting, kind)) <= max(left(), PATIENCE):
            # Told of the water at every other frame alone, a leaf shows that of the frame before: no measure of what is
            # left where it is told at each.
            finer = refine(setting, kind)
            try:
                after = run(finer, math.inf)
            except LeafwarpError as error:
                say(f"given up: {finer.in_words(setting)}: {error}")
            else:
                compare(kind, setting, trial, finer, after)
                setting, trial = finer, after
                continue
        if coarse is not None:
            compare(kind, coarse, run(coarse, math.inf), setting, trial)
        elif refine(setting, kind) is not None:
            sizes[kind] = math.inf  # as coarse as can be: nothing is known of it but what a finer one tells
    while sizes and max(sizes.values()) > CONVERGED:
        # Nothing may be coarser than in the scene itself, if that can be paid.
        kind = "map" if "map" in sizes and setting.cells < own.cells else max(sizes, key=sizes.get)
        finer = refine(setting, kind)
        if finer is not None and predict(finer) > left():
            finer = None
            if kind == "mesh" and may_change_motion:
                may_change_motion = False
                finer = implicit_in_its_place()
        if finer is None:
            del sizes[kind]
            continue
        try:
            after = run(finer, left())
        except (OutOfTime, LeafwarpError) as error:
            say(f"given up: {finer.in_words(setting)}: {str(error) or 'no time left'}")
            del sizes[kind]
            continue
        compare(kind if finer.motion == setting.motion else "motion", setting, trial, finer, after)
        setting, trial = finer, after
    return Reference(setting, trial, tuple(refinements))
