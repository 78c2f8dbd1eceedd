"""H(B) as a monotone cubic spline, continued with the slope of vacuum: the representation that kernels know.

The energy density is the spline's own antiderivative, so energy and H agree to round-off, which the energy line search
of Newton relies on. Any law becomes one, sampled as closely as wanted (`spline_of`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.interpolate import CubicHermiteSpline, PPoly

from field.laws.reluctivity import NU_0, Law, LinearLaw
from geometry.kernels.device_functions import device_function

# Cubics of a sampled law: 1e-6 takes 50 to 150 for the laws here, 1e-9 up to a thousand.
_MAX_INTERVALS = 20_000
# Where a sampled law is compared with its cubic: off the middle as well, where a symmetric error would hide.
_PROBES = np.array([0.25, 0.5, 0.8])
# Field strength [A/m] from which downwards the error counts against this one: far below the earth's 40 A/m.
_MIN_H = 1e-3


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


def spline_of(law: Law, tolerance: float = 1e-6) -> HSpline:
    """Any law as the one spline of this module.

    A table and a fitted permeability are such splines already and are returned as they are; a linear law is one
    interval; any other is sampled with its exact slopes, and bisected until H agrees.

    Parameters
    ----------
    law : Law
    tolerance : float
        Allowed error of H relative to H, for every B >= 0 [-]; 1e-12 to 1e-2.

    Raises
    ------
    ValueError
        A tolerance out of range, a law that does not grow, or one that needs more than 20 000 intervals (it jumps).
    """
    if not 1e-12 <= tolerance <= 1e-2:
        raise ValueError(f"`tolerance` = {tolerance:g}: allowed are 1e-12 to 1e-2; the default is 1e-6")
    if isinstance(own := getattr(law, "curve", None), HSpline):
        return own
    if isinstance(law, LinearLaw):
        return _linear_spline(law.mu_r)
    B = np.linspace(0.0, _saturation_flux_density(law, tolerance), 9)
    while True:
        H, slope = law.H_of_B(B)
        if np.any(slope <= 0.0) or np.any(np.diff(H) <= 0.0):
            raise ValueError(f"H of {law.name!r} does not grow with B everywhere: not a law that can be solved with")
        coarse = _too_coarse(law, B, H, slope, tolerance)
        if not np.any(coarse):
            return HSpline.through(CubicHermiteSpline(B, H, slope))
        if B.size > _MAX_INTERVALS:
            raise ValueError(
                f"{law.name!r} needs more than {_MAX_INTERVALS} cubics for H to within {tolerance:g}: "
                "its slope jumps or is not that of H; raise `tolerance`, or correct the law"
            )
        middles = 0.5 * (B[:-1] + B[1:])[coarse]
        B = np.sort(np.concatenate((B, middles)))


def _linear_spline(mu_r: float) -> HSpline:
    """H = B/(mu_0 mu_r) on an interval that no field leaves: beyond it the slope would be that of vacuum."""
    end = 1e6  # [T]
    nu = NU_0 / mu_r
    return HSpline(
        np.array([0.0, end]), np.array([[0.0], [0.0], [nu], [0.0]]), np.array([0.0, 0.5 * nu * end**2]), nu * end
    )


def _saturation_flux_density(law: Law, tolerance: float) -> float:
    """Flux density [T] from which H continues with slope nu_0, to within half the tolerance."""
    end = 0.25
    while end < 1e6:
        start = float(law.H_of_B(np.array([end]))[0][0])
        B = end * np.logspace(0.02, 6.0, 60)
        H = law.H_of_B(B)[0]
        if np.all(np.abs(start + NU_0 * (B - end) - H) <= 0.5 * tolerance * H):
            return end
        end *= 1.25
    raise ValueError(f"{law.name!r} does not saturate: its slope does not reach that of vacuum, nu_0 = {NU_0:.4g} m/H")


def _too_coarse(law: Law, B: np.ndarray, H: np.ndarray, slope: np.ndarray, tolerance: float) -> np.ndarray:
    """Mark intervals whose cubics are off by more than the tolerance, or may not be monotone; shape (m,)."""
    width, spline = np.diff(B), CubicHermiteSpline(B, H, slope)
    points = B[:-1, None] + width[:, None] * _PROBES
    exact = law.H_of_B(points)[0]
    off = np.abs(spline(points) - exact) > 0.7 * tolerance * np.maximum(exact, _MIN_H)
    # Fritsch and Carlson: end slopes of at most three times the chord's make a cubic monotone
    chord = 3.0 * np.diff(H) / width
    return off.any(axis=1) | (slope[:-1] > chord) | (slope[1:] > chord)
