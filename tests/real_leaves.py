"""The real leaf photos beside the repository, where there are any, and where their petioles end by eye."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = Path(os.environ.get("LEAFWARP_LEAVES", Path(__file__).parents[2] / "shared" / "leaves"))
BASES = {  # [pixels] x, y of the upright photo
    "corn_gls": (114.0, 255.0),  # the blade is cut by the picture; its midrib thickens downwards
    "grape_esca": (204.0, 255.0),
    "grapevine": (1369.0, 263.0),
    "leafcalc1": (1800.0, 4076.0),
    "poplar": (279.0, 491.0),
    "potato_hole": (164.0, 249.0),
    "raspberry": (118.0, 240.0),
    "squash": (115.0, 209.5),
    "zelkova": (1170.0, 588.0),
}


def present() -> list[str]:
    """Names of the photos that are there."""
    return [name for name in BASES if (FOLDER / f"{name}.jpg").is_file()]
