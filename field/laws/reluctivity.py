"""Interface of a magnetic law to the field solver, and the linear law.

The solver works with the flux density as the given quantity, so a law gives H(B), its slope and
its energy density.  H must grow with B: then the stored energy is a convex functional of psi and
Newton with a line search on it converges from anywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

MU_0 = 4e-7 * math.pi
"""Permeability of vacuum [H/m]."""

NU_0 = 1.0 / MU_0
"""Reluctivity of vacuum [m/H]."""


@runtime_checkable
class Law(Protocol):
    """An isotropic law H = H(|B|) of one material, without hysteresis."""

    @property
    def name(self) -> str:
        """The material's name, for messages and tables."""

    @property
    def source(self) -> str:
        """Source of the numbers."""

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Field strength and slope.

        Parameters
        ----------
        B : ndarray, any shape
            Magnitude of the flux density [T], >= 0.

        Returns
        -------
        H : ndarray, shape of `B`
            Field strength [A/m].
        dH_dB : ndarray, shape of `B`
            Differential reluctivity [A/(m T)], > 0.
        """

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Energy density w = integral of H dB from 0 to B [J/m^3]."""


@dataclass(frozen=True, slots=True)
class LinearLaw:
    """Constant relative permeability, H = B/(mu_0 mu_r).

    Parameters
    ----------
    mu_r : float
        Relative permeability [-], >= 1 (a superconductor or a diamagnet is not meant here).
    """

    mu_r: float = 1.0
    name: str = "linear"
    source: str = "H = B/(mu_0 mu_r)"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mu_r) and self.mu_r >= 1.0):
            raise ValueError(
                f"`mu_r` = {self.mu_r} of {self.name!r} must be a finite number of at least 1; "
                "use 1 for air and non-magnetic metals"
            )

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Law.H_of_B`."""
        nu = NU_0 / self.mu_r
        B = np.asarray(B, dtype=float)
        return nu * B, np.full_like(B, nu)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """See `Law.energy_density`."""
        return 0.5 * NU_0 / self.mu_r * np.asarray(B, dtype=float) ** 2


AIR = LinearLaw(1.0, "air", "mu_r = 1")
