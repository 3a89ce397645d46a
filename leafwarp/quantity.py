"""Quantities with units in a scene: a plain number is SI, a string carries its unit ("48 h", "12 cm")."""

from __future__ import annotations

import re
from numbers import Real
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

# Factor to SI of every accepted unit, by dimension; the first of each is the SI unit.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "rate": {"1/s": 1.0, "1/min": 1.0 / 60.0, "1/h": 1.0 / 3600.0, "1/d": 1.0 / 86400.0},
    "diffusivity": {"m2/s": 1.0, "cm2/s": 1e-4, "mm2/s": 1e-6},
    "membrane stiffness": {"N/m": 1.0},
    "bending stiffness": {"N m": 1.0, "N mm": 1e-3, "uN m": 1e-6},
    "mass per area": {"kg/m2": 1.0, "g/m2": 1e-3},
    "pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5},
    "conductance": {"mol/m2/s": 1.0, "mmol/m2/s": 1e-3},
    "temperature": {"K": 1.0, "degC": 1.0},
    "fraction": {"": 1.0, "%": 1e-2},
}
# What a unit's zero is in SI, where that is not 0.
ZEROS = {"degC": 273.15}

# Other ways in which a unit is written: "mmol m^-2 s^-1", "m²/s", "°C", "h^-1", "/h".
_SPELLINGS = str.maketrans("²¹⁻·µμ", "21- uu", "^") | {ord("°"): "deg"}
_INVERSE_POWER = re.compile(r"(?:^|\s+)([a-z]+)-(\d)")

_NUMBER_AND_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")


def _plain(unit: str) -> str:
    """A unit as it is spelled in :data:`UNITS`."""
    unit = _INVERSE_POWER.sub(
        lambda power: "/" + power[1] + (power[2] if power[2] != "1" else ""), unit.translate(_SPELLINGS)
    )
    return f"1{unit}" if unit.startswith("/") else unit


def _accepted(dimension: str) -> str:
    """What a scene may say for a quantity of a dimension, in words."""
    units = list(UNITS[dimension])
    if units[0] == "":
        return f"accepted: a number, or a number and {units[1]}"
    return f"accepted: a number [{units[0]}], or a number and one of {', '.join(units)}"


def parse_quantity(value: Any, dimension: str) -> Any:
    """Convert a number or a string with a unit to a number in SI.

    Args:
        value: What the scene says. A number is returned as it is.
        dimension: A key of :data:`UNITS`.

    Raises:
        ValueError: The value is neither a number nor a string of a number and an accepted unit.
    """
    if isinstance(value, Real) and not isinstance(value, bool):
        return value
    units = UNITS[dimension]
    match = _NUMBER_AND_UNIT.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ValueError(_accepted(dimension))
    unit = next(iter(units)) if match[2] is None else _plain(match[2])
    if unit not in units:
        raise ValueError(_accepted(dimension))
    return float(match[1]) * units[unit] + ZEROS.get(unit, 0.0)


def quantity(dimension: str) -> Any:
    """The annotated type of a scene key that holds a quantity of this dimension, in SI after validation."""
    si, *_ = units = list(UNITS[dimension])
    number = {"type": "number"} | ({"description": f"[{si}]"} if si else {})
    string = {"type": "string", "description": f"a number with a unit: {', '.join(filter(None, units))}"}
    schema = {"anyOf": [number, string]}
    return Annotated[float, BeforeValidator(lambda value: parse_quantity(value, dimension)), WithJsonSchema(schema)]
