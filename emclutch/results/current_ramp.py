"""Torque against current from one run whose current is a slow ramp: means of bins on the rising and falling branches.

The course of the current is cut where its magnitude turns from rising to falling or to being held. Bins divide the
magnitude from 0 to the largest one evenly, the same for all branches, so that they can be compared bin by bin. Of
several replicas a bin's error is that of the mean of its means; of one it is that of its own fluctuation about a smooth
curve, by the correlation time, and leaves out the scatter between replicas.

A branch in which the gap is sheared by less than `MIN_AVERAGED_STRAIN` is a switching and not a ramp, and has no bins.
What lags behind the current (grains need a strain of some units to rearrange) makes the rising branch lower and the
falling one higher, as hysteresis does: a ramp of half the rate distinguishes them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import TIME, TORQUE_DISC
from emclutch.results.fits import Measured
from emclutch.results.statistics import correlation_samples
from emclutch.results.steady_torque import MIN_AVERAGED_STRAIN, SteadyConditions, durations, shear_strain

if TYPE_CHECKING:
    import pandas

    from geometry.time_profile import TimeProfile

TABLE, PICTURE = "torque_vs_current.csv", "torque_vs_current.png"
RISING, FALLING, HELD = "rising", "falling", "held"
SHARES = (0.2, 0.5, 0.8)
"""Of the largest current, at which the summary compares both branches."""
_BINS = 20  # at most; of a torque as I^2 a mean over a twentieth is 1 % too large at a fifth of the current
_STRAIN = 1.0  # of the gap, that a bin has at least
_WINDOWS = 4  # that a bin has at least
_AROUND = 2  # bins on each side, from whose fluctuation the error of a single replica is taken
_ROUND_OFF = 1e-6  # of a window, in the time of its begin
_APART = 0.1  # of a bin's width, that mean currents of two branches differ by at most: else one covers a part of it


@dataclass(frozen=True, slots=True)
class Branch:
    """A stretch of time in which the magnitude of the current rises, falls or is held.

    Attributes
    ----------
    kind : str
        "rising", "falling" or "held".
    begin, end : float
        [s].
    """

    kind: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True, eq=False)
class RampBin:
    """Torque of one bin of one branch.

    Attributes
    ----------
    branch : int
        Its number, from 0 on.
    kind : str
        "rising", "falling" or "held".
    low, high : float
        Ends of the bin, magnitudes [A]; equal where the current is held.
    current : float
        Mean current [A], with its sign.
    means : ndarray (m,)
        Mean torque [N m] of each replica.
    torque : Measured
        Mean of these [N m]; error nan: unknown.
    correlated : float
        Bins that one correlation time of a single replica lasts, at least 1: their noise is the same.
    settled : bool
        False where the current is held so briefly that the change of the torque after the ramp is averaged too.
    """

    branch: int
    kind: str
    low: float
    high: float
    current: float
    means: np.ndarray
    torque: Measured
    correlated: float = 1.0
    settled: bool = True


@dataclass(frozen=True, slots=True)
class CurrentRamp:
    """Bins of a run's branches, in the order of time."""

    bins: tuple[RampBin, ...]

    @property
    def largest(self) -> float:
        """Largest current of a bin's end [A]."""
        return max(one.high for one in self.bins)

    def table(self) -> pandas.DataFrame:
        """A row for each bin; currents in A, torques in N m, `low` and `high` the 95 % interval."""
        import pandas

        rows = []
        for one in self.bins:
            low, high = one.torque.interval()
            rows.append(
                {
                    "branch": one.branch + 1,
                    "course": one.kind,
                    "current": one.current,
                    "current_low": one.low,
                    "current_high": one.high,
                    "torque": one.torque.value,
                    "standard_error": one.torque.error,
                    "low": low,
                    "high": high,
                    "replicas": one.means.size,
                }
            )
        return pandas.DataFrame(rows)

    def summary(self) -> dict[str, Any]:
        """Both branches compared at `SHARES` of the largest current, the loop's area, and the torque left at 0 A.

        The first rising branch and the first falling one after it; their difference is taken replica by replica. Area:
        integral of falling less rising torque over the current, over the product of the largest current and the torque
        there. `half_width` is of the 95 % interval, None: unknown. Entries are None where the run has no such branch.
        Bins that one of the branches covers in part are left out.
        """
        rising = self._first(RISING)
        falling = self._first(FALLING, rising[-1].branch) if rising else []
        found: dict[str, Any] = {"largest_current": self.largest, "loop": [], "area": None, "residual": None}
        residual = [one for one in self.bins if one.kind == HELD and one.high == 0.0 and falling
                    and one.branch > falling[0].branch]  # fmt: skip
        if residual:
            left = residual[0]
            found["residual"] = _in_numbers(left.torque, "torque")
            found["residual"]["decay_included"] = not left.settled
        pairs = [(up, down) for up in rising for down in falling if up.low == down.low and up.high == down.high
                 and abs(abs(up.current) - abs(down.current)) <= _APART * (up.high - up.low)]  # fmt: skip
        if len(pairs) < 3:
            return found
        pairs.sort(key=lambda pair: pair[0].low)
        x = np.array([0.5 * (up.low + up.high) for up, _ in pairs])
        up, down = (np.array([pair[i].means for pair in pairs]) for i in (0, 1))
        top = 0.5 * (up + down).mean(axis=1)
        at_top = float(top[-1] + (top[-1] - top[-2]) / (x[-1] - x[-2]) * (self.largest - x[-1]))
        found["torque_at_largest_current"] = at_top
        for share in SHARES:
            at = share * self.largest
            if not x[0] <= at <= x[-1]:
                continue
            weight = np.array([np.interp(at, x, row) for row in np.eye(x.size)])
            low, high = weight @ up, weight @ down
            mean, of_falling = float(low.mean()), float(high.mean())
            ratio = of_falling / mean if mean else None
            width = _in_numbers(_of_weighted(high - low, weight, pairs), "width")
            found["loop"].append({"share": share, "rising": mean, "falling": of_falling, "ratio": ratio} | width)
        step = np.gradient(x)
        area = step @ (down - up) / (self.largest * at_top) if at_top else np.full(up.shape[1], np.nan)
        shares = _of_weighted(area, step / abs(self.largest * at_top or 1.0), pairs)
        found["area"] = _in_numbers(shares, "share") if at_top else None
        return found

    def _first(self, kind: str, after: int = -1) -> list[RampBin]:
        """Bins of the first branch of a kind after another branch."""
        found = [one for one in self.bins if one.kind == kind and one.branch > after]
        return [one for one in found if one.branch == found[0].branch]


def current_ramp(
    histories: Sequence[pandas.DataFrame], currents: TimeProfile, conditions: SteadyConditions
) -> CurrentRamp | None:
    """Bins of torque against current.

    Parameters
    ----------
    histories : sequence of DataFrame
        Of each replica; columns `time` [s], `torque_disc` [N m] and speeds [rad/s] as in ``history.csv``.
    currents : TimeProfile
        Given current [A].
    conditions : SteadyConditions
        Radius and width of the gap.

    Returns
    -------
    CurrentRamp or None
        None where the current does not change, or in no branch slowly enough.
    """
    end = min(float(each[TIME].iloc[-1]) for each in histories)
    at, strain = histories[0][TIME].to_numpy(), shear_strain(histories[0], durations(histories[0]), conditions)
    if currents.is_constant or strain is None:
        return None

    def sheared(one: Branch) -> float:
        return float(np.diff(np.interp([one.begin, one.end], at, strain))[0])

    parts = branches(currents, end)
    ramps = [one for one in parts if one.kind != HELD and sheared(one) >= MIN_AVERAGED_STRAIN]
    if not ramps:
        return None
    largest = max(abs(currents(time)) for one in ramps for time in (one.begin, one.end))
    count = _BINS
    for one in ramps:
        share = abs(abs(currents(one.end)) - abs(currents(one.begin))) / largest
        windows = np.count_nonzero((at > one.begin) & (at <= one.end))
        count = min(count, int(sheared(one) / _STRAIN / share), int(windows / _WINDOWS / share))
    edges = np.linspace(0.0, largest, max(count, 1) + 1)
    found: list[RampBin] = []
    for number, one in enumerate(parts):
        if sheared(one) < (MIN_AVERAGED_STRAIN if one.kind != HELD else _STRAIN):
            continue
        settled = one.kind != HELD or sheared(one) >= 2.0 * MIN_AVERAGED_STRAIN
        if one.kind == HELD and settled:  # without what is left of the ramp
            begin = float(np.interp(np.interp(one.begin, at, strain) + MIN_AVERAGED_STRAIN, strain, at))
            one = replace(one, begin=begin)
        found += [replace(each, settled=settled) for each in _bins_of(number, one, histories, currents, edges)]
    return CurrentRamp(tuple(found)) if found else None


def branches(currents: TimeProfile, end: float) -> list[Branch]:
    """Stretches of time up to `end` [s] in which the current's magnitude rises, falls or is held."""
    times = [0.0, *(time for time in currents.times if 0.0 < time < end), end]
    for (first, a), (second, b) in pairwise(list(zip(currents.times, currents.values, strict=True))):
        if a * b < 0.0:  # its magnitude turns where it passes zero
            times.append(first + (second - first) * a / (a - b))
    times = sorted({time for time in times if 0.0 <= time <= end})
    found: list[Branch] = []
    for first, second in pairwise(times):
        change = abs(currents(second)) - abs(currents(first))
        kind = HELD if abs(change) <= 1e-9 * currents.largest else RISING if change > 0.0 else FALLING
        if found and found[-1].kind == kind:
            found[-1] = Branch(kind, found[-1].begin, second)
        else:
            found.append(Branch(kind, first, second))
    return found


def _bins_of(
    number: int, branch: Branch, histories: Sequence[pandas.DataFrame], currents: TimeProfile, edges: np.ndarray
) -> list[RampBin]:
    """Bins of one branch that all replicas have windows in, in the order of time."""
    replicas = []
    for history in histories:
        duration = durations(history)
        begin = history[TIME].to_numpy() - duration  # a window keeps the field of its begin
        inside = (begin > branch.begin - _ROUND_OFF * duration) & (begin < branch.end - _ROUND_OFF * duration)
        current = currents.at(begin[inside])
        replicas.append((current, history[TORQUE_DISC].to_numpy()[inside], duration[inside]))
    if branch.kind == HELD:
        held = abs(currents(branch.end))
        edges = np.array([held, held])
    places = [
        np.zeros(current.size, dtype=int)
        if branch.kind == HELD
        else np.clip(np.searchsorted(edges, np.abs(current), side="right") - 1, 0, edges.size - 2)
        for current, _, _ in replicas
    ]
    order = range(edges.size - 1)
    found = []
    for k in reversed(order) if branch.kind == FALLING else order:
        chosen = [place == k for place in places]
        if any(np.count_nonzero(one) < min(2, _WINDOWS) for one in chosen):
            continue
        both = list(zip(replicas, chosen, strict=True))
        means = np.array([np.average(torque[one], weights=time[one]) for (_, torque, time), one in both])
        at = float(np.mean([current[one].mean() for (current, _, _), one in both]))
        torque, correlated = (
            (Measured.of(means), 1.0)
            if means.size > 1
            else _of_one_replica(float(means[0]), replicas[0][0], replicas[0][1], places[0], k)
        )
        low, high = float(edges[k]), float(edges[k + 1])
        found.append(RampBin(number, branch.kind, low, high, at, means, torque, correlated))
    return found


def _of_one_replica(
    mean: float, current: np.ndarray, torque: np.ndarray, place: np.ndarray, k: int
) -> tuple[Measured, float]:
    """Mean [N m] of bin k with the error by the fluctuation in it and beside it, and `correlated`."""
    order = min(3, max(current.size // 8, 0)) if np.ptp(current) > 0.0 else 0
    fit = np.polynomial.Polynomial.fit(current, torque, order) if order else lambda x: np.full(x.shape, torque.mean())
    rest = torque - fit(current)
    near = np.abs(place - k) <= _AROUND
    n, here = np.count_nonzero(near), np.count_nonzero(place == k)
    if n < 3 * _WINDOWS or not rest[near].any():
        return Measured(mean, math.nan), 1.0
    samples = correlation_samples(rest / max(float(np.abs(rest).max()), 1e-300))
    freedom = n / samples - 1.0
    if freedom < 1.0:
        return Measured(mean, math.nan), 1.0
    error = float(rest[near].std()) * math.sqrt(min(1.0, samples / here))
    return Measured(mean, error, freedom), max(1.0, samples / here)


def _of_weighted(values: np.ndarray, weight: np.ndarray, pairs: Sequence[tuple[RampBin, RampBin]]) -> Measured:
    """Return the mean of replicas' sums (m,) of weights (n,) times falling less rising torque.

    The error of one replica's has the fewest degrees of freedom of the bins in it. Bins that share their noise with
    `correlated` - 1 others have that many times the variance of independent ones, and at most that of errors which add
    linearly.
    """
    if values.size > 1:
        return Measured.of(values)
    variance, freedom = 0.0, math.inf
    for branch in zip(*pairs, strict=True):
        used = [(abs(w), one) for w, one in zip(weight, branch, strict=True) if abs(w) > 1e-9 * np.abs(weight).max()]
        errors = np.array([w * one.torque.error for w, one in used])
        variance += min(float(errors**2 @ [one.correlated for _, one in used]), float(errors.sum()) ** 2)
        freedom = min(freedom, *(one.torque.freedom for _, one in used))
    return Measured(float(values[0]), math.sqrt(variance), freedom)


def _in_numbers(mean: Measured, name: str) -> dict[str, Any]:
    half = mean.half_width()
    return {name: mean.value, "half_width": None if math.isnan(half) else half}


def in_words(found: dict[str, Any]) -> list[str]:
    """Lines on `CurrentRamp.summary`: both branches at `SHARES`, area, and what is left at 0 A."""
    lines = []
    for one in found["loop"]:
        width = _with_half(one["width"], one["half_width"], "N m")
        ratio = "" if one["ratio"] is None else f" ({one['ratio']:.3g} times)"
        lines.append(
            f"torque on the disc at {one['share'] * found['largest_current']:.4g} A: {one['rising']:.4g} N m rising, "
            f"{one['falling']:.4g} N m falling{ratio}, difference {width}"
        )
    if found["area"] is not None:
        share = _with_half(100.0 * found["area"]["share"], _times(100.0, found["area"]["half_width"]), "%")
        lines.append(f"area between the branches: {share} of the largest current times its torque")
    if found["residual"] is not None:
        left = _with_half(found["residual"]["torque"], found["residual"]["half_width"], "N m")
        decay = ", its decay after the ramp included" if found["residual"].get("decay_included") else ""
        lines.append(f"torque on the disc after the current is off{decay}: {left}")
    return [*lines, f"table of torque against current, up to {found['largest_current']:.4g} A: {TABLE}"]


def _with_half(value: float, half: float | None, unit: str) -> str:
    return f"{value:.3g} {unit} (error unknown)" if half is None else f"{value:.3g} ± {half:.2g} {unit} (95 %)"


def _times(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value
