"""Anhysteretic magnetisation after Langevin, M = Ms L(a), L(a) = coth a - 1/a, a = 3 chi H/Ms.

chi is the initial susceptibility, since L(a) = a/3 for small a.  The solver gives B: H is the root of
H + M(H) = B/mu_0, found by Newton.  M is concave in H, so that the iteration started at a lower bound of the root
(M <= chi H and M <= Ms each give one) climbs to it monotonically; it is clipped to the bracket all the same, for
round-off.  The energy is exact, from the co-energy:

    w = H B - integral of B dH = mu_0 (H^2/2 + Ms h (a L(a) - log(sinh(a)/a))),      h = Ms/(3 chi).

Source: P. Langevin, Annales de chimie et de physique 5 (1905) 70; as the anhysteretic curve of iron in D. C. Jiles
and D. L. Atherton, J. Magn. Magn. Mater. 61 (1986) 48.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field.laws.froehlich import check_saturating
from field.laws.reluctivity import MU_0, NU_0

# coth a - 1/a and its kin cancel for small a; six terms of their series are exact to 1e-16 below 0.1 (radius pi).
_SMALL = 0.1
_COTH_SERIES = (1 / 3, -1 / 45, 2 / 945, -1 / 4725, 2 / 93555, -1382 / 638512875)  # of a, a^3, a^5, ...
# Newton needs 5 to 12 steps from the lower bound at chi = 1 to 1e5; more than this is a defect.
_MAX_STEPS = 60


@dataclass(frozen=True, slots=True)
class LangevinLaw:
    """Initial susceptibility chi [-], saturation magnetisation Ms [A/m].

    Raises
    ------
    ValueError
        chi or Ms not above 0.
    """

    chi: float
    Ms: float
    name: str = "langevin"
    source: str = "Langevin"

    def __post_init__(self) -> None:
        check_saturating(self.chi, self.Ms, self.name)

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B [T]."""
        b = NU_0 * np.asarray(B, dtype=float)
        scale = self.Ms / (3.0 * self.chi)
        low = np.maximum(b - self.Ms, b / (1.0 + self.chi))
        H = low
        for _ in range(_MAX_STEPS):
            L, slope = _langevin(H / scale)
            step = (b - H - self.Ms * L) / (1.0 + 3.0 * self.chi * slope)
            new = np.clip(H + step, low, b)
            moved, H = np.abs(new - H), new
            # quadratic: after a step of 1e-9 the next one is below round-off
            if np.all(moved <= 1e-9 * H):
                break
        return H, NU_0 / (1.0 + 3.0 * self.chi * _langevin(H / scale)[1])

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Integral of H dB from 0 to B [J/m^3]."""
        H, _ = self.H_of_B(B)
        scale = self.Ms / (3.0 * self.chi)
        return MU_0 * (0.5 * H**2 + self.Ms * scale * _bound_energy(H / scale))


def _langevin(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L(a) and L'(a) = 1/a^2 - 1/sinh(a)^2 for a >= 0."""
    square = np.minimum(a, _SMALL) ** 2
    small, small_slope = np.zeros_like(square), np.zeros_like(square)
    for k in range(len(_COTH_SERIES), 0, -1):
        small = small * square + _COTH_SERIES[k - 1]
        small_slope = small_slope * square + (2 * k - 1) * _COTH_SERIES[k - 1]
    large = np.maximum(a, _SMALL)
    fading = np.exp(-2.0 * large)  # sinh itself overflows beyond 710
    L = np.where(a < _SMALL, small * a, (1.0 + fading) / (1.0 - fading) - 1.0 / large)
    return L, np.where(a < _SMALL, small_slope, 1.0 / large**2 - 4.0 * fading / (1.0 - fading) ** 2)


def _bound_energy(a: np.ndarray) -> np.ndarray:
    """a L(a) - log(sinh(a)/a) for a >= 0; a^2/6 for small a."""
    square = np.minimum(a, _SMALL) ** 2
    small = np.zeros_like(square)
    for k in range(len(_COTH_SERIES), 0, -1):
        small = small * square + (1.0 - 0.5 / k) * _COTH_SERIES[k - 1]
    large = np.maximum(a, _SMALL)
    fading = np.exp(-2.0 * large)
    # a coth a - a = 2 a fading/(1 - fading)
    large_part = 2.0 * large * fading / (1.0 - fading) - 1.0 - np.log1p(-fading) + np.log(2.0 * large)
    return np.where(a < _SMALL, small * square, large_part)
