"""[particles]: the grains and how they magnetise. [contact]: how they touch."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from emclutch.scene.section import Choice, Section, Whole, refuse
from emclutch.units import Angle, Density, Length, Magnetisation, Mass, Stiffness, number

LARGEST_SOLID_FRACTION = 0.60
"""Fill beyond which equal spheres are not packed at random without pressing them (close packing: 0.64)."""


class Particles(Section):
    """Equal spheres; their amount: mass or solid fraction of the whole device, or the simulated count."""

    diameter: Length = Field(description="diameter of a grain")
    mass: Mass | None = Field(default=None, description="mass of powder in the whole device, not only in the sector")
    solid_fraction: Annotated[float, number("0.4", 0.0, 1.0, above=True)] | None = Field(
        default=None, description="volume of grains / volume of the region; at most 0.60 can be packed"
    )
    count: Annotated[int, Whole(1, 100_000_000, "1000")] | None = Field(
        default=None, description="number of simulated grains (those of the sector, where there is one)"
    )
    density: Density = Field(default=7700.0, description="density of the grain's material")
    region: Annotated[str, Choice(("cavity", "rim", "faces"))] = Field(
        default="cavity", description="where a clutch is filled: rim gap, both face gaps or all of them"
    )
    sector: Angle | None = Field(default=None, description="cyclic sector that stands for the ring; divides 360 deg")
    susceptibility: Annotated[float, number("200", 0.0, 1e6, above=True)] = Field(
        default=200.0, description="initial susceptibility of the grain's material"
    )
    saturation: Magnetisation = Field(default=1.3e6, description="saturation magnetisation of the grain's material")
    law: Annotated[str, Choice(("sphere", "thesis"))] = Field(
        default="sphere",
        description="sphere: demagnetised, in the Lorentz field of its neighbours; thesis: M = chi H",
    )

    @model_validator(mode="after")
    def _has_one_amount(self) -> Self:
        given = [key for key in ("mass", "solid_fraction", "count") if getattr(self, key) is not None]
        if not given:
            raise refuse("is missing; give one of mass, solid_fraction, count, e.g. mass = '20 g'", key="mass")
        if len(given) > 1:
            raise refuse(
                f"stands beside {' and '.join(given[:-1])}; keep exactly one of mass, solid_fraction, count",
                key=given[-1],
            )
        if self.sector is not None:
            n = round(2.0 * math.pi / self.sector)
            if n < 2 or abs(n * self.sector / (2.0 * math.pi) - 1.0) > 1e-6:
                near = 360.0 / max(n, 2)
                raise refuse(
                    "does not divide 360 deg into equal sectors, two or more; take 360 deg / n, "
                    f"e.g. '{near:.10g} deg'",
                    key="sector",
                )
        return self

    @property
    def n_sectors(self) -> int:
        """Sectors in the ring; 1 where the whole ring is simulated."""
        return 1 if self.sector is None else round(2.0 * math.pi / self.sector)

    @property
    def grain_volume(self) -> float:
        """Volume of a grain [m^3]."""
        return math.pi / 6.0 * self.diameter**3


_Friction = Annotated[float, number("0.3", 0.0, 10.0)]


class Contact(Section):
    """Linear spring and dashpot with Coulomb friction; stiffness follows from the overlap that is allowed."""

    method: Annotated[str, Choice(("dem",), planned=("dvi",))] = Field(default="dem", description="contact method")
    friction: _Friction = Field(default=0.3, description="between grains")
    wall_friction: _Friction | None = Field(default=None, description="between grain and wall; default: friction")
    restitution: Annotated[float, number("0.5", 0.0, 1.0, above=True)] = Field(
        default=0.5, description="speed after / before a head-on collision"
    )
    stiffness: Stiffness | None = Field(default=None, description="normal stiffness; default: from max_overlap")
    max_overlap: Annotated[float, number("0.005", 1e-5, 0.05)] = Field(
        default=0.005, description="overlap / diameter allowed under the largest load to be expected"
    )

    @property
    def friction_at_walls(self) -> float:
        """Coefficient of friction between grain and wall."""
        return self.friction if self.wall_friction is None else self.wall_friction
