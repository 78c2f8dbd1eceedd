"""[coil]: current and turns."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.time_table import CurrentCourse
from emclutch.units import Resistance, Voltage, number

COPPER_RESISTIVITY = 1.72e-8
"""Resistivity of annealed copper at 20 degrees C [ohm m] (IEC 60028)."""


class Coil(Section):
    """The winding: its turns are given, or follow from its resistance and the window that it fills."""

    current: CurrentCourse = Field(description="current, one value or a table in time")
    turns: Annotated[float, number("1000", 0.0, 1e7, above=True)] | None = Field(default=None, description="turns")
    resistance: Resistance | None = Field(default=None, description="resistance at 20 degrees C")
    fill_factor: Annotated[float, number("0.6", 0.0, 1.0, above=True)] | None = Field(
        default=None, description="copper's share of the window, with resistance; default 0.6"
    )
    voltage: Voltage | None = Field(default=None, description="supply, to check the current against")

    @model_validator(mode="after")
    def _has_one_way_to_the_turns(self) -> Self:
        if self.turns is not None and self.resistance is not None:
            raise refuse("stands beside coil.resistance, which gives the turns too; keep one of them", key="turns")
        if self.turns is None and self.resistance is None:
            raise refuse("is missing; give turns, e.g. 1000, or resistance, e.g. '25.5 ohm'", key="turns")
        if self.turns is not None and self.fill_factor is not None:
            raise refuse(
                "has no meaning beside coil.turns; remove it, or give coil.resistance instead of the turns",
                key="fill_factor",
            )
        return self

    def turns_in(self, window_area: float, mean_radius: float) -> float:
        """Return the number of turns [-] in a window of area [m^2] at a mean radius [m].

        A wire of length l = N 2 pi r and section a = fill A / N has R = rho l / a, so that
        N^2 = R fill A / (rho 2 pi r), valid for a layer winding whose turns share the mean radius.
        """
        if self.turns is not None:
            return self.turns
        assert self.resistance is not None  # by the model's rule
        fill = 0.6 if self.fill_factor is None else self.fill_factor
        return math.sqrt(self.resistance * fill * window_area / (COPPER_RESISTIVITY * 2.0 * math.pi * mean_radius))
