"""Water that flows in the leaf: transpiration, source and diffusion, one fluid step after another.

Names are imported when they are asked for, so that a scene loads the kernels of its own scheme alone.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leafwarp.sim.fluid.controller import Fluid, WaterLedger
    from leafwarp.sim.fluid.factored import FactoredDiffusion
    from leafwarp.sim.fluid.second_order import Extrapolation, HalfSteps
    from leafwarp.sim.fluid.source import Source
    from leafwarp.sim.fluid.split import SplitDiffusion
    from leafwarp.sim.fluid.steps import FluidSteps
    from leafwarp.sim.fluid.transpiration import Transpiration
    from leafwarp.sim.fluid.unsplit import UnsplitDiffusion
    from leafwarp.sim.fluid.water import Water

_PLACES = {
    "Extrapolation": "second_order",
    "FactoredDiffusion": "factored",
    "Fluid": "controller",
    "FluidSteps": "steps",
    "HalfSteps": "second_order",
    "Source": "source",
    "SplitDiffusion": "split",
    "Transpiration": "transpiration",
    "UnsplitDiffusion": "unsplit",
    "Water": "water",
    "WaterLedger": "controller",
}

__all__ = [
    "Extrapolation",
    "FactoredDiffusion",
    "Fluid",
    "FluidSteps",
    "HalfSteps",
    "Source",
    "SplitDiffusion",
    "Transpiration",
    "UnsplitDiffusion",
    "Water",
    "WaterLedger",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
