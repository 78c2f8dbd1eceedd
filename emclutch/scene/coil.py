"""[coil]: the winding, and what drives it: a current, or a voltage behind its resistance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.time_table import CurrentProfile, VoltageProfile
from emclutch.scene.units import Resistance, Temperature, number

if TYPE_CHECKING:
    from field.coil.winding import Winding
    from geometry.time_profile import TimeProfile

_FILL_FACTOR = 0.6


class CoilSection(Section):
    """The winding: its turns are given, or follow from its resistance and the window that it fills.

    Its current is given; or a voltage is, and the current is V/R, or with the effect `coil_circuit` follows
    from resistance and flux linkage. Without `resistance` that is the one of the turns in copper.
    """

    current: CurrentProfile | None = Field(default=None, description="current, one value or a table in time")
    turns: Annotated[float, number("1000", 0.0, 1e7, above=True)] | None = Field(default=None, description="turns")
    resistance: Resistance | None = Field(default=None, description="resistance at 20 degrees C")
    fill_factor: Annotated[float, number("0.6", 0.0, 1.0, above=True)] | None = Field(
        default=None, description="fraction of copper in the window, if turns or resistance follow from it; default 0.6"
    )
    voltage: VoltageProfile | None = Field(
        default=None,
        description="voltage that drives the coil, one value or a table in time; beside a current it is the supply "
        "voltage, against which the current is checked",
    )
    temperature: Temperature = Field(
        default=20.0, description="temperature of the winding; its resistance grows by 0.393 % per degree"
    )

    @model_validator(mode="after")
    def _has_one_drive(self) -> Self:
        if self.current is None and self.voltage is None:
            raise refuse("is missing; give current, e.g. '1 A', or voltage, e.g. '24 V'", key="current")
        if self.current is None or self.voltage is None:
            return self
        if not self.voltage.is_constant:
            raise refuse(
                "is a time profile, which drives the coil, and coil.current is given too; remove coil.current (--set "
                "coil.current=none), or give a constant voltage, that of the supply",
                key="voltage",
            )
        if not self.voltage(0.0) > 0.0:
            raise refuse("of the supply must be above 0 V with coil.current; correct or remove it", key="voltage")
        return self

    @model_validator(mode="after")
    def _has_one_way_to_the_turns(self) -> Self:
        # at a voltage both may be given: a resistance that is not that of the turns alone (a lead, another metal)
        if self.turns is not None and self.resistance is not None and not self.is_at_voltage:
            raise refuse("conflicts with coil.resistance, which gives the turns too; keep one of them", key="turns")
        if self.turns is None and self.resistance is None:
            raise refuse("is missing; give turns, e.g. 1000, or resistance, e.g. '25.5 ohm'", key="turns")
        if self.turns is not None and self.fill_factor is not None and not self._resistance_follows:
            raise refuse(
                "has no meaning with coil.turns; remove it, or give coil.resistance instead of the turns",
                key="fill_factor",
            )
        return self

    @property
    def is_at_voltage(self) -> bool:
        """True if a voltage drives the coil."""
        return self.current is None

    @property
    def _resistance_follows(self) -> bool:
        return self.is_at_voltage and self.resistance is None

    def winding_in(self, window_area: float, mean_radius: float) -> Winding:
        """The winding in a window of area [m^2] at a mean radius [m], at its temperature.

        Where turns and resistance are both given the wire follows from them, and with it the fill factor: at most 1.
        """
        from field.coil.winding import Winding  # local: a scene is read without the field

        fill = _FILL_FACTOR if self.fill_factor is None else self.fill_factor
        turns = self.turns
        if turns is not None and self.resistance is not None:
            fill = min(1.0, Winding(turns, window_area, mean_radius, 1.0).resistance / self.resistance)
        if turns is None:
            assert self.resistance is not None  # by the model's rule
            turns = Winding.of_resistance(self.resistance, window_area, mean_radius, fill).turns
        return Winding(turns, window_area, mean_radius, fill, self.temperature)

    def resistance_in(self, window_area: float, mean_radius: float) -> float:
        """Return the resistance [ohm] at the winding's temperature: the given one, or that of the turns in copper."""
        from field.coil.winding import resistance_ratio

        if self.resistance is not None:
            return self.resistance * resistance_ratio(self.temperature)
        return self.winding_in(window_area, mean_radius).resistance

    def currents_in(self, window_area: float, mean_radius: float) -> TimeProfile:
        """Return the current [A] in time: the given one, or V/R without the circuit's delay."""
        if self.current is not None:
            return self.current
        assert self.voltage is not None  # by the model's rule
        return self.voltage / self.resistance_in(window_area, mean_radius)
