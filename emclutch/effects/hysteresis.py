"""[effects.hysteresis]: steel remembers the currents before (`field.laws.pinning`, `field.section.steel_history`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from emclutch.effects.effect import EffectSection
from emclutch.effects.left_out import ABSENT, LeftOut
from emclutch.scene.draft import Draft
from emclutch.scene.errors import Fault
from emclutch.scene.units import Coercivity

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from field import AxisymmetricProblem
    from field.section.steel_history import SteelHistory


def _of_the_field_alone(draft: Draft) -> Iterator[Fault]:
    """A run does not carry the steel's history from window to window, and no grain is moved by a field that has one."""
    if draft.scene.effects.memory is not None and not draft.is_of_the_field_alone:
        yield Fault(
            "effects.hysteresis",
            "",
            "is available for the field alone (`emclutch field`), without grains: a run does not carry the steel's "
            "history, nor do [effects.coil_circuit] and [effects.eddy_currents]; remove [particles] with the tables of "
            "all other effects, or the effect's table",
        )


def _known_steels(draft: Draft) -> Iterator[Fault]:
    """Coercivities are of materials that the device has, and each goes with its magnetisation curve."""
    scene = draft.scene
    effect = scene.effects.memory
    if effect is None or "geometry.materials" in draft.of_geometry:
        return
    from emclutch.device_model.materials import coercivity_of, magnetic_law  # local: they import the field
    from field.laws.pinning import Pinning

    in_use = dict(getattr(scene.geometry, "materials", None) or {}).values()
    for name in effect.coercivity:
        if name not in {*(scene.materials or {}), *in_use}:
            yield draft.fault(
                f"effects.hysteresis.coercivity.{name}",
                f"is for no material of this device; it has {', '.join(sorted({*(scene.materials or {}), *in_use}))}",
            )
    for name in sorted(set(in_use)):
        try:
            Pinning.of(magnetic_law(scene, name), coercivity_of(scene, name))
        except ValueError as error:
            of_effect = name in effect.coercivity
            key = f"effects.hysteresis.coercivity.{name}" if of_effect else f"materials.{name}.coercivity"
            yield draft.fault(key, str(error))


class HysteresisSection(EffectSection):
    """The steel has hysteresis: its field depends on the currents before."""

    name = "hysteresis"
    summary = "steel remembers earlier currents"
    role = "memory"
    of_the_field_alone = True
    not_in_3d = "the history of the steel is kept in a section only"
    CHECKS: ClassVar = (
        (_of_the_field_alone, ("effects",)),
        (_known_steels, ("effects", "geometry.kind", "materials")),
    )

    coercivity: dict[str, Coercivity] = Field(
        default={}, description="coercivity by name of the material, where it is not that of the library"
    )

    @classmethod
    def left_out(cls, at):
        """Yield that a run has no residual field of the steel; its share follows from the field alone."""
        if at.solved and at.M > 0.0:
            yield LeftOut(cls.name, ABSENT, "residual field of the steel",
                          note="`emclutch field` of the scene without grains has it")  # fmt: skip

    def history(self, scene: Scene, problem: AxisymmetricProblem) -> SteelHistory | None:
        """Build the history of demagnetised steel; None where no material of the device has a coercivity."""
        from emclutch.device_model.materials import coercivity_of, region_materials
        from field.section.steel_history import SteelHistory

        names = region_materials(scene, problem.mesh)
        return SteelHistory.demagnetised(
            problem, {region: coercivity_of(scene, name) for region, name in names.items()}
        )
