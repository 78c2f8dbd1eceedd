"""Fit of contact parameters to a measured torque curve: response surface, least squares, profile intervals, valley.

The torque T(p, x) of simulated points, p the parameters and x the drive (a current), is interpolated: at each simulated
drive a polynomial of ln T, of second order where a parameter has three values or more and of first order where it has
two, with all products of two parameters; between the drives a natural cubic spline of ln T in ln x. Measured torques
T_i at x_i give

    S(p) = sum_i [(ln T_i - ln T(p, x_i))/s_i]^2,    s_i^2 = (error_i/T_i)^2 + (scatter of the surface)^2,

which `scipy.optimize.least_squares` minimises within the range of the simulated points: nothing is extrapolated. Where
no errors of the measurement are known, s_i is the scatter that S itself leaves, S_min/(n - k).

**Intervals** are profiles: for each value of a parameter the others are fitted again, and what lies within

    S <= S_min + 3.84   or, with unknown errors,   S <= S_min [1 + F(1, n - k; 95 %)/(n - k)]

is the 95 % interval (D. M. Bates, D. G. Watts, Nonlinear Regression Analysis, 1988, chapter 6). An interval that
reaches the end of the range says that the data do not bound the parameter there. The fitted others along the profile
are the valley: parameters that the data cannot tell apart, as friction and rolling friction, which both make a powder
stronger.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.stats import chi2, f

from emclutch.results.errors import OutputError
from emclutch.results.measured_table import TORQUE_CURVE, read_measured

Residual = Callable[[np.ndarray], np.ndarray | float]
PROFILE = 33
"""Values of a parameter that its profile is computed at."""
LEVEL = 0.95
POOR = 0.01
"""Probability of a sum of squares this large, below which no parameters fit."""
Z = 1.96
"""Half width of a normal distribution's 95 % interval, in standard errors."""
STEP = 1e-3
"""Of a parameter's range, for differences."""
SMALLEST_SCATTER = 1e-3
"""Of ln T: a surface through all of its points is not exact between them."""


@dataclass(frozen=True, slots=True)
class SimulatedTorques:
    """Torques of simulated points.

    Attributes
    ----------
    names : tuple of str
        The k parameters.
    parameters : ndarray, shape (n, k)
    drive, torque, error : ndarray, shape (n,)
        Drive [SI], torque [N m] above 0, its standard error [N m].
    """

    names: tuple[str, ...]
    parameters: np.ndarray
    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray


@dataclass(frozen=True, slots=True)
class MeasuredTorques:
    """A measured curve.

    Attributes
    ----------
    drive, torque : ndarray, shape (n,)
        Drive [SI], torque [N m], above 0.
    error : ndarray, shape (n,), or None
        Standard errors [N m]; None: unknown.
    """

    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray | None = None


def read_torques(path: str | Path, unit: str) -> tuple[MeasuredTorques, int]:
    """Read a curve, and how many of its points are left out: those with a drive or a torque of 0.

    Parameters
    ----------
    path : of a table as of `read_measured`, with the drive in the first column, one column of torques, and their
        standard errors in one that is named "error [N m]", or no errors. All names have their units.
    unit : of the drive that is returned.

    Raises
    ------
    OutputError
        As `read_measured`; several curves; errors that are not above 0; no point with a drive and a torque above 0.
    """
    curves = read_measured(path, f"drive [{unit}]" if unit else "drive", TORQUE_CURVE[1])
    if len(curves) > 1:
        raise OutputError(
            f"{path} has {len(curves)} columns of torques, {', '.join(curves)}; leave one, and name the "
            "column of standard errors 'error [N m]'"
        )
    (points,) = curves.values()
    used = points[(points[:, :2] > 0.0).all(axis=1)]  # both are fitted by their logarithms
    if not len(used):
        raise OutputError(f"{path} has no point with a drive and a torque above 0")
    if not (used[:, 2:] > 0.0).all():
        raise OutputError(f"{path} has points without an error above 0; give all points one, or leave the column out")
    return MeasuredTorques(*used.T), len(points) - len(used)


class ResponseSurface:
    """ln T of simulated points, between them (see the module).

    Attributes
    ----------
    low, high : ndarray, shape (k,)
        Range of each parameter.
    drives : ndarray, shape (m,)
        Ascending.
    scatter : float
        Standard deviation of ln T of the points from the surface, and of their own errors.

    Raises
    ------
    ValueError
        A parameter with one value only, too few points at a drive, a torque that is not above 0.
    """

    def __init__(self, simulated: SimulatedTorques) -> None:
        p, log_torque = simulated.parameters, np.log(np.where(simulated.torque > 0.0, simulated.torque, np.nan))
        if not np.isfinite(log_torque).all():
            raise ValueError("a simulated point has no torque above 0; leave its drive or its parameters out")
        self.low, self.high = p.min(axis=0), p.max(axis=0)
        for name, low, high in zip(simulated.names, self.low, self.high, strict=True):
            if low == high:
                raise ValueError(f"{name} has one value only, {low:g}; give two or more, or do not fit it")
        self.drives = np.unique(simulated.drive)
        self._curved = np.array([len(np.unique(column)) > 2 for column in p.T])
        terms = self._terms(self._scaled(p))
        self._coefficients, rest, free = [], 0.0, 0
        for drive in self.drives:
            here = simulated.drive == drive
            if here.sum() < terms.shape[1]:
                raise ValueError(
                    f"{here.sum()} points at a drive of {drive:g} are too few for {terms.shape[1]} terms of the surface"
                )
            found, *_ = np.linalg.lstsq(terms[here], log_torque[here], rcond=None)
            self._coefficients.append(found)
            rest += float(np.sum((log_torque[here] - terms[here] @ found) ** 2))
            free += int(here.sum()) - terms.shape[1]
        own = float(np.mean((simulated.error / simulated.torque) ** 2))
        self.scatter = max(np.sqrt(max(rest / free if free else 0.0, own)), SMALLEST_SCATTER)

    def _scaled(self, p: np.ndarray) -> np.ndarray:
        return (p - self.low) / (self.high - self.low)

    def _terms(self, u: np.ndarray) -> np.ndarray:
        """Columns 1, u_a, u_a^2 of parameters with three values, u_a u_b."""
        squares = [u[:, a] ** 2 for a in np.flatnonzero(self._curved)]
        products = [u[:, a] * u[:, b] for a, b in combinations(range(u.shape[1]), 2)]
        return np.column_stack([np.ones(len(u)), u, *squares, *products])

    def log_torque_at(self, drive: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function of parameters (k,) that is ln T (n,) at drives (n,)."""
        if len(self.drives) == 1:
            weights = np.ones((len(drive), 1))
        else:  # the spline is linear in its knots: one matrix serves all parameters
            weights = CubicSpline(np.log(self.drives), np.eye(len(self.drives)), bc_type="natural")(np.log(drive))
        linear = weights @ np.array(self._coefficients)
        return lambda p: linear @ self._terms(self._scaled(p)[None])[0]


@dataclass(frozen=True, slots=True)
class FittedParameter:
    """One parameter of a fit.

    Attributes
    ----------
    name : str
    value, low, high : float
        Best value; ends of the 95 % interval, within the range that was simulated.
    bounded : tuple of 2 bool
        Whether the data, and not the range, set each end.
    """

    name: str
    value: float
    low: float
    high: float
    bounded: tuple[bool, bool]


@dataclass(frozen=True, slots=True)
class TorqueFit:
    """A fit.

    Attributes
    ----------
    parameters : tuple of FittedParameter
    valley : ndarray, shape (m, k)
        Best parameters for each value of the first one that the data allow (95 %).
    torque, low, high : ndarray, shape (n,)
        At the measured drives [N m]: of the best parameters, and its 95 % band by linear propagation.
    sum_of_squares : float
        S_min.
    degrees_of_freedom : int
        n - k.
    probability : float or None
        Of an S this large, if the model is right; None where the errors of the measurement are unknown.
    scatter : float
        Standard deviation of ln(T measured/T fitted).
    """

    parameters: tuple[FittedParameter, ...]
    valley: np.ndarray
    torque: np.ndarray
    low: np.ndarray
    high: np.ndarray
    sum_of_squares: float
    degrees_of_freedom: int
    probability: float | None
    scatter: float

    @property
    def is_poor(self) -> bool:
        """True if no parameters within the range fit the measured curve within its errors."""
        return self.probability is not None and self.probability < POOR


def fit_torque(
    simulated: SimulatedTorques, measured: MeasuredTorques, bulk_friction: Residual | None = None
) -> TorqueFit:
    """Fit the parameters of simulated points to a measured curve.

    Parameters
    ----------
    simulated, measured
    bulk_friction : callable, optional
        Takes parameters (k,) and returns one more residual in standard errors, of something else that was measured.

    Raises
    ------
    ValueError
        As of `ResponseSurface`; fewer measured torques than parameters and one; a drive outside of those simulated.
    """
    surface, k = ResponseSurface(simulated), len(simulated.names)
    first, last = surface.drives[0] * (1.0 - 1e-9), surface.drives[-1] * (1.0 + 1e-9)
    if not ((measured.drive >= first) & (measured.drive <= last)).all():
        raise ValueError(
            f"drives from {measured.drive.min():g} to {measured.drive.max():g} were measured, those from "
            f"{surface.drives[0]:g} to {surface.drives[-1]:g} simulated; nothing is extrapolated"
        )
    n = len(measured.drive) + (bulk_friction is not None)
    if n <= k:
        raise ValueError(f"{n} measured values cannot fix {k} parameters; measure more, or fit fewer")
    wanted, log_torque = np.log(measured.torque), surface.log_torque_at(measured.drive)
    own = np.zeros(len(wanted)) if measured.error is None else measured.error / measured.torque
    s = np.hypot(own, surface.scatter)

    def residuals(p: np.ndarray) -> np.ndarray:
        rest = (wanted - log_torque(p)) / s
        return rest if bulk_friction is None else np.append(rest, bulk_friction(p))

    best, smallest = _smallest(residuals, surface.low, surface.high, {})
    free = n - k
    allowed = smallest + float(chi2.ppf(LEVEL, 1))
    if measured.error is None:  # the scatter itself is the error, but not less than that of the surface
        allowed = smallest + max(smallest / free, 1.0) * float(f.ppf(LEVEL, 1, free))
    found, valley = [], np.empty((0, k))
    for a, name in enumerate(simulated.names):
        at = np.unique(np.append(np.linspace(surface.low[a], surface.high[a], PROFILE), best[a]))
        profile = [_smallest(residuals, surface.low, surface.high, {a: value}, best) for value in at]
        sums = np.array([one[1] for one in profile])
        inside = np.flatnonzero(sums <= allowed)
        if a == 0:
            valley = np.array([profile[i][0] for i in inside])
        low, high = _crossing(at, sums, allowed, inside[0], -1), _crossing(at, sums, allowed, inside[-1], 1)
        bounded = bool(inside[0] > 0), bool(inside[-1] < len(at) - 1)
        found.append(FittedParameter(name, float(best[a]), low, high, bounded))
    fitted = log_torque(best)
    scale = 1.0 if measured.error is not None else np.sqrt(max(smallest / free, 1.0))
    half = Z * scale * _errors_of_curve(log_torque, residuals, best, surface.high - surface.low)
    return TorqueFit(
        parameters=tuple(found),
        valley=valley,
        torque=np.exp(fitted),
        low=np.exp(fitted - half),
        high=np.exp(fitted + half),
        sum_of_squares=smallest,
        degrees_of_freedom=free,
        probability=None if measured.error is None else float(chi2.sf(smallest, free)),
        scatter=float(np.sqrt(np.sum((wanted - fitted) ** 2) / free)),
    )


def _errors_of_curve(log_torque: Residual, residuals: Residual, best: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Standard errors (n,) of ln T of the best parameters, linear in them; what the data do not fix does not count."""

    def jacobian(of: Residual) -> np.ndarray:
        steps = STEP * np.diag(span)
        return np.array([np.asarray(of(best + one)) - np.asarray(of(best - one)) for one in steps]).T / (2.0 * STEP)

    J, R = jacobian(log_torque), jacobian(residuals)
    return np.sqrt(np.einsum("ij,jk,ik->i", J, np.linalg.pinv(R.T @ R, rcond=1e-8, hermitian=True), J))


def _smallest(
    residuals: Residual, low: np.ndarray, high: np.ndarray, fixed: dict[int, float], start: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """Return the parameters of the smallest sum of squares, with some of them fixed, and that sum."""
    free = [a for a in range(len(low)) if a not in fixed]

    def whole(part: np.ndarray) -> np.ndarray:
        p = np.empty(len(low))
        p[free] = part
        for a, value in fixed.items():
            p[a] = value
        return p

    if not free:
        p = whole(np.empty(0))
        return p, float(np.sum(residuals(p) ** 2))
    span = (high - low)[free]
    starts = [low[free] + np.array(u) * span for u in product((0.2, 0.8), repeat=len(free))]
    starts += [] if start is None else [start[free]]
    tries = [
        least_squares(lambda part: residuals(whole(part)), one, bounds=(low[free], high[free]), x_scale=span)
        for one in starts
    ]
    best = min(tries, key=lambda one: one.cost)
    return whole(best.x), 2.0 * float(best.cost)


def _crossing(at: np.ndarray, sums: np.ndarray, allowed: float, i: int, side: int) -> float:
    """Return where the profile crosses what is allowed, beyond its value i; the end of the range where it does not."""
    j = i + side
    if not 0 <= j < len(at):
        return float(at[i])
    return float(at[i] + (at[j] - at[i]) * (allowed - sums[i]) / (sums[j] - sums[i]))
