"""[effects.fluid_drag]: Stokes drag of the grains in a carrier at rest or in Couette flow (`coupling.FluidDrag`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

from pydantic import Field

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Choice
from emclutch.scene.units import Quantity


def _is_between_cylinders(partial: PartialScene) -> bool:
    scene = partial.scene
    return scene.geometry.is_annulus or (scene.geometry.has_regions and scene.particles.region in ("rim", "poles"))


def _flow_has_its_gap(partial: PartialScene) -> Iterator[Fault]:
    """Couette flow is that between two coaxial cylinders."""
    drag = partial.scene.effects.get("fluid_drag")
    if drag is not None and drag.flow == "couette" and not _is_between_cylinders(partial):
        yield partial.fault(
            "effects.fluid_drag.flow",
            "needs a gap between two coaxial cylinders: geometry.kind = 'shear_cell', or 'clutch' and 'drum' with "
            "particles.region = 'rim' or 'poles'; take one of them, or flow = 'rest'",
        )


TORQUE_FLUID_DRAG = Column(
    "torque_fluid_drag", "N m", "minus the torque of the drag of the carrier fluid on the grains", When.MEAN
)


class FluidDragSection(EffectSection):
    """Stokes drag of the grains, -3 pi eta d (v - u), in a carrier fluid with the flow u."""

    name = "fluid_drag"
    changes_stress = True
    summary = "Stokes drag in a carrier fluid"
    role = "drag"
    size_note = "the drag on a volume of powder scales as 1/d^2"
    columns = (TORQUE_FLUID_DRAG,)
    has_lagged_forces = True
    CHECKS: ClassVar = ((_flow_has_its_gap, ("effects", "particles", "geometry.kind")),)

    viscosity: Annotated[float, Quantity("a viscosity", "Pa s", "0.1 Pa s", 1e-7, 1e4)] = Field(
        description="dynamic, of the carrier: air 1.8e-5 Pa s, light oil some 0.1 Pa s"
    )
    flow: Annotated[str, Choice(("rest", "couette"))] = Field(
        default="rest",
        description="rest: the carrier is at rest; couette: it flows steadily between disc and rotor at their speeds",
    )

    def acting(self, scene, bodies):
        """Yield the drag."""
        from coupling.effects.fluid_drag import CouetteFlow, FluidDrag, at_rest  # local: the schema needs no particles

        if self.flow == "rest":
            yield FluidDrag(self.viscosity, at_rest)
            return
        gap = scene.shape().sheared_gap(scene.grains.region)
        named = {body.name: body for body in bodies}
        inner, outer = gap.radius - 0.5 * gap.width, gap.radius + 0.5 * gap.width
        yield FluidDrag(self.viscosity, CouetteFlow(inner, outer, named["disc"], named["rotor"]))

    @classmethod
    def omitted_effects(cls, at):
        """Yield the Stokes number in air."""
        yield OmittedEffect(cls.name, OFF, "Stokes number in air", at.stokes, 10.0, below=True)
