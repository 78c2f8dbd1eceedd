"""[effects.coil_circuit]: a voltage drives the coil, V = R i + d lambda/dt (`coupling.CircuitCoilField`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from emclutch.effects.drive import BEGINNING, ENERGY_COLUMNS, need_of_a_coil, switching_omitted
from emclutch.effects.effect import EffectSection
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Choice
from emclutch.scene.units import number

if TYPE_CHECKING:
    from coupling import CircuitCoilField, PowderFeedback
    from emclutch.device_model.device import CoilDevice
    from emclutch.device_model.device_3d import CoilDevice3D
    from emclutch.device_model.excitation import Supply
    from particles import Body


def _has_a_voltage(partial: PartialScene) -> Iterator[Fault]:
    """A circuit needs a coil with a voltage, and computes the current."""
    coil = partial.scene.coil
    yield from need_of_a_coil(partial, CoilCircuitSection)
    circuit, eddy = partial.scene.effects.circuit, partial.scene.effects.eddy
    if circuit is None or coil is None:
        return
    if eddy is not None and circuit.begin != eddy.begin:
        yield partial.fault(
            "effects.coil_circuit.begin",
            f"differs from effects.eddy_currents.begin = '{eddy.begin}': current and field begin together; give both "
            "the same",
        )
    if coil.current is not None and coil.voltage is not None:
        yield partial.fault(
            "coil.current",
            "conflicts with coil.voltage: [effects.coil_circuit] computes it; remove it, or the effect's table",
        )
    elif coil.voltage is None:
        yield Fault(
            "coil.voltage",
            "",
            "is missing: [effects.coil_circuit] computes the current from it; give coil.voltage, e.g. '24 V', "
            "instead of coil.current, or remove the effect's table",
        )


COIL_VOLTAGE = Column("coil_voltage", "V", "voltage at the terminals of the coil", When.END)
INTO_FIELD = Column(
    "into_field",
    "J",
    "part of coil_supplied that goes into the field, the integral of current times d(flux linkage)",
    When.SUM,
)


class CoilCircuitSection(EffectSection):
    """The coil's voltage drives its current through resistance and flux linkage, V = R i + d lambda/dt."""

    name = "coil_circuit"
    summary = "resistance and inductance delay the current"
    role = "circuit"
    columns = (COIL_VOLTAGE, INTO_FIELD, *ENERGY_COLUMNS)
    of_the_field_alone = True
    CHECKS: ClassVar = ((_has_a_voltage, ("effects", "coil", "field", "geometry.kind", "materials")),)

    begin: Annotated[str, Choice(BEGINNING)] = Field(
        default="off",
        description="off: without current, the voltage is switched on at t = 0; steady: with the current V/R",
    )
    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02,
        description="change of the current, relative to the largest V/R, that triggers a new solve; between solves the "
        "flux linkage follows a line; a step in which the line misses the current by more is divided; with eddy "
        "currents their tolerance counts instead",
    )

    def source(
        self,
        coil: CoilDevice | CoilDevice3D,
        supply: Supply,
        feedback: PowderFeedback | None,
        powder_tolerance: float,
        carrier: Body | None = None,
    ) -> CircuitCoilField:
        """Build the coil's field with the current of its circuit; `carrier` is the slotted body of a field in 3D."""
        from coupling import CircuitCoilField  # local: the schema itself needs no fields

        return CircuitCoilField(
            coil.problem,
            coil.turns,
            supply.voltage,
            supply.resistance,
            newton_tolerance=coil.newton_tolerance,
            current_tolerance=self.tolerance,
            begin_steady=self.begin == "steady",
            largest_current=coil.largest_current,
            feedback=feedback,
            powder_tolerance=powder_tolerance,
            carrier=carrier,
        )

    @classmethod
    def omitted_effects(cls, at):
        """Yield the time constant of the coil over the time of switching."""
        yield from switching_omitted(at, cls.name, "time constant L/R of the coil", at.coil_time)
