"""An entry that may change in time: one value, or a table {times, values}; either becomes a `TimeProfile`."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import (
    Discriminator,
    Field,
    PlainSerializer,
    Tag,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    create_model,
    model_validator,
)

from emclutch.scene.section import Section, refuse, value_or_table
from emclutch.scene.units import Current, Instant, LoadTorque, Quantity, Speed
from geometry.time_profile import TimeProfile

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


def _profile(given: Any, read: ValidatorFunctionWrapHandler) -> TimeProfile:
    if isinstance(given, TimeProfile):
        return given
    entry = read(given)
    if not isinstance(entry, TimeTable):
        return TimeProfile.constant(entry)
    return TimeProfile.constant(entry.values[0]) if len(entry.times) == 1 else TimeProfile(entry.times, entry.values)


def _entry(profile: TimeProfile) -> float | dict[str, tuple[float, ...]]:
    """A profile as it stands in a scene file."""
    return profile.values[0] if profile.is_constant else {"times": profile.times, "values": profile.values}


if TYPE_CHECKING:
    CurrentProfile = TimeProfile
    VoltageProfile = TimeProfile
    SpeedProfile = TimeProfile
    LoadProfile = TimeProfile
else:

    def _in_time(quantity: Any, name: str, words: str) -> Any:
        """Return the annotation of a quantity that is one value or a table in time; name and words of its model."""
        values = Field(min_length=1, description="value at each instant")
        model = create_model(name, __base__=TimeTable, __doc__=words, values=(tuple[quantity, ...], values))
        return Annotated[
            Annotated[quantity, Tag("value")] | Annotated[model, Tag("table")],
            Discriminator(value_or_table),
            WrapValidator(_profile),
            PlainSerializer(_entry),
        ]

    CurrentProfile = _in_time(Current, "CurrentTable", "Coil current [A] against time [s].")
    VoltageProfile = _in_time(SignedVoltage, "VoltageTable", "Voltage of the coil [V] against time [s].")
    SpeedProfile = _in_time(Speed, "SpeedTable", "Speed of a shaft [rad/s] against time [s].")
    LoadProfile = _in_time(LoadTorque, "LoadTable", "Load torque [N m] against time [s].")
