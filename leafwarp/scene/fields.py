"""The types of a scene's keys."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
)
from pydantic_core.core_schema import CoreSchema, no_info_after_validator_function

from leafwarp.quantity import quantity


def plain_number(value: float) -> str:
    """A number as a person writes it: 1e-6, not 1e-06."""
    if isinstance(value, int):
        return str(value)
    return f"{value:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


@dataclass(frozen=True)
class Bounds:
    """The rule that a number, in SI, lies between two bounds; its refusal and the JSON Schema say them.

    Attributes:
        low: Smallest accepted value.
        high: Largest accepted value; infinite for none.
        unit: Unit of both; empty for a plain number.
        hint: What a refusal adds.
        above: Whether ``low`` itself is not accepted.
    """

    low: float
    high: float = math.inf
    unit: str = ""
    hint: str = ""
    above: bool = False

    @property
    def accepted(self) -> str:
        """The rule in words."""
        low, high = plain_number(self.low), plain_number(self.high)
        if self.above:
            numbers = f"above {low}" + (f", to {high}" if math.isfinite(self.high) else "")
        else:
            numbers = f"{low} to {high}" if math.isfinite(self.high) else f"{low} or more"
        return "; ".join(filter(None, [f"accepted: {numbers} {self.unit}".rstrip(), self.hint]))

    def _check(self, value: float) -> float:
        if not self.low <= value <= self.high or (self.above and value == self.low):
            raise ValueError(self.accepted)
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        described = copy.deepcopy(handler(schema))
        for alternative in described.get("anyOf", [described]):
            if alternative["type"] in ("number", "integer"):
                alternative["exclusiveMinimum" if self.above else "minimum"] = self.low
                if math.isfinite(self.high):
                    alternative["maximum"] = self.high
        return described


Time = quantity("time")
Length = quantity("length")
Rate = quantity("rate")
Diffusivity = quantity("diffusivity")
Pressure = quantity("pressure")
Temperature = quantity("temperature")
Conductance = quantity("conductance")
Fraction = quantity("fraction")
MassPerArea = quantity("mass per area")
Integer = Annotated[int, Strict()]
Switch = Annotated[bool, Strict()]
Number = Annotated[float, Strict()]
Share = Annotated[Fraction, Bounds(0.0, 1.0)]
# Far beyond any leaf, and well within single precision.
Component = Annotated[Number, Bounds(-1e9, 1e9)]
Vector = tuple[Component, Component, Component]


# Piecewise linear in the relative water content y, constant beyond its ends.
Curve = tuple[tuple[float, float], ...]


def _sorted_curve(points: Curve) -> Curve:
    points = tuple(sorted(points))
    if len({y for y, _ in points}) < len(points):
        raise ValueError("two points have the same water content")
    return points


def curve_within(low: float, high: float) -> Any:
    """The type of a response curve of the relative water content, whose values lie between two bounds."""
    point = tuple[Share, Annotated[Fraction, Bounds(low, high)]]
    return Annotated[tuple[point, ...], Field(min_length=1, max_length=64), AfterValidator(_sorted_curve)]


def product(*curves: Curve) -> Curve:
    """The product of response curves, as a curve through the water contents of all of them.

    Exact wherever but one of them changes; elsewhere, at those contents.
    """
    contents = sorted({y for curve in curves for y, _ in curve})
    values = [np.interp(contents, *zip(*curve, strict=True)) for curve in curves]
    return tuple(zip(contents, np.prod(values, axis=0).tolist(), strict=True))


def varies(curve: Curve) -> bool:
    """Whether a response curve is not the same everywhere."""
    return len({value for _, value in curve}) > 1


class Table(BaseModel):
    """A table of the scene file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def filled(self, **values: Any) -> Self:
        """A copy in which the keys that the file leaves out have these values.

        They still count as left out: a scene that is made anew with other values derives them anew.
        """
        filled = self.model_copy()
        for key, value in values.items():
            if key not in self.model_fields_set or getattr(self, key) is None:
                filled.__dict__[key] = value
        return filled
