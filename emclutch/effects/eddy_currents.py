"""[effects.eddy_currents]: eddy currents in solid conductors delay the field (`coupling.EddyCoilField`)."""

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
from emclutch.scene.units import Quantity, number

if TYPE_CHECKING:
    from coupling import EddyCoilField, PowderFeedback
    from emclutch.device_model.device import CoilDevice
    from emclutch.device_model.excitation import Supply

_Conductivity = Annotated[float, Quantity("a conductivity", "S/m", "5 MS/m", 0.0, 1e9)]


def _known_conductors(partial: PartialScene) -> Iterator[Fault]:
    """Eddy currents need a coil's field, and conductivities of materials that the device has."""
    yield from need_of_a_coil(partial, EddyCurrentsSection)
    eddy = partial.scene.effects.eddy
    if eddy is None or "geometry.materials" in partial.of_geometry:
        return
    in_use = dict(getattr(partial.scene.geometry, "materials", None) or {}).values()
    known = {*(partial.scene.materials or {}), *in_use}
    for name in eddy.conductivity:
        if name not in known:
            yield partial.fault(
                f"effects.eddy_currents.conductivity.{name}",
                f"is for no material of this device; it has {', '.join(sorted(known))}",
            )


EDDY_LOSS = Column("eddy_loss", "J", "part of coil_supplied that eddy currents turn into heat", When.SUM)


class EddyCurrentsSection(EffectSection):
    """Eddy currents in the solid parts delay the field."""

    name = "eddy_currents"
    summary = "solid conductors delay the field"
    role = "eddy"
    columns = (EDDY_LOSS, *ENERGY_COLUMNS)
    of_the_field_alone = True
    window_solves = 0.6  # a solve in 0.35 of the windows, 1.8 times as long as a static one (cases/switch_on.toml)
    not_in_3d = "they need a vector potential, and the field in 3D has a scalar potential"
    CHECKS: ClassVar = ((_known_conductors, ("effects", "coil", "field", "geometry.kind", "materials")),)

    begin: Annotated[str, Choice(BEGINNING)] = Field(
        default="off", description="off: without a field; steady: with the static field of the drive at t = 0"
    )
    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02,
        description="change of field and current, relative to their largest, in one step of the field; a step whose "
        "local error is larger is divided",
    )
    conductivity: dict[str, _Conductivity] = Field(
        default={}, description="conductivity by name of the material, where it is not that of the library"
    )

    def source(
        self, coil: CoilDevice, supply: Supply | None, feedback: PowderFeedback | None, powder_tolerance: float
    ) -> EddyCoilField:
        """Build the coil's field with eddy currents, at the voltage of a supply or, without one, at its current."""
        from coupling import EddyCoilField  # local: the schema itself needs no fields
        from field.section.eddy_currents import EddyCurrentProblem

        return EddyCoilField(
            coil.problem,
            coil.turns,
            EddyCurrentProblem(coil.problem, coil.conductivity or {}, turns=coil.turns),
            coil.currents if supply is None else supply.voltage,
            None if supply is None else supply.resistance,
            newton_tolerance=coil.newton_tolerance,
            begin_steady=self.begin == "steady",
            change_tolerance=self.tolerance,
            largest_current=coil.largest_current,
            feedback=feedback,
            powder_tolerance=powder_tolerance,
        )

    @classmethod
    def omitted_effects(cls, at):
        """Yield the diffusion time of the steel over the time of switching."""
        yield from switching_omitted(at, cls.name, "diffusion time of the steel", at.diffusion_time)
