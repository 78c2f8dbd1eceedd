"""field.source = "coil": the field of the device's coil, by finite elements in its section or in 3D."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Integer
from emclutch.scene.units import number
from emclutch.sources.source_section import SourceSection

MIN_SIZE_IN_3D = 0.2  # `geometry.mesh_slotted`


def _device_with_a_coil(partial: PartialScene) -> Iterator[Fault]:
    """The device has a coil, and the scene says what drives it."""
    from emclutch.devices import kinds_in_words  # local: the lists name this module
    from emclutch.sources import sources_in_words

    geometry, others = partial.scene.geometry, sources_in_words(is_solved=False)
    if not geometry.has_coil:
        yield partial.fault(
            "field.source",
            f"needs a device with a coil, but geometry.kind = '{geometry.kind}'; "
            f"take geometry.kind = {kinds_in_words(has_coil=True)}, or field.source = {others}",
        )
    elif partial.scene.coil is None and "coil" not in partial.broken:
        yield Fault("coil", "", "is missing, but field.source = 'coil'; add [coil] with its current and turns")


def _solved_in_3d(partial: PartialScene) -> Iterator[Fault]:
    """Yield the combinations that a field in 3D does not support."""
    source, geometry = partial.scene.field, partial.scene.geometry
    if not geometry.is_solved_in_3d:
        return
    key = f"geometry.{geometry.key_of_3d}"
    for one in partial.scene.effects.present:
        if one.not_in_3d:
            yield Fault(
                f"effects.{one.name}",
                "",
                f"is not available in a 3D field, which {key} asks for: {one.not_in_3d}; remove one of them",
            )
    if source.tolerance is not None:
        yield partial.fault(
            "field.tolerance", f"refines the mesh of a section, but {key} asks for a field in 3D; remove it, and "
            "set the mesh by field.size_factor"
        )  # fmt: skip
    if source.size_factor < MIN_SIZE_IN_3D:
        yield partial.fault(
            "field.size_factor", f"is too fine for a field in 3D, which {key} asks for; allowed: at least "
            f"{MIN_SIZE_IN_3D:g}"
        )  # fmt: skip


class CoilFieldSection(SourceSection):
    """The field of the coil in the device, by finite elements."""

    is_solved = True
    CHECKS: ClassVar = (
        (_device_with_a_coil, ("geometry.kind",)),
        (_solved_in_3d, ("geometry.kind", "effects")),
    )

    source: Literal["coil"]
    order: Annotated[int, Integer(1, 3, "2")] = Field(
        default=2, description="polynomial order of the elements; with 1, B near the axis is some 10 % off on any mesh"
    )
    gap_layers: Annotated[int, Integer(3, 40, "4")] = Field(default=4, description="element layers across a gap")
    size_factor: Annotated[float, number("1", 0.1, 4.0)] = Field(default=1.0, description="scales the mesh size")
    tolerance: Annotated[float, number("1e-3", 1e-6, 0.1)] | None = Field(
        default=None,
        description="refine the mesh until flux linkage and gap field have this relative error; unset: no refinement",
    )
    open_boundary: bool = Field(default=True, description="air continues beyond the mesh; false: a flux wall there")
    newton_tolerance: Annotated[float, number("1e-8", 1e-14, 1e-2)] = Field(
        default=1e-8, description="relative residual at which Newton stops"
    )

    def equip(self, device, scene):
        """Give the device its coil, with mesh and materials."""
        from emclutch.device_model.device import solved_coil  # local: the schema itself needs no fields

        return replace(device, coil=solved_coil(scene))

    def build(self, scene, device, bodies, walls, peak):
        """Build the coil's field, of a section or in 3D.

        Its class follows from what its current follows from: a course in time, the circuit, eddy currents.
        """
        from coupling import CoilField
        from field.three_d import Field3D

        coil, section = device.coil, device.section_coil
        carrier = None if section is not None else next(body for body in bodies if body.name == coil.carrier)
        circuit, eddy, reaction = scene.effects.circuit, scene.effects.eddy, scene.effects.feedback
        feedback = None if reaction is None else reaction.powder_feedback(scene, coil.problem, walls, carrier)
        tolerance = 0.0 if reaction is None else reaction.tolerance
        supply = None if circuit is None else coil.supply
        if eddy is not None:
            return eddy.source(section, supply, feedback, tolerance)
        if supply is not None:
            return circuit.source(coil, supply, feedback, tolerance, carrier)
        if section is not None and section.history is not None:
            return scene.effects.memory.source(section, feedback, tolerance)
        return CoilField(
            coil.problem,
            coil.turns,
            coil.currents,
            carrier=carrier,
            newton_tolerance=coil.newton_tolerance,
            powder_tolerance=tolerance,
            feedback=feedback,
            known=peak if isinstance(peak, Field3D) else None,
        )
