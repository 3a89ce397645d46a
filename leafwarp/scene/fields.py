"""The types of a scene's keys."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict

from leafwarp.quantity import quantity

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
Share = Annotated[Number, Field(ge=0.0, le=1.0)]
# Far beyond any leaf, and well within single precision.
Component = Annotated[Number, Field(ge=-1e9, le=1e9)]
Vector = tuple[Component, Component, Component]


def _sorted_curve(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    points = tuple(sorted(points))
    contents = [y for y, _ in points]
    if contents[0] < 0.0 or contents[-1] > 1.0:
        raise ValueError("the first number of each pair is a relative water content in [0, 1]")
    if len(set(contents)) < len(contents):
        raise ValueError("two points have the same water content")
    return points


# Piecewise linear in the relative water content y, constant beyond its ends.
Curve = Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1, max_length=64), AfterValidator(_sorted_curve)]


def product(*curves: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """The product of response curves, as a curve through the water contents of all of them.

    Exact wherever but one of them changes; elsewhere, at those contents.
    """
    contents = sorted({y for curve in curves for y, _ in curve})
    values = [np.interp(contents, *zip(*curve, strict=True)) for curve in curves]
    return tuple(zip(contents, np.prod(values, axis=0).tolist(), strict=True))


def varies(curve: tuple[tuple[float, float], ...]) -> bool:
    """Whether a response curve is not the same everywhere."""
    return len({value for _, value in curve}) > 1


def within(low: float, high: float, what: str) -> AfterValidator:
    """The rule that all values of a response curve, which a message calls ``what``, lie between two bounds."""

    def check(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for _, value in curve:
            if not low <= value <= high:
                raise ValueError(f"{what} {value:g} is not in [{low:g}, {high:g}]")
        return curve

    return AfterValidator(check)


def plain_number(value: float) -> str:
    """A number as a person writes it: 1e-6, not 1e-06."""
    return f"{value:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def bounded(low: float, high: float, unit: str = "", hint: str = "") -> AfterValidator:
    """The rule that a number in SI lies between two bounds; its refusal says them, and a hint where there is one."""
    accepted = " ".join(filter(None, [f"accepted: {plain_number(low)} to {plain_number(high)}", unit]))

    def check(value: float) -> float:
        if not low <= value <= high:
            raise ValueError("; ".join(filter(None, [accepted, hint])))
        return value

    return AfterValidator(check)


class Table(BaseModel):
    """A table of the scene file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def filled(self, **values: Any) -> Self:
        """A copy in which the keys that the file leaves out have these values.

        They still count as left out: a scene that is made anew with other values derives them anew.
        """
        copy = self.model_copy()
        for key, value in values.items():
            if key not in self.model_fields_set or getattr(self, key) is None:
                copy.__dict__[key] = value
        return copy
