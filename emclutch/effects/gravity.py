"""[effects.gravity]: weight of the grains, a constant acceleration in the equations of motion of DEM and DVI."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from emclutch.effects.effect import EffectSection, Load
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault, shown
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import refuse
from emclutch.scene.units import Acceleration, number
from emclutch.scene.usual_ranges import ACCELERATION

_Component = Annotated[float, number("-1", -1e6, 1e6)]


def _in_a_sector(partial: PartialScene) -> Iterator[Fault]:
    """Weight may act along the axis of a sector only."""
    gravity = partial.scene.effects.weight
    if partial.scene.particles.sector is not None and gravity is not None and any(gravity.direction[:2]):
        yield Fault(
            "effects.gravity.direction",
            shown(list(gravity.direction)),
            "turns from sector to sector; with particles.sector it must lie along the axis: take [0, 0, -1], "
            "or remove particles.sector or [effects.gravity]",
        )


WORK_GRAVITY = Column("work_gravity", "J", "work of gravity on the grains", When.SUM)


class GravitySection(EffectSection):
    """Weight of the grains."""

    name = "gravity"
    summary = "weight of the grains"
    role = "weight"
    columns = (WORK_GRAVITY,)
    CHECKS: ClassVar = ((_in_a_sector, ("particles", "effects")),)
    USUAL: ClassVar = {"acceleration": ACCELERATION}

    acceleration: Acceleration = Field(default=9.81, description="magnitude")
    direction: tuple[_Component, _Component, _Component] = Field(
        default=(0.0, 0.0, -1.0), description="x, y, z; its length does not matter"
    )

    @model_validator(mode="after")
    def _points_somewhere(self) -> Self:
        if not any(self.direction):
            raise refuse("has no length; give x, y, z, e.g. [0, 0, -1]", key="direction")
        return self

    @property
    def vector(self) -> tuple[float, float, float]:
        """Acceleration of free fall [m/s^2]."""
        x, y, z = self.direction
        scale = self.acceleration / math.hypot(x, y, z)
        return x * scale, y * scale, z * scale

    def loads(self, scene, device, M_max):
        """Yield the weight of a bed as high as the device."""
        from coupling import weight_load  # local: the schema itself needs no particles

        particles, height = scene.particles, device.shape.bed_height
        force = weight_load(particles.density, self.acceleration, height, particles.largest_diameter)
        yield Load(self.name, force, "the weight of the bed")

    @classmethod
    def omitted_effects(cls, at):
        """Yield the pull of touching grains, or the centrifugal force, over the weight."""
        if at.pull > 0.0:
            what, ratio = "attraction of touching grains divided by weight", at.pull / at.weight
        else:
            what, ratio = "centrifugal force over weight", at.centrifugal / at.weight
        yield OmittedEffect(cls.name, OFF, what, ratio, 10.0, below=True)
