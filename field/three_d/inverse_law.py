"""B(H) of the magnetic laws, which are given as H(B), for the scalar potential.

B over H is a cubic Hermite spline through points of the law with the law's own slopes, bisected until it
agrees with the law to 1e-8; the co-energy density w* = integral of B dH is the spline's antiderivative.  So
energy, gradient and tangent of the discrete functional belong together to round-off, whatever the law, and
B grows with H: the functional is convex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.interpolate import CubicHermiteSpline

from field.laws.reluctivity import MU_0, NU_0, Law, LinearLaw

_TOLERANCE = 1e-8  # of B: far below any field solution's error
_MAX_BISECTIONS = 24
# The spline ends here, where every law's slope is that of vacuum; beyond it continues straight.
_LAST_B = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class InverseLaw:
    """Piecewise cubic B(H) on [0, H_last], then straight.

    Attributes
    ----------
    H : ndarray (m+1,)
        Break points [A/m], from 0.
    coefficients : ndarray (m, 4)
        Cubic of each interval in (H - H_i), lowest power first [T].
    coenergy : ndarray (m+1,)
        Integral of B dH at the break points [J/m^3].
    last_slope : float
        dB/dH beyond the last break point [H/m].
    """

    H: np.ndarray
    coefficients: np.ndarray
    coenergy: np.ndarray
    last_B: float
    last_slope: float

    @classmethod
    def of(cls, law: Law) -> InverseLaw:
        """Invert a law; exact for a linear one."""
        if isinstance(law, LinearLaw):
            mu = MU_0 * law.mu_r
            return cls(np.array([0.0, 1.0]), np.array([[0.0, mu, 0.0, 0.0]]), np.array([0.0, 0.5 * mu]), mu, mu)
        B = np.concatenate((np.linspace(0.0, 3.0, 241), np.geomspace(3.0, _LAST_B, 41)[1:]))
        for _ in range(_MAX_BISECTIONS):
            H, slope = law.H_of_B(B)
            if np.any(np.diff(H) <= 0.0) or np.any(slope <= 0.0):
                raise ValueError(f"H of {law.name!r} does not grow with B everywhere; a scalar potential needs that")
            middle = 0.5 * (B[1:] + B[:-1])
            found = CubicHermiteSpline(H, B, 1.0 / slope)(law.H_of_B(middle)[0])
            coarse = np.abs(found - middle) > _TOLERANCE * np.maximum(middle, 1e-3)
            if not coarse.any():
                break
            B = np.sort(np.concatenate((B, middle[coarse])))
        H, slope = law.H_of_B(B)
        spline = CubicHermiteSpline(H, B, _monotone(H, B, 1.0 / slope))
        return cls(
            np.array(spline.x),
            np.ascontiguousarray(spline.c[::-1].T),
            spline.antiderivative()(spline.x),
            float(B[-1]),
            float(1.0 / slope[-1]) if abs(slope[-1] / NU_0 - 1.0) > 1e-6 else MU_0,
        )

    def B_of_H(self, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """B [T] and dB/dH [H/m] at H >= 0 [A/m], shape (n,)."""
        mu, excess, _ = MaterialTable([self]).evaluate(np.column_stack((H, 0.0 * H, 0.0 * H)), *_one_element(H))
        return mu * H, mu + excess

    def coenergy_density(self, H: np.ndarray) -> np.ndarray:
        """Integral of B dH from 0 to H [J/m^3], shape (n,)."""
        return MaterialTable([self]).evaluate(np.column_stack((H, 0.0 * H, 0.0 * H)), *_one_element(H))[2]


def _one_element(H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0, len(H)]), np.array([0])


def _monotone(H: np.ndarray, B: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Slopes that keep each cubic growing (Fritsch and Carlson 1980); here a safeguard, hardly ever at work."""
    secant = np.diff(B) / np.diff(H)
    a, b = slope[:-1] / secant, slope[1:] / secant
    size = np.hypot(a, b)
    shrink = np.where(size > 3.0, 3.0 / np.where(size > 0.0, size, 1.0), 1.0)
    limit = np.minimum(np.append(shrink, 1.0), np.insert(shrink, 0, 1.0))
    return slope * limit


class MaterialTable:
    """All inverse laws of a problem in flat arrays, evaluated at quadrature points.

    Parameters
    ----------
    laws : sequence of InverseLaw
        Addressed by their position.
    """

    def __init__(self, laws: Sequence[InverseLaw]) -> None:
        self._first = np.concatenate(([0], np.cumsum([len(law.H) for law in laws]))).astype(np.int64)
        self._H = np.concatenate([law.H for law in laws])
        self._coenergy = np.concatenate([law.coenergy for law in laws])
        # beyond the last point: one more, straight, row
        self._coefficients = np.concatenate(
            [np.vstack((law.coefficients, (law.last_B, law.last_slope, 0.0, 0.0))) for law in laws]
        )

    def evaluate(
        self, H: np.ndarray, start: np.ndarray, material: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Permeability, what the tangent adds along H, and co-energy density.

        Parameters
        ----------
        H : ndarray (n, 3)
            [A/m]
        start : ndarray (n_elements + 1,)
            First point of each element.
        material : ndarray (n_elements,)
            Law of each element.

        Returns
        -------
        mu : ndarray (n,)
            B/H [H/m]; at H = 0 the initial slope.
        excess : ndarray (n,)
            dB/dH - B/H [H/m].
        coenergy : ndarray (n,)
            [J/m^3]
        """
        mu, excess, coenergy = np.empty(len(H)), np.empty(len(H)), np.empty(len(H))
        _evaluate(H, start, material, self._first, self._H, self._coefficients, self._coenergy, mu, excess, coenergy)
        return mu, excess, coenergy


@njit(cache=True, error_model="numpy", nogil=True)
def _evaluate(H, start, material, first, breaks, coefficients, energy, mu, excess, coenergy):
    for e in range(start.size - 1):
        base, end = first[material[e]], first[material[e] + 1]
        for q in range(start[e], start[e + 1]):
            h = np.sqrt(H[q, 0] * H[q, 0] + H[q, 1] * H[q, 1] + H[q, 2] * H[q, 2])
            low, high = base, end
            while high - low > 1:
                middle = (low + high) >> 1
                if breaks[middle] <= h:
                    low = middle
                else:
                    high = middle
            t = h - breaks[low]
            c0, c1 = coefficients[low, 0], coefficients[low, 1]
            c2, c3 = coefficients[low, 2], coefficients[low, 3]
            slope = c1 + t * (2.0 * c2 + t * 3.0 * c3)
            if h > 0.0:
                mu[q] = (c0 + t * (c1 + t * (c2 + t * c3))) / h
            else:
                mu[q] = slope
            excess[q] = slope - mu[q]
            coenergy[q] = energy[low] + t * (c0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
