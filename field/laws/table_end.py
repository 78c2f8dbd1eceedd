"""The end of a measured curve at which its steel is not saturated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from field.laws.h_spline import SplineLaw
from field.laws.magnetisation_curve import TableLaw
from field.laws.reluctivity import MU_0, Law
from field.laws.temperature import ScaledLaw

if TYPE_CHECKING:
    from field.section.magnetic_field import MagneticField
    from field.three_d import Field3D

# dB/dH over mu_0 in the last interval of a table, up to which its steel counts as saturated. Steels at 2 T have 2 to 3.
_SATURATED = 3.0
# Of the B at the end, beyond which a region counts as driven past it: what the table's own figures do not resolve.
_BEYOND = 1.01


@dataclass(frozen=True, slots=True)
class TableEnd:
    """Where a measured curve ends before the steel is saturated; beyond, the slope of vacuum is an assumption.

    Attributes
    ----------
    name : str
        Of the material.
    H, B : float
        Its last point [A/m], [T].
    slope : float
        dB/dH over mu_0 in its last interval [-].
    """

    name: str
    H: float
    B: float
    slope: float

    @classmethod
    def of(cls, law: Law) -> TableEnd | None:
        """The end of a law that is continued with the slope of vacuum too early; None for all others."""
        if isinstance(law, ScaledLaw):
            end = cls.of(law.law)
            return None if end is None else replace(end, H=law.ratio * end.H, B=law.ratio * end.B)
        if not isinstance(law, SplineLaw) or (isinstance(law, TableLaw) and law.left_out):
            return None  # or it has a tail below the slope of vacuum: saturated
        curve = law.curve
        before = float(curve.H_of_B(curve.B[-2:-1])[0][0])
        slope = float(curve.B[-1] - curve.B[-2]) / (curve.H_last - before) / MU_0
        return cls(law.name, curve.H_last, float(curve.B[-1]), slope) if slope > _SATURATED else None

    def in_words(self) -> str:
        """Where it ends, and that it is not saturated there."""
        return (
            f"the curve ends unsaturated at H = {self.H:.4g} A/m, B = {self.B:.4g} T, where dB/dH is still "
            f"{self.slope:.3g} mu_0; beyond it B is assumed to grow with mu_0 alone (slope of vacuum) and is too "
            "low: add points up to saturation"
        )


def driven_beyond_their_tables(fields: Iterable[MagneticField | Field3D]) -> dict[str, str]:
    """Materials by a warning of each with the regions that solutions drive beyond its unsaturated end, worst first."""
    largest: dict[TableEnd, dict[str, float]] = {}
    for solution in fields:
        problem = solution.problem
        ends_here = {region: TableEnd.of(problem.laws[region]) for region in problem.mesh.regions}
        here = {region: end for region, end in ends_here.items() if end is not None}
        if not here:
            continue
        B = np.linalg.norm(solution.flux_density(), axis=1)
        for region, end in here.items():
            known = largest.setdefault(end, {})
            known[region] = max(known.get(region, 0.0), float(B[problem.mesh.regions[region]].max()))
    found: dict[str, str] = {}
    for end, known in sorted(largest.items(), key=lambda pair: -max(pair[1].values()) / pair[0].B):
        worst = sorted((-B, region) for region, B in known.items() if B > _BEYOND * end.B)
        where = ", ".join(f"{name} ({end.name}) is driven to {-B:.3g} T" for B, name in worst)
        found |= {f"{where}: {end.in_words()}": end.name} if worst else {}
    return found
