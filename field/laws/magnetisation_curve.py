"""Saturating steels: H(B) as a monotone cubic spline, continued with the slope of vacuum.

Two ways into the spline of `field.laws.h_spline`: a measured table (`TableLaw`, monotone PCHIP of H over B, Fritsch
and Carlson 1980), and a fitted permeability mu_r(B) (`PermeabilityLaw`, the form of Modelica's FluxTubes).
Beyond the last point the material is saturated: M stays what it is and dH/dB = nu_0.  A table whose last points rise
more slowly than mu_0 H, as those of some published steels do, is taken as saturated from where that begins
(`last_before_tail`).  With a saturation polarisation J_s, J = B - mu_0 H goes from the last point (H_1, J_1) on to

    J = J_s - (J_s - J_1) exp(-(H - H_1)/h),    h such that dB/dH is continuous:

the exponential extrapolation of Umenei, Melikhov and Jiles, IEEE Trans. Magn. 47 (2011) 4707; dB/dH falls to mu_0 from
above.  The energy density is the spline's own antiderivative, so energy and H agree to round-off, which the energy line
search of Newton relies on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator, PPoly

from field.laws.h_spline import HSpline, SplineLaw
from field.laws.reluctivity import MU_0, NU_0

# Slope at a table's ends, at least, over that of the next interval.
_MIN_END = 0.1
# Beside the origin; fewer say nothing of the knee.
_MIN_POINTS = 3
# No material has a saturation polarisation of more (iron-cobalt: 2.45 T).
_MAX_POLARISATION = 3.0
_WEAK = 0.2  # polarisation [T] below that of any steel, and of most ferrites
_STEEPEST_STEEL, _STRONG = 4e4, 1.2  # largest relative permeability, grain-oriented, of what has this polarisation [T]

# A published table rounds its figures: a last slope 2 % under mu_0 is a rounding, not a fault.
SLOPE_ROUNDING = 0.02
# Points of the exponential approach to J_s, and its length over h: what is left of dB/dH - mu_0 is 6e-6 of its begin.
_APPROACH = np.linspace(0.0, 12.0, 61)[1:]

# A tail is what lies above this fraction of the largest B: nothing that ends a curve lower is saturation.
_SATURATION_FRACTION = 0.5


def too_flat(H: np.ndarray, B: np.ndarray) -> np.ndarray:
    """True for intervals of a curve (n,) [A/m], [T] rise more slowly than mu_0 H, beyond a rounding; bool (n-1,)."""
    return np.diff(B) < (1.0 - SLOPE_ROUNDING) * MU_0 * np.diff(H)


def last_before_tail(H: np.ndarray, B: np.ndarray) -> int | None:
    """Last point of a growing curve (n,) [A/m], [T] before a tail with dB/dH < mu_0; None where it has no such tail.

    Measured far in saturation, B - mu_0 H is a small difference of errors and may fall. It is a tail where the
    polarisation never gets above that of its first point again; a curve that rises once more after a flat interval
    is wrong in its middle, and none of saturation.
    """
    flat = too_flat(H, B)
    if not flat.any():
        return None
    last = int(np.argmax(flat))
    polarisation = B - MU_0 * H
    rounding = SLOPE_ROUNDING * MU_0 * (H[last + 1 :] - H[last])
    rises_again = np.any(polarisation[last + 1 :] > polarisation[last] + rounding)
    if rises_again or np.count_nonzero(H[: last + 1]) < _MIN_POINTS or B[last] < _SATURATION_FRACTION * B[-1]:
        return None
    return last


def _within_bounds(H: np.ndarray, B: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """dH/dB (n,) [A/(m T)] with which H(B) and, where the points do so, M(B) = B/mu_0 - H grow between all points.

    Fritsch and Carlson's bound for both: at most three times the slopes of the chords on both sides. That for H(B)
    comes first, at a kink from steep to saturated where no slope meets both.
    """
    chord = np.diff(H) / np.diff(B)
    most = 3.0 * np.minimum(np.append(chord, chord[-1]), np.append(chord[0], chord))
    rise = 3.0 * np.maximum(NU_0 - np.maximum(np.append(chord, chord[-1]), np.append(chord[0], chord)), 0.0)
    return np.minimum(np.clip(slope, NU_0 - rise, NU_0), most)


def _cubics(H: np.ndarray, B: np.ndarray, slope: np.ndarray) -> PPoly:
    """Cubics through the points with dH/dB (n,); at a kink each side keeps its own bound, and dH/dB jumps."""
    step = np.diff(B)
    chord = np.diff(H) / step
    least, most = NU_0 - 3.0 * np.maximum(NU_0 - chord, 0.0), np.minimum(3.0 * chord, NU_0)
    begin, end = np.clip(slope[:-1], least, most), np.clip(slope[1:], least, most)
    bend = (begin + end - 2.0 * chord) / step
    return PPoly(np.array([bend / step, (chord - begin) / step - bend, begin, H[:-1]]), B)


def _approach(
    H: np.ndarray, B: np.ndarray, slope: np.ndarray, J_s: float, name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H, B and dH/dB with the points of the exponential approach to J_s [T] after the last one."""
    left, rise = J_s - (B[-1] - MU_0 * H[-1]), 1.0 / slope[-1] - MU_0
    if not (left > 0.0 and rise > 0.0):
        raise ValueError(
            f"`J_s` = {J_s:g} T of {name!r} cannot be approached from the table's end, where B - mu_0 H = "
            f"{J_s - left:.4g} T and dB/dH = {1.0 / slope[-1]:.4g} H/m: give a larger J_s, or leave out points beyond "
            f"which dB/dH is not above mu_0 = {MU_0:.4g} H/m"
        )
    part = np.exp(-_APPROACH)
    beyond = H[-1] + left / rise * _APPROACH
    return (
        np.append(H, beyond),
        np.append(B, J_s - left * part + MU_0 * beyond),
        np.append(slope, 1.0 / (MU_0 + rise * part)),
    )


def _too_permeable(H: np.ndarray, B: np.ndarray) -> str:
    """A warning of a strong magnet's curve that rises as no steel's does; empty of another."""
    ratio = float((B[1:] / H[1:]).max()) / MU_0
    if ratio < _STEEPEST_STEEL or B[-1] - MU_0 * H[-1] < _STRONG:
        return ""
    return f"the relative permeability reaches {ratio:.2g}, that of steels 40 000 at most; is H in Oe?"


def _too_weak(J: float) -> str:
    """A warning of a saturation polarisation [T] below that of any steel."""
    return f"J_s = {J:.2g} T; steels have 1 to 2.4 T: check the unit of B" if J < _WEAK else ""


@dataclass(frozen=True, slots=True)
class TableLaw(SplineLaw):
    """A measured magnetisation curve: H grows with B, and dB/dH is not below mu_0, up to the rounding of a table.

    dB/dH is continuous but at kinks of coarse tables, from a steep interval to one near the slope of vacuum, and at
    the end of a table without `J_s`.

    Parameters
    ----------
    H : ndarray (n,)
        Field strength [A/m], strictly growing; the point (0, 0) is added where it is missing.
    B : ndarray (n,)
        Flux density [T], strictly growing.
    name, source : str
        For messages and tables.
    J_s : float or None
        Saturation polarisation [T] that the curve approaches beyond its last point; None: it is that of this point.

    Attributes
    ----------
    H, B : ndarray
        The points of the table that the curve goes through: the origin first, without a tail in which dB/dH is below
        mu_0.
    left_out : int
        Points of a tail in which dB/dH is below mu_0; the slope of vacuum replaces it.
    warning : str
        The tail that is left out, a permeability beyond and a J_s below that of any steel; empty of others.

    Raises
    ------
    ValueError
        Fewer than four points, a curve that does not grow, or one with dB/dH below mu_0 before its saturation (no
        material: usually M or mu_0 M was entered as B), or not below J_s at its end.
    """

    H: np.ndarray
    B: np.ndarray
    name: str = "table"
    source: str = "a table of the user"
    J_s: float | None = None
    curve: HSpline = field(init=False, repr=False)
    left_out: int = field(init=False, repr=False, default=0)
    warning: str = field(init=False, repr=False, default="")

    def __post_init__(self) -> None:
        H = np.atleast_1d(np.asarray(self.H, dtype=float))
        B = np.atleast_1d(np.asarray(self.B, dtype=float))
        self._check_shape(H, B)
        if H[0] > 0.0 and B[0] > 0.0:
            H, B = np.concatenate(([0.0], H)), np.concatenate(([0.0], B))
        self._check_curve(H, B)
        warnings = [_too_permeable(H, B), _too_weak(float((B - MU_0 * H).max()))]
        last = last_before_tail(H, B)
        if last is not None:
            left_out = len(H) - 1 - last
            lowest = float((np.diff(B) / np.diff(H))[last:].min())
            warnings.append(
                f"the last {left_out} point{'s' * (left_out > 1)} of the table, from H = {H[last + 1]:g} A/m on, "
                f"{'are' if left_out > 1 else 'is'} not used: dB/dH falls to {lowest:.3g} H/m there, below "
                f"mu_0 = {MU_0:.4g} H/m; from H = {H[last]:g} A/m, B = {B[last]:g} T on the curve has the slope of "
                "vacuum; check that B, not J = B - mu_0 H, is given, and the unit of H"
            )
            H, B = H[: last + 1], B[: last + 1]
            object.__setattr__(self, "left_out", left_out)
        object.__setattr__(self, "warning", "; ".join(filter(None, warnings)))
        object.__setattr__(self, "H", H)
        object.__setattr__(self, "B", B)
        slope = PchipInterpolator(B, H).derivative()(B)
        # PCHIP's rule for the ends gives 0 next to an interval three times as steep: mu_r would be infinite there
        slope[0] = max(slope[0], _MIN_END * H[1] / B[1])
        slope[-1] = max(slope[-1], _MIN_END * (H[-1] - H[-2]) / (B[-1] - B[-2]))
        slope = _within_bounds(H, B, slope)
        if self.J_s is not None:
            H, B, slope = _approach(H, B, slope, self.J_s, self.name)
        object.__setattr__(self, "curve", HSpline.through(_cubics(H, B, slope)))

    def _check_shape(self, H: np.ndarray, B: np.ndarray) -> None:
        if H.ndim != 1 or H.shape != B.shape:
            raise ValueError(
                f"the table of {self.name!r} has {H.size} values of H and {B.size} of B; "
                "give one B [T] for each H [A/m]"
            )
        if not (np.all(np.isfinite(H)) and np.all(np.isfinite(B))):
            raise ValueError(f"the table of {self.name!r} holds a value that is not a finite number")
        if np.count_nonzero(H) < _MIN_POINTS:
            raise ValueError(
                f"the table of {self.name!r} has {np.count_nonzero(H)} points besides the "
                f"origin; a curve needs at least {_MIN_POINTS}, better 10 up to saturation"
            )

    def _check_curve(self, H: np.ndarray, B: np.ndarray) -> None:
        if H[0] != 0.0 or B[0] != 0.0:
            raise ValueError(
                f"the table of {self.name!r} starts at H = {H[0]:g} A/m, B = {B[0]:g} T; it "
                "must start at the origin (no hysteresis here: give the virgin curve)"
            )
        dH, dB = np.diff(H), np.diff(B)
        for values, step, symbol, unit in ((H, dH, "H", "A/m"), (B, dB, "B", "T")):
            if np.any(step <= 0.0):
                i = int(np.argmax(step <= 0.0))
                raise ValueError(
                    f"the table of {self.name!r} is not monotone: {symbol} goes from "
                    f"{values[i]:g} to {values[i + 1]:g} {unit} (points {i + 1} and {i + 2}); "
                    "sort it and remove repeated points"
                )
        polarisation = B - MU_0 * H
        if polarisation.max() > _MAX_POLARISATION:
            i = int(np.argmax(polarisation))
            raise ValueError(
                f"the table of {self.name!r} has B - mu_0 H = {polarisation[i]:.3g} T at H = {H[i]:g} A/m; no material "
                f"has more than {_MAX_POLARISATION:g} T: check the unit of B (mT, G?), or whether H and B are exchanged"
            )
        flat = too_flat(H, B)
        if np.any(flat) and last_before_tail(H, B) is None:
            i = int(np.argmax(flat))
            raise ValueError(
                f"the table of {self.name!r} has dB/dH = {dB[i] / dH[i]:.3g} H/m between "
                f"H = {H[i]:g} and {H[i + 1]:g} A/m, below mu_0 = {MU_0:.4g} H/m: no material "
                "does that; check the units and that B, not M or mu_0 M, is given"
            )


@dataclass(frozen=True, slots=True)
class PermeabilityLaw(SplineLaw):
    """A fitted permeability, mu_r(B) = 1 + (mu_i - 1 + c_a b)/(1 + c_b b + b^n), b = B/B_m.

    Source of the form: Modelica Standard Library, Magnetic.FluxTubes.Material.SoftMagnetic (Roschke).
    The fitted magnetisation M = (1 - 1/mu_r) B/mu_0 falls again far in saturation, which no steel does:
    from its maximum on M is constant and the slope is nu_0.

    Parameters
    ----------
    mu_i : float
        Initial relative permeability [-].
    B_m : float
        Flux density that scales the fit [T].
    c_a, c_b, n : float
        Coefficients of the fit [-].
    """

    mu_i: float
    B_m: float
    c_a: float
    c_b: float
    n: float
    name: str = "fitted permeability"
    source: str = "a fit of the user"
    curve: HSpline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (self.mu_i > 1.0 and self.B_m > 0.0 and min(self.c_a, self.c_b) >= 0.0 and self.n > 1.0):
            raise ValueError(
                f"the permeability of {self.name!r} needs mu_i > 1, B_m > 0 T, c_a >= 0, "
                "c_b >= 0 and n > 1; "
                f"got {self.mu_i}, {self.B_m}, {self.c_a}, {self.c_b}, {self.n}"
            )
        # Quadratic spacing: b = 0 is where mu_r rises fastest (DC01: from 5 to 1000 within 0.2 T).
        B = self.saturation_B() * np.linspace(0.0, 1.0, 600) ** 2
        H, slope = self._fit(B)
        slope = np.minimum(slope, NU_0)  # the last one, where M is largest, to the spacing in which it was looked for
        if np.any(slope <= 0.0):
            at = B[int(np.argmax(slope <= 0.0))]
            raise ValueError(
                f"the permeability of {self.name!r} makes H fall with B at {at:.3g} T; lower c_a or raise mu_i"
            )
        object.__setattr__(self, "curve", HSpline.through(CubicHermiteSpline(B, H, slope)))

    def mu_r(self, B: np.ndarray) -> np.ndarray:
        """The fit itself [-], B in T."""
        b = np.asarray(B, dtype=float) / self.B_m
        return 1.0 + (self.mu_i - 1.0 + self.c_a * b) / (1.0 + self.c_b * b + b**self.n)

    def _fit(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        b = B / self.B_m
        top, bottom = self.mu_i - 1.0 + self.c_a * b, 1.0 + self.c_b * b + b**self.n
        mu_r = 1.0 + top / bottom
        dmu_dB = (self.c_a - top / bottom * (self.c_b + self.n * b ** (self.n - 1.0))) / bottom / self.B_m
        return B / (MU_0 * mu_r), (1.0 - B * dmu_dB / mu_r) / (MU_0 * mu_r)

    def saturation_B(self) -> float:
        """Flux density from which M is constant: the maximum of the fitted M [T]."""
        B = np.linspace(0.0, 20.0 * self.B_m, 200_001)
        H, _ = self._fit(B)
        return float(B[np.argmax(B / MU_0 - H)])
