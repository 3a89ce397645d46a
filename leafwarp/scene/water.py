"""Tables of the water: how it flows, enters and leaves."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from leafwarp.quantity import ZEROS
from leafwarp.scene.fields import (
    Bounds,
    Conductance,
    Diffusivity,
    Fraction,
    Integer,
    Number,
    Pressure,
    Rate,
    Share,
    Table,
    Temperature,
    Time,
    curve_within,
)


class FluidTable(Table):
    """Water that flows (paper, Sec. III-A)."""

    step: Annotated[Time, Bounds(0.0, unit="s", above=True)] = Field(
        60.0, description="Fluid step in plant time [s]; chosen for accuracy."
    )
    scheme: Literal["split", "unsplit"] = Field(
        "split",
        description="split: rows, then columns, line by line (the paper). unsplit: both at once, without the "
        "splitting error.",
    )
    order: Annotated[Integer, Bounds(1, 2)] = Field(
        1,
        description="2: every step is also taken in two halves, and its error of first order extrapolated away. Costs "
        "three steps; pays where the step's own error is what counts.",
    )
    step_tolerance: Annotated[Number, Bounds(1e-7, 1.0, above=True)] | None = Field(
        None,
        description="Error that a fluid step, or a straight line between its ends, may have, relative to the water, as "
        "its two halves tell; what solvers and rounding leave (unsplit in float32: 2e-5) is not counted. 'step' is "
        "then the longest one: steps are halved where the water changes faster than that allows, and doubled again "
        "where it does not. Needs order = 2. Default: all steps alike.",
    )
    solver: Literal["factor", "conjugate_gradients"] | None = Field(
        None,
        description="How the unsplit scheme solves a step. conjugate_gradients: preconditioned with multigrid, all on "
        "the device. factor: a sparse factor, made once, on the host. Default: factor in float64, whose tolerance "
        "takes more iterations, and for many leaves; else conjugate_gradients, and factor from a step on that they do "
        "not solve (up to a million cells).",
    )
    lamina_diffusivity: Annotated[Diffusivity, Bounds(0.0, unit="m2/s")] = Field(
        1e-9, description="Diffusivity of water between the veins [m^2/s] (artistic)."
    )
    vein_diffusivity: Annotated[Diffusivity, Bounds(0.0, unit="m2/s")] = Field(
        1e-7, description="Diffusivity of water along a vein of capacity 1 [m^2/s] (artistic)."
    )
    tolerance: Number = Field(
        1e-5,
        gt=0.0,
        lt=1.0,
        description="Error of an unsplit step that is accepted, relative to the contents (float64: its square).",
    )

    @model_validator(mode="after")
    def _error_is_known(self) -> FluidTable:
        if self.step_tolerance is not None and self.order != 2:
            raise ValueError(
                f"step_tolerance = {self.step_tolerance:g} needs order = 2, which tells the error of a step; order is "
                f"{self.order}"
            )
        return self


class WaterTable(Table):
    """Water that is prescribed: the same everywhere, a function of plant time. Excludes [fluid]."""

    curve: Annotated[tuple[tuple[Time, Share], ...], Field(min_length=1, max_length=64)] = Field(
        description="Points [plant time, relative water content], linear in between."
    )

    @model_validator(mode="after")
    def _rising_times(self) -> WaterTable:
        times = [t for t, _ in self.curve]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("the times of 'curve' must rise")
        return self


# Opening of the stomata, 1 open and 0 closed.
Closure = curve_within(0.0, 1.0)


class TranspirationTable(Table):
    """Water lost through the leaf's surface, as plain rates. [air] and [stomata] say the same in physical units."""

    rate: Annotated[Rate, Bounds(0.0, unit="1/s")] = Field(
        description="Share of the saturated leaf's water lost a second, averaged over the leaf [1/s]."
    )
    cuticle_rate: Annotated[Rate, Bounds(0.0, unit="1/s")] = Field(
        0.0, description="The part of it that leaves everywhere alike, stomata or not [1/s]."
    )

    closure: Closure | None = Field(
        None,
        description="Points [relative water content, opening of the stomata]: the rate less its cuticular part follows "
        "it; default: always open, or that of [stomata].",
    )

    @model_validator(mode="after")
    def _cuticle_is_a_part(self) -> TranspirationTable:
        if self.cuticle_rate > self.rate:
            raise ValueError(
                f"cuticle_rate {self.cuticle_rate:g} is more than rate {self.rate:g}, of which it is a part"
            )
        return self

    @property
    def stomata_close(self) -> bool:
        """Whether the loss through stomata depends on the water."""
        is_open = self.closure is None or all(opening == 1.0 for _, opening in self.closure)
        return self.rate > self.cuticle_rate and not is_open


class SourceTable(Table):
    """Water that enters through the petiole."""

    conductance: Annotated[Rate, Bounds(0.0, unit="1/s")] = Field(
        description="Share of the saturated leaf's water that enters a second for a difference of 1 [1/s] (artistic)."
    )
    supply: Share = Field(
        1.0, description="Relative water content of the supply; a leaf wetter than it gives water back."
    )
    cut_at: Annotated[Time, Bounds(0.0, unit="s")] | None = Field(
        None, description="Plant time at which the leaf is severed and the source ends [s]."
    )
    rewatered_at: Annotated[Time, Bounds(0.0, unit="s")] | None = Field(
        None, description="Plant time at which the source opens again after cut_at [s]."
    )

    @model_validator(mode="after")
    def _cut_before_rewatered(self) -> SourceTable:
        if self.rewatered_at is not None and (self.cut_at is None or self.rewatered_at <= self.cut_at):
            cut = "no cut_at is given" if self.cut_at is None else f"cut_at is {self.cut_at:g} s"
            raise ValueError(f"rewatered_at = {self.rewatered_at:g} s: {cut}; accepted: a time after cut_at")
        return self


STANDARD_PRESSURE = 101325.0  # [Pa]
BOILING = ZEROS["degC"] + 100.0  # [K]


def saturation_pressure(temperature: float) -> float:
    """Pressure of saturated water vapour over water [Pa] (Buck 1981, with his coefficients of 1996).

    Args:
        temperature: [K].
    """
    celsius = temperature - ZEROS["degC"]
    return 611.21 * math.exp((18.678 - celsius / 234.5) * celsius / (257.14 + celsius))


class AirTable(Table):
    """The air around the leaf."""

    temperature: Annotated[
        Temperature,
        Bounds(ZEROS["degC"] - 40.0, BOILING, "K", "a plain number is in kelvin, a string may say degC: '24.5 degC'"),
    ] = Field(
        298.15,
        description="Temperature of leaf and air [K]; a string may say degC. It makes a deficit of the relative "
        "humidity; a vapour_pressure_deficit only has to be possible at it.",
    )
    relative_humidity: Annotated[Fraction, Bounds(0.0, 1.0, "", "a string may say %: '65 %'")] | None = Field(
        None, description="Relative humidity of the air, 0 to 1; a string may say %."
    )
    vapour_pressure_deficit: Annotated[Pressure, Bounds(0.0, 1e5, "Pa")] | None = Field(
        None, description="Vapour pressure deficit of the air [Pa], instead of relative_humidity."
    )
    pressure: Annotated[Pressure, Bounds(1e3, 1e6, "Pa")] = Field(
        STANDARD_PRESSURE, description="Pressure of the air [Pa]."
    )

    @model_validator(mode="after")
    def _one_dryness(self) -> AirTable:
        if (self.relative_humidity is None) == (self.vapour_pressure_deficit is None):
            raise ValueError("give either 'relative_humidity' or 'vapour_pressure_deficit'")
        return self

    @model_validator(mode="after")
    def _humidity_is_possible(self) -> AirTable:
        saturated = saturation_pressure(self.temperature)
        if "temperature" in self.model_fields_set and self.deficit > saturated:
            raise ValueError(
                f"vapour_pressure_deficit = {self.deficit:g} Pa: accepted at a temperature of {self.temperature:g} K: "
                f"0 to {saturated:.4g} Pa, where the air is dry"
            )
        if self.deficit >= self.pressure:
            raise ValueError(
                f"pressure = {self.pressure:g} Pa: water boils at a vapour pressure deficit of {self.deficit:.4g} Pa; "
                "accepted: a pressure above that"
            )
        return self

    @property
    def deficit(self) -> float:
        """Vapour pressure deficit [Pa]: what the air lacks to be saturated at its temperature."""
        if self.vapour_pressure_deficit is not None:
            return self.vapour_pressure_deficit
        return (1.0 - self.relative_humidity) * saturation_pressure(self.temperature)


_LeafConductance = Annotated[Conductance, Bounds(0.0, 100.0, "mol/m2/s")]


class StomataTable(Table):
    """What the leaf's surface lets through, in physical units. Needs [air]."""

    open_conductance: _LeafConductance = Field(
        description="Conductance of the leaf to water vapour with open stomata, cuticle included, averaged over the "
        "leaf [mol/m2/s]."
    )
    minimum_conductance: _LeafConductance = Field(
        5.1e-3,
        description="Conductance with closed stomata, everywhere alike [mol/m2/s]; default: the median of 247 species.",
    )
    closure: Closure | None = Field(
        None,
        description="Points [relative water content, opening of the stomata]; default: proportional to the turgor of "
        "[material], so closed from the turgor loss point on.",
    )

    @model_validator(mode="after")
    def _minimum_is_less(self) -> StomataTable:
        if self.minimum_conductance > self.open_conductance:
            raise ValueError(
                f"minimum_conductance {self.minimum_conductance:g} is more than open_conductance "
                f"{self.open_conductance:g}, of which it is a part; accepted: 0 to open_conductance"
            )
        return self
