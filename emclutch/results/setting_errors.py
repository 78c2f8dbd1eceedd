"""Errors of numerical settings from the torques of an accuracy study: one hierarchical model for all of them.

**Model.** For the value i of the setting k, all other settings being the scene's own,

    ln T_ki = m + b_k (x_ki - x_k)/x_k + d_ki - d_k + noise,    x = g(h) - g(L),  g = h^p_k,

with the mean m at the scene's own settings, the error b_k + d_k of its own value (b alone follows the power law of the
step size h, L is the step size without error), and the deviation d of single values from the law, as grains that order
in layers have it. The torque without errors is exp(m - sum of b_k + d_k). A large error follows T_0 (1 + a h^p): for it
g = ln(1 + a h^p), with a from a line through the torques, and b is the error of its coarsest value. All settings that
are measured by torques share m; one measured on a frozen packing, or on later parts of the same histories, has
an m of its own.

**Priors.**

| quantity | prior |
|---|---|
| order p | log-normal about the theoretical order, 35 %; of unknown order: about 2, a factor of 2 |
| b of a small setting | normal of scale s, s half-Cauchy of 0.7 %: a measured error is not shrunk |
| b of a large setting (grain size) | normal of scale 1: flat |
| d of the grain size | normal of scale tau, tau half-Cauchy of 0.7 % |
| d of settings without noise | the same, tau half-Cauchy of a tenth of the range of their values |
| scatter between replicas | the measured one, chi^2 of its degrees of freedom |

Besides, 5 % of each error is unknown, and three times the product of two errors may be added to them in either
direction (95 % each): the brake's torque at 4 grains per gap and an inertial number of 0.4 together lacks 3.0 times the
product of both errors, -11 %.

**Computation.** Given orders, scales and scatter, the model is linear and Gaussian. These are drawn in transformed
coordinates from a Gaussian proposal, weighted by the marginal likelihood (importance sampling) and resampled. The
proposal is fitted to pilot draws. The first ones come from the prior, and are weighted by a power of the likelihood
that leaves a tenth of them effective; the power rises from fit to fit up to 1 (O. Cappé et al., J. Comput. Graph. Stat.
13 (2004) 907-929; R. M. Neal, Stat. Comput. 11 (2001) 125-139). m, b and d follow from conditioning joint draws of
themselves and of the data (Matheron's rule; A. G. Journel, C. J. Huijbregts, Mining Geostatistics, 1978, section
VII.A). The generator has a fixed seed: equal input gives equal output. Hierarchical shrinkage: A. Gelman, Bayesian
Analysis 1 (2006) 515-533 (half-Cauchy scales).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.fits import NORMAL

if TYPE_CHECKING:
    from emclutch.results.accuracy_study import MeasuredSetting

log = logging.getLogger(__name__)
DRAWS, PILOT = 8192, 2048
MAX_PILOTS = 60  # fits of the proposal
EFFECTIVE = 0.1  # of the pilot draws, that a power of the likelihood leaves
FEWEST = 100  # effective draws, below which half widths are uncertain by more than a tenth
ORDER_SPREAD, FREE_ORDER, FREE_SPREAD = 0.35, 2.0, 0.7  # of ln p
SMALL_ERROR = 0.007
"""Scale of the errors of small settings, relative to the torque."""
DEVIATION = 0.007
"""Scale of the deviations of the grain size from its law, relative."""
OF_RANGE = 0.1  # deviations of values without noise over their range
MODEL = 0.05
"""Part of each error that is unknown, 95 %."""
PAIRS = 3.0
"""Times the product of two errors that may be added to them, 95 %."""
LOWEST_EXCESS, LARGEST_EXCESS = -0.5, 10.0
LARGEST = 1.0  # scale of an error or a deviation
HIGHEST_ORDER = 10.0
MOST = 8.0  # standard deviations of the scatter's coordinate
RESOLVED, MIN_NOISE = 1e-3, 1e-6  # of the range of values without noise; relative
NO_NOISE = 1e-6  # of the variance of the noise, that is as good as none
ROUND_OFF = 1e-12  # of the prior variance of each value: without it covariances of far values are singular
WIDER = 1.1  # proposal over the draws that it is fitted to
DIAGONAL = 0.1  # of the proposal's covariance: coordinates are as if they did not correlate
REL_TOL = 1e-6


@dataclass(frozen=True, slots=True)
class Posterior:
    """Draws of what the values of some settings leave open, all of equal weight.

    Attributes
    ----------
    u : (s, c) array
        Coordinates of orders, scales and scatter, standard normal a priori.
    latent : (s, l) array
        m less the mean of all values, b and d.
    noise : (s, l) array
        The part of them by the scatter between replicas: what values without noise, at the same coordinates, would
        remove. Its mean is 0.
    """

    u: np.ndarray
    latent: np.ndarray
    noise: np.ndarray


class SharedMean:
    """Model of the settings that share the mean m at the scene's own values.

    Parameters
    ----------
    settings : sequence of MeasuredSetting
        Settings of which `own_place` is not None.
    has_prior : bool
        False: the errors of small settings have the flat prior of large ones.
    """

    def __init__(self, settings: Sequence[MeasuredSetting], has_prior: bool = True) -> None:
        self.settings = tuple(settings)
        self._values = [[one for one in setting.values if one.result] for setting in settings]
        self._own = [own for setting in settings if (own := own_place(setting)) is not None]
        rows = [(0, self._own[0])]
        rows += [(k, i) for k, some in enumerate(self._values) for i in range(len(some)) if i != self._own[k]]
        y = np.log(np.abs([float(self._values[k][i].result or 0.0) for k, i in rows]))
        self._error = np.array([self._values[k][i].error for k, i in rows])
        self._rows, self.level, self._y = rows, float(y.mean()), y - y.mean()
        self._is_noisy, extent = bool(self._error.any()), float(np.ptp(y))
        self._floor = MIN_NOISE if self._is_noisy else max(RESOLVED * extent, MIN_NOISE)
        large = np.array([one.is_large for one in settings])
        self._is_flat = large | (not has_prior)
        self._deviation = DEVIATION * large if self._is_noisy else np.full(len(settings), OF_RANGE * extent)
        self._excess = [_excess(setting) if setting.is_large else None for setting in settings]
        counts = [len(some) if scale else 0 for some, scale in zip(self._values, self._deviation, strict=True)]
        self._first = np.cumsum([1 + len(settings), *counts])  # latent d of the first value of each, where it has any
        has_factor = self._is_noisy and math.isfinite(settings[0].freedom)
        self._is_used = np.r_[np.ones(len(settings), dtype=bool), ~self._is_flat, self._deviation > 0.0, has_factor]

    def posterior(self, random: np.random.Generator) -> Posterior:
        """Return `DRAWS` draws."""
        size = self._is_used.size
        middle, factor, power = np.zeros(size), np.eye(size), 0.0

        def propose(draws: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Return draws of the proposal, their log-likelihoods, and the logarithms of prior over proposal."""
            z = random.standard_normal((draws, size))
            u = middle + z @ factor.T
            return u, self.log_evidence(u), 0.5 * (z**2 - u**2).sum(axis=1)

        for _ in range(MAX_PILOTS):
            is_last = power == 1.0
            u, evidence, ratio = propose(PILOT)
            power = _power(evidence, ratio, power)
            middle, factor = _fitted(u, _weights(power * evidence + ratio), self._is_used)
            if is_last:
                break
        u, evidence, ratio = propose(DRAWS)
        weight = _weights(evidence + ratio)
        if (effective := weight.sum() ** 2 / (weight @ weight)) < FEWEST:
            names = ", ".join(one.name for one in self.settings)
            log.warning("errors of %s: %.0f effective draws only, half widths are rough", names, effective)
        share = np.cumsum(weight) / weight.sum()
        u = u[np.searchsorted(share, (np.arange(DRAWS) + 0.5) / DRAWS).clip(max=DRAWS - 1)]
        terms, prior, noise, covariance = self._linear(u)
        latent = np.sqrt(prior) * random.standard_normal(prior.shape)
        exact = np.einsum("snl,sl->sn", terms, latent)
        data = exact + np.sqrt(noise) * random.standard_normal(noise.shape)

        def answer(covariance: np.ndarray, values: np.ndarray) -> np.ndarray:
            """Return the expectations of the latent quantities (s, l) for some values (s, n)."""
            return (terms.transpose(0, 2, 1) @ np.linalg.solve(covariance, values[..., None]))[..., 0] * prior

        found = latent + answer(covariance, self._y - data)
        if not self._is_noisy:
            return Posterior(u, found, np.zeros_like(found))
        diagonal = range(noise.shape[1])
        without = covariance.copy()
        without[:, diagonal, diagonal] -= (1.0 - NO_NOISE) * noise
        return Posterior(u, found, answer(without, exact) - answer(covariance, data))

    def log_evidence(self, u: np.ndarray) -> np.ndarray:
        """Return the logarithm of the marginal likelihood of the values (s,) at some coordinates (s, c)."""
        covariance = self._linear(u)[3]
        solved = np.linalg.solve(covariance, np.broadcast_to(self._y[:, None], (*covariance.shape[:2], 1)))[..., 0]
        return -0.5 * (solved @ self._y + np.linalg.slogdet(covariance)[1])

    def moments(self, u: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and variance (s,) of a linear combination (s, l) of the latent quantities at coordinates."""
        terms, prior, _, covariance = self._linear(u)
        crossed = np.einsum("snl,sl->sn", terms, prior * direction)
        solved = np.linalg.solve(covariance, crossed[..., None])[..., 0]
        variance = np.einsum("sl,sl->s", prior, direction**2) - np.einsum("sn,sn->s", crossed, solved)
        return solved @ self._y, np.maximum(variance, 0.0)

    def direction(self, u: np.ndarray, setting: str, step_size: float, limit: float | None = None) -> np.ndarray:
        """Return the error of a value as a combination (s, l) of the latent quantities, d of new values left out."""
        k = next(n for n, one in enumerate(self.settings) if one.name == setting)
        found = np.zeros((len(u), self._first[-1]))
        own_limit = self.settings[k].limit
        limit = own_limit if limit is None else limit
        if math.isclose(step_size, limit, rel_tol=REL_TOL):
            return found
        p = self._orders(u)[:, k]
        found[:, 1 + k] = (self._law(k, step_size, p) - self._law(k, limit, p)) / self._unit(k, p)
        if self._deviation[k] and (i := self._place(k, step_size)) is not None:
            found[:, self._first[k] + i] = 1.0
        return found

    def new_deviation(self, u: np.ndarray, setting: str, step_size: float) -> np.ndarray:
        """Return the standard deviation (s,) of d of a value; 0 of those that were measured."""
        k = next(n for n, one in enumerate(self.settings) if one.name == setting)
        known = self._place(k, step_size) is not None
        return np.zeros(len(u)) if known else np.minimum(self._scales(u, 2)[:, k] * self._deviation[k], LARGEST)

    def _place(self, k: int, step_size: float) -> int | None:
        h = [one.step_size for one in self._values[k]]
        return next((i for i, one in enumerate(h) if math.isclose(one, step_size, rel_tol=REL_TOL)), None)

    def _orders(self, u: np.ndarray) -> np.ndarray:
        known = np.array([one.order or 0.0 for one in self.settings])
        spread = np.where(known > 0.0, ORDER_SPREAD, FREE_SPREAD)
        orders = np.where(known > 0.0, known, FREE_ORDER) * np.exp(spread * u[:, : known.size])
        return np.minimum(orders, HIGHEST_ORDER)

    def _scales(self, u: np.ndarray, block: int) -> np.ndarray:
        """Return half-Cauchy scales (s, k) from a block of coordinates."""
        from scipy.special import ndtr

        count = len(self.settings)
        return np.tan(0.5 * math.pi * ndtr(u[:, block * count : (block + 1) * count]))

    def _unit(self, k: int, p: np.ndarray) -> np.ndarray:
        """Return x of the value whose error is b: the scene's own, of a large error the farthest from the limit."""
        h, limit = [one.step_size for one in self._values[k]], self.settings[k].limit
        reference = h[self._own[k]]
        if self.settings[k].is_large or math.isclose(reference, limit, rel_tol=1e-3):
            reference = max(h, key=lambda one: abs(one - limit))
        if math.isclose(reference, limit, rel_tol=REL_TOL):  # no other value was measured
            return np.ones_like(p)
        return self._law(k, reference, p) - self._law(k, limit, p)

    def _law(self, k: int, step_size: float, p: np.ndarray) -> np.ndarray:
        """Return g of a step size (s,), up to a factor."""
        coarsest = max(one.step_size for one in self._values[k])
        u = (step_size / coarsest) ** p if step_size else np.zeros_like(p)
        excess = self._excess[k]
        return u if excess is None else np.log1p(excess * u) / excess

    def _linear(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return what multiplies the latent quantities (s, n, l), their prior variances (s, l), the variances of the
        values' noise and the covariances of the values (s, n, n)."""
        from scipy.special import gammaincinv, ndtr

        s, count, orders = len(u), len(self.settings), self._orders(u)
        prior = np.ones((s, self._first[-1]))
        scale = np.minimum(SMALL_ERROR * self._scales(u, 1), LARGEST)
        prior[:, 1 : 1 + count] = np.where(self._is_flat, LARGEST, scale) ** 2
        deviation = np.minimum(self._deviation * self._scales(u, 2), LARGEST) ** 2
        terms = np.zeros((s, len(self._rows), self._first[-1]))
        terms[:, :, 0] = 1.0
        for k in range(count):
            prior[:, self._first[k] : self._first[k + 1]] = deviation[:, [k]]
        for n, (k, i) in enumerate(self._rows[1:], start=1):
            p, own = orders[:, k], self._own[k]
            step = self._law(k, self._values[k][i].step_size, p) - self._law(k, self._values[k][own].step_size, p)
            terms[:, n, 1 + k] = step / self._unit(k, p)
            if self._deviation[k]:
                terms[:, n, self._first[k] + i], terms[:, n, self._first[k] + own] = 1.0, -1.0
        freedom = self.settings[0].freedom
        factor = np.ones(s)
        if math.isfinite(freedom):  # chi^2 from its lower tail, which is exact where the scatter is far too small
            factor = 0.5 * freedom / gammaincinv(0.5 * freedom, ndtr(-u[:, -1].clip(-MOST, MOST)))
        noise = factor[:, None] * self._error**2 + self._floor**2
        covariance = (terms * prior[:, None]) @ terms.transpose(0, 2, 1)
        diagonal = range(len(self._rows))
        covariance[:, diagonal, diagonal] += noise + ROUND_OFF * covariance[:, diagonal, diagonal]
        return terms, prior, noise, covariance


class SettingErrors:
    """Draws of the errors of all settings of an accuracy study.

    Parameters
    ----------
    groups : sequence of sequences of MeasuredSetting
        Settings that share the mean at the scene's own values; the first group is that of the torques.
    has_prior
        As of `SharedMean`.
    """

    def __init__(self, groups: Sequence[Sequence[MeasuredSetting]], has_prior: bool = True) -> None:
        self._random = np.random.default_rng(0)
        self._of: dict[str, tuple[SharedMean, Posterior]] = {}
        self.level = np.zeros((2, DRAWS))
        """Logarithm of the torque at the scene's own values, and what of it is noise, (2, s)."""
        for number, group in enumerate(groups):
            if group:
                model = SharedMean(group, has_prior)
                draws = model.posterior(self._random)
                self._of |= {one.name: (model, draws) for one in group}
                if number == 0:
                    self.level = np.stack([model.level + draws.latent[:, 0], draws.noise[:, 0]])
        self._normal = self._random.standard_normal(DRAWS)
        self._model = {name: self._random.standard_normal(DRAWS) for name in self._of}
        self._new = {name: self._random.standard_normal(DRAWS) for name in self._of}

    def error(self, setting: str, step_size: float, limit: float | None = None) -> np.ndarray:
        """Return ln(T/T_0) of a value, and what of it is noise, (2, s).

        `limit`: step size without error, where it is another one than that of the study.
        """
        model, draws = self._of[setting]
        direction = model.direction(draws.u, setting, step_size, limit)
        if not direction.any():
            return np.zeros((2, DRAWS))
        found = np.einsum("sl,sl->s", direction, draws.latent)
        noise = np.einsum("sl,sl->s", direction, draws.noise)
        more = model.new_deviation(draws.u, setting, step_size) * self._new[setting]
        return np.stack([found * (1.0 + MODEL / NORMAL * self._model[setting]) + more, noise])

    def law(self, setting: str, step_size: float, limit: float | None = None) -> np.ndarray:
        """Return ln(T/T_0) of a value by its power law alone, (s,): without d."""
        model, draws = self._of[setting]
        direction = model.direction(draws.u, setting, step_size, limit)
        k = 1 + next(n for n, one in enumerate(model.settings) if one.name == setting)
        return direction[:, k] * draws.latent[:, k] * (1.0 + MODEL / NORMAL * self._model[setting])

    def order(self, setting: str) -> tuple[float, float, float]:
        """Return median and 95 % interval of the order of a setting."""
        model, draws = self._of[setting]
        k = next(n for n, one in enumerate(model.settings) if one.name == setting)
        low, middle, high = np.quantile(model._orders(draws.u)[:, k], [0.025, 0.5, 0.975])
        return float(middle), float(low), float(high)

    def interaction(self, errors: Sequence[np.ndarray]) -> np.ndarray:
        """Return what errors, (2, s) each, may do to each other (s,), by the products of all pairs."""
        squares = np.sum([one[0] ** 2 for one in errors], axis=0)
        pairs = 0.5 * (squares**2 - np.sum([one[0] ** 4 for one in errors], axis=0))
        return np.sqrt(np.maximum(pairs, 0.0)) * PAIRS / NORMAL * self._normal


def own_place(setting: MeasuredSetting) -> int | None:
    """Return the place of the scene's own among the values of a setting; None without it, or where signs differ."""
    values = [one for one in setting.values if one.result]
    if any((one.result or 0.0) * (values[0].result or 0.0) <= 0.0 for one in values):
        return None
    return next((n for n, one in enumerate(values) if setting.is_own(one.value)), None)


def _excess(setting: MeasuredSetting) -> float | None:
    """Return the relative error of the coarsest value by a line over h^p; None where it is too small to matter."""
    values = [one for one in setting.values if one.result]
    h, torque = np.array([one.step_size for one in values]), np.abs([float(one.result or 0.0) for one in values])
    if len(values) < 2:
        return None
    slope, intercept = np.polyfit((h / h.max()) ** (setting.order or FREE_ORDER), torque / torque.mean(), 1)
    excess = min(max(slope / max(intercept, MIN_NOISE), LOWEST_EXCESS), LARGEST_EXCESS)
    return excess if abs(excess) > MIN_NOISE else None


def _weights(log_weight: np.ndarray) -> np.ndarray:
    """Return weights up to a factor (s,), the largest being 1."""
    return np.exp(log_weight - log_weight.max())


def _power(evidence: np.ndarray, ratio: np.ndarray, before: float) -> float:
    """Return the largest power of the likelihood, above the one before and up to 1, that leaves enough draws."""

    def is_enough(power: float) -> bool:
        weight = _weights(power * evidence + ratio)
        return bool(weight.sum() ** 2 >= EFFECTIVE * weight.size * (weight @ weight))

    if is_enough(1.0):
        return 1.0
    low, high = before, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_enough(middle) else (low, middle)
    return max(low, min(1.0, 1.1 * before))


def _fitted(u: np.ndarray, weight: np.ndarray, is_used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (c,) and factor (c, c) of a proposal from weighted draws; what is not used keeps its prior."""
    middle = np.where(is_used, np.average(u, axis=0, weights=weight), 0.0)
    covariance = np.cov(u.T, aweights=weight, ddof=0)
    covariance = (1.0 - DIAGONAL) * covariance + np.diag(DIAGONAL * np.diag(covariance) + MIN_NOISE)
    factor = WIDER * np.linalg.cholesky(np.where(np.outer(is_used, is_used), covariance, np.eye(len(middle))))
    return middle, np.where(is_used[:, None], factor, np.eye(len(middle)))
