"""leafwarp: a photo of a leaf becomes an animated USD of the leaf drying, wilting, curling and shrinking.

The public API is imported lazily, so that ``import leafwarp`` costs nothing:

- :func:`load_scene`, :class:`Scene`: a scene file, validated, in SI units;
- :func:`prepare_leaf`, :class:`Leaf`: a photo turned into mesh, texture and maps;
- :class:`Simulation`, :class:`Frame`: the leaf, frame by frame;
- :func:`run_scene`: all of it, written to a USD.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_PLACES = {
    "Scene": "leafwarp.scene",
    "load_scene": "leafwarp.scene.file",
    "Leaf": "leafwarp.leaf.leaf",
    "prepare_leaf": "leafwarp.leaf",
    "Simulation": "leafwarp.sim.simulation",
    "Frame": "leafwarp.frame",
    "run_scene": "leafwarp.run",
}

__all__ = list(_PLACES)


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'leafwarp' has no attribute '{name}'")
    return getattr(import_module(_PLACES[name]), name)
