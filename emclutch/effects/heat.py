"""[effects.heat]: slip power and copper loss warm the section (`field.heat`), through hours of duty (`emclutch heat`).

Grains move in milliseconds and steel warms in hours, so that a run of the grains does not feel the effect. The torque
is that of the law of the powder at each current and temperature; `torque`, `torque_curve` and `fade` are measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Self

from pydantic import Field, StrictBool, model_validator

from emclutch.device_model.coil_heat import CONVECTION, EMISSIVITY, HOTTEST
from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Section, refuse
from emclutch.scene.time_table import CurrentProfile, SpeedProfile
from emclutch.scene.units import Current, LoadTorque, Power, Quantity, Temperature, Time, format_number, number

MAX_RISE = 100.0
"""Rise of the temperature [K] above which the effect is significant."""
_Film = Annotated[float, Quantity("a heat transfer coefficient", "W/(m^2*K)", "6 W/(m^2 K)", 0.0, 1e5)]
_Conductance = Annotated[float, Quantity("a thermal conductance", "W/K", "0.5 W/K", 0.0, 1e4)]
_Conductivity = Annotated[
    float, Quantity("a thermal conductivity", "W/(m*K)", "50 W/(m K)", 0.0, 5e3, open_minimum=True, least=1e-6)
]
_Capacity = Annotated[
    float, Quantity("a heat capacity", "J/(m^3*K)", "3.5e6 J/(m^3 K)", 0.0, 1e8, open_minimum=True, least=1e-3)
]
_BodyCapacity = Annotated[float, Quantity("a heat capacity of a body", "J/K", "200 J/K", 0.0, 1e8)]
_Limit = Annotated[float, Quantity("a temperature", "degC", "300 degC", -100.0, 1000.0)]
_Resistance = Annotated[float, Quantity("a thermal resistance", "m^2*K/W", "1e-4 m^2 K/W", 0.0, 10.0)]


def _increases(values: tuple[float, ...]) -> bool:
    return all(later > earlier for earlier, later in pairwise(values))


class FadeSection(Section):
    """The measured torque at temperatures of the powder over its own at the first one, at a given current.

    Linear between, constant outside. It replaces the change by the law of the powder, which leaves out friction's.
    """

    temperatures: tuple[Temperature, ...] = Field(min_length=1, description="increasing")
    factors: tuple[Annotated[float, number("0.9", 0.0, 10.0)], ...] = Field(
        min_length=1, description="one for each, the first 1"
    )

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if len(self.temperatures) != len(self.factors):
            raise refuse(f"has {len(self.temperatures)} temperatures and {len(self.factors)} factors; give as many")
        if not _increases(self.temperatures):
            raise refuse("must increase from each to the next", key="temperatures")
        first = self.factors[0]
        if not math.isclose(first, 1.0):
            raise refuse(
                f"must begin with 1, as they are relative to the torque at the first temperature, of "
                f"{self.temperatures[0]:g} degrees C; begin with the temperature at which the torque is known"
                + (f", and divide all by {first:g}" if first > 0.0 else ""),
                key="factors",
            )
        return self


class TorqueCurveSection(Section):
    """Measured torque against the coil's current; linear between, constant outside, the same at every temperature."""

    currents: tuple[Current, ...] = Field(min_length=2, description="increasing, >= 0")
    torques: tuple[LoadTorque, ...] = Field(min_length=2, description="one for each")

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if len(self.currents) != len(self.torques):
            raise refuse(f"has {len(self.currents)} currents and {len(self.torques)} torques; give as many")
        if not _increases(self.currents) or self.currents[0] < 0.0:
            raise refuse("must increase from each to the next, from 0 A or more", key="currents")
        return self


class DutySection(Section):
    """What the device does for hours: on all the time, or on and off in periods."""

    end: Time = Field(default=14400.0, description="time that is computed, from the ambient temperature on")
    period: Time | None = Field(
        default=None, description="time after which the duty repeats; default: never", examples=["10 min"]
    )
    on: Time | None = Field(
        default=None, description="time at the start of each period in which the coil is on", examples=["4 min"]
    )
    current: CurrentProfile | None = Field(
        default=None, description="coil current while it is on, in a period; default: the largest of [coil]"
    )
    slip: SpeedProfile | None = Field(
        default=None,
        description="slip speed in a period; default: the largest of [motion]; the bodies that turn in [motion] turn "
        "with it and are cooled accordingly, at a slip that varies as at their slowest speeds",
    )

    @model_validator(mode="after")
    def _fits_into_the_period(self) -> Self:
        if self.on is not None and self.period is None:
            raise refuse("needs a period; give it too, e.g. '60 s'", key="on")
        if self.period is None:
            return self
        if self.on is not None and self.on > self.period:
            raise refuse(f"is longer than the period of {self.period:g} s; lower it", key="on")
        for key, profile in (("current", self.current), ("slip", self.slip)):
            if profile is not None and profile.times[-1] > self.period:
                raise refuse(
                    f"goes on to {profile.times[-1]:g} s, beyond the period of {self.period:g} s, at whose end it "
                    "begins again; raise the period, or end the table with it",
                    key=key,
                )
        return self


def _has_its_device(partial: PartialScene) -> Iterator[Fault]:
    """Heat is conducted in the section of a device whose outside and whose clearances are known."""
    scene = partial.scene
    if scene.effects.thermal is None:
        return
    if scene.geometry.clearances(scene.shape()) is None:
        message = f"cannot be used with geometry.kind = '{scene.geometry.kind}', whose outside and clearances are not "
        yield Fault("effects.heat", "", message + "known; take 'clutch' or 'drum', or remove the effect's table")
    elif scene.geometry.is_solved_in_3d:
        message = f"cannot be used with geometry.{scene.geometry.key_of_3d}: heat is conducted in a section"
        yield Fault("effects.heat", "", f"{message}; remove one of them")
    if scene.coil is None:
        message = "needs [coil], whose copper loss it takes; add it, or remove the effect's table"
        yield Fault("effects.heat", "", message)


def _knows_its_materials(partial: PartialScene) -> Iterator[Fault]:
    """Conductivity and heat capacity are those of a material of the device; the user's own ones have both given."""
    from field.laws.materials import canonical_name  # local: only here

    scene = partial.scene
    effect = scene.effects.thermal
    if effect is None or "geometry.materials" in partial.of_geometry:
        return
    in_use = {*dict(getattr(scene.geometry, "materials", None) or {}).values()}
    for key, given in (("conductivity", effect.conductivity), ("heat_capacity", effect.heat_capacity)):
        for name in given:
            if name not in in_use:
                yield partial.fault(
                    f"effects.heat.{key}.{name}",
                    f"is for no material of this device; it has {', '.join(sorted(in_use))}",
                )
        for name in sorted(in_use):
            if canonical_name(name) is None and name not in given and name in (scene.materials or {}):
                yield Fault(
                    f"effects.heat.{key}.{name}", "", f"is missing: [materials.{name}] is none of the library; give it"
                )


def _knows_its_torque(partial: PartialScene) -> Iterator[Fault]:
    """The torque at another current than the coil's largest is that of the law of the powder, or of a curve."""
    effect, coil = partial.scene.effects.thermal, partial.scene.coil
    of_all_currents = effect is not None and (effect.torque_curve is not None or effect.slip_power is not None)
    if effect is None or coil is None or of_all_currents or not partial.is_of_the_field_alone:
        return
    if coil.is_at_voltage:
        yield Fault(
            "effects.heat.torque_curve",
            "",
            "is missing: at a given voltage the current falls as the coil warms; give [particles] for the law of the "
            "powder, the measured torque against the current, or coil.current instead of the voltage alone",
        )
    duty, of_scene = effect.duty.current, coil.current
    if duty is not None and (
        not duty.is_constant or (of_scene is not None and not math.isclose(duty.largest, of_scene.largest))
    ):
        largest = "" if of_scene is None else f" of {of_scene.largest:g} A"
        yield partial.fault(
            "effects.heat.duty.current",
            f"changes the torque from that at the coil's largest current{largest}; give [particles] for the law of the "
            "powder, or effects.heat.torque_curve, or take that current all the time",
        )


def _duty_has_one_drive(partial: PartialScene) -> Iterator[Fault]:
    effect, coil = partial.scene.effects.thermal, partial.scene.coil
    if effect is None or coil is None:
        return
    if effect.duty.current is not None and coil.is_at_voltage:
        yield partial.fault(
            "effects.heat.duty.current",
            "conflicts with coil.voltage, from which the current follows; remove one of them",
        )
    if effect.torque is not None and effect.torque_curve is not None:
        yield partial.fault("effects.heat.torque", "conflicts with torque_curve; keep one of them")


class HeatSection(EffectSection):
    """Slip power in the powder and copper loss warm the solid parts, which air, radiation and the shaft cool."""

    name = "heat"
    summary = "slip power and copper loss warm the device in hours of duty (emclutch heat)"
    role = "thermal"
    of_the_field_alone = True
    acts_on_grains = False
    CHECKS: ClassVar = (
        (_has_its_device, ("effects", "geometry.kind", "geometry", "coil")),
        (_knows_its_materials, ("effects", "geometry.kind", "materials")),
        (_knows_its_torque, ("effects", "coil")),
        (_duty_has_one_drive, ("effects", "coil")),
    )

    ambient: Temperature = Field(default=20.0, description="temperature of air, shaft and surroundings")
    convection: _Film = Field(
        default=CONVECTION, description="heat transfer coefficient of the outside in still air; a fan: 20 to 60"
    )
    self_cooling: StrictBool = Field(
        default=True, description="the faces of what turns are cooled as discs that turn in still air as well"
    )
    emissivity: Annotated[float, number("0.9", 0.0, 1.0)] = Field(
        default=EMISSIVITY, description="of the outside: paint 0.9, oxidised steel 0.7, bare metal 0.1 to 0.3"
    )
    shaft_conductance: _Conductance = Field(
        default=0.0, description="of the shaft from the ends of its stubs to the surroundings, both together"
    )
    shaft_heat_capacity: _BodyCapacity = Field(
        default=0.0, description="of the shaft beyond its stubs, shared by both, in the middle of shaft_conductance"
    )
    powder_conductivity: _Conductivity | None = Field(
        default=None, description="of the powder; default: of a packing of its solid fraction at rest in air"
    )
    contact_resistance: _Resistance = Field(default=0.0, description="between the powder and each of its two walls")
    coil_conductivity: _Conductivity | None = Field(
        default=None, description="of the winding across its wires; default: of its fill factor in varnish"
    )
    conductivity: dict[str, _Conductivity] = Field(
        default={}, description="thermal, by name of the material, where it is not that of the library"
    )
    heat_capacity: dict[str, _Capacity] = Field(
        default={}, description="of a volume, by name of the material, where it is not that of the library"
    )
    torque: LoadTorque | None = Field(
        default=None,
        description="measured at the largest current of [coil], to which the law of the powder is scaled; default: the "
        "law's own, or that of a run (emclutch heat --run)",
    )
    torque_curve: TorqueCurveSection | None = Field(
        default=None, description="measured torque against current, instead of the law; scaled to a run's"
    )
    slip_power: Power | None = Field(
        default=None,
        description="given slip power while the coil is on, at the largest slip of the duty; the current follows from "
        "the torque against current, unless duty.current is given (emclutch heat --slip-power)",
        examples=["200 W"],
    )
    fade: FadeSection | None = Field(
        default=None, description="measured change with the powder's temperature, instead of the law's"
    )
    duty: DutySection = DutySection()
    surface_limit: _Limit = Field(default=75.0, description="largest temperature of the outside; no limit: '1000 degC'")
    coil_limit: Temperature = Field(
        default=130.0, description="of the winding's hottest place: 105, 130, 155 in classes A, B, F (IEC 60085)"
    )
    powder_limit: _Limit | None = Field(
        default=None, description="of the powder's hottest place; default: no limit", examples=["300 degC"]
    )
    tolerance: Annotated[float, number("0.1", 1e-6, 10.0)] = Field(
        default=0.1, description="error of a step in time [K]"
    )

    @model_validator(mode="after")
    def _limits_lie_above_the_room(self) -> Self:
        for key in ("surface_limit", "coil_limit", "powder_limit"):
            if (limit := getattr(self, key)) is not None and limit <= self.ambient:
                raise refuse(f"is not above the ambient temperature of {self.ambient:g} degrees C; raise it", key=key)
        return self

    @model_validator(mode="after")
    def _is_cooled(self) -> Self:
        if self.convection == self.emissivity == self.shaft_conductance == 0.0:
            raise refuse(
                "is 0, as emissivity and shaft_conductance are: nothing cools a body at rest; raise one of the three",
                key="convection",
            )
        return self

    @model_validator(mode="after")
    def _shaft_takes_heat(self) -> Self:
        if self.shaft_heat_capacity > 0.0 and self.shaft_conductance == 0.0:
            raise refuse("needs shaft_conductance above 0 W/K, by which it is heated", key="shaft_heat_capacity")
        return self

    @classmethod
    def omitted_effects(cls, at):
        """Yield the kelvins that slip makes in the powder alone, and those of the housing by slip and copper loss."""
        copper, steady = f"{format_number(at.copper_loss)} W of copper loss", ""
        if at.housing_rise is not None and at.housing_rise > MAX_RISE:
            part = f"housing would be {format_number(at.housing_rise)} K above the room"
            if at.housing_rise == math.inf:
                part = f"winding would exceed {HOTTEST:g} °C"
            steady = f"In continuous operation the {part}. How long it may last: emclutch heat"
        if at.slip_power is None:
            note = copper if at.copper_loss > 0.0 else ""
            number = "slip power, which follows from no expected torque"
            yield OmittedEffect(cls.name, OFF, number, note=note, in_operation=steady)
            return
        note = f"at most {format_number(at.slip_power)} W of slip, {format_number(at.heating)} K/s in the powder alone"
        note += f", and {copper}" if at.copper_loss > 0.0 else ""
        kelvin = at.heating * at.end
        yield OmittedEffect(cls.name, OFF, "warming in this run [K]", kelvin, MAX_RISE, note=note, in_operation=steady)
