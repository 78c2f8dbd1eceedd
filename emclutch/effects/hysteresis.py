"""[effects.hysteresis]: steel remembers the currents before (`field.laws.pinning`, `field.section.steel_history`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from emclutch.effects.drive import need_of_a_coil
from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.units import Coercivity

if TYPE_CHECKING:
    from coupling import HysteresisCoilField, PowderFeedback
    from emclutch.device_model.device import CoilDevice
    from emclutch.scene.model import Scene
    from field import AxisymmetricProblem
    from field.section.steel_history import SteelHistory


def _needs_a_given_current(partial: PartialScene) -> Iterator[Fault]:
    """The steel's history is kept in steps of a given current, in a field of a coil."""
    effects = partial.scene.effects
    yield from need_of_a_coil(partial, HysteresisSection)
    for other in (effects.circuit, effects.eddy):
        if effects.memory is not None and other is not None:
            yield Fault(
                "effects.hysteresis",
                "",
                f"cannot be used with [effects.{other.name}], which does not follow the steel's history; remove one of "
                "them",
            )


def _known_steels(partial: PartialScene) -> Iterator[Fault]:
    """Coercivities are of materials that the device has, and each goes with its magnetisation curve."""
    scene = partial.scene
    effect = scene.effects.memory
    if effect is None or "geometry.materials" in partial.of_geometry:
        return
    from emclutch.device_model.materials import pinning_of  # local: it imports the field

    in_use = dict(getattr(scene.geometry, "materials", None) or {}).values()
    for name in effect.coercivity:
        if name not in {*(scene.materials or {}), *in_use}:
            yield partial.fault(
                f"effects.hysteresis.coercivity.{name}",
                f"is for no material of this device; it has {', '.join(sorted({*(scene.materials or {}), *in_use}))}",
            )
    for name in sorted(set(in_use)):
        try:
            pinning_of(scene, name)
        except ValueError as error:
            of_effect = name in effect.coercivity
            key = f"effects.hysteresis.coercivity.{name}" if of_effect else f"materials.{name}.coercivity"
            yield partial.fault(key, str(error))


HYSTERESIS_LOSS = Column("hysteresis_loss", "J", "heat from the hysteresis of the steel", When.SUM)


class HysteresisSection(EffectSection):
    """The steel has hysteresis: its field depends on the currents before."""

    name = "hysteresis"
    summary = "steel remembers earlier currents"
    role = "memory"
    columns = (HYSTERESIS_LOSS,)
    of_the_field_alone = True
    not_in_3d = "the history of the steel is stored only in a section"
    CHECKS: ClassVar = (
        (_needs_a_given_current, ("effects", "field", "coil", "geometry.kind")),
        (_known_steels, ("effects", "geometry.kind", "materials")),
    )

    coercivity: dict[str, Coercivity] = Field(
        default={}, description="coercivity by name of the material, where it is not that of the library"
    )

    def source(self, coil: CoilDevice, feedback: PowderFeedback | None, powder_tolerance: float) -> HysteresisCoilField:
        """Build the field of a coil with a given current in steel that remembers."""
        from coupling import HysteresisCoilField  # local: the schema itself needs no fields

        assert coil.history is not None
        return HysteresisCoilField(
            coil.problem,
            coil.turns,
            coil.currents,
            newton_tolerance=coil.newton_tolerance,
            powder_tolerance=powder_tolerance,
            feedback=feedback,
            history=coil.history,
        )

    @classmethod
    def omitted_effects(cls, at):
        """Yield that the steel leaves no residual field; how large it is follows from a ramp of the field alone."""
        if at.solved and at.M > 0.0:
            note = "in one brake the hysteresis of the steel raised the torque by 2 to 13 % while the current fell"
            note += "; `emclutch field` computes it"
            yield OmittedEffect(cls.name, OFF, "residual field of the steel", note=note)

    def history(self, scene: Scene, problem: AxisymmetricProblem) -> SteelHistory | None:
        """Build the history of demagnetised steel; None where no material of the device has hysteresis."""
        from emclutch.device_model.materials import pinning_of, region_materials
        from field.section.steel_history import SteelHistory

        names = region_materials(scene, problem.mesh)
        return SteelHistory.demagnetised(problem, {region: pinning_of(scene, name) for region, name in names.items()})
