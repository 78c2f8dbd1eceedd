"""Mean of a noisy signal over independent replicas (runs with other seeds): one replica is one number.

1. **Start-up.** The averaged part is the same for all replicas. It begins at the latest of: the time that the caller
   knows the start-up to last (`settled`), half of the series, and, where MSER-5 cuts the mean over the replicas later
   than `settled`, twice that cut, at most 0.6 of the series (P. D. Welch in S. S. Lavenberg (ed.), Computer
   Performance Modeling Handbook, 1983, 268-328, for the mean over replicas; for MSER-5 see `statistics`).
2. **Interval.** Student's t of the replicas' means over that part, with one degree of freedom less than replicas.
   Nothing within a replica is pooled: a replica never changes how its grains were packed. Where a rule that looks
   several times ends the run, the level is 97 % for 95 % (`Estimate.half_width`). A replica that has not come as far
   as the others has its mean up to its own end; all means have the same weight, since the variance of their sum is
   then the mean of their variances, whatever these are.

   **Pooled scatter.** An accuracy study has measured the standard deviation s_0 between replicas with nu_0 degrees of
   freedom. With it s^2 = (nu_0 s_0^2 + (n - 1) s_n^2)/(nu_0 + n - 1), and t has nu_0 + n - 1 degrees of freedom. The
   run's own scatter s_n counts alone where it is significantly larger (F test at `POOLING_SIGNIFICANCE`), since the
   study may have had other conditions.
3. **Drift.** One slope a replica. The error of their mean comes from the scatter of the slopes and from the quadratic
   and cubic coefficients of each replica (Legendre polynomials; for short-memory noise their variances are equal):
   3 R - 1 degrees of freedom for R replicas. Slow fluctuations have
   larger slopes than cubic coefficients, which makes the error up to a tenth too small at a correlation time of a tenth
   of the part.
   A single replica has the line through its batch means: it is not steady where that drifts by more than is asked
   for, or by more than `USUAL`, beyond its 95 % error. It is never converged, since its error leaves out the scatter
   between replicas (`Estimate.steady_alone`).
4. **Verdict** (`steadiness`): steady, drifting or not settled. To exclude a drift takes several times the replicas that
   the interval needs; it need not be excluded where an accuracy study has measured the start-up, on more replicas.

Coverage and power, measured with synthetic series: tests/results/test_stopping_rule.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from emclutch.results.fits import Measured, student
from emclutch.results.statistics import (
    CONSTANT,
    MIN_SAMPLES,
    NOT_CONVERGED,
    RUN_LONGER,
    Estimate,
    checked_signal,
    correlation_samples,
    drift_of,
    mser_cut,
    rebinned,
    steady_mean,
)
from emclutch.results.text import format_time

USUAL = 0.05
"""Half the 95 % interval over the mean, for which verdicts and estimates are given where nothing is asked for."""

MAX_MSER_CUT = 0.6  # of the series
START_UP_LIMIT = 0.5  # of the series: a longer start-up is not over
MSER_FACTOR = 2.0  # MSER minimises the mean square error, which leaves a bias of the size of the standard error
MIN_AVERAGED = 8  # windows that are averaged at least: a cubic has four coefficients
DRIFT_LIMIT = 2.0  # of the half width that is asked for: a drift that a steady signal excludes
DRIFT_CONFIDENCE = 0.975
"""One-sided. With it a drift at the limit passes in less than 10 % of runs under the rule that ends them: up to nine
looks, of which each has its chance."""
MARGIN = 0.9  # of the half width that is asked for: aimed at when the rest is estimated
POOLING_SIGNIFICANCE = 0.3
"""One-sided, of the F test that keeps a run's own scatter apart from that of a study. It is large since the test has
little power with few replicas: with 0.2 and a study's scatter of half the true one 90 % of intervals hold, with 0.3 and
no more than 3 degrees of freedom of the study 93 %."""
MAX_DRIFT = 0.75  # of the half width that is asked for: beyond it (95 %) a drift is not cured by more replicas


class Steadiness(Enum):
    """Verdict on a mean over replicas, see `steadiness`."""

    STEADY = "steady"
    DRIFTING = "drifting"
    NOT_SETTLED = "not settled"


def replicated_mean(
    signals: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    *,
    average_from: float | None = None,
    settled: float = 0.0,
    exclude_drift: bool = True,
    wanted: Callable[[float], float] = lambda mean: USUAL * abs(mean),
    several_looks: bool = False,
    scatter: float = 0.0,
    scatter_freedom: float = 0.0,
) -> Estimate:
    """Mean, standard error and drift of the steady part that replicas of one signal have in common.

    Parameters
    ----------
    signals : of each replica the ends of its windows (n,) [s], the signal's means over them (n,), and their lengths
        (n,) [s]; windows of the replica that has come farthest are taken for all, each up to its own end.
    average_from : beginning of the averaged part [s]; None chooses it as the module says.
    settled : time [s] before which the averaged part does not begin, unless `average_from` says so.
    exclude_drift : False: the start-up is known to be over by `average_from`.
    wanted : half width of the interval that is asked for, as a function of the mean; the verdict depends on it.
    several_looks : a rule that looks several times ends the run.
    scatter, scatter_freedom : standard deviation between replicas over the mean that a study has measured, and its
        degrees of freedom; 0: none.

    Returns
    -------
    Estimate
        Of a single replica that of `statistics.steady_mean`, but not converged.

    Raises
    ------
    ValueError : as `statistics.steady_mean`; no signal.
    """
    if not signals:
        raise ValueError("no replica to take a mean of")
    if len(signals) == 1:
        time, value, duration = signals[0]
        alone = steady_mean(time, value, duration=duration, average_from=average_from)
        if average_from is None and settled > (alone.start or 0.0):
            rest = steady_mean(time, value, duration=duration, average_from=settled)
            if rest.mean is None:
                return _too_short(alone, settled)
            alone = rest
        return _without_drift(alone, signals[0], wanted).of_one_replica()
    t, dt, rows = _on_common_windows([checked_signal(*signal) for signal in signals])
    count, size, farthest = len(signals), min(map(len, rows)), float(t[-1]) if t.size else 0.0
    y, t = np.array([row[:size] for row in rows]), t[:size]
    end = float(t[-1]) if size else 0.0
    begin = t - dt[:size] * (1.0 + 1e-9)
    nominal = max(settled, end / 2.0) if average_from is None else average_from
    first = int(np.searchsorted(begin, nominal - 1e-6 * dt.mean())) if size else 0
    if size < MIN_SAMPLES or size - first < MIN_AVERAGED:
        late = min(first, size // 2)
        mean = float(np.average(y[:, late:].mean(axis=0), weights=dt[late:size])) if size else None
        start = float(t[late] - dt[late]) if size else None
        reason = f"{size} windows, {MIN_SAMPLES} needed"
        short = Estimate(mean, None, 0, None, start, False, reason, count, end=end, settled=nominal,
                         status=NOT_CONVERGED, remedy=RUN_LONGER)  # fmt: skip
        return short if size < MIN_SAMPLES else _too_short(short, nominal)
    own, drift = _mean_and_drift(rows, dt, first)
    starting = False
    if average_from is None:
        latest = max(first, size - MIN_AVERAGED)
        found_cut, is_over = mser_cut(y.mean(axis=0), dt[:size])
        cut = int(MSER_FACTOR * found_cut) if begin[found_cut] > settled else 0  # else part of what is known
        # after a start-up that is known MSER alone decides; else a start-up is over after twice its cut
        starting = cut > 0 and (not is_over if settled > 0.0 else cut > START_UP_LIMIT * size)
        cut = min(cut, int(MAX_MSER_CUT * size))
        if cut > first:
            first = min(cut, latest)
            own, drift = _mean_and_drift(rows, dt, first)
    start, length = float(t[first] - dt[first]), farthest - float(t[first] - dt[first])
    averaged = np.concatenate([row[first:] for row in rows])
    if np.ptp(averaged) <= 1e-13 * np.max(np.abs(averaged)):  # round-off of a value that does not change
        return Estimate(own.value, None, 0, None, start, False, CONSTANT, count, end=farthest, settled=nominal,
                        status=NOT_CONVERGED)  # fmt: skip
    even = np.array([rebinned(dt[first:size], row, size - first) for row in y[:, first:]])
    samples = correlation_samples(even)
    average, pooled = _pooled(own, scatter, scatter_freedom)
    found = Estimate(
        average.value,
        average.error,
        count,
        (end - start) / even.shape[1] * samples,
        start,
        False,
        "",
        count,
        degrees_of_freedom=average.freedom,
        end=farthest,
        settled=min(nominal, start),
        drift=drift.value / length,
        drift_error=drift.error / length,
        drift_freedom=drift.freedom,
        starts_up=starting,
        fluctuation=math.sqrt(float(even.var(axis=1).mean()) * min(1.0, samples / even.shape[1])),
        exclude_drift=exclude_drift,
        several_looks=several_looks,
        pooled_scatter=scatter if pooled else None,
        pooled_freedom=scatter_freedom if pooled else None,
    )
    return judged(found, wanted(average.value))


def _pooled(mean: Measured, scatter: float, freedom: float) -> tuple[Measured, bool]:
    """The mean of replicas with a study's scatter pooled in its error, and whether it is."""
    from scipy.special import fdtri

    count = mean.freedom + 1.0
    own, known = mean.error**2 * count, (scatter * mean.value) ** 2
    if known <= 0.0 or freedom <= 0.0 or own > known * fdtri(mean.freedom, freedom, 1.0 - POOLING_SIGNIFICANCE):
        return mean, False
    both = freedom + mean.freedom
    return Measured(mean.value, math.sqrt((freedom * known + mean.freedom * own) / both / count), both), True


def _without_drift(
    found: Estimate, signal: tuple[np.ndarray, np.ndarray, np.ndarray], wanted: Callable[[float], float]
) -> Estimate:
    """The estimate of one replica; not converged where it drifts by more than `wanted` or `USUAL` (95 %)."""
    if not found.converged or found.mean is None or found.start is None:
        return found
    t, y, dt = checked_signal(*signal)
    late = t - 0.5 * dt > found.start
    drift = drift_of(rebinned(dt[late], y[late], found.batches))
    limit = min(wanted(found.mean), USUAL * abs(found.mean))
    if abs(drift.value) <= max(limit, drift.half_width()):
        return found
    size = 100.0 * abs(drift.value / found.mean)
    how = "falls" if drift.value * found.mean < 0.0 else "rises"
    reason = f"the signal {how} by {size:.2g} % over the averaged part"
    remedy = "run longer, or average from later"
    return replace(found, converged=False, reason=reason, status=NOT_CONVERGED, remedy=remedy)


def _too_short(found: Estimate, nominal: float) -> Estimate:
    """The estimate of a run that ends before its start-up does, at `nominal` [s] at the earliest."""
    reason = f"the run is too short for its start-up, at least {format_time(nominal)}"
    short = replace(found, converged=False, standard_error=None, reason=reason)
    return replace(short, status=Steadiness.NOT_SETTLED.value, remedy=RUN_LONGER)


def judged(found: Estimate, wanted: float) -> Estimate:
    """The estimate of several replicas with the verdict for a half width that is asked for [unit of the signal]."""
    verdict = steadiness(found, wanted)
    part = f"{found.replicas} replicas, averaged from {found.start:.3g} to {found.end:.3g} s"
    share = f"{drift_in_words(found)} over the averaged part"
    remedy = RUN_LONGER
    if verdict is Steadiness.STEADY:
        reason, remedy = f"{part}; drift {share}", ""
    elif verdict is Steadiness.DRIFTING:
        reason = f"the drift is {share}; the interval is of this part ({part})"
    elif found.starts_up:
        reason = (
            f"the start-up takes more than {START_UP_LIMIT:g} of the run, and the interval is of the rest ({part})"
        )
    else:
        limit = DRIFT_LIMIT * wanted
        reason = (
            f"a drift of {_relative(limit, found.mean)} over the averaged part is not excluded ({share}), and the "
            f"interval is of this part ({part})"
        )
        remedy = "more replicas, or run longer"
    is_steady = verdict is Steadiness.STEADY
    return replace(found, converged=is_steady, reason=reason, status=verdict.value, remedy=remedy)


def steadiness(found: Estimate, wanted: float) -> Steadiness:
    """Verdict for a half width that is asked for [unit of the signal].

    With the drift counted over the run from the end of the start-up on (a later start of the average hides nothing):
    *steady* where a drift of twice `wanted` is excluded, *drifting* where it is not and zero is (95 %), else *not
    settled*; not settled too where the start-up takes most of the run. Where the start-up is known to be over
    (`Estimate.exclude_drift` is False) all is steady but what `drifts_significantly`. Of a single replica: whether it
    converged.
    """
    if found.drift is None or found.drift_error is None or found.drift_freedom is None:
        return Steadiness.STEADY if found.converged else Steadiness.NOT_SETTLED
    if not found.exclude_drift:
        return Steadiness.DRIFTING if drifts_significantly(found, wanted) else Steadiness.STEADY
    drift = _nominal_drift(found)
    excluded = drift.value + student(drift.freedom, DRIFT_CONFIDENCE) * drift.error < DRIFT_LIMIT * wanted
    if excluded and not found.starts_up:
        return Steadiness.STEADY
    return Steadiness.DRIFTING if drift.is_significant() else Steadiness.NOT_SETTLED


def drifts_significantly(found: Estimate, wanted: float) -> bool:
    """True if a drift beyond `MAX_DRIFT` times `wanted` is certain (95 %): more replicas do not cure it."""
    if found.drift is None or found.drift_error is None or found.drift_freedom is None:
        return False
    drift = _nominal_drift(found)
    return drift.value - student(drift.freedom, 0.95) * drift.error > MAX_DRIFT * wanted


def may_be_zero(found: Estimate) -> bool:
    """True if the interval holds 0, so that no fraction of the mean can be reached."""
    half = found.half_width()
    return half is not None and found.mean is not None and abs(found.mean) <= half


def more_replicas_suffice(found: Estimate, count: int, wanted: float) -> bool:
    """True if `count` replicas of the same length are expected to reach the half width `wanted`."""
    return _expected(found, count, 1.0) <= MARGIN * wanted and _expected_drift(found, count, 1.0, wanted)


def more_time_suffices(found: Estimate, length: float, wanted: float) -> bool:
    """True if the same replicas are expected to reach the half width `wanted` at the time `length` [s]."""
    start, end = found.start or 0.0, found.end or length
    start = max(start, 0.5 * length)
    if found.end is None or found.start is None or length <= start or end <= found.start:
        return False
    factor = (length - start) / (end - found.start)
    return _expected(found, found.replicas, factor) <= MARGIN * wanted and _expected_drift(
        found, found.replicas, factor, wanted
    )


def _expected(found: Estimate, count: int, factor: float) -> float:
    """Half width [unit of the signal] of `count` replicas averaged `factor` times as long."""
    variance = (found.standard_error or math.inf) ** 2 * found.replicas
    own = min((found.fluctuation or 0.0) ** 2, variance)
    one = variance - own + own / factor
    freedom = found.replicas - 1.0 if found.degrees_of_freedom is None else found.degrees_of_freedom
    return found.quantile(freedom + count - found.replicas) * math.sqrt(one / count)


def _expected_drift(found: Estimate, count: int, factor: float, wanted: float) -> bool:
    """True if a drift is expected to be excluded, if there is none."""
    if not found.exclude_drift or found.drift_error is None or found.end is None or found.settled is None:
        return True
    error = _nominal_drift(found).error * math.sqrt(found.replicas / count / factor)
    return bool((1.0 + student(3.0 * count - 1.0, DRIFT_CONFIDENCE)) * error < DRIFT_LIMIT * wanted)


def drift_in_words(found: Estimate) -> str:
    """The drift over the averaged part with its 95 % half width, relative to the mean: ``1.2 ± 0.8 %``."""
    if found.drift is None or found.drift_error is None or found.start is None or found.end is None or not found.mean:
        return "unknown"
    length, scale = found.end - found.start, 100.0 / abs(found.mean)
    half = student(found.drift_freedom or 1.0) * found.drift_error * length
    sign = 1.0 if found.mean > 0.0 else -1.0
    return f"{sign * found.drift * length * scale:.2g} ± {half * scale:.2g} %"


def _nominal_drift(found: Estimate) -> Measured:
    """Magnitude of the drift from the end of the start-up to the end of the run."""
    span = (found.end or 0.0) - (found.settled or 0.0)
    return Measured(abs(found.drift or 0.0) * span, (found.drift_error or 0.0) * span, found.drift_freedom or 1.0)


def _relative(value: float, mean: float | None) -> str:
    return f"{100.0 * value / abs(mean):.2g} %" if mean else f"{value:.2g}"


def _mean_and_drift(rows: Sequence[np.ndarray], dt: np.ndarray, first: int) -> tuple[Measured, Measured]:
    """Return mean and drift over the longest part, of Legendre polynomials up to the cubic through each replica.

    From the means over windows of lengths dt (n,) of each replica, from the window `first` to its own end.
    """
    longest = float(dt[first:].sum())
    means, slopes, scales, curvature = [], [], [], 0.0
    for size in sorted({row.size for row in rows}):
        width, same = dt[first:size], [row[first:] for row in rows if row.size == size]
        x = (2.0 * np.arange(width.size) + 1.0) / width.size - 1.0
        basis, triangle = np.linalg.qr(np.polynomial.legendre.legvander(x, 3))
        even = np.array([rebinned(width, row, width.size) for row in same])
        coefficients = even @ basis  # of one variance for white noise, in all replicas
        means += list(np.average(same, weights=width, axis=1))
        slopes += list(coefficients[:, 1])
        scales += [0.5 * triangle[1, 1] * float(width.sum()) / longest] * len(same)  # 1 on [-1, 1] drifts by 2
        curvature += float((coefficients[:, 2:] ** 2).sum())
    scale = float(np.dot(scales, scales))
    drift, freedom = float(np.dot(scales, slopes)) / scale, 3.0 * len(rows) - 1.0
    squares = float(((np.array(slopes) - drift * np.array(scales)) ** 2).sum()) + curvature
    return Measured.of(means), Measured(drift, math.sqrt(squares / freedom / scale), freedom)


def _on_common_windows(
    signals: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Ends (n,) and lengths (n,) of common windows [s], and of each replica the means over those it has come to."""
    t, _, dt = max(signals, key=lambda signal: float(signal[0][-1]) if signal[0].size else 0.0)
    rows = []
    for time, value, duration in signals:
        size = int(np.searchsorted(t, float(time[-1]) * (1.0 + 1e-9), side="right")) if time.size else 0
        if np.array_equal(time[:size], t[:size]):
            rows.append(value[:size])
            continue
        ends = np.concatenate([time[:1] - duration[:1], time])
        integral = np.concatenate([[0.0], np.cumsum(duration * value)])
        inside = t[:size]
        rows.append((np.interp(inside, ends, integral) - np.interp(inside - dt[:size], ends, integral)) / dt[:size])
    return t, dt, rows
