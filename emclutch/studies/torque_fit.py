"""Fit of a powder's law to a measured torque curve: misfit over a grid of parameters, profile intervals, valley.

With T(p, x) the torque by the law, p the parameters and x the drive (a current), measured torques T_i at x_i have the
residuals r_i(p) = ln T_i - ln T(p, x_i), normal with the covariance

    C(p) = diag(s^2) + F + c(p) c(p)^T,   F_ij = f_i f_j exp(-|ln(x_i/x_j)|),   c_i(p)^2 = c_m^2 + e_i(p)^2 + d^2/2:

s is the relative standard error of each measured torque, c_m the one that all of them share, e that of the law by all
causes with which it is wrong by one factor at all drives, d the scatter of cells about the form of the law. Gap cells
of one powder, fill and size in other fields share half of their squared scatter, however far apart the fields are (3.3
of 7.4e-4, docs/gap_cells.csv), so half of d^2 is common; the other half is f_i^2, correlated within a factor of e of
the drive, so that many measured points do not average it out. Where the law is a guess, c has the error of a guess if
it is one at all drives, and f_i if it is one at this drive. The misfit is

    S(p) = r^T C^-1 r,

with the squared residual of another measurement added where there is one. It is computed on a grid of p; between
the trials of the law ln T and ln e are cubic splines of p, and ln T is one of ln x. Where no errors of the measurement
are known, one s for all points solves S_0 = n - k (R. C. Paule, J. Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377),
with S_0 that S which a common factor of any size leaves. So a factor between the measurement and the law, which errors
of single points do not make, stays: S - S_0, of one degree of freedom, tells whether the common errors explain it.

**Intervals** are profiles: what has S within 3.84 of its smallest value, for some value of the other parameters, is
the 95 % interval (D. M. Bates, D. G. Watts, Nonlinear Regression Analysis, 1988, chapter 6). ln det C is not added:
it would prefer powders near the simulated ones, whose law has small errors, and shorten the intervals. The best
parameters have the smallest S + 0.1 ln c^2: of those that fit alike, the ones with the smallest error of the law. An
interval up to the end of the range says that the data do not bound the parameter there. The best others for each value
of the first parameter are the valley: parameters that the data cannot tell apart, as friction and rolling friction,
which both make a powder stronger. The band has the torques by the law of all parameters within that bound, with
the error of a guess added in quadrature to the logarithm at drives where the law is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import brentq
from scipy.stats import chi2

from emclutch.results.errors import OutputError
from emclutch.results.fits import NORMAL
from emclutch.results.measured_table import TORQUE_CURVE, read_measured

POINTS = {1: 401, 2: 201, 3: 41}
"""Of the grid along each parameter, by their number."""
CURVE = 41
"""Drives at which the fitted curve is drawn."""
WITHIN = float(chi2.ppf(0.95, 1))
"""By which S may exceed its smallest value within the 95 % interval."""
TIE = 0.1
"""Weight of ln c^2 beside S where the best parameters are chosen: of those that fit alike, the best known."""
POOR = 0.01
"""Probability of a sum of squares this large, below which no parameters fit."""
FALL = 0.05
"""Relative, of a torque with a rising drive: what counts as a fall where the errors of the points are unknown."""
SMALLEST_ERROR = 1e-3
"""Relative, of a measured torque: repeated points of no error are none."""

Residual = Callable[[tuple[np.ndarray, ...]], np.ndarray]


@dataclass(frozen=True, slots=True)
class TrialTorques:
    """Torques by the law for every combination of some values of k parameters, at m drives.

    Attributes
    ----------
    names : tuple of str
        The k parameters.
    levels : tuple of ndarray
        Ascending values of each, two or more.
    drive : ndarray (m,)
        Ascending [SI].
    torque : ndarray (*levels, m)
        [N m]
    error, guess : ndarray (*levels, m)
        Standard errors of ln T that all drives share, and of a guess, 0 where the law holds.
    form : float
        Scatter of ln T about the form of the law, standard deviation.
    """

    names: tuple[str, ...]
    levels: tuple[np.ndarray, ...]
    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray
    guess: np.ndarray
    form: float

    def at(self, drive: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return values (..., m), interpolated to drives (n,): (..., n)."""
        if len(self.drive) == 1:
            return np.repeat(values, len(drive), axis=-1)
        return CubicSpline(np.log(self.drive), values, axis=-1)(np.log(drive))

    def nearest(self, drive: np.ndarray) -> np.ndarray:
        """Return which of the m drives is nearest to each of others (n,)."""
        return _nearest(np.log(self.drive), np.log(drive))


@dataclass(frozen=True, slots=True)
class MeasuredTorques:
    """A measured curve.

    Attributes
    ----------
    drive, torque : ndarray, shape (n,)
        Drive [SI], torque [N m], above 0.
    error : ndarray, shape (n,), or None
        Standard errors of each point alone [N m]; None: unknown.
    common_error : float
        Relative standard error that all torques share, as that of a calibration: 0.03 for 3 %.
    """

    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray | None = None
    common_error: float = 0.0

    def largest_fall(self) -> tuple[tuple[float, float], ...]:
        """Return drive and torque of the points between which it falls most beyond its errors (95 %) while that rises.

        None of them where it does not, as by the law, whose torque rises with the drive.
        """
        error = FALL / np.sqrt(2.0) / NORMAL * self.torque if self.error is None else self.error
        drop = np.subtract.outer(self.torque, self.torque) / (NORMAL * np.hypot.outer(error, error))
        drop[np.greater_equal.outer(self.drive, self.drive)] = 0.0
        points = np.unravel_index(np.argmax(drop), drop.shape)
        return tuple((float(self.drive[k]), float(self.torque[k])) for k in points if drop[points] > 1.0)


def read_torques(path: str | Path, unit: str) -> tuple[MeasuredTorques, int]:
    """Read a curve, and how many of its points are left out: those with no drive or torque above 0.

    Parameters
    ----------
    path : of a table as of `read_measured`, with a column of the drive, one of torques, and their standard errors, as
        in "error [N m]", or no errors. All names have their units.
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


@dataclass(frozen=True, slots=True)
class FittedParameter:
    """One parameter of a fit.

    Attributes
    ----------
    name : str
    value, low, high : float
        Best value; ends of the 95 % interval, within the range of the trials.
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
    levels : tuple of ndarray
        Grid of each parameter.
    excess : ndarray (*levels)
        S less its smallest value.
    valley : ndarray, shape (j, k)
        Best parameters for each value of the first one within the 95 % interval.
    measured : ndarray, shape (n, 3)
        At the measured drives [N m]: torque of the best parameters by the law, ends of its 95 % band.
    curve : ndarray, shape (q, 4)
        Drives [SI] from the smallest measured to the largest, and the same three there.
    own_error : float
        Relative standard error of each measured torque, root mean square; found by the fit where it is unknown.
    sum_of_squares : float
        S of the best parameters.
    degrees_of_freedom : int
        n - k, at least 0; n counts another measurement too.
    probability : float or None
        Of an S this large, if the model is right, or of an S - S_0 where the errors of the measurement are unknown;
        None where there are no more points than parameters.
    scatter : float
        Standard deviation of ln(T measured/T fitted), without points that are guesses unless all are.
    factor : float
        Common factor of all points that T measured/T fitted has, by the errors of the single points.
    has_shape : bool
        Whether the best parameters with that factor fit within the errors.
    guess_at : ndarray of bool, shape (n,)
        Measured points at whose drive the law is a guess.
    is_guess : bool
        Whether the law is a guess for the best parameters, at all drives.
    """

    parameters: tuple[FittedParameter, ...]
    levels: tuple[np.ndarray, ...]
    excess: np.ndarray
    valley: np.ndarray
    measured: np.ndarray
    curve: np.ndarray
    own_error: float
    sum_of_squares: float
    degrees_of_freedom: int
    probability: float | None
    scatter: float
    factor: float
    has_shape: bool
    guess_at: np.ndarray
    is_guess: bool

    @property
    def is_poor(self) -> bool:
        """True if no parameters within the range fit the measured curve within its errors and those of the law."""
        return self.probability is not None and self.probability < POOR


def fit_torque(trials: TrialTorques, measured: MeasuredTorques, other: Residual | None = None) -> TorqueFit:
    """Fit the parameters of a law to a measured curve.

    Parameters
    ----------
    trials : at drives from the smallest measured to the largest.
    measured : more values than parameters where their errors are unknown, with the other one.
    other : callable, optional
        Takes the grid's values of each parameter and returns the residuals of something else that was measured, in
        standard errors, (*levels).
    """
    k, n = len(trials.names), len(measured.drive)
    free = n + (other is not None) - k
    levels = tuple(np.linspace(one[0], one[-1], POINTS[k]) for one in trials.levels)
    log_torque, log_error = (_refined(np.log(one), trials.levels, levels) for one in (trials.torque, trials.error))
    guess = trials.guess[np.ix_(*(_nearest(of, to) for of, to in zip(trials.levels, levels, strict=True)))]
    is_guess = (guess > 0.0).all(axis=-1)
    form = np.where(is_guess[..., None], 0.0, guess).reshape(-1, len(trials.drive)).max(axis=0)
    near = trials.nearest(measured.drive)
    c_squared = np.exp(2.0 * log_error) + np.where(is_guess[..., None], guess, 0.0) ** 2
    c = np.sqrt(c_squared + 0.5 * trials.form**2 + measured.common_error**2)[..., near].reshape(-1, n)
    residuals = (np.log(measured.torque) - trials.at(measured.drive, log_torque)).reshape(-1, n)
    f = np.hypot(form, np.sqrt(0.5) * trials.form)[near]
    F = np.outer(f, f) * np.exp(-np.abs(np.log(measured.drive[:, None] / measured.drive)))
    further = np.zeros(is_guess.shape) if other is None else other(levels) ** 2

    def squares(own: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return S, S_0 and by how many c the points are off together (*levels), with their relative errors (n,)."""
        L = cholesky(F + np.diag(np.broadcast_to(np.square(own) + SMALLEST_ERROR**2, n)), lower=True)
        z, w = (solve_triangular(L, one.T, lower=True) for one in (residuals, c))
        square = (w**2).sum(axis=0)  # Sherman and Morrison's formula
        both, shape = (z * w).sum(axis=0), further.shape
        S, S_0 = ((z**2).sum(axis=0) - both**2 / by for by in (1.0 + square, square))
        return S.reshape(shape) + further, S_0.reshape(shape), (both / square).reshape(shape)

    def smallest(own: float) -> float:
        S, S_0, _ = squares(own)
        return float(S_0.ravel()[np.argmin(S)])

    known = None if measured.error is None else measured.error / measured.torque
    own = np.full(n, _unknown_error(smallest, free)) if known is None else known
    S, S_0, off = squares(own)
    excess = S - S.min()
    best = np.unravel_index(np.argmin(S + TIE * np.log((c**2).mean(axis=1)).reshape(S.shape)), S.shape)
    found, valley = [], np.empty((0, k))
    for a, name in enumerate(trials.names):
        rows = np.moveaxis(excess, a, 0).reshape(len(levels[a]), -1)
        profile = rows.min(axis=1)
        inside = np.flatnonzero(profile <= WITHIN)
        if a == 0:
            others = np.unravel_index(rows[inside].argmin(axis=1), excess.shape[1:]) if k > 1 else ()
            valley = np.column_stack([levels[0][inside], *(x[i] for x, i in zip(levels[1:], others, strict=True))])
        low, high = (_crossing(levels[a], profile, inside[end], -1 - 2 * end) for end in (0, -1))
        bounded = bool(inside[0] > 0), bool(inside[-1] < len(profile) - 1)
        found.append(FittedParameter(name, float(levels[a][best[a]]), low, high, bounded))

    def band(drive: np.ndarray) -> np.ndarray:
        within, mean = trials.at(drive, log_torque[excess <= WITHIN]), trials.at(drive, log_torque[best])
        guessed = NORMAL * form[trials.nearest(drive)]
        low, high = (np.hypot(mean - within.min(axis=0), guessed), np.hypot(within.max(axis=0) - mean, guessed))
        return np.exp(np.column_stack([mean, mean - low, mean + high]))

    drives, at = np.geomspace(measured.drive.min(), measured.drive.max(), CURVE), band(measured.drive)
    guess_at = form[near] > 0.0
    judged = guess_at == guess_at.all()
    square, count = (S[best], free) if known is not None else (S[best] - further[best] - S_0[best], 1)
    return TorqueFit(
        parameters=tuple(found), levels=levels, excess=excess, valley=valley, measured=at,
        curve=np.column_stack([drives, band(drives)]),
        own_error=float(np.sqrt(np.mean(own**2))),
        sum_of_squares=float(S[best]), degrees_of_freedom=max(free, 0),
        probability=float(chi2.sf(square, count)) if count > 0 else None,
        factor=float(np.exp(off[best] * c.reshape(*S.shape, n)[best].mean())),
        has_shape=bool(chi2.sf(S_0[best], max(free - 1, 1)) >= POOR),
        scatter=float(np.sqrt(np.sum(np.log(measured.torque / at[:, 0])[judged] ** 2) / max(judged.sum() - k, 1))),
        guess_at=guess_at, is_guess=bool(is_guess[best]),
    )  # fmt: skip


def _refined(values: np.ndarray, levels: tuple[np.ndarray, ...], to: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return values (*levels, m) on a finer grid, by cubic splines along each parameter."""
    for axis, (before, after) in enumerate(zip(levels, to, strict=True)):
        values = CubicSpline(before, values, axis=axis)(after)
    return values


def _nearest(levels: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Return which of some levels is nearest to each of others."""
    return np.argmin(np.abs(to[:, None] - levels), axis=1)


def _unknown_error(smallest: Callable[[float], float], free: int) -> float:
    """Return the relative error of each measured torque with which S_0 is its expectation, n - k; 0 if it is less."""
    if smallest(0.0) <= free:
        return 0.0
    high = 0.1
    while smallest(high) > free:
        high *= 4.0
    return float(brentq(lambda s: np.sqrt(free / smallest(s)) - 1.0, 0.0, high, rtol=1e-2))


def _crossing(at: np.ndarray, profile: np.ndarray, i: int, side: int) -> float:
    """Return where a profile crosses the bound, beyond its value i; the end of the range where it does not."""
    j = i + side
    if not 0 <= j < len(at):
        return float(at[i])
    return float(at[i] + (at[j] - at[i]) * (WITHIN - profile[i]) / (profile[j] - profile[i]))
