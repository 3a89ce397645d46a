"""The commented scene that ``python -m leafwarp new PHOTO`` writes."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

from leafwarp.errors import InputError
from leafwarp.files import write_text
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene_file import parse_scene

TEMPLATE = """\
# A leaf that dries over a day. Every key and its unit: python -m leafwarp schema
# A plain number is SI; a string carries its unit. A table that you delete is not modelled and costs nothing.

[leaf]
image = {image}
length = {length}            # petiole base to farthest point: measure yours

[mesh]
vertices = 1700              # more is finer and slower

[maps]
size = 128                   # cells of the water map: a number, or [width, height]
# venation = "veins.png"     # your own maps instead of automatic ones; so for stomata, water, source

[time]
duration = "24 h"            # what the leaf lives through ...
frames = 120                 # ... shown in so many frames
fps = 24

[fluid]                      # water flows along the veins and seeps between them
step = "15 s"                # shorter is more accurate and slower: python -m leafwarp tradeoff measures it
# scheme = "unsplit"         # no error along diagonal veins; then "4 min" is accurate, and ten times slower
lamina_diffusivity = 5e-10   # m^2/s
vein_diffusivity = 1.5e-5    # m^2/s

[transpiration]
rate = "0.055 1/h"           # share of the saturated leaf's water lost an hour
cuticle_rate = "0.01 1/h"

[source]                     # water from the twig ...
conductance = "20 1/h"
cut_at = "12 h"              # ... until the leaf is picked

[shrink]
curve = [[1.0, 0.0], [0.1, 0.2]]      # [water, share of the length lost]
vein_resistance = 0.5

[curl]                                # positive: toward the photographed side
mismatch = [[1.0, 0.0], [0.1, 0.008]] # [water, strain between the two sides]
thickness = "0.25 mm"
vein_resistance = 0.5

[structure]
membrane_stiffness = 2.0     # N/m, soft: explicit motion
bending_stiffness = 5e-7     # N m
vein_stiffness = 3.0         # a vein over the lamina
stiffness = [[1.0, 1.0], [0.85, 0.7], [0.2, 1.1]]  # wilting softens, drying stiffens
dry_mass = 0.15              # kg/m^2
water_mass = 0.20            # kg/m^2

[motion]
# gravity = [0.0, 0.0, -0.01] # m/s^2, z up; scaled down with the soft bending stiffness
drag = 4.0                   # 1/s

[output]
contact_sheet = true
display_color = true
"""


def write_new_scene(photo: Path, output: Path, length: str, overwrite: bool) -> Path:
    """Write a scene for a photo, after seeing that a leaf can be found in it.

    Args:
        photo: Photo of a leaf.
        output: Scene file to write.
        length: Length of the leaf with its unit, such as "8 cm".
        overwrite: Replace a file that is there already.

    Raises:
        InputError: The photo holds no usable leaf, the length is none, or the scene exists already.
    """
    if output.exists() and not overwrite:
        raise InputError(f"{output}: exists already; --overwrite replaces it")
    if not photo.is_file():
        raise InputError(f"{photo}: no such file")
    if not output.parent.is_dir():
        raise InputError(f"{output.parent}: no such folder")
    image = os.path.relpath(photo.resolve(), output.parent.resolve())
    # A TOML basic string and a JSON string agree on everything that a path or a length can hold.
    text = TEMPLATE.format(image=json.dumps(Path(image).as_posix()), length=json.dumps(length))
    data = {"name": "leaf", **tomllib.loads(text)}
    prepare_scene_leaf(parse_scene(data, str(output), output.parent), None)
    write_text(output, text)
    return output
