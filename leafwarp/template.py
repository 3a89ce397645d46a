"""The commented scene that ``python -m leafwarp new PHOTO`` writes."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

from leafwarp.errors import InputError
from leafwarp.run import prepare_scene_leaf, write_text
from leafwarp.scene import parse_scene

TEMPLATE = """\
# A leaf that dries over a day. Every key and its unit: python -m leafwarp schema
# A plain number is SI; a string carries its unit. A table that you delete is not modelled and costs nothing.

[leaf]
image = {image}
length = {length}            # petiole base to farthest point: measure yours

[mesh]
vertices = 1700              # more is finer and slower

[maps]
size = 256                   # cells of the water map: a number, or [width, height]
# venation = "veins.png"     # your own maps instead of automatic ones; so for stomata, water, source

[time]
duration = "24 h"            # what the leaf lives through ...
frames = 120                 # ... shown in so many frames
fps = 24

[fluid]                      # water flows along the veins and seeps between them
step = "60 s"                # shorter is more accurate and slower
lamina_diffusivity = 1e-9    # m^2/s
vein_diffusivity = 1e-7      # m^2/s

[transpiration]
rate = "0.06 1/h"            # share of the saturated leaf's water lost an hour

[source]                     # water from the twig, until the leaf is picked
conductance = "0.2 1/h"
cut_at = "2 h"

[shrink]
curve = [[1.0, 0.0], [0.3, 0.18]]     # [water, share of the length lost]
vein_resistance = 0.5

[curl]                                # positive: toward the photographed side
mismatch = [[1.0, 0.0], [0.2, 0.006]] # [water, strain between the two sides]
thickness = "0.25 mm"
vein_resistance = 0.3

[structure]
membrane_stiffness = 6.0     # N/m, soft: explicit motion
bending_stiffness = 4e-6     # N m
vein_stiffness = 4.0         # a vein over the lamina
stiffness = [[1.0, 1.0], [0.85, 0.6], [0.3, 1.2]]  # wilting softens, drying stiffens

[motion]
# gravity = [0.0, 0.0, -0.1] # m/s^2, z up; scaled down with the soft bending stiffness
drag = 4.0

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
