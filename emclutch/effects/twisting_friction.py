"""[effects.twisting_friction]: resistance to spin about the contact normal (`particles.laws.twisting_friction`)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.units import number

DISSIPATED_TWISTING = Column("dissipated_twisting", "J", "part of dissipated by twisting friction", When.SUM)


class TwistingFrictionSection(EffectSection):
    """Resistance of rough, flattened contacts to the spin of two grains about their common normal."""

    name = "twisting_friction"
    changes_stress = True
    summary = "grains resist twisting"
    columns = (DISSIPATED_TWISTING,)

    coefficient: Annotated[float, number("0.05", 0.0, 10.0)] = Field(
        default=0.05, description="torque / (effective radius times normal force) between grains"
    )
    wall_coefficient: Annotated[float, number("0.05", 0.0, 10.0)] | None = Field(
        default=None, description="at walls; default: as between grains"
    )

    def step_ns(self):
        """Return the processor time of the torques in a grain's step [ns] (tests/benchmarks/dem_cost.py)."""
        return 5.0

    def contact_terms(self):
        """Return the resistance for the contacts."""
        from particles.laws.twisting_friction import TwistingFriction  # local: the schema itself needs no particles

        return {"twisting": TwistingFriction(self.coefficient, self.wall_coefficient)}

    @classmethod
    def omitted_effects(cls, at):
        """Yield the torque of a contact's twist over that of its sliding."""
        yield OmittedEffect(cls.name, OFF, "twisting torque of a contact divided by its sliding torque", at.twist, 0.1)
