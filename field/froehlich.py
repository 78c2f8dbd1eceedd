"""Bulk material that saturates after Froehlich and Kennelly, M = chi Ms H/(Ms + chi H).

It is the grain law at solid fraction 1: no cavity, no demagnetisation, H = B/mu_0 - M.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .powder_law import GrainLaw, PowderLaw


@dataclass(frozen=True, slots=True)
class FroehlichLaw:
    """Susceptibility chi [-] at weak field, saturation Ms [A/m]."""

    chi: float
    Ms: float
    name: str = "froehlich"
    source: str = "Froehlich-Kennelly"

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B [T]."""
        return PowderLaw(GrainLaw(self.chi, self.Ms)).H_of_B(B, 1.0)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Integral of H dB from 0 to B [J/m^3]."""
        return PowderLaw(GrainLaw(self.chi, self.Ms)).energy_density(B, 1.0)
