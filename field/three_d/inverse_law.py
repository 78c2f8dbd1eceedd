"""B(H) of the magnetic laws, which are given as H(B), for the scalar potential.

B over H is a cubic Hermite spline through points of the law with the law's own slopes, bisected until it
agrees with the law to 1e-8; the co-energy density w* = integral of B dH is the spline's antiderivative.  So
energy, gradient and tangent of the discrete functional belong together to round-off, whatever the law, and
B grows with H: the functional is convex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from field.laws.reluctivity import MU_0, NU_0, Law, LinearLaw

_TOLERANCE = 1e-8  # of B: far below any field solution's error
_MAX_BISECTIONS = 24
# The spline ends here, where every law's slope is that of vacuum; beyond it continues straight.
_LAST_B = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class InverseLaw:
    """Piecewise cubic B(H), beyond its last break point straight.

    Attributes
    ----------
    B : PPoly
        [T] over H >= 0 [A/m].
    coenergy : PPoly
        Integral of B dH from 0 [J/m^3].
    """

    B: PPoly
    coenergy: PPoly

    @classmethod
    def of(cls, law: Law) -> InverseLaw:
        """Invert a law; exact for a linear one. Raises ValueError where H does not grow with B."""
        if isinstance(law, LinearLaw):
            line = PPoly(np.array([[MU_0 * law.mu_r], [0.0]]), np.array([0.0, 1.0]))
            return cls(line, line.antiderivative())
        B = np.concatenate((np.linspace(0.0, 3.0, 241), np.geomspace(3.0, _LAST_B, 41)[1:]))
        for _ in range(_MAX_BISECTIONS):
            H, slope = law.H_of_B(B)
            if np.any(np.diff(H) <= 0.0) or np.any(slope <= 0.0):
                raise ValueError(f"H of {law.name!r} does not grow with B everywhere; a scalar potential needs that")
            middle = 0.5 * (B[1:] + B[:-1])
            approximate = CubicHermiteSpline(H, B, 1.0 / slope)(law.H_of_B(middle)[0])
            coarse = np.abs(approximate - middle) > _TOLERANCE * np.maximum(middle, 1e-3)
            if not coarse.any():
                break
            B = np.sort(np.concatenate((B, middle[coarse])))
        H, slope = law.H_of_B(B)
        spline = CubicHermiteSpline(H, B, _monotone(H, B, 1.0 / slope))
        # one more piece, straight, which extrapolates itself
        last = 1.0 / slope[-1] if abs(slope[-1] / NU_0 - 1.0) > 1e-6 else MU_0
        spline = PPoly(spline.c, spline.x)
        spline.extend(np.array([[0.0], [0.0], [last], [B[-1]]]), np.array([2.0 * H[-1]]))
        return cls(spline, spline.antiderivative())

    def evaluate(self, H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At H >= 0 [A/m], of any shape: B/H (the initial slope at H = 0), dB/dH - B/H [H/m], coenergy [J/m^3]."""
        slope = self.B(H, 1)
        mu = np.where(H > 0.0, self.B(H) / np.where(H > 0.0, H, 1.0), slope)
        return mu, slope - mu, self.coenergy(H)


def _monotone(H: np.ndarray, B: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Slopes that keep each cubic growing (Fritsch and Carlson 1980); here a safeguard, hardly ever at work."""
    secant = np.diff(B) / np.diff(H)
    a, b = slope[:-1] / secant, slope[1:] / secant
    size = np.hypot(a, b)
    shrink = np.where(size > 3.0, 3.0 / np.where(size > 0.0, size, 1.0), 1.0)
    limit = np.minimum(np.append(shrink, 1.0), np.insert(shrink, 0, 1.0))
    return slope * limit
