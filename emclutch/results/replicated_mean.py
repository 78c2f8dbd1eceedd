"""Mean of a noisy signal out of independent replicas: what one run fluctuates, and what runs differ by.

A run's batch means tell how the signal fluctuates in it. They cannot tell what the run never changes: how its grains
were packed. Replicas (own packings, the same scene) can. In this order:

1. **Common warm-up:** MSER-5 on the mean over the replicas, in which what all share stands out of their noise.
   P. D. Welch, "The statistical analysis of simulation results", in S. S. Lavenberg (ed.), Computer Performance
   Modeling Handbook, 1983, 268-328, for the mean over replicas; for MSER-5 see `statistics`.
2. **Within replicas:** correlation time from their mean covariance, batches of at least four of it, and the mean square
   MSW of the batch means about their replica's mean, with R (b - 1) degrees of freedom; not below what the correlation
   time says.
3. **Between replicas:** b times the variance of the replicas' means, MSB, with R - 1 degrees of freedom.
4. **Error:** two components of variance, what a replica's mean fluctuates and what packings add,
   ``s^2 = (W + P)/(R b)`` with W = MSW, P = max(MSB - MSW, 0), and degrees of freedom after F. E. Satterthwaite, "An
   approximate distribution of estimates of variance components", Biometrics Bulletin 2 (1946) 110-114:
   ``f = (W + P)^2/(P (W + P)/(R - 1) + W^2/(R (b - 1)))``. P is weighed with W + P and not with itself, since all of
   MSB goes into it. Simulated with 2 to 8 replicas, 8 batches and a variance between packings of 0 to 20 times the
   fluctuation's share in a replica's mean, the difference of two such means lies in its own 95 % interval in 93 to 98 %
   of all cases. One mean alone: with three replicas and more in 90 to 97 %, with two in 86 to 97 %, the least where
   packings differ much: two of them say little about how much.
5. **Drift:** one slope through all batch means, each replica with its own level, must not differ from zero in Student's
   t test at 99.9 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from emclutch.results.statistics import (
    BATCH_CORRELATION_TIMES,
    DRIFT_SIGNIFICANCE,
    MAX_BATCHES,
    MIN_BATCHES,
    MIN_SAMPLES,
    TOO_FEW,
    Estimate,
    batches_needed,
    checked_signal,
    correlation_samples,
    mser_cut,
    rebinned,
    steady_mean,
)


def replicated_mean(
    signals: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], *, average_from: float | None = None
) -> Estimate:
    """Mean and standard error of the steady part that replicas of one signal have in common.

    Parameters
    ----------
    signals : of each replica the ends of its windows (n,) [s], the signal's means over them (n,), and their lengths
        (n,) [s]; windows of the first replica are taken for all, up to the earliest end.
    average_from : beginning of the steady part [s]; None lets MSER-5 find it.

    Raises
    ------
    ValueError : as `statistics.steady_mean`; no signal.
    """
    if not signals:
        raise ValueError("no replica to take a mean of")
    if len(signals) == 1:
        time, value, duration = signals[0]
        return steady_mean(time, value, duration=duration, average_from=average_from)
    t, y, dt = _common_windows([checked_signal(*signal) for signal in signals])
    if average_from is not None:
        late = t - dt >= average_from - 1e-9 * dt
        t, y, dt = t[late], y[:, late], dt[late]
    count = len(signals)
    if t.size < MIN_SAMPLES:
        where = "" if average_from is None else f" after {average_from:g} s"
        reason = f"not converged: {t.size} samples{where}, {MIN_SAMPLES} needed; run longer"
        mean = float(np.average(y.mean(axis=0), weights=dt)) if t.size else None
        return Estimate(mean, None, 0, None, float(t[0] - dt[0]) if t.size else None, False, reason, count)
    steady = True
    if average_from is None:
        cut, steady = mser_cut(y.mean(axis=0), dt)
        t, y, dt = t[cut:], y[:, cut:], dt[cut:]
    start, total = float(t[0] - dt[0]), float(dt.sum())
    means = np.average(y, weights=dt, axis=1)
    mean = float(means.mean())
    if np.ptp(y) <= 1e-13 * np.max(np.abs(y)):  # round-off of a value that does not change
        reason = "not converged: the signal does not change, so nothing in it says how far off its mean is"
        return Estimate(mean, None, 0, None, start, False, reason, count)
    even = np.array([rebinned(dt, one, one.size) for one in y])
    tau = total / t.size * correlation_samples(even)
    batches = max(1, min(int(total / (BATCH_CORRELATION_TIMES * tau)), MAX_BATCHES, t.size))
    error, freedom, share = _error(np.array([rebinned(dt, one, batches) for one in y]), even, tau / total)
    drift = batches >= 2 and count * batches >= MIN_BATCHES and _drifts(y, dt, batches)
    if not steady:
        reason = "not converged: no steady part found, the signal still changes; run longer"
    elif count * batches < MIN_BATCHES or batches < 2:
        reason = (
            f"not converged: {batches} uncorrelated {'batch' if batches == 1 else 'batches'} in each of {count} "
            f"replicas, {batches_needed(count)} {TOO_FEW}"
        )
    elif drift:
        reason = "not converged: the signal drifts; run longer or set a later average_from"
    else:
        reason = (
            f"converged: {count} replicas, {batches} batches of {total / batches:.2g} s in each, correlation time "
            f"{tau:.2g} s"
        )
        if freedom < 2.0 * (count - 1):
            reason += "; packings differ by more than the torque fluctuates: only more replicas make the mean better"
    good = steady and not drift and batches >= 2 and count * batches >= MIN_BATCHES
    return Estimate(mean, error, count * batches, tau, start, good, reason, count, freedom, share)


def _common_windows(
    signals: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (n,) and lengths (n,) of common windows [s], and the replicas' means over them (m, n)."""
    t, _, dt = signals[0]
    end = min(float(time[-1]) if time.size else 0.0 for time, _, _ in signals)
    inside = t <= end * (1.0 + 1e-9)
    t, dt = t[inside], dt[inside]
    rows = []
    for time, value, duration in signals:
        if np.array_equal(time[: t.size], t):
            rows.append(value[: t.size])
            continue
        ends = np.concatenate([time[:1] - duration[:1], time])
        integral = np.concatenate([[0.0], np.cumsum(duration * value)])
        rows.append((np.interp(t, ends, integral) - np.interp(t - dt, ends, integral)) / dt)
    return t, np.array(rows).reshape(len(signals), t.size), dt


def _error(batch_means: np.ndarray, even: np.ndarray, independent: float) -> tuple[float, float, float]:
    """Standard error of the mean of all, its degrees of freedom, and the share of what replicas differ by.

    `batch_means` (m, b); `even` (m, n), the series evenly spaced; `independent`, length of one independent sample over
    the series'.
    """
    count, batches = batch_means.shape
    own = batch_means.mean(axis=1)
    between = batches * float(own.var(ddof=1))
    within = batches * float(even.var(axis=1).mean()) * min(1.0, independent)
    inner = count * (batches - 1)
    if inner:
        within = max(within, float(((batch_means - own[:, None]) ** 2).sum()) / inner)
    added = max(between - within, 0.0)
    whole = within + added
    freedom = whole**2 / (added * whole / (count - 1) + within**2 / max(inner, count - 1))
    return math.sqrt(whole / (count * batches)), freedom, math.sqrt(added / batches)


def _drifts(value: np.ndarray, duration: np.ndarray, batches: int) -> bool:
    """Student's t test of one slope through the batch means of all replicas, each with its own level."""
    from scipy.special import stdtrit

    count, n = len(value), max(batches, math.ceil(MIN_BATCHES / len(value)))
    y = np.array([rebinned(duration, one, n) for one in value])
    y = y - y.mean(axis=1, keepdims=True)
    x = np.arange(n) - 0.5 * (n - 1)
    size = count * float(x @ x)
    slope = float((y * x).sum()) / size
    freedom = count * (n - 1) - 1
    error = math.sqrt(float(((y - slope * x) ** 2).sum()) / freedom / size)
    return abs(slope) > float(stdtrit(freedom, 1.0 - 0.5 * DRIFT_SIGNIFICANCE)) * error
