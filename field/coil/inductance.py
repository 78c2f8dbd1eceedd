"""Flux linkage and inductance of the coil, and its flux linkage curve against the current.

    lambda = N phi_turn,      L = lambda/i  (apparent),      L_d = d lambda/d i  (incremental).

L_d needs no second nonlinear solve: with the tangent K at the solution K dpsi/d(N I) = c, c the load of one
ampere-turn, so that L_d = 2 pi N^2 c . dpsi/d(N I).  In saturation L_d < L; at zero current both are the
same.  K is that of the material's curve, so L_d is the slope along the sweep, not that of a minor loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator

from field.newton import scalar_product

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.magnetic_field import MagneticField
    from field.three_d import Field3D


def psi_per_ampere_turn(solution: MagneticField) -> np.ndarray:
    """d psi/d(N I) at constant fill, (n_dofs,) [Wb/(rad A)]: one linear solve with the tangent."""
    problem = solution.problem
    change = np.zeros(problem.n_dofs)
    change[problem._free] = problem.factorise_tangent(solution).solve_again(problem.coil_load[problem._free])
    return change


def incremental_inductance(solution: MagneticField | Field3D, turns: float) -> float:
    """d lambda/d i at constant fill [H]."""
    from field.three_d import Field3D

    if isinstance(solution, Field3D):
        return turns**2 * solution.flux_slope
    _check_coil(solution.problem)
    return 2.0 * math.pi * turns**2 * scalar_product(solution.problem.coil_load, psi_per_ampere_turn(solution))


def apparent_inductance(solution: MagneticField | Field3D, turns: float) -> float:
    """lambda/i [H]; without current its limit, the incremental inductance."""
    if solution.ampere_turns == 0.0:
        return incremental_inductance(solution, turns)
    return turns**2 * solution.flux_linkage_per_turn / solution.ampere_turns


def _check_coil(problem: AxisymmetricProblem) -> None:
    if problem.coil_area == 0.0:
        raise ValueError(
            f"no inductance without a coil: the mesh has no region {problem.coil_region!r}; "
            f"it has {', '.join(sorted(problem.mesh.regions))}"
        )


@dataclass(frozen=True, slots=True)
class FluxLinkageCurve:
    """lambda(i) of a coil at constant fill, odd in i: monotone cubic (PCHIP), the last slope beyond.

    Parameters
    ----------
    currents : ndarray (n,)
        [A], from 0, growing.
    linkages : ndarray (n,)
        [Wb], from 0, growing.
    """

    currents: np.ndarray
    linkages: np.ndarray
    _linkage: PchipInterpolator = field(init=False, repr=False)
    _current: PchipInterpolator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        i, linkage = np.asarray(self.currents, dtype=float), np.asarray(self.linkages, dtype=float)
        if i.ndim != 1 or i.shape != linkage.shape or i.size < 3 or i[0] != 0.0 or linkage[0] != 0.0:
            raise ValueError(
                f"a flux linkage curve needs one linkage for each of at least 3 currents, both from 0; "
                f"got {i.size} currents and {linkage.size} linkages"
            )
        if np.any(np.diff(i) <= 0.0) or np.any(np.diff(linkage) <= 0.0):
            raise ValueError("currents and linkages of a flux linkage curve must grow from point to point")
        object.__setattr__(self, "currents", i)
        object.__setattr__(self, "linkages", linkage)
        object.__setattr__(self, "_linkage", PchipInterpolator(i, linkage))
        object.__setattr__(self, "_current", PchipInterpolator(linkage, i))

    @classmethod
    def of(
        cls,
        problem: AxisymmetricProblem,
        turns: float,
        largest_current: float,
        fill: np.ndarray | None = None,
        *,
        points: int = 13,
        tolerance: float = 1e-8,
    ) -> FluxLinkageCurve:
        """Solve a sweep from 0 to `largest_current` [A], each point started from the one before."""
        _check_coil(problem)
        if not largest_current > 0.0 or points < 3:
            raise ValueError(
                f"a sweep needs a largest current above 0 A and at least 3 points; got {largest_current} A, {points}"
            )
        # dense at small currents, where iron opens
        currents = largest_current * np.linspace(0.0, 1.0, points) ** 1.5
        linkages, guess = np.zeros(points), None
        for k, current in enumerate(currents[1:], start=1):
            guess = problem.solve(turns * current, fill, guess, tolerance=tolerance)
            linkages[k] = turns * guess.flux_linkage_per_turn
        return cls(currents, linkages)

    def linkage(self, current: np.ndarray | float) -> np.ndarray:
        """lambda [Wb] at currents [A]."""
        return _odd(self._linkage, self.currents[-1], np.asarray(current, dtype=float))

    def current(self, linkage: np.ndarray | float) -> np.ndarray:
        """i [A] at flux linkages [Wb]."""
        return _odd(self._current, self.linkages[-1], np.asarray(linkage, dtype=float))

    def incremental(self, current: np.ndarray | float) -> np.ndarray:
        """d lambda/d i [H] at currents [A]."""
        return self._linkage.derivative()(np.minimum(np.abs(current), self.currents[-1]))


def _odd(curve: PchipInterpolator, last: float, x: np.ndarray) -> np.ndarray:
    size = np.abs(x)
    slope = float(curve.derivative()(last))
    return np.sign(x) * (curve(np.minimum(size, last)) + slope * np.maximum(size - last, 0.0))
