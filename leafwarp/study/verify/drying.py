"""The measured drying of a leaf, from parameters that were published with it or elsewhere.

A severed kohlrabi leaf (Brassica oleracea var. gongylodes) was weighed for 11 hours (data of the R package
pvldcurve, Raesch 2020). What the simulation is told, and where it comes from:

* temperature, vapour pressure deficit, water per area of the saturated leaf, dry mass: that measurement;
* conductance with open and with closed stomata, 30 and 1.3 mmol m^-2 s^-1: the highest and the last of that leaf;
* turgor in proportion to the water lost, and gone at a loss of 23 %: kale leaves (Brassica oleracea var. acephala),
  from 310 kPa when fresh (Calbo and Ferreira 2011, Brazilian Journal of Plant Physiology 23 (2));
* stomata that close in proportion to turgor: the default of a scene.

So two conductances are read off this leaf's own curve, from its slopes, and nothing else is: the case tests the closure
between them, and the ledger. In the first interval the leaf lost water at 13 mmol m^-2 s^-1 only, before its
stomata opened to 30, which no closure that falls with the water content follows; hence the comparison from the end of
that interval on, started either from saturation or from the content measured there.
"""

from __future__ import annotations

import numpy as np

from leafwarp.study.verify.case import Check, near
from leafwarp.study.verify.drawn_fluid import ellipse, make_sample

# Relative water content of the kohlrabi leaf at hours after it was severed.
MEASURED = (
    (0.0, 1.000), (0.83, 0.976), (1.62, 0.923), (2.37, 0.880), (3.18, 0.847),
    (3.77, 0.834), (4.57, 0.822), (6.45, 0.804), (8.08, 0.791), (11.18, 0.782),
)  # fmt: skip
FIRST_INTERVAL = MEASURED[1][0]  # [h]
TOLERANCE = 0.03

KOHLRABI = {
    "air": {"temperature": "24.5 degC", "vapour_pressure_deficit": "1.6 kPa"},
    "stomata": {"open_conductance": "30 mmol/m2/s", "minimum_conductance": "1.3 mmol/m2/s"},
    "material": {
        "dry_mass": 0.046,
        "saturated_water": 0.45,
        "osmotic_potential": "310 kPa",  # the turgor of the saturated leaf
        "bulk_modulus": 310e3 / 0.23,  # with which a loss of 23 % takes it all
    },
}


def drying_curve(
    tables: dict[str, dict], hours: np.ndarray, start: float = 1.0, device: str = "cpu", step: float = 300.0
) -> np.ndarray:
    """Mean relative water content of a severed leaf with the same stomata and the same water everywhere.

    Args:
        tables: Tables of a scene that say what transpires.
        hours: Moments since it was severed, rising [h], shape [moment_count].
        start: Content of the leaf at the start.
        device: Warp device.
        step: Fluid step [s].
    """
    mask = ellipse(8)
    seconds = 3600.0 * np.asarray(hours, float)
    still = {"step": step, "lamina_diffusivity": 0.0, "vein_diffusivity": 0.0}
    time = {"duration": max(seconds[-1], step), "frames": 2}
    maps = {"water": np.where(mask, start, 0.0), "stomata": mask.astype(float)}
    sample = make_sample({"fluid": still, "time": time} | tables, mask, maps, device=device, precision="float64")
    curve = []
    for moment in seconds:
        sample.fluid.advance(moment)
        curve.append(sample.state["water_now"].numpy()[mask].mean())
    return np.array(curve)


def kohlrabi_drying(device: str) -> list[Check]:
    """The measured contents of the leaf, from published parameters, started from saturation and after 0.83 h."""
    hours, measured = np.array(MEASURED)[1:].T
    whole = drying_curve(KOHLRABI, hours, device=device)
    rest = drying_curve(KOHLRABI, hours - FIRST_INTERVAL, start=measured[0], device=device)
    return [
        near(f"y at {hour:g} h, {label}", expected, got, TOLERANCE)
        for label, curve in (("from saturation", whole), ("from 0.83 h on", rest))
        for hour, expected, got in zip(hours, measured, curve, strict=True)
        if not (label == "from 0.83 h on" and hour == FIRST_INTERVAL)
    ]
