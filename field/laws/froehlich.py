"""Bulk material that saturates after Froehlich and Kennelly, M = chi Ms H/(Ms + chi H).

With b = B/mu_0 = H + M the field strength is the positive root of

    chi H^2 + (Ms (1 + chi) - chi b) H - Ms b = 0,

and the energy follows from w = H B - integral of B dH with x = chi H/Ms,

    w = mu_0 (H^2/2 + Ms^2/chi (log(1 + x) - x/(1 + x))).

Sources: O. Froehlich, Elektrotechn. Z. 2 (1881) 134; A. E. Kennelly, Trans. AIEE 8 (1891) 485.  It is the grain
law (`powder_law`) at solid fraction 1: no cavity, no demagnetisation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from field.laws.reluctivity import MU_0, NU_0

# Below it log(1 + x) - x/(1 + x) loses more digits than the four terms of its series leave out (x^6/7 of x^2/2).
_SMALL = 2e-3


@dataclass(frozen=True, slots=True)
class FroehlichLaw:
    """Susceptibility chi [-] at weak field, saturation Ms [A/m].

    Raises
    ------
    ValueError
        chi or Ms not above 0.
    """

    chi: float
    Ms: float
    name: str = "froehlich"
    source: str = "Froehlich-Kennelly"

    def __post_init__(self) -> None:
        check_saturating(self.chi, self.Ms, self.name)

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B [T]."""
        chi, Ms, b = self.chi, self.Ms, NU_0 * np.asarray(B, dtype=float)
        half = 0.5 * (Ms * (1.0 + chi) - chi * b)
        root = np.sqrt(half**2 + chi * Ms * b)
        # The form of the root in which both terms have one sign: before the knee and beyond it.
        H = np.where(half > 0.0, Ms * b / (np.abs(half) + root), (np.abs(half) + root) / chi)
        return H, NU_0 / (1.0 + chi * (Ms / (Ms + chi * H)) ** 2)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Integral of H dB from 0 to B [J/m^3]."""
        H, _ = self.H_of_B(B)
        x = self.chi * H / self.Ms
        series = x**2 * (1.0 / 2.0 - x * (2.0 / 3.0 - x * (3.0 / 4.0 - x * (4.0 / 5.0))))
        bound = np.where(x < _SMALL, series, np.log1p(x) - x / (1.0 + x))
        return MU_0 * (0.5 * H**2 + self.Ms**2 / self.chi * bound)


def check_saturating(chi: float, Ms: float, name: str) -> None:
    """Raise ValueError unless susceptibility chi [-] and saturation Ms [A/m] are finite and above 0."""
    if not (math.isfinite(chi) and chi > 0.0):
        raise ValueError(f"`chi` = {chi} of {name!r} must be a finite number above 0 (iron: 100 to 5000)")
    if not (math.isfinite(Ms) and Ms > 0.0):
        raise ValueError(f"`Ms` = {Ms} A/m of {name!r} must be a finite number above 0 (iron: 1.7e6 A/m)")
