"""What is accepted with a warning: values out of their usual range, what has no effect, what is taken for granted.

Of the papers that a range names, Koerner 1995 is a chapter of Schulze and Caldwell (eds.), Ecophysiology of
Photosynthesis, and Duursma et al. 2019 is in New Phytologist 221; the others are listed in
:mod:`leafwarp.scene.presets`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from leafwarp.scene.derived import suitable_cells
from leafwarp.scene.fields import plain_number

if TYPE_CHECKING:
    from leafwarp.scene import Scene


@dataclass(frozen=True)
class Usual:
    """The usual range of a value.

    Attributes:
        low: Smallest usual value.
        high: Largest usual value.
        unit: Unit of both, and of the value; empty for a plain number.
        why: Whose values they are, or what the value follows from.
    """

    low: float
    high: float
    unit: str
    why: str


# A share of the length, and of it for a share of water, that explicit motion does not take at once (``stability
# curve_width``: a fifth folds a strip within a tenth of the water).
ABRUPT_LOSS, ABRUPT_SLOPE = 0.02, 1.0
MANY_SUBSTEPS = 500  # of explicit motion in a frame; a soft leaf takes about 100

# By key, or by what follows from keys: dotted names of attributes of the scene.
USUAL: dict[str, Usual] = {
    "material.thickness": Usual(5e-5, 3e-3, "m", "laminas from films to succulents"),
    "material.vein_thickness": Usual(5e-5, 2e-2, "m", "bundles of a grass to midribs of large leaves"),
    "material.lamina_modulus": Usual(1e6, 5e9, "Pa", "soft herbs to sclerophylls and fibrous blades"),
    "material.vein_modulus": Usual(1e6, 3e10, "Pa", "soft herbs to fibres"),
    "material.poisson_ratio": Usual(0.0, 0.5, "", "plant tissues"),
    "material.dry_mass": Usual(0.01, 1.5, "kg/m2", "leaf mass per area, Wright et al. 2004"),
    "material.saturated_water": Usual(0.02, 5.0, "kg/m2", "thin leaves to succulents"),
    "material.density": Usual(
        300.0,
        1500.0,
        "kg/m3",
        "it follows from dry_mass, saturated_water and thickness; tissue with air in it, to wood",
    ),
    "material.osmotic_potential": Usual(3e5, 5e6, "Pa", "pressure-volume curves, Bartlett et al. 2012"),
    "material.bulk_modulus": Usual(1e6, 6e7, "Pa", "pressure-volume curves, Bartlett et al. 2012"),
    "material.turgor_loss_point": Usual(
        0.6, 0.98, "", "it follows from osmotic_potential and bulk_modulus; leaves mostly have 0.8 to 0.95"
    ),
    "material.wilted_stiffness": Usual(0.01, 1.0, "", "a wilted leaf is soft, but no cloth"),
    "material.dry_stiffness": Usual(1.0, 100.0, "", "a dry leaf is stiffer than a wilted one"),
    "material.area_lost": Usual(
        0.0, 0.82, "", "it follows from shrink_across and shrink_along; 380 species, Blonder et al. 2012"
    ),
    "material.mismatch": Usual(-0.1, 0.1, "", "0.01 curls a leaf of 0.25 mm to a radius of 2 cm"),
    "material.plastic_set": Usual(0.0, 0.95, "", "with 1 nothing of what has dried ever comes back"),
    "air.temperature": Usual(263.15, 323.15, "K", "air around a leaf; a plain number is in kelvin"),
    "air.relative_humidity": Usual(0.05, 1.0, "", "drier air is rare in any desert"),
    "air.pressure": Usual(5e4, 1.1e5, "Pa", "from the sea to 5,500 m"),
    "air.deficit": Usual(
        0.0, 8000.0, "Pa", "the vapour pressure deficit, given or from the relative humidity; a hot desert has 8000"
    ),
    "stomata.open_conductance": Usual(0.005, 1.5, "mol/m2/s", "leaves in light have 0.05 to 0.6, Koerner 1995"),
    "stomata.minimum_conductance": Usual(1e-4, 0.05, "mol/m2/s", "247 species, Duursma et al. 2019"),
}


def unusual_values(scene: Scene) -> Iterator[str]:
    """A line for every value of a scene that lies outside its usual range."""
    for key, usual in USUAL.items():
        table, name = key.split(".")
        holder = getattr(scene, table)
        value = None if holder is None else getattr(holder, name)
        if value is not None and not usual.low <= value <= usual.high:
            unit = f" {usual.unit}" if usual.unit else ""
            usual_range = f"{plain_number(usual.low)} to {plain_number(usual.high)}{unit}"
            yield f"{key} = {plain_number(value)}{unit}: usual: {usual_range} ({usual.why})"


def opening_stomata(scene: Scene) -> Iterator[str]:
    """A line for every part of a closure by which stomata open as the leaf dries."""
    if scene.stomata is None or scene.stomata.closure is None:
        return
    for (dry, dry_opening), (wet, wet_opening) in pairwise(scene.stomata.closure):
        if dry_opening > wet_opening:
            yield (
                f"stomata.closure = {dry_opening:g} at a water content of {dry:g} and {wet_opening:g} at {wet:g}: "
                "usual: the drier the leaf, the smaller the opening"
            )


def events_without_effect(scene: Scene) -> Iterator[str]:
    """A line for everything that a scene says to happen after its end."""
    if scene.source is None:
        return
    duration = scene.time.duration
    for key, what in (("cut_at", "the leaf is never cut off"), ("rewatered_at", "the leaf is never rewatered")):
        moment = getattr(scene.source, key)
        if moment is not None and moment >= duration:
            yield (
                f"source.{key} = {plain_number(moment)} s: {what}; usual: before the end, "
                f"time.duration = {plain_number(duration)} s"
            )


def assumed_values(scene: Scene) -> Iterator[str]:
    """A line for every default that decides how fast the leaf dries."""
    if scene.stomata is None:
        return
    air, structure = scene.air, scene.structure
    if air.relative_humidity is not None and "temperature" not in air.model_fields_set:
        yield (
            f"air.temperature: not given; {plain_number(air.temperature)} K is taken, at which a relative humidity of "
            f"{air.relative_humidity:g} is a vapour pressure deficit of {air.deficit:.4g} Pa"
        )
    if scene.material is None and "water_mass" not in structure.model_fields_set:
        yield (
            f"structure.water_mass: not given; {plain_number(structure.water_mass)} kg/m2 of water are taken for the "
            "saturated leaf, of which [stomata] makes its rates; give it, or a [material]"
        )


def slow_motion(scene: Scene) -> Iterator[str]:
    """A line if explicit motion of the saturated leaf has to take very many steps a frame.

    A vertex of a regular mesh has six springs of ``k = sqrt(3)/2 E h`` and the mass ``m`` of its share of the leaf's
    area, which is less than the square of the length. The step is below ``2 / sqrt(2 sum k / m)``; veins and
    irregular triangles shorten it by a factor of a few.
    """
    structure = scene.structure
    stiffness = structure.membrane_stiffness * structure.stiffness_factor[-1][1]
    if scene.motion.method != "explicit" or scene.method_is_open or scene.leaf.length is None or stiffness == 0.0:
        return
    mass = (structure.dry_mass + structure.water_mass) * scene.leaf.length**2 / scene.mesh.vertices
    step = 2.0 / math.sqrt(12.0 * 0.5 * math.sqrt(3.0) * stiffness / mass)
    substeps = 1.0 / (scene.time.fps * step)
    other = (
        ""
        if scene.leaves or structure.bending == "paper"
        else "; motion.method = 'quasistatic' or 'implicit' takes one"
    )
    if substeps > MANY_SUBSTEPS:
        yield (
            f"motion.method = 'explicit': a membrane of {plain_number(stiffness)} N/m takes steps "
            f"below {step:.2g} s, more than {substeps:.0f} a frame{other}"
        )


def abrupt_shrinking(scene: Scene) -> Iterator[str]:
    """A line if explicit motion may be handed a leaf that shrinks all at once, which folds triangles over."""
    if scene.motion.method != "explicit" or not scene.shrinks:
        return
    for (dry, dry_lost), (wet, wet_lost) in pairwise(scene.shrink.curve):
        lost = abs(dry_lost - wet_lost)
        if lost > ABRUPT_LOSS and lost > ABRUPT_SLOPE * (wet - dry):
            yield (
                f"shrink.curve: {lost:.2g} of the length are lost between the water contents {dry:g} and {wet:g}: "
                f"usual: over {lost / ABRUPT_SLOPE:.2g} of water or more; explicit motion may fold the leaf over, "
                "which 'quasistatic' and 'implicit' do not"
            )


def motion_without_effect(scene: Scene) -> Iterator[str]:
    """A line for every key by which a leaf would swing, where it does not."""
    if scene.motion.method != "quasistatic":
        return
    keys = [("structure.damping", scene.structure)]
    keys += [("motion.drag", scene.motion)] * (scene.motion.wind is None)
    for key, table in keys:
        name = key.partition(".")[2]
        value = getattr(table, name)
        if name in table.model_fields_set and value > 0.0:
            yield (
                f"{key} = {plain_number(value)}: has no effect with motion.method = 'quasistatic', in which the leaf "
                "is always at rest; motion.method = 'implicit' has inertia"
            )


def inertia_decides(scene: Scene) -> Iterator[str]:
    """A line if inertia may carry a leaf in SI units past a buckle, into a shape that depends on the film's length."""
    if scene.material is None or scene.motion.method == "quasistatic" or not scene.curls:
        return
    yield (
        f"motion.method = '{scene.motion.method}': has inertia in the film's time; where a curling leaf can rest in "
        "several shapes, time.frames and time.fps may decide in which; with 'quasistatic' they do not"
    )


def fine_maps(scene: Scene) -> Iterator[str]:
    """A line if many leaves have maps far finer than their meshes."""
    if scene.leaves is None or not scene.map_names:
        return
    suitable = suitable_cells(scene.mesh.vertices)
    cells = math.prod(scene.maps.shape)
    if cells > 4 * suitable**2:
        yield (
            f"maps.size = {list(scene.maps.shape)} for each of {scene.leaves.count} leaves of {scene.mesh.vertices} "
            f"vertices: usual: {suitable}, in {suitable**2 / cells:.0%} of the time and memory"
        )


def steps_that_cannot_adapt(scene: Scene) -> Iterator[str]:
    """Adaptive steps whose error does not fall much as they get shorter."""
    if scene.water_flows and scene.fluid.step_tolerance is not None and scene.fluid.scheme == "split":
        yield (
            f"fluid.step_tolerance = {scene.fluid.step_tolerance:g}: with fluid.scheme = 'split' steps may become very "
            "short, as what splitting takes from diagonal veins hardly falls with them; usual: 'unsplit'"
        )


def warnings_of(scene: Scene) -> tuple[str, ...]:
    """What of a scene is accepted but unusual, one line each."""
    kinds = (
        unusual_values,
        opening_stomata,
        events_without_effect,
        assumed_values,
        slow_motion,
        abrupt_shrinking,
        motion_without_effect,
        inertia_decides,
        fine_maps,
        steps_that_cannot_adapt,
    )
    return tuple(line for kind in kinds for line in kind(scene))
