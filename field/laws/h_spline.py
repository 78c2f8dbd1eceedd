"""H(B) as a monotone cubic spline, continued with the slope of vacuum: the representation that kernels know.

The energy density is the spline's own antiderivative, so energy and H agree to round-off, which the energy line search
of Newton relies on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.interpolate import PPoly

from field.laws.reluctivity import NU_0
from geometry.kernels.device_functions import device_function


@dataclass(frozen=True, slots=True)
class HSpline:
    """Piecewise cubic H(B) on [0, B_last] with its antiderivative, then slope nu_0.

    Attributes
    ----------
    B : ndarray (m+1,)
        Break points [T], from 0.
    coefficients : ndarray (4, m)
        Cubic of each interval in (B - B_i), highest power first [A/m].
    energy : ndarray (m+1,)
        Energy density at the break points [J/m^3].
    H_last : float
        Field strength at the last break point [A/m].
    """

    B: np.ndarray
    coefficients: np.ndarray
    energy: np.ndarray
    H_last: float

    @classmethod
    def through(cls, spline: PPoly) -> HSpline:
        """Take over a scipy spline of cubics."""
        energy = spline.antiderivative()(spline.x)
        return cls(np.array(spline.x), np.array(spline.c), energy, float(spline(spline.x[-1])))

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB [A/(m T)] at B >= 0 [T]."""
        B = np.asarray(B, dtype=float)
        H, slope = np.empty(B.shape), np.empty(B.shape)
        _evaluate(np.ravel(B), self.B, self.coefficients, self.H_last, NU_0, H.reshape(-1), slope.reshape(-1))
        return H, slope

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """Integral of H dB from 0 [J/m^3]."""
        B = np.asarray(B, dtype=float)
        w = np.empty(B.shape)
        _integrate(B.reshape(-1), self.B, self.coefficients, self.energy, self.H_last, NU_0, w.reshape(-1))
        return w


class SplineLaw:
    """A law that is a spline, its `curve`."""

    __slots__ = ()
    curve: HSpline

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Law.H_of_B`."""
        return self.curve.H_of_B(B)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """See `Law.energy_density`."""
        return self.curve.energy_density(B)


@device_function(error_model="numpy")
def _interval(B, breaks, last):
    """Index of the interval that holds B, by bisection; `last` is tried first (neighbours in an element are alike)."""
    if breaks[last] <= B and (last == breaks.size - 2 or B < breaks[last + 1]):
        return last
    low, high = 0, breaks.size - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if breaks[middle] <= B:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, error_model="numpy", nogil=True)
def _evaluate(B, breaks, coefficients, H_last, nu_0, H, slope):
    i, end = 0, breaks[-1]
    for k in range(B.size):
        if B[k] > end:
            H[k], slope[k] = H_last + nu_0 * (B[k] - end), nu_0
            continue
        i = _interval(B[k], breaks, i)
        c3, c2, c1, c0 = coefficients[0, i], coefficients[1, i], coefficients[2, i], coefficients[3, i]
        t = B[k] - breaks[i]
        H[k] = ((c3 * t + c2) * t + c1) * t + c0
        slope[k] = (3.0 * c3 * t + 2.0 * c2) * t + c1


@njit(cache=True, error_model="numpy", nogil=True)
def _integrate(B, breaks, coefficients, energy, H_last, nu_0, w):
    i, end = 0, breaks[-1]
    for k in range(B.size):
        if B[k] > end:
            beyond = B[k] - end
            w[k] = energy[-1] + beyond * (H_last + 0.5 * nu_0 * beyond)
            continue
        i = _interval(B[k], breaks, i)
        c3, c2, c1, c0 = coefficients[0, i], coefficients[1, i], coefficients[2, i], coefficients[3, i]
        t = B[k] - breaks[i]
        w[k] = energy[i] + t * (c0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
