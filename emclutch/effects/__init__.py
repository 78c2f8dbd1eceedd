"""The effects of a scene, one module each: schema, needs, check, construction, cost, and what its absence means.

To add one: a module here with a subclass of `EffectSection`, its import and its place in `EFFECTS`; if it has compiled
physics, a module in `coupling/effects`, `particles` or `field` (docs/how_to/extend.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field, create_model

from emclutch.effects.back_reaction import BackReactionSection
from emclutch.effects.cohesion import CohesionSection
from emclutch.effects.coil_circuit import CoilCircuitSection
from emclutch.effects.dipoles import DipolesSection
from emclutch.effects.eddy_currents import EddyCurrentsSection
from emclutch.effects.effect import EffectSection
from emclutch.effects.effects_section import BaseEffectsSection
from emclutch.effects.fluid_drag import FluidDragSection
from emclutch.effects.gravity import GravitySection
from emclutch.effects.heat import HeatSection
from emclutch.effects.hysteresis import HysteresisSection
from emclutch.effects.magnetic_force import MagneticForceSection
from emclutch.effects.rolling_friction import RollingFrictionSection
from emclutch.effects.saturation import SaturationSection
from emclutch.effects.twisting_friction import TwistingFrictionSection
from emclutch.effects.wall_images import WallImagesSection

EFFECTS: tuple[type[EffectSection], ...] = (  # in this order they act and are listed
    GravitySection,
    MagneticForceSection,
    DipolesSection,
    SaturationSection,
    HysteresisSection,
    WallImagesSection,
    BackReactionSection,
    CoilCircuitSection,
    EddyCurrentsSection,
    RollingFrictionSection,
    TwistingFrictionSection,
    CohesionSection,
    FluidDragSection,
    HeatSection,
)

PLANNED_EFFECTS = ("grain_hysteresis",)

if TYPE_CHECKING:

    class EffectsSection(BaseEffectsSection):
        """The tables [effects.NAME] of a scene."""

        def __getattr__(self, name: str) -> Any: ...

else:
    EffectsSection = create_model(
        "EffectsSection",
        __base__=BaseEffectsSection,
        __doc__=BaseEffectsSection.__doc__,
        **{one.name: (one | None, Field(default=None, description=one.summary)) for one in EFFECTS},
    )

__all__ = ["EFFECTS", "PLANNED_EFFECTS", "EffectSection", "EffectsSection"]
