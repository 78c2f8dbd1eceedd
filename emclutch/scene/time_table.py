"""An entry that may change in time: one value, or a table {times, values}, linear between points."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.units import Current, Instant, Quantity, Speed

# of either sign, and nothing: a table switches off and reverses
SignedVoltage = Annotated[float, Quantity("a voltage", "V", "24 V", -1e6, 1e6)]


class TimeTable(Section):
    """Points of a piecewise linear time profile; its first and last value are held before and after."""

    times: tuple[Instant, ...] = Field(min_length=1, description="increasing instants")
    values: tuple[float, ...] = Field(min_length=1, description="value at each instant")

    @model_validator(mode="after")
    def _is_a_function_of_time(self) -> Self:
        if len(self.times) != len(self.values):
            raise refuse(
                f"has {len(self.times)} times and {len(self.values)} values; give as many of one as of the other"
            )
        if any(later <= earlier for earlier, later in pairwise(self.times)):
            raise refuse("must increase from each instant to the next; sort it and remove duplicates", key="times")
        return self


class CurrentTable(TimeTable):
    """Coil current [A] against time [s]."""

    values: tuple[Current, ...] = Field(min_length=1, description="current at each instant")


class VoltageTable(TimeTable):
    """Voltage of the coil [V] against time [s]."""

    values: tuple[SignedVoltage, ...] = Field(min_length=1, description="voltage at each instant")


class SpeedTable(TimeTable):
    """Speed of a shaft [rad/s] against time [s]."""

    values: tuple[Speed, ...] = Field(min_length=1, description="speed at each instant")


def _value_or_table(given: Any) -> str:
    return "table" if isinstance(given, (dict, BaseModel)) else "value"


CurrentProfile = Annotated[
    Annotated[Current, Tag("value")] | Annotated[CurrentTable, Tag("table")], Discriminator(_value_or_table)
]
VoltageProfile = Annotated[
    Annotated[SignedVoltage, Tag("value")] | Annotated[VoltageTable, Tag("table")], Discriminator(_value_or_table)
]
SpeedProfile = Annotated[
    Annotated[Speed, Tag("value")] | Annotated[SpeedTable, Tag("table")], Discriminator(_value_or_table)
]


def points_of(profile: float | TimeTable) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the times [s] and the values [SI] of a time profile; a constant is one point at 0 s."""
    if isinstance(profile, TimeTable):
        return profile.times, profile.values
    return (0.0,), (profile,)


def largest(profile: float | TimeTable) -> float:
    """Return the largest magnitude that a time profile reaches."""
    return max(abs(value) for value in points_of(profile)[1])
