"""The text of the scene that ``python -m leafwarp new PHOTO`` writes: commented, and fit for the size of the leaf.

What moves is the same at any length: with shares ``s`` of the reference leaf's area, diffusivities go as ``s``, the
membrane's stiffness as ``s`` and the bending stiffness as ``s^2`` (which keeps the ratio of the two and every
frequency), the curl's curvature as ``1 / sqrt(s)``.
"""

from __future__ import annotations

import json
import math
import textwrap

from leafwarp.leaf.leaf import Leaf

TEMPLATE = """\
# A leaf that dries over a day. Every key and its unit: python -m leafwarp schema
# A plain number is SI; a string carries its unit. A table that you delete is not modelled and costs nothing.
# A leaf as a botanist would state it, by its material, the air and its stomata, is offered further down.

quality = "final"            # or balanced or draft, which are faster and coarser; or in place of this line
                             # tolerance = "1 %" of the leaf's length: coarse films find what that takes

[leaf]
image = {image}
{length}
{found}
[mesh]
# vertices = 1700            # your own number instead of the quality's; so for maps.size, fluid.step, fluid.scheme
# follow_veins = true        # main veins become edges of the mesh

[maps]
# size = 256                 # cells of the water map: a number, or [width, height]
# venation = "veins.png"     # your own maps instead of automatic ones; so for stomata, water, source
# venation = "parallel"      # or veins made up: parallel, pinnate or palmate

[time]
duration = "24 h"            # what the leaf lives through ...
frames = 120                 # ... shown in so many frames
fps = 24

[fluid]                      # water flows along the veins and seeps between them
# scheme = "split"           # the paper's; it wants a step of seconds: python -m leafwarp tradeoff measures it
# step = "15 s"
{lamina_diffusivity}
{vein_diffusivity}

[source]                     # water from the twig ...
conductance = "20 1/h"
cut_at = "12 h"              # ... until the leaf is picked

# ---- A soft leaf of artistic figures, quick to compute: from here ...
[transpiration]
rate = "0.055 1/h"           # share of the saturated leaf's water lost an hour
cuticle_rate = "0.01 1/h"

[shrink]
curve = [[1.0, 0.0], [0.1, 0.2]]      # [water, share of the length lost]
vein_resistance = 0.5

[curl]                                # positive: toward the photographed side
{mismatch}
thickness = "0.25 mm"
vein_resistance = 0.5

[structure]
{membrane_stiffness}
{bending_stiffness}
vein_stiffness = 3.0         # a vein over the lamina
stiffness = [[1.0, 1.0], [0.85, 0.7], [0.2, 1.1]]  # wilting softens, drying stiffens
dry_mass = 0.15              # kg/m^2
water_mass = 0.20            # kg/m^2

[motion]
# gravity = [0.0, 0.0, -0.01] # m/s^2, z up; scaled down with the soft bending stiffness
drag = 4.0                   # 1/s
# ---- ... to here. For a real leaf, in SI units: delete what lies between these two lines, and take away one "# " from
# ---- each line of what follows.
# [material]
# preset = "tree"            # or herb, waxy, grass; the figures below hold instead of the preset's where they are given
# # thickness = "0.2 mm"     # lamina; every key and its unit: python -m leafwarp schema
# # lamina_modulus = "50 MPa"
# # dry_mass = "80 g/m2"
# # saturated_water = "120 g/m2"
# # osmotic_potential = "1.5 MPa"      # it and the next set where turgor is lost: at the water content 1 - 1.5 / 12
# # bulk_modulus = "12 MPa"
#
# [air]
# temperature = "24 degC"
# relative_humidity = "50 %"           # or vapour_pressure_deficit = "1.5 kPa"
#
# [stomata]
# open_conductance = "150 mmol/m2/s"
# minimum_conductance = "5 mmol/m2/s"  # what the cuticle lets through
#
# [motion]
# method = "quasistatic"     # an equilibrium a frame; "implicit" swings, with inertia in the film's time
# gravity = [0.0, 0.0, -9.81]
# clamp = true               # the petiole is held in its direction
# settle = true              # the film starts with the leaf at rest under its weight
# ---- The end of the leaf in SI units.

[output]
contact_sheet = true
display_color = true
# texture_limit = 4096       # longest side of the texture in pixels; the photo's own without
"""

FOUND = """
# What was found in the photo of {width} x {height} pixels; {overlay} shows it.
#   confidence {confidence:.2f} of 1; {veins}
#   {centimetres:.3g} cm long, {square_centimetres:.3g} cm^2, if the length above is right
{notes}# Where it is wrong, un-comment a line and correct it. Pixels count from the photo's top left corner.
{base}
{rect}
{mask}
{holes}
"""
VEINS = {
    "photo": "veins as the photo shows them",
    "pinnate": "pinnate veins, made up: the photo shows none",
    "palmate": "palmate veins, made up: the photo shows none",
    "parallel": "parallel veins, made up: the leaf is a blade",
}
BASE_FOUND = {"stalk": "found as the end of a stalk", "veins": "no stalk seen: where the veins and the shape point to"}
COMMENT_COLUMN = 29
LINE_LENGTH = 116
RECT_MARGIN = 0.08  # of the leaf's longer side: a search needs some background
REFERENCE_AREA = 60e-4  # [m^2] of the leaf that the values below are made for
LAMINA_DIFFUSIVITY, VEIN_DIFFUSIVITY = 2e-10, 1.5e-5  # [m^2/s]
MEMBRANE_STIFFNESS, BENDING_STIFFNESS = 2.0, 5e-7  # [N/m], [N m]
MISMATCH = 0.01  # strain between the two sides of the dry leaf


def scene_text(image: str, length: str, leaf: Leaf | None = None, overlay: str = "") -> str:
    """The scene of a photo.

    Args:
        image: The photo's path, relative to the scene.
        length: Length of the leaf with its unit.
        leaf: The leaf that was found, which sets what depends on its size and is described; None for neither.
        overlay: Name of the picture of what was found.
    """
    share = 1.0 if leaf is None else _area(leaf) / REFERENCE_AREA
    mismatch = min(MISMATCH / math.sqrt(share), 0.5)
    return TEMPLATE.format(
        # A TOML basic string and a JSON string agree on everything that a path or a length can hold.
        image=json.dumps(image, ensure_ascii=False),
        length=_line(
            f"length = {json.dumps(length, ensure_ascii=False)}", "petiole base to farthest point: measure yours"
        ),
        found="" if leaf is None else _found(leaf, overlay),
        lamina_diffusivity=_line(f"lamina_diffusivity = {LAMINA_DIFFUSIVITY * share:.3g}", "m^2/s"),
        vein_diffusivity=_line(f"vein_diffusivity = {VEIN_DIFFUSIVITY * share:.3g}", "m^2/s"),
        mismatch=_line(f"mismatch = [[1.0, 0.0], [0.1, {mismatch:.3g}]]", "[water, strain between the two sides]", 38),
        membrane_stiffness=_line(
            f"membrane_stiffness = {MEMBRANE_STIFFNESS * share:.3g}", "N/m, soft: explicit motion"
        ),
        bending_stiffness=_line(f"bending_stiffness = {BENDING_STIFFNESS * share**2:.3g}", "N m"),
    )


def _found(leaf: Leaf, overlay: str) -> str:
    """What was found in the photo, as comments: to be read, and overrides to un-comment."""
    findings = leaf.findings
    low, high = findings.outline.min(axis=0), findings.outline.max(axis=0)
    margin = RECT_MARGIN * (high - low).max()
    left, top = (max(0, math.floor(value)) for value in low - margin)
    right, bottom = (
        min(side, math.ceil(value)) for side, value in zip(findings.photo_size, high + margin, strict=True)
    )
    notes = [
        textwrap.wrap(note, LINE_LENGTH, initial_indent="#   ", subsequent_indent="#   ") for note in findings.notes
    ]
    return FOUND.format(
        width=findings.photo_size[0],
        height=findings.photo_size[1],
        overlay=overlay,
        confidence=findings.confidence,
        veins=VEINS[findings.vein_kind],
        centimetres=100.0 * leaf.length,
        square_centimetres=1e4 * _area(leaf),
        notes="".join(f"{line}\n" for lines in notes for line in lines),
        base=_line(
            "# base = [{:.0f}, {:.0f}]".format(*findings.base),
            f"the petiole's end; {BASE_FOUND.get(findings.base_found, 'as given')}",
        ),
        rect=_line(
            f"# rect = [{left}, {top}, {right - left}, {bottom - top}]",
            "look for the leaf in here only: left, top, width, height",
        ),
        mask=_line('# mask = "mask.png"', "a picture of the same view, light on the leaf: no search at all"),
        holes=_line('# holes = "keep"', "holes of the leaf in the mesh too, not in the texture alone"),
    )


def _line(text: str, comment: str, column: int = COMMENT_COLUMN) -> str:
    """A line of the scene with its comment in a column."""
    return f"{text.ljust(column - 1)} # {comment}"


def _area(leaf: Leaf) -> float:
    return float(leaf.mesh.vertex_areas.sum())
