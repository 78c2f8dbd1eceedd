"""[effects.rolling_friction]: resistance of rough, angular grains to rolling (`particles.laws.rolling_friction`)."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.units import number
from emclutch.scene.usual_ranges import UsualRange

_USUAL = UsualRange(0.0, 1.0, "", "rolling freely to hindered; C. M. Wensrich and A. Katterfeld, Powder Technol. 217 "
                     "(2012) 409", "it counts in effective radii, is a length meant?")  # fmt: skip


DISSIPATED_ROLLING = Column("dissipated_rolling", "J", "part of dissipated by rolling friction", When.SUM)


class RollingFrictionSection(EffectSection):
    """Resistance of rough, angular grains to rolling; perfect spheres roll on smooth walls like a bearing."""

    name = "rolling_friction"
    summary = "grains resist rolling"
    role = "rolling"
    columns = (DISSIPATED_ROLLING,)
    USUAL: ClassVar = {"coefficient": _USUAL, "wall_coefficient": _USUAL}

    coefficient: Annotated[float, number("0.2", 0.0, 10.0)] = Field(
        default=0.2, description="torque / (effective radius times normal force) between grains"
    )
    wall_coefficient: Annotated[float, number("0.2", 0.0, 10.0)] | None = Field(
        default=None, description="at walls; default: as between grains"
    )

    def step_ns(self):
        """Return the processor time of the torques in a grain's step [ns] (tests/benchmarks/dem_cost.py)."""
        return 10.0

    def contact_terms(self):
        """Return the resistance for the contacts."""
        from particles.laws.rolling_friction import RollingFriction  # local: the schema itself needs no particles

        return {"rolling": RollingFriction(self.coefficient, self.wall_coefficient)}

    @classmethod
    def omitted_effects(cls, at):
        """Yield that the shape of the grains decides."""
        doubled = "0 for smooth shot; 0.2 for rough grains doubled the torque of the shipped clutches"
        yield OmittedEffect(cls.name, OFF, "the shape of the grains decides", note=doubled)
