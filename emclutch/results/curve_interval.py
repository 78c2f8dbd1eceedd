"""A curve through noisy torques at few places, with its 95 % interval everywhere between them.

Torque over current (or another value above zero) is near a power law, and its replicas scatter by about the same share
everywhere. So y = log T is modelled over u = log x as a Gaussian process: a straight line, a smooth deviation from it
of Matern's kernel (nu = 5/2), and independent noise of every replica,

    y_i = b_0 + b_1 u_i + z(u_i) + e_i,   cov z = r tau^2 (1 + d + d^2/3) exp(-d), d = sqrt(5) |u - u'| / length,
    e_i of variance tau^2.

The line's coefficients and tau are integrated out under their flat priors (universal kriging: Handcock, Stein,
Technometrics 35, 1993), which leaves Student's t with n - 2 degrees of freedom; length and r are averaged over a grid
of values with the weights of their restricted likelihood, so that the interval knows that they are not known. It holds
for curves that are smooth on the scale of the data; a kink between two places is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from emclutch.results.fits import student

LENGTHS = np.geomspace(0.15, 3.0, 8)
"""Of the kernel, in parts of the range."""
RATIOS = np.geomspace(1e-2, 1e4, 13)
"""Variance of the deviation from the line, over that of a replica."""


_Models = tuple[tuple[float, np.ndarray, float], ...]
"""Weight, covariance (m, m) and variance of a replica of each pair of length and ratio."""


@dataclass(frozen=True, slots=True)
class CurveInterval:
    """A curve with its interval at some places.

    Attributes
    ----------
    x : (m,) places.
    torque : (m,) [N m].
    half_width : (m,) of the 95 % interval of log T: its ends are torque exp(+- half_width).
    noise : relative scatter of one replica, as a standard deviation.
    """

    x: np.ndarray
    torque: np.ndarray
    half_width: np.ndarray
    noise: float
    _models: _Models
    _quantile: float

    def narrowed(self, place: int) -> CurveInterval:
        """Return what one more replica at x[place] makes of the intervals, whatever its torque is."""
        models = []
        for weight, covariance, noise in self._models:
            column = covariance[:, place]
            models.append((weight, covariance - np.outer(column, column) / (column[place] + noise), noise))
        spread = self.half_width**2 - self._quantile**2 * _mean_variance(self._models)
        half_width = np.sqrt(np.maximum(spread, 0.0) + self._quantile**2 * _mean_variance(tuple(models)))
        return CurveInterval(self.x, self.torque, half_width, self.noise, tuple(models), self._quantile)


def curve_interval(x: np.ndarray, torque: np.ndarray, at: np.ndarray) -> CurveInterval:
    """Fit a curve to torques of single replicas, and return it with its interval.

    Parameters
    ----------
    x : (n,) places of the replicas, each above 0, at least four of them in all and two different ones.
    torque : (n,) [N m], each above 0.
    at : (m,) places where the curve is wanted, above 0.

    Raises
    ------
    ValueError
        There are too few replicas, or a place or a torque is not above 0.
    """
    x, torque, at = (np.asarray(one, dtype=float) for one in (x, torque, at))
    if len(x) < 4 or np.unique(x).size < 2:
        raise ValueError(f"{len(x)} replicas at {np.unique(x).size} places; needed: 4 or more, at 2 or more places")
    if min(x.min(), at.min()) <= 0.0 or not torque.min() > 0.0:
        raise ValueError(
            f"places from {min(x.min(), at.min()):.4g}, torques from {torque.min():.4g} N m; allowed: above 0"
        )
    low, high = np.log(min(x.min(), at.min())), np.log(max(x.max(), at.max()))
    u, v, y = (np.log(x) - low) / (high - low), (np.log(at) - low) / (high - low), np.log(torque)
    line, there = np.stack([np.ones_like(u), u], axis=1), np.stack([np.ones_like(v), v], axis=1)
    free = len(u) - 2
    likelihoods, means, covariances, noises = [], [], [], []
    for length in LENGTHS:
        own, cross, far = _kernel(u, u, length), _kernel(v, u, length), _kernel(v, v, length)
        for ratio in RATIOS:
            root = np.linalg.cholesky(ratio * own + np.eye(len(u)))
            white_line, white_y = (solve_triangular(root, one, lower=True) for one in (line, y))
            normal = np.linalg.cholesky(white_line.T @ white_line)
            slope = cho_solve((normal, True), white_line.T @ white_y)
            rest = white_y - white_line @ slope
            noise = max(float(rest @ rest) / free, 1e-12)  # torques without scatter leave rounding alone
            white_cross = solve_triangular(root, ratio * cross.T, lower=True)
            missing = solve_triangular(normal, (there - white_cross.T @ white_line).T, lower=True)
            likelihoods.append(
                -0.5 * free * np.log(noise) - np.log(np.diag(root)).sum() - np.log(np.diag(normal)).sum()
            )
            means.append(there @ slope + white_cross.T @ rest)
            covariances.append(noise * (ratio * far - white_cross.T @ white_cross + missing.T @ missing))
            noises.append(noise)
    weights = np.exp(np.array(likelihoods) - max(likelihoods))
    weights /= weights.sum()
    kept = np.flatnonzero(weights > 1e-3)  # the others change no digit that is shown
    share = weights[kept] / weights[kept].sum()
    models: _Models = tuple((float(one), covariances[n], noises[n]) for one, n in zip(share, kept, strict=True))
    mean = share @ np.array(means)[kept]
    apart = share @ (np.array(means)[kept] - mean) ** 2
    quantile = student(free)
    half_width = quantile * np.sqrt(_mean_variance(models) + apart)
    noise = float(np.sqrt(sum(weight * one for weight, _, one in models)))
    return CurveInterval(at, np.exp(mean), half_width, noise, models, quantile)


def _kernel(first: np.ndarray, second: np.ndarray, length: float) -> np.ndarray:
    """Matern's correlation, nu = 5/2, shape (n, m)."""
    d = np.sqrt(5.0) * np.abs(first[:, None] - second[None, :]) / length
    return (1.0 + d + d**2 / 3.0) * np.exp(-d)


def _mean_variance(models: _Models) -> np.ndarray:
    return np.sum([weight * np.maximum(np.diag(covariance), 0.0) for weight, covariance, _ in models], axis=0)
