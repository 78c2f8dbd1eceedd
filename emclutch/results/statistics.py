"""Mean of a noisy signal with an honest error bar: steady part, correlation time, batch means.

A torque history starts with a transient and its samples are correlated, so neither the plain mean
nor ``std/sqrt(n)`` means anything. Four published steps, in this order:

1. **Steady part** by MSER-5: the samples are averaged in fives and the cut is put where
   ``MSER(d) = sum_{i>=d} (Y_i - mean)^2 / (n - d)^2`` is smallest, looking no further than half of
   the series. A smallest value right at that limit means that no steady part was found.
   K. P. White, M. J. Cobb, S. C. Spratt, "A comparison of five steady-state truncation heuristics
   for simulation", Proc. Winter Simulation Conference 2000, 755-760.
2. **Correlation time** ``tau = dt (1 + 2 sum_k rho_k)``, the time that holds one independent sample
   (twice the exponential time for slowly decaying exponentials), with the sum cut at the first
   ``k >= 5 tau_int``, ``tau_int = 1/2 + sum_k rho_k``.
   N. Madras, A. D. Sokal, J. Stat. Phys. 50 (1988) 109-186, appendix C.
3. **Batch means**: 10 to 30 batches of equal duration, each longer than 4 tau. More than 30 batches
   gain nothing; B. Schmeiser, "Batch size effects in the analysis of simulation output",
   Operations Research 30 (1982) 556-568. The standard error is the larger of the one from the
   batches and ``sigma sqrt(tau/T)``: short batches are still slightly correlated and
   alone would promise too much.
4. **Drift**: the slope of a straight line through the batch means must not differ from zero in
   Student's t test at 99.9 %.

A signal that does not change at all says nothing about its error: it may be one that has not begun, as the torque of
grains that touch nothing yet. Its error is unknown, not 0.

Samples of unequal duration are window means: the signal is taken as constant over each window, and
all averages are time averages (rebinned through the running integral, which preserves them).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from emclutch.results.fits import Measured, line, student

MIN_BATCHES = 10
MAX_BATCHES = 30  # Schmeiser 1982
MIN_SAMPLES = 20  # fewer give neither a cut nor a correlation time worth its name
BATCH_CORRELATION_TIMES = 4.0  # with 2 the error of AR(1) series came out 1.5 times too small where 10 batches just fit
SOKAL_WINDOW = 5.0
DRIFT_SIGNIFICANCE = 1e-3
STOPPING_ALLOWANCE = 0.6
"""Fraction of the probability of error that the interval of a run uses whose rule looks several times: 97 % is computed
for 95 %."""
REPLICAS = 4  # from which on the interval is of a useful width
ONE_REPLICA = "one replica, whose interval leaves out the scatter between replicas"
NOT_CONVERGED, RUN_LONGER = "not converged", "run longer"
CONSTANT = "the signal is constant, so its error cannot be estimated"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A time average with its standard error; every undefined number is None, never NaN.

    Attributes
    ----------
    mean : time average over the steady part [unit of the signal].
    standard_error : its standard error [unit of the signal], above 0; None: unknown. Where `converged` is
        False, this is the best that the data give and probably too small.
    batches : number of uncorrelated batches behind the error; of several replicas their number.
    correlation_time : time that holds one independent sample [s].
    start : beginning of the steady part [s].
    converged : steady; of a single series without drift, and at least 10 batches each longer than 4 correlation times.
        Of a run of one replica never: its error leaves out the scatter between replicas.
    reason : why it is known, or not.
    status : verdict in a word or two: "steady", "converged", "drifting", "not settled", "not converged".
    remedy : what to do where it is not known; empty where it is, or where nothing helps.
    replicas : independent runs behind it.
    degrees_of_freedom : of the error; None: one less than the batches.
    end : end of the averaged part [s]; None of a single series.
    settled : time [s] up to which the signal starts up at the least; the drift counts from there.
    drift : slope over the averaged part [unit of the signal per s], mean of the replicas; None of a single series.
    drift_error : its standard error [unit of the signal per s].
    drift_freedom : degrees of freedom of that error.
    starts_up : whether the start-up takes most of the run, by MSER-5 on the mean over several replicas.
    fluctuation : standard deviation of one replica's mean that its own fluctuation explains [unit of the signal].
    exclude_drift : whether a small drift is to be excluded; else the start-up is known to be over.
    missing : time [s] that the run is estimated to lack; None: none, or unknown.
    steady_alone : the run has one replica, which is steady; the error is that within the replica.
    several_looks : whether a rule that looks at the estimate several times ends the run.
    pooled_scatter : standard deviation between replicas over the mean, of an earlier study, that is pooled with the
        scatter of these replicas in `standard_error`: s^2 = (nu_0 s_0^2 + (n - 1) s_n^2)/(nu_0 + n - 1); None: none.
    pooled_freedom : its degrees of freedom nu_0.
    """

    mean: float | None
    standard_error: float | None
    batches: int
    correlation_time: float | None
    start: float | None
    converged: bool
    reason: str
    replicas: int = 1
    degrees_of_freedom: float | None = None
    end: float | None = None
    settled: float | None = None
    drift: float | None = None
    drift_error: float | None = None
    drift_freedom: float | None = None
    fluctuation: float | None = None
    starts_up: bool = False
    exclude_drift: bool = True
    missing: float | None = None
    steady_alone: bool = False
    several_looks: bool = False
    pooled_scatter: float | None = None
    pooled_freedom: float | None = None
    status: str = ""
    remedy: str = ""

    def in_words(self) -> str:
        """Return status, reason and remedy."""
        text = ": ".join(filter(None, (self.status, self.reason)))
        return "; ".join(filter(None, (text, self.remedy)))

    @property
    def is_steady(self) -> bool:
        """True if the estimate is converged, or lacks nothing but other replicas."""
        return self.converged or self.steady_alone

    def of_one_replica(self) -> Estimate:
        """Return the estimate of a run of one replica: not converged, though it may be steady."""
        if not self.converged:
            return self
        remedy = f"set accuracy.replicas = {REPLICAS}"
        found = replace(self, converged=False, steady_alone=True, status=NOT_CONVERGED, remedy=remedy)
        return replace(found, reason=ONE_REPLICA)

    def half_width(self, confidence: float = 0.95) -> float | None:
        """Half the width of the mean's two-sided confidence interval by Student's t; None: unknown.

        Where a rule that looks several times ends the run, two fifths of the probability of error are kept for its
        other looks. Half the drift over the averaged part of several replicas is added in quadrature where it is to be
        excluded, so that the interval tends to hold the two ends of that part too.
        """
        freedom = self.batches - 1 if self.degrees_of_freedom is None else self.degrees_of_freedom
        if self.mean is None or self.standard_error is None or freedom < 1:
            return None
        half = self.quantile(freedom, confidence) * self.standard_error
        if self.drift is None or self.start is None or self.end is None or not self.exclude_drift:
            return half
        return math.hypot(half, 0.5 * self.drift * (self.end - self.start))

    def quantile(self, freedom: float, confidence: float = 0.95) -> float:
        """Half the width of a two-sided confidence interval over the standard error, with the allowance for looks."""
        allowance = STOPPING_ALLOWANCE if self.several_looks else 1.0
        return student(freedom, 1.0 - allowance * 0.5 * (1.0 - confidence))

    @property
    def known(self) -> bool:
        """True if the mean has an error, so that its interval is finite; `converged` says whether to trust it."""
        return self.half_width() is not None

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Two-sided confidence interval of the mean; infinite where the mean or its error is unknown."""
        half = self.half_width(confidence)
        return (-math.inf, math.inf) if half is None or self.mean is None else (self.mean - half, self.mean + half)

    def figure_of_merit(self, seconds: float) -> float | None:
        """Return 1 / (relative error^2 t) [1/s] of a mean that took t = `seconds` of processor time; None: unknown.

        Relative error is the standard error over the mean. It does not depend on how long a run is, and is the larger
        the less time a method needs for an error: MCNP's figure of merit (X-5 Monte Carlo Team, MCNP: a general Monte
        Carlo N-particle transport code, version 5, LA-UR-03-1987, 2003, volume I, section 2.VI.C).
        """
        if self.mean is None or not self.standard_error or seconds <= 0.0:
            return None
        return (self.mean / self.standard_error) ** 2 / seconds

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Estimate:
        """Inverse of `as_dict`; other keys are ignored, and one replica is not converged, as of earlier versions."""
        known = {name: values.get(name) for name in cls.__slots__}
        known |= {name: bool(known[name]) for name in ("starts_up", "steady_alone", "several_looks")}
        found = cls(**{**known, "batches": known["batches"] or 0, "replicas": known["replicas"] or 1})  # type: ignore[arg-type]
        return found.of_one_replica() if found.replicas == 1 else found


def more_time(found: Estimate, end: float, wanted: float) -> float | None:
    """Estimate how much longer [s] a single series must continue until half its 95 % interval is `wanted`.

    The error falls with the root of the time averaged, so that time grows with the square of half width over wanted;
    and it holds at least `MIN_BATCHES` batches. None: the steady part or the error is unknown.

    Parameters
    ----------
    found : Estimate
    end : time up to which the signal goes [s].
    wanted : half the interval's width [unit of the signal].
    """
    start, tau = found.start, found.correlation_time
    if start is None or tau is None or wanted <= 0.0:
        return None
    half = replace(found, batches=max(found.batches, MIN_BATCHES)).half_width()
    if half is None:
        return None
    averaged = end - start
    return max(max(averaged * (half / wanted) ** 2, MIN_BATCHES * BATCH_CORRELATION_TIMES * tau) - averaged, tau)


def steady_mean(
    time: np.ndarray,
    value: np.ndarray,
    *,
    average_from: float | None = None,
    duration: np.ndarray | None = None,
) -> Estimate:
    """Mean and standard error of the steady part of a signal.

    Parameters
    ----------
    time : (n,) end of each sample's window [s], strictly increasing.
    value : (n,) mean of the signal over each window.
    average_from : beginning of the steady part [s]; None lets MSER-5 find it.
    duration : (n,) length of each window [s]; None takes the distance to the window before, and for
        the first window that of the second.

    Raises
    ------
    ValueError : lengths differ, time does not increase, or a value is not finite.
    """
    t, y, dt = checked_signal(time, value, duration)
    keep = np.ones(t.size, dtype=bool)
    if average_from is not None:
        # A window that straddles the wanted start still holds transient: leave it out.
        keep = t - dt >= average_from - 1e-9 * dt
    t, y, dt = t[keep], y[keep], dt[keep]
    if t.size < MIN_SAMPLES:
        where = "" if average_from is None else f" after {average_from:g} s"
        return Estimate(
            mean=float(np.average(y, weights=dt)) if t.size else None,
            standard_error=None,
            batches=0,
            correlation_time=None,
            start=float(t[0] - dt[0]) if t.size else None,
            converged=False,
            reason=f"{t.size} samples{where}, {MIN_SAMPLES} needed",
            status=NOT_CONVERGED,
            remedy=RUN_LONGER,
        )
    steady = True
    if average_from is None:
        cut, steady = mser_cut(y, dt)
        t, y, dt = t[cut:], y[cut:], dt[cut:]
    start, total = float(t[0] - dt[0]), float(dt.sum())
    if np.ptp(y) <= 1e-13 * np.max(np.abs(y)):  # round-off of a value that does not change
        return Estimate(
            mean=float(y[0]) if np.ptp(y) == 0.0 else float(np.average(y, weights=dt)),
            standard_error=None,
            batches=0,
            correlation_time=None,
            start=start,
            converged=False,
            reason=CONSTANT,
            status=NOT_CONVERGED,
        )
    mean = float(np.average(y, weights=dt))
    even = y if np.ptp(dt) <= 1e-6 * dt.mean() else rebinned(dt, y, y.size)
    step = total / even.size
    tau = step * correlation_samples(even)
    possible = int(total / (BATCH_CORRELATION_TIMES * tau))
    batches = min(possible, MAX_BATCHES, y.size)
    error = float(np.std(even)) * math.sqrt(min(1.0, tau / total))
    drift = False
    if batches >= 2:
        means = rebinned(dt, y, batches)
        error = max(error, Measured.of(means).error)
        drift = batches >= MIN_BATCHES and drift_of(means).is_significant(1.0 - DRIFT_SIGNIFICANCE)

    status, remedy = NOT_CONVERGED, RUN_LONGER
    if not steady:
        reason = "no steady part found, the signal still changes"
    elif batches < MIN_BATCHES:
        reason = f"{batches} uncorrelated batches, {MIN_BATCHES} needed"
    elif drift:
        reason, remedy = "the signal drifts", "run longer or set a later average_from"
    else:
        reason = f"{batches} batches of {total / batches:.2g} s, correlation time {tau:.2g} s"
        status, remedy = "converged", ""
    return Estimate(
        mean=mean,
        standard_error=error,
        batches=batches,
        correlation_time=tau,
        start=start,
        converged=steady and not drift and batches >= MIN_BATCHES,
        reason=reason,
        status=status,
        remedy=remedy,
    )


def mser_cut(value: np.ndarray, duration: np.ndarray) -> tuple[int, bool]:
    """First sample of the steady part by MSER-5, and whether one was found.

    With durations w the rule reads ``MSER(d) = sum w (Y - mean)^2 / (sum w)^2``, all sums from d on;
    for equal durations that is White's. Series of fewer than 50 samples are not grouped in fives.
    """
    group = 5 if value.size >= 50 else 1
    n = value.size // group
    first = value.size - n * group  # an incomplete group is left out at the beginning
    w = duration[first:].reshape(n, group)
    weight = w.sum(axis=1)
    mean = (w * value[first:].reshape(n, group)).sum(axis=1) / weight
    y = mean - np.average(mean, weights=weight)  # centred: the running sums below cancel less
    tail_w, tail_y, tail_yy = (np.cumsum(s[::-1])[::-1] for s in (weight, weight * y, weight * y * y))
    mser = (tail_yy - tail_y**2 / tail_w) / tail_w**2
    last = n // 2
    d = int(np.argmin(mser[: last + 1]))
    return (first + d * group if d else 0), d < last


def correlation_samples(value: np.ndarray) -> float:
    """Statistical inefficiency ``1 + 2 sum rho_k`` of evenly spaced samples (n,), Sokal's window; at least 1.

    Of several series (m, n), independent ones of the same process, their mean covariance is taken.

    Anticorrelated series would give less than 1; that gain is not claimed. The sample mean takes about tau/n from every
    rho_k, which makes tau too small by the factor (1 - (2 M + 1)/n)/(1 - tau/n) to first order, M terms in the sum;
    that is put back, at most twice the value: beyond it the series is too short for any statement.
    """
    n = value.shape[-1]
    y = np.atleast_2d(value - value.mean(axis=-1, keepdims=True))
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(y, size)
    covariance = np.fft.irfft(spectrum * np.conj(spectrum), size)[:, :n].mean(axis=0)
    if covariance[0] <= 0.0:
        return 1.0
    tau_int = np.cumsum(covariance / covariance[0]) - 0.5
    inside = np.arange(n) >= SOKAL_WINDOW * tau_int
    window = int(np.argmax(inside)) if inside.any() else n - 1
    tau = max(1.0, 2.0 * float(tau_int[window]))
    return tau * max(1.0, min(2.0, (1.0 - tau / n) / max(1e-9, 1.0 - (2 * window + 1) / n)))


def rebinned(duration: np.ndarray, value: np.ndarray, bins: int) -> np.ndarray:
    """Means over `bins` equal stretches of time of a signal that is constant over each window."""
    edges = np.concatenate([[0.0], np.cumsum(duration)])
    integral = np.concatenate([[0.0], np.cumsum(duration * value)])
    new_edges = np.linspace(0.0, edges[-1], bins + 1)
    return np.diff(np.interp(new_edges, edges, integral)) / (edges[-1] / bins)


def drift_of(means: np.ndarray) -> Measured:
    """Return the drift from begin to end of a line through batch means (n,), positive where they rise."""
    return line(np.arange(means.size), means).slope.scaled(means.size)


def checked_signal(
    time: np.ndarray, value: np.ndarray, duration: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.asarray(time, dtype=np.float64).ravel()
    y = np.asarray(value, dtype=np.float64).ravel()
    if t.size != y.size:
        raise ValueError(f"time has {t.size} samples, value has {y.size}; they must be equally long")
    bad = np.count_nonzero(~np.isfinite(y)) + np.count_nonzero(~np.isfinite(t))
    if bad:
        raise ValueError(f"{bad} of {t.size} samples are not finite numbers; their mean is undefined")
    steps = np.diff(t)
    if (steps <= 0.0).any():
        at = int(np.argmax(steps <= 0.0))
        raise ValueError(f"time must increase: sample {at + 1} at {t[at + 1]:g} s follows {t[at]:g} s")
    if duration is not None:
        dt = np.asarray(duration, dtype=np.float64).ravel()
        if dt.size != t.size or not (dt > 0.0).all():
            raise ValueError("duration needs one positive number a sample")
    else:
        dt = np.concatenate([steps[:1], steps]) if t.size > 1 else np.ones(t.size)
    return t, y, dt
