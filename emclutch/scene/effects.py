"""[effects.NAME]: a scene simulates exactly the effects whose table it has."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from emclutch.scene.section import Automatic, Choice, Section, Whole, refuse
from emclutch.scene.units import Acceleration, Force, Quantity, WorkOfAdhesion, number

if TYPE_CHECKING:
    from particles.laws.cohesion import Cohesion as CohesionLaw
    from particles.laws.rolling_friction import RollingFriction
    from particles.laws.twisting_friction import TwistingFriction

PLANNED_EFFECTS = (
    "remanence",
    "fluid_drag",
    "heat",
)

_Beginning = Annotated[str, Choice(("off", "steady"))]
_Conductivity = Annotated[float, Quantity("a conductivity", "S/m", "5 MS/m", 0.0, 1e9)]
_Component = Annotated[float, number("-1", -1e6, 1e6)]


class GravitySection(Section):
    """Weight of the grains."""

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


class MagneticForceSection(Section):
    """Force mu_0 V (M . grad) H of the field on each grain."""


class DipolesSection(Section):
    """Forces between the grains' moments within a cut-off."""

    model: Annotated[str, Choice(("mutual", "near_field"))] = Field(
        default="near_field",
        description="mutual: grains magnetise one another as dipoles and saturate; near_field: besides, the flux in "
        "the necks of grains that nearly touch, without which contacts are too weak",
    )
    cutoff: Annotated[float, number("3", 1.1, 10.0)] = Field(default=3.0, description="reach, in grain diameters")
    update_every: Annotated[Annotated[int, Whole(1, 10_000, "10")] | None, Automatic()] = Field(
        default=None, description="steps between evaluations of the magnetic forces, which are held meanwhile"
    )
    tolerance: Annotated[float, number("1e-3", 1e-12, 0.05)] = Field(
        default=1e-3, description="residual of the moments, relative to the magnetisation"
    )
    surface_gap: Annotated[float, number("0.003", 3e-4, 0.5)] = Field(
        default=3e-3,
        description="near_field: least gap between surfaces that touch (oxide, roughness), in grain radii; at "
        "18 kA/m a gap of 0.02 costs 30 % of the force, at 80 kA/m nothing",
    )


class SaturationSection(Section):
    """Grains saturate; without it their law is linear."""


class WallImagesSection(Section):
    """Images of the dipoles in the steel faces."""


class BackReactionSection(Section):
    """The powder changes the field: the grains' moments are part of its solution."""

    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02, description="how far the magnetisation of the solution and that of the grains may differ"
    )


class CoilCircuitSection(Section):
    """The coil's voltage drives its current through resistance and flux linkage, V = R i + d lambda/dt."""

    begin: _Beginning = Field(
        default="off",
        description="off: without current, the voltage is switched on at t = 0; steady: with the current V/R",
    )
    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02,
        description="change of the current, relative to the largest V/R, that triggers a new solve; between solves the "
        "flux linkage follows a line, whose error is of its square",
    )


class EddyCurrentsSection(Section):
    """Eddy currents in the solid parts delay the field."""

    begin: _Beginning = Field(
        default="off", description="off: without a field; steady: with the static field of the drive at t = 0"
    )
    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02, description="change of the field, relative to its largest, in one of its steps"
    )
    conductivity: dict[str, _Conductivity] = Field(
        default={}, description="conductivity by name of the material, where it is not that of the library"
    )


class RollingFrictionSection(Section):
    """Resistance of rough, angular grains to rolling; perfect spheres roll on smooth walls like a bearing."""

    coefficient: Annotated[float, number("0.2", 0.0, 10.0)] = Field(
        default=0.2, description="torque over (effective radius times normal force), between grains"
    )
    wall_coefficient: Annotated[float, number("0.2", 0.0, 10.0)] | None = Field(
        default=None, description="at walls; default: as between grains"
    )

    def law(self) -> RollingFriction:
        """Return the resistance for the contacts."""
        from particles.laws.rolling_friction import RollingFriction  # local: the schema itself needs no particles

        return RollingFriction(self.coefficient, self.wall_coefficient)


class TwistingFrictionSection(Section):
    """Resistance of rough, flattened contacts to the spin of two grains about their common normal."""

    coefficient: Annotated[float, number("0.05", 0.0, 10.0)] = Field(
        default=0.05, description="torque over (effective radius times normal force), between grains"
    )
    wall_coefficient: Annotated[float, number("0.05", 0.0, 10.0)] | None = Field(
        default=None, description="at walls; default: as between grains"
    )

    def law(self) -> TwistingFriction:
        """Return the resistance for the contacts."""
        from particles.laws.twisting_friction import TwistingFriction  # local: the schema itself needs no particles

        return TwistingFriction(self.coefficient, self.wall_coefficient)


class CohesionSection(Section):
    """Pull between grains that touch: constant, or from the work of adhesion w and r = R_i R_j/(R_i + R_j)."""

    model: Annotated[str, Choice(("constant", "dmt", "jkr"))] = Field(
        default="constant",
        description="constant: force; dmt: 2 pi w r, small stiff grains; jkr: 3/2 pi w r, large soft grains",
    )
    force: Force | None = Field(default=None, description="constant: pull of a contact")
    wall_force: Force | None = Field(default=None, description="constant: at walls; default: force")
    work_of_adhesion: WorkOfAdhesion | None = Field(
        default=None,
        description="dmt and jkr: energy to part a unit of area, twice the surface energy of like grains",
    )
    wall_work_of_adhesion: WorkOfAdhesion | None = Field(
        default=None, description="dmt and jkr: at walls; default: work_of_adhesion"
    )

    @model_validator(mode="after")
    def _has_what_its_model_needs(self) -> Self:
        needed, other = ("force", "work_of_adhesion") if self.model == "constant" else ("work_of_adhesion", "force")
        for key in (other, f"wall_{other}"):
            if getattr(self, key) is not None:
                raise refuse(f"does not belong to model = '{self.model}'; remove it, or take another model", key=key)
        if getattr(self, needed) is None:
            example = "'1 mN'" if needed == "force" else "'0.05 J/m^2'"
            raise refuse(f"is missing for model = '{self.model}'; give it, e.g. {needed} = {example}", key=needed)
        return self

    def law(self) -> CohesionLaw:
        """Return the pull for the contacts."""
        from particles.laws.cohesion import Cohesion as CohesionLaw  # local: the schema itself needs no particles

        if self.model == "constant":
            assert self.force is not None  # by the model's rule
            return CohesionLaw.constant(self.force, self.wall_force)
        assert self.work_of_adhesion is not None
        made = CohesionLaw.dmt if self.model == "dmt" else CohesionLaw.jkr
        return made(self.work_of_adhesion, self.wall_work_of_adhesion)


class EffectsSection(Section):
    """The effects of a scene; one without its table does not exist."""

    gravity: GravitySection | None = Field(default=None, description="weight of the grains")
    magnetic_force: MagneticForceSection | None = Field(default=None, description="force of the field on each grain")
    dipoles: DipolesSection | None = Field(default=None, description="forces between magnetised grains")
    saturation: SaturationSection | None = Field(default=None, description="grains saturate")
    wall_images: WallImagesSection | None = Field(default=None, description="images of the dipoles in steel faces")
    back_reaction: BackReactionSection | None = Field(default=None, description="the powder changes the field")
    coil_circuit: CoilCircuitSection | None = Field(
        default=None, description="resistance and inductance delay the current"
    )
    eddy_currents: EddyCurrentsSection | None = Field(default=None, description="solid conductors delay the field")
    rolling_friction: RollingFrictionSection | None = Field(default=None, description="grains resist rolling")
    twisting_friction: TwistingFrictionSection | None = Field(default=None, description="grains resist twisting")
    cohesion: CohesionSection | None = Field(default=None, description="grains that touch pull each other")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the effects that this version has."""
        return tuple(cls.model_fields)

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the effects that the scene has."""
        return tuple(name for name in self.names() if getattr(self, name) is not None)
