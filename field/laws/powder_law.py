"""One law for the moment of a grain and for the permeability of the powder.

A grain is a sphere of a material that saturates after Froehlich and Kennelly,

    M(H_in) = chi Ms H_in/(Ms + chi H_in),

inside the powder of solid fraction phi.  In the Lorentz cavity it sees H_fe + phi M/3, its own
demagnetising field is -M/3, so that

    H_in = H_fe - N M,          N = (1 - phi)/3          with the macroscopic field H_fe given,
    H_in = B/mu_0 - N_B M,      N_B = (1 + 2 phi)/3      with B = mu_0 (H_fe + phi M) given.

Both give the same quadratic  chi N M^2 - M (Ms + chi h + chi N Ms) + chi Ms h = 0  whose smaller root is
the magnetisation.  The field solver uses H = B/mu_0 - phi M(B, phi), the grains get M(H, phi): one law,
so that phi M = chi_eff(phi, H) H.  For Ms -> infinity it is Maxwell Garnett's mixing rule.
It knows no structure of the packing (chains) beyond the Lorentz sphere.  Where the moments of the grains are known
one by one, they say what N is there: N = (H - h(M))/M, with h(M) the field inside a grain; N_B = N + phi.
Neglected: hysteresis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from field.laws.reluctivity import MU_0, NU_0

Factor = np.ndarray | float | None


class ParticleLaw(Protocol):
    """Magnetisation of a grain's material inside the powder; all arguments are magnitudes, vectorised."""

    def demagnetising_factors(self, phi: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, float]:
        """N against H, N_B against B/mu_0, and dN_B/dphi [-], of powder without structure."""

    def magnetisation(self, H: np.ndarray, phi: np.ndarray | float) -> np.ndarray:
        """M [A/m] of the grains in the macroscopic field H [A/m] at solid fraction phi [-]."""

    def from_flux(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> tuple[np.ndarray, np.ndarray]:
        """M [A/m] and dM/dB [A/(m T)] with the macroscopic flux density B [T] given.

        ``N`` [-] is the demagnetising factor against H; None: that of the Lorentz cavity.
        """

    def flux_sensitivity(self, B: np.ndarray, phi: np.ndarray | float) -> np.ndarray:
        """dM/dphi at constant B [A/m]."""

    def magnetisation_work(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> np.ndarray:
        """Integral of M dB at constant phi and N [J/m^3]."""

    def field_inside(self, M: np.ndarray) -> np.ndarray:
        """Field [A/m] inside a grain of the magnetisation M [A/m]; infinite from saturation on."""

    def chi_eff(self, phi: np.ndarray | float, H: np.ndarray) -> np.ndarray:
        """Susceptibility of the powder, phi M/H [-]."""


@dataclass(frozen=True, slots=True)
class GrainLaw:
    """Spherical grains of a saturating or linear material in the Lorentz cavity.

    Parameters
    ----------
    chi : float
        Initial susceptibility of the grain's material [-], mu_r - 1.
    Ms : float or None
        Saturation magnetisation [A/m]; None for a linear material.
    """

    chi: float
    Ms: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.chi) and self.chi > 0.0):
            raise ValueError(f"`chi` = {self.chi} of the grains must be a finite number above 0 (iron: 100 to 5000)")
        if self.Ms is not None and not (math.isfinite(self.Ms) and self.Ms > 0.0):
            raise ValueError(
                f"`Ms` = {self.Ms} A/m of the grains must be above 0 (iron: 1.7e6 A/m), or None for a linear material"
            )

    @staticmethod
    def demagnetising_factors(phi: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, float]:
        """N against H_fe, N_B against B/mu_0, and dN_B/dphi [-], of the Lorentz cavity."""
        phi = np.asarray(phi, dtype=float)
        return (1.0 - phi) / 3.0, (1.0 + 2.0 * phi) / 3.0, 2.0 / 3.0

    def _against_flux(self, phi: np.ndarray | float, N: Factor) -> np.ndarray:
        """N_B = N + phi, of the Lorentz cavity where no N is given."""
        return self.demagnetising_factors(phi)[1] if N is None else np.asarray(N) + phi

    def field_inside(self, M: np.ndarray) -> np.ndarray:
        """See `ParticleLaw.field_inside`: M = chi Ms h/(Ms + chi h) turned round."""
        M = np.asarray(M, dtype=float)
        if self.Ms is None:
            return M / self.chi
        left = self.Ms - M
        return np.divide(M * self.Ms, self.chi * left, out=np.full_like(M, np.inf), where=left > 0.0)

    def _root(self, h: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Magnetisation M and dM/dh with H_in = h - N M."""
        if self.Ms is None:
            slope = self.chi / (1.0 + self.chi * N)
            return slope * h, slope + 0.0 * h
        a, x = self.chi * N * self.Ms, self.chi * h
        # The discriminant as a sum of squares, and the root as 2c/(b + d): no cancellation anywhere,
        # neither for N -> 0 nor for h -> 0 or far in saturation.
        d = np.sqrt((self.Ms + x - a) ** 2 + 4.0 * a * self.Ms)
        M = 2.0 * x * self.Ms / (self.Ms + x + a + d)
        return M, self.chi * (self.Ms - M) / d

    def magnetisation(self, H: np.ndarray, phi: np.ndarray | float) -> np.ndarray:
        """See `ParticleLaw.magnetisation`."""
        return self._root(np.asarray(H, dtype=float), self.demagnetising_factors(phi)[0])[0]

    def from_flux(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> tuple[np.ndarray, np.ndarray]:
        """See `ParticleLaw.from_flux`."""
        M, dM_dh = self._root(NU_0 * np.asarray(B, dtype=float), self._against_flux(phi, N))
        return M, NU_0 * dM_dh

    def flux_sensitivity(self, B: np.ndarray, phi: np.ndarray | float) -> np.ndarray:
        """See `ParticleLaw.flux_sensitivity`: dM = dM/dh (dh - M dN_B) along H_in = h - N_B M."""
        _, N_B, dN_B = self.demagnetising_factors(phi)
        M, dM_dh = self._root(NU_0 * np.asarray(B, dtype=float), N_B)
        return -dM_dh * M * dN_B

    def magnetisation_work(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> np.ndarray:
        """See `ParticleLaw.magnetisation_work`.

        M B - mu_0 integral of h dM, with h = N_B M + (Ms/chi) M/(Ms - M) from the quadratic.
        """
        B = np.asarray(B, dtype=float)
        N_B = self._against_flux(phi, N)
        M = self._root(NU_0 * B, N_B)[0]
        if self.Ms is None:
            return 0.5 * M * B
        m = M / self.Ms
        # small m: m + log(1 - m) cancels, its series does not
        log_part = np.where(m < 1e-3, m**2 * (0.5 + m * (1.0 / 3.0 + m * (0.25 + m * 0.2))), -(m + np.log1p(-m)))
        return M * B - MU_0 * (0.5 * N_B * M**2 + self.Ms**2 / self.chi * log_part)

    def chi_eff(self, phi: np.ndarray | float, H: np.ndarray) -> np.ndarray:
        """See `ParticleLaw.chi_eff`; at H = 0 the limit phi chi/(1 + chi N)."""
        H, phi = np.broadcast_arrays(np.asarray(H, dtype=float), np.asarray(phi, dtype=float))
        N = self.demagnetising_factors(phi)[0]
        M = self._root(H, N)[0]
        return phi * np.where(H > 0.0, M / np.where(H > 0.0, H, 1.0), self.chi / (1.0 + self.chi * N))


@dataclass(frozen=True, slots=True)
class ThesisLaw(GrainLaw):
    """M = chi H_fe, without demagnetisation and Lorentz field (Jurinic 2017), levelling off at Ms if given.

    Its chi is the thesis' effective «0.3 for a sphere», not the material's; one-body forces come out about
    ten times too small for iron.  A named option for comparison, never the default.
    """

    @staticmethod
    def demagnetising_factors(phi: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, float]:
        """N = 0 against H_fe; against B/mu_0 = H_fe + phi M it is phi."""
        phi = np.asarray(phi, dtype=float)
        return np.zeros_like(phi), phi, 1.0


@dataclass(frozen=True, slots=True)
class PowderLaw:
    """The powder as a continuum whose reluctivity depends on its fill: H = B/mu_0 - phi M(B, phi).

    Parameters
    ----------
    grain_law : ParticleLaw
        Law of the grains.
    """

    grain_law: ParticleLaw
    name: str = "powder"
    source: str = "grains in the Lorentz cavity (Maxwell Garnett, saturating)"

    def H_of_B(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B [T], solid fraction phi [-] and demagnetising factor N [-]."""
        M, dM_dB = self.grain_law.from_flux(B, phi, N)
        return NU_0 * B - phi * M, NU_0 - phi * dM_dB

    def of_H(
        self, H: np.ndarray, phi: np.ndarray | float, N: Factor = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """B/H and dB/dH - B/H [H/m], and the integral of B dH [J/m^3], at H [A/m], phi and N as in `H_of_B`.

        With H in the place of B/mu_0 a grain's factor is N instead of N + phi.
        """
        H, law = np.asarray(H, dtype=float), self.grain_law
        N = (law.demagnetising_factors(phi)[0] if N is None else N) - phi
        M, dM_dB = law.from_flux(MU_0 * H, phi, N)
        chi = np.where(H > 0.0, M / np.where(H > 0.0, H, 1.0), MU_0 * dM_dB)
        work = 0.5 * MU_0 * H**2 + phi * law.magnetisation_work(MU_0 * H, phi, N)
        return MU_0 * (1.0 + phi * chi), MU_0 * phi * (MU_0 * dM_dB - chi), work

    def dH_dphi(self, B: np.ndarray, phi: np.ndarray | float) -> np.ndarray:
        """Change of H with the fill at constant B [A/m]."""
        return -self.grain_law.from_flux(B, phi)[0] - phi * self.grain_law.flux_sensitivity(B, phi)

    def energy_density(self, B: np.ndarray, phi: np.ndarray | float, N: Factor = None) -> np.ndarray:
        """Integral of H dB from 0 to B at constant phi and N [J/m^3]."""
        return 0.5 * NU_0 * np.asarray(B, dtype=float) ** 2 - phi * self.grain_law.magnetisation_work(B, phi, N)
