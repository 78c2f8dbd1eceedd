"""Mean of a noisy signal over independent replicas (packings of the same scene): one replica is one number.

1. **Start-up.** The averaged part is the same for all replicas. It begins at the latest of: the time that the caller
   knows the start-up to last (`settled`), half of the series, and, where MSER-5 cuts the mean over the replicas later
   than `settled`, twice that cut, at most 0.6 of the series (P. D. Welch in S. S. Lavenberg (ed.), Computer
   Performance Modeling Handbook, 1983, 268-328, for the mean over replicas; for MSER-5 see `statistics`).
2. **Interval.** Student's t of the replicas' means over that part, with one degree of freedom less than replicas.
   Nothing within a replica is pooled: a replica never changes how its grains were packed. Its level is 97 % where
   95 % is asked for, since the rule that ends a run looks several times (`Estimate.half_width`).
3. **Drift.** One slope a replica. The error of their mean comes from the scatter of the slopes and from the quadratic
   and cubic coefficients of each replica (Legendre polynomials, which a series of short memory has with the same
   variance, and one without curvature with mean 0): 3 R - 1 degrees of freedom for R replicas. Slow fluctuations have
   larger slopes than cubic coefficients, which makes the error up to a tenth too small at a correlation time of a tenth
   of the part.
   A single replica has the line through its batch means: it is not converged where that drifts by more than is asked
   for, or by more than `USUAL`, beyond its 95 % error.
4. **Verdict** (`steadiness`): steady, drifting or not settled. To exclude a drift takes several times the packings that
   the interval needs; it need not be excluded where a ladder has measured the start-up, on more packings than a run.

Coverage and power, measured with synthetic series: tests/results/test_stopping_rule.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from emclutch.results.statistics import (
    MIN_SAMPLES,
    STOPPING_ALLOWANCE,
    Estimate,
    checked_signal,
    correlation_samples,
    drift_of,
    mser_cut,
    rebinned,
    steady_mean,
)

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
MAX_DRIFT = 0.75  # of the half width that is asked for: beyond it (95 %) a drift is not cured by more packings


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
) -> Estimate:
    """Mean, standard error and drift of the steady part that replicas of one signal have in common.

    Parameters
    ----------
    signals : of each replica the ends of its windows (n,) [s], the signal's means over them (n,), and their lengths
        (n,) [s]; windows of the first replica are taken for all, up to the earliest end.
    average_from : beginning of the averaged part [s]; None chooses it as the module says.
    settled : time [s] before which the averaged part does not begin, unless `average_from` says so.
    exclude_drift : False: the start-up is known to be over by `average_from`.
    wanted : half width of the interval that is asked for, as a function of the mean; the verdict depends on it.

    Returns
    -------
    Estimate
        Of a single replica that of `statistics.steady_mean`, which lacks what replicas differ by.

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
        return _without_drift(alone, signals[0], wanted)
    t, y, dt = _common_windows([checked_signal(*signal) for signal in signals])
    count, size = len(signals), t.size
    end = float(t[-1]) if size else 0.0
    begin = t - dt * (1.0 + 1e-9)
    nominal = max(settled, end / 2.0) if average_from is None else average_from
    first = int(np.searchsorted(begin, nominal - 1e-6 * dt.mean())) if size else 0
    if size < MIN_SAMPLES or size - first < MIN_AVERAGED:
        late = min(first, size // 2)
        mean = float(np.average(y[:, late:].mean(axis=0), weights=dt[late:])) if size else None
        start = float(t[late] - dt[late]) if size else None
        reason = f"not converged: {size} windows, {MIN_SAMPLES} needed; run longer"
        short = Estimate(mean, None, 0, None, start, False, reason, count, end=end, settled=nominal)
        return short if size < MIN_SAMPLES else _too_short(short, nominal)
    fit = _StretchFit.of(y[:, first:], dt[first:])
    starting = False
    if average_from is None:
        latest = max(first, size - MIN_AVERAGED)
        found_cut, is_over = mser_cut(y.mean(axis=0), dt)
        cut = int(MSER_FACTOR * found_cut) if begin[found_cut] > settled else 0  # else part of what is known
        # after a start-up that is known MSER alone decides; else a start-up is over after twice its cut
        starting = cut > 0 and (not is_over if settled > 0.0 else cut > START_UP_LIMIT * size)
        cut = min(cut, int(MAX_MSER_CUT * size))
        if cut > first:
            first = min(cut, latest)
            fit = _StretchFit.of(y[:, first:], dt[first:])
    start, length = float(t[first] - dt[first]), float(dt[first:].sum())
    if np.ptp(y[:, first:]) <= 1e-13 * np.max(np.abs(y[:, first:])):  # round-off of a value that does not change
        reason = "not converged: the signal does not change, so nothing in it says how far off its mean is"
        return Estimate(fit.mean, None, 0, None, start, False, reason, count, end=end, settled=nominal)
    even = np.array([rebinned(dt[first:], row, size - first) for row in y[:, first:]])
    samples = correlation_samples(even)
    found = Estimate(
        fit.mean,
        fit.error,
        count,
        length / even.shape[1] * samples,
        start,
        False,
        "",
        count,
        degrees_of_freedom=count - 1.0,
        end=end,
        settled=min(nominal, start),
        drift=fit.drift / length,
        drift_error=fit.drift_error / length,
        drift_freedom=3.0 * count - 1.0,
        starts_up=starting,
        fluctuation=math.sqrt(float(even.var(axis=1).mean()) * min(1.0, samples / even.shape[1])),
        exclude_drift=exclude_drift,
    )
    return judged(found, wanted(fit.mean))


def _without_drift(
    found: Estimate, signal: tuple[np.ndarray, np.ndarray, np.ndarray], wanted: Callable[[float], float]
) -> Estimate:
    """The estimate of one replica; not converged where it drifts by more than `wanted` or `USUAL` (95 %)."""
    if not found.converged or found.mean is None or found.start is None:
        return found
    t, y, dt = checked_signal(*signal)
    late = t - 0.5 * dt > found.start
    drift, error = drift_of(rebinned(dt[late], y[late], found.batches))
    limit = min(wanted(found.mean), USUAL * abs(found.mean))
    if abs(drift) <= max(limit, _quantile(found.batches - 2.0, 0.975) * error):
        return found
    size = 100.0 * abs(drift / found.mean)
    how = "falls" if drift * found.mean < 0.0 else "rises"
    reason = f"not converged: the signal {how} by {size:.2g} % over the averaged part"
    return replace(found, converged=False, reason=f"{reason}; run longer, or average from later")


def _too_short(found: Estimate, nominal: float) -> Estimate:
    """The estimate of a run that ends before its start-up does, at `nominal` [s] at the earliest."""
    reason = f"not settled: the run is hardly longer than its start-up ({nominal:.3g} s at the least); run longer"
    return replace(found, converged=False, standard_error=None, reason=reason)


def judged(found: Estimate, wanted: float) -> Estimate:
    """The estimate of several replicas with the verdict for a half width that is asked for [unit of the signal]."""
    verdict = steadiness(found, wanted)
    part = f"{found.replicas} packings, averaged from {found.start:.3g} to {found.end:.3g} s"
    share = f"{drift_in_words(found)} over the averaged part"
    if verdict is Steadiness.STEADY:
        reason = f"steady: {part}; drift {share}"
    elif verdict is Steadiness.DRIFTING:
        reason = f"drifting: by {share}; the interval is of this part ({part}); run longer"
    elif found.starts_up:
        reason = (
            f"not settled: the start-up takes more than {START_UP_LIMIT:g} of the run, and the interval is of the rest "
            f"({part}); run longer"
        )
    else:
        limit = DRIFT_LIMIT * wanted
        reason = (
            f"not settled: a drift of {_relative(limit, found.mean)} over the averaged part is not excluded "
            f"({share}), and the interval is of this part ({part}); more packings, or run longer"
        )
    return replace(found, converged=verdict is Steadiness.STEADY, reason=reason)


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
    drift, error = _nominal_drift(found)
    excluded = drift + _quantile(found.drift_freedom, DRIFT_CONFIDENCE) * error < DRIFT_LIMIT * wanted
    if excluded and not found.starts_up:
        return Steadiness.STEADY
    zero_excluded = drift > _quantile(found.drift_freedom, 0.975) * error
    return Steadiness.DRIFTING if zero_excluded else Steadiness.NOT_SETTLED


def drifts_significantly(found: Estimate, wanted: float) -> bool:
    """True if a drift beyond `MAX_DRIFT` times `wanted` is certain (95 %): more replicas do not cure it."""
    if found.drift is None or found.drift_error is None or found.drift_freedom is None:
        return False
    drift, error = _nominal_drift(found)
    return drift - _quantile(found.drift_freedom, 0.95) * error > MAX_DRIFT * wanted


def may_be_zero(found: Estimate) -> bool:
    """True if the interval holds 0, so that no fraction of the mean can be reached."""
    half = found.half_width()
    return half is not None and found.mean is not None and abs(found.mean) <= half


def more_packings_suffice(found: Estimate, count: int, wanted: float) -> bool:
    """True if `count` packings of the same length are expected to reach the half width `wanted`."""
    return _expected(found, count, 1.0) <= MARGIN * wanted and _expected_drift(found, count, 1.0, wanted)


def more_time_suffices(found: Estimate, length: float, wanted: float) -> bool:
    """True if the same packings are expected to reach the half width `wanted` at the time `length` [s]."""
    start, end = found.start or 0.0, found.end or length
    start = max(start, 0.5 * length)
    if found.end is None or found.start is None or length <= start or end <= found.start:
        return False
    factor = (length - start) / (end - found.start)
    return _expected(found, found.replicas, factor) <= MARGIN * wanted and _expected_drift(
        found, found.replicas, factor, wanted
    )


def _expected(found: Estimate, count: int, factor: float) -> float:
    """Half width [unit of the signal] of `count` packings averaged `factor` times as long."""
    variance = (found.standard_error or math.inf) ** 2 * found.replicas
    own = min((found.fluctuation or 0.0) ** 2, variance)
    one = variance - own + own / factor
    return _quantile(count - 1.0, 1.0 - 0.025 * STOPPING_ALLOWANCE) * math.sqrt(one / count)


def _expected_drift(found: Estimate, count: int, factor: float, wanted: float) -> bool:
    """True if a drift is expected to be excluded, if there is none."""
    if not found.exclude_drift or found.drift_error is None or found.end is None or found.settled is None:
        return True
    error = _nominal_drift(found)[1] * math.sqrt(found.replicas / count / factor)
    return bool((1.0 + _quantile(3.0 * count - 1.0, DRIFT_CONFIDENCE)) * error < DRIFT_LIMIT * wanted)


def drift_in_words(found: Estimate) -> str:
    """The drift over the averaged part with its 95 % half width, relative to the mean: ``1.2 +- 0.8 %``."""
    if found.drift is None or found.drift_error is None or found.start is None or found.end is None or not found.mean:
        return "unknown"
    length, scale = found.end - found.start, 100.0 / abs(found.mean)
    half = _quantile(found.drift_freedom or 1.0, 0.975) * found.drift_error * length
    sign = 1.0 if found.mean > 0.0 else -1.0
    return f"{sign * found.drift * length * scale:.2g} +- {half * scale:.2g} %"


def _nominal_drift(found: Estimate) -> tuple[float, float]:
    """Magnitude and standard error of the drift from the end of the start-up to the end of the run."""
    span = (found.end or 0.0) - (found.settled or 0.0)
    return abs(found.drift or 0.0) * span, (found.drift_error or 0.0) * span


def _relative(value: float, mean: float | None) -> str:
    return f"{100.0 * value / abs(mean):.2g} %" if mean else f"{value:.2g}"


def _quantile(freedom: float, probability: float) -> float:
    """Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, probability))


class _StretchFit:
    """Legendre coefficients up to the cubic of each replica over a part; mean and drift with their errors."""

    def __init__(self, coefficients: np.ndarray, mean: float, error: float) -> None:
        count = len(coefficients)
        slopes = coefficients[:, 1]
        self.mean, self.error = mean, error
        self.freedom = 3.0 * count - 1.0
        squares = float(((slopes - slopes.mean()) ** 2).sum() + (coefficients[:, 2:] ** 2).sum())
        self.drift = float(slopes.mean())  # from one end of the part to the other
        self.drift_error = math.sqrt(squares / self.freedom / count)

    @classmethod
    def of(cls, y: np.ndarray, dt: np.ndarray) -> _StretchFit:
        """From the means (m, n) over windows of lengths dt (n,)."""
        means = np.average(y, weights=dt, axis=1)
        error = float(means.std(ddof=1)) / math.sqrt(len(means))
        even = np.array([rebinned(dt, row, dt.size) for row in y])
        x = (2.0 * np.arange(dt.size) + 1.0) / dt.size - 1.0
        basis, triangle = np.linalg.qr(np.polynomial.legendre.legvander(x, 3))
        # coefficients of orthonormal columns have one variance for white noise; a slope of 1 on [-1, 1] drifts by 2
        return cls(even @ basis * (2.0 / triangle[1, 1]), float(means.mean()), error)


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
