"""Reluctivity after Brauer, H = (k1 exp(k2 B^2) + k3) B, as fitted to many electrical steels.

Its slope grows without limit, which no material's does: from the flux density B_s on at which dH/dB reaches nu_0 the
material is saturated, M is constant and the slope stays nu_0.  The energy is closed,

    w = k1/(2 k2) (exp(k2 B^2) - 1) + k3 B^2/2         for B <= B_s.

Source: J. R. Brauer, Simple equations for the magnetization and reluctivity curves of steel, IEEE Trans. Magn. 11
(1975) 81.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from field.laws.reluctivity import NU_0


@dataclass(frozen=True, slots=True)
class BrauerLaw:
    """Coefficients k1 [m/H], k2 [1/T^2], k3 [m/H].

    Attributes
    ----------
    B_s : float
        Flux density from which the slope is nu_0 [T].
    H_s, w_s : float
        Field strength [A/m] and energy density [J/m^3] there.

    Raises
    ------
    ValueError
        k1 or k2 not above 0, k3 below 0, or an initial slope k1 + k3 that is not below nu_0.
    """

    k1: float
    k2: float
    k3: float
    name: str = "brauer"
    source: str = "Brauer"
    B_s: float = field(init=False)
    H_s: float = field(init=False)
    w_s: float = field(init=False)

    def __post_init__(self) -> None:
        finite = all(math.isfinite(value) for value in (self.k1, self.k2, self.k3))
        if not (finite and self.k1 > 0.0 and self.k2 > 0.0 and self.k3 >= 0.0):
            raise ValueError(
                f"the reluctivity of {self.name!r} needs k1 > 0 m/H, k2 > 0 1/T^2 and k3 >= 0 m/H; "
                f"got {self.k1}, {self.k2}, {self.k3}"
            )
        if self.k1 + self.k3 >= NU_0:
            raise ValueError(
                f"the reluctivity of {self.name!r} starts at k1 + k3 = {self.k1 + self.k3:.4g} m/H, not below that of "
                f"vacuum, {NU_0:.4g} m/H: no material does that; check the units (m/H, not A/m)"
            )
        B_s = math.sqrt(self._saturation_exponent() / self.k2)
        object.__setattr__(self, "B_s", B_s)
        H_s, w_s = self._fit(np.array(B_s))[0], self._fit_energy(np.array(B_s))
        object.__setattr__(self, "H_s", float(H_s))
        object.__setattr__(self, "w_s", float(w_s))

    def _saturation_exponent(self) -> float:
        """u = k2 B_s^2 from exp(u) (1 + 2 u) = (nu_0 - k3)/k1, by Newton on its logarithm, which is concave."""
        target = math.log((NU_0 - self.k3) / self.k1)
        u = 0.0  # left of the root: a concave growing function is climbed monotonically from there
        for _ in range(100):
            step = (target - u - math.log1p(2.0 * u)) / (1.0 + 2.0 / (1.0 + 2.0 * u))
            u += step
            if abs(step) <= 1e-15 * u:
                break
        return u

    def _fit(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = self.k2 * B**2
        growing = self.k1 * np.exp(u)
        return (growing + self.k3) * B, growing * (1.0 + 2.0 * u) + self.k3

    def _fit_energy(self, B: np.ndarray) -> np.ndarray:
        return 0.5 * self.k1 / self.k2 * np.expm1(self.k2 * B**2) + 0.5 * self.k3 * B**2

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B [T]."""
        B = np.asarray(B, dtype=float)
        beyond = np.maximum(B - self.B_s, 0.0)
        H, slope = self._fit(np.minimum(B, self.B_s))
        return H + NU_0 * beyond, np.where(beyond > 0.0, NU_0, slope)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Integral of H dB from 0 to B [J/m^3]."""
        B = np.asarray(B, dtype=float)
        beyond = np.maximum(B - self.B_s, 0.0)
        return self._fit_energy(np.minimum(B, self.B_s)) + beyond * (self.H_s + 0.5 * NU_0 * beyond)
