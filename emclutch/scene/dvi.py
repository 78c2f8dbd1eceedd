"""[contact.dvi]: how the impulses between rigid grains are found; read where contact.method = 'dvi', else idle."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictBool

from emclutch.scene.section import Automatic, Choice, Section, Whole
from emclutch.scene.units import LinearSpeed, Time, number

# Why a tenth: the centrifugal clutch of cases/thesis/centrifugal_held.toml at 400 rpm, torque from 0.8 to 1.3 s, by
# max_sweeps (2026-11-23). Misses of less than 1 %: 241.0 +- 1.1 N m (11 runs); 11 to 12 %: 239.3 (2); 60 %: 243.8 (2);
# 94 %: 231.8 (2); 98 %: 217 (1), and of 14 runs with 94 % and more 10 stopped for overlaps. So a tenth costs less than
# the 1.5 % that these runs can resolve.


class DviSection(Section):
    """Solver of the rigid contacts. It may stand in a scene by DEM too: a study may then change the method alone."""

    friction_law: Annotated[str, Choice(("coulomb", "convex"))] = Field(
        default="coulomb",
        description="coulomb: exact; convex: the cone complementarity of Project Chrono, which lifts sliding grains",
    )
    solver: Annotated[str, Choice(("accelerated", "gauss_seidel"))] = Field(
        default="accelerated",
        description="accelerated: Gauss-Seidel sweeps, accelerated where they stall; gauss_seidel: sweeps alone",
    )
    springs: StrictBool = Field(
        default=True,
        description="contacts are compliant, with the scene's stiffness taken implicitly: jams have finite forces, and "
        "those of packings are unique; false: perfectly rigid",
    )
    tolerance: Annotated[LinearSpeed | None, Automatic()] = Field(
        default=None, description="on the natural map of every contact; default: 1e-4 of the slip speed"
    )
    max_sweeps: Annotated[int, Whole(1, 1_000_000, "500")] = Field(
        default=500, description="sweeps over all contacts that a step may take"
    )
    allowed_misses: Annotated[float, number("0.1", 0.0, 1.0)] = Field(
        default=0.1,
        description="fraction of the steps that may miss the tolerance before the run is stopped",
    )
    step: Annotated[Time | None, Automatic()] = Field(
        default=None,
        description="step of the rigid grains; default: time.step, else by the rules of travel and force",
        examples=["5 us"],
    )
    allow_long_step: StrictBool = Field(default=False, description="take a step that is longer than the rules allow")
    theta: Annotated[float, number("1", 0.5, 1.0)] = Field(
        default=1.0, description="weight of the new velocity in a step's drift"
    )
    threshold: Annotated[LinearSpeed | None, Automatic()] = Field(
        default=None, description="approach below which nothing rebounds; default: 2 h g, at least 1 mm/s"
    )
