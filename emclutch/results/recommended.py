"""Cheapest settings that reach a wanted accuracy, from the accuracy study of a device.

The search compares every combination of the values that were measured, with 2 to 24 replicas. Its cost is that of a
replica at the scene's own settings, times the ratio of each value, times the replicas. Its half width has two parts in
quadrature: that of the replicas' mean, t s / sqrt(n) with the scatter s of the study's and its own replicas together
(smaller where a value means more grains), and that of the discretisation (`emclutch.results.accuracy_study.Total`) of
the best estimate, the torque over 1 + bias. All combinations are compared by the variances of their errors, with one
covariance: by the mean at the scene's own settings, which the errors share; the choice has its interval from the draws
of all errors. Where the study does not have the start-up, a run must exclude a drift by itself, which takes more
replicas than their mean.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, MeasuredValue, Total
from emclutch.results.fits import NORMAL, student
from emclutch.results.replicated_mean import DRIFT_CONFIDENCE, DRIFT_LIMIT
from emclutch.results.setting_errors import PAIRS
from emclutch.results.statistics import STOPPING_ALLOWANCE
from emclutch.results.text import format_cost, format_duration, format_percent, in_words

OWN_REPLICAS = 4
"""Of the scene's own settings, where nothing is asked for."""
REPLICAS = (2, 4, 6, 8, 12, 16, 24)
"""Numbers of replicas that a run with `time.until` looks at (emclutch.simulation.stopping_rule)."""
STATISTICS = "statistics"
"""Name of the part that is no setting's: of the mean over replicas."""
MAX_VALUES = 4  # of a setting, that are combined with those of others
MAX_COMBINATIONS = 1_000_000
REL_TOL = 1e-6
FINER = 2  # replicas at a finer value, which a longer study measures besides
NEGLIGIBLE = 0.002
"""Error at the scene's own value that makes finer ones pointless, whatever they are predicted to cost."""
MAX_WITHOUT_NOISE = 64  # combinations of the settings without noise, on their frontier
ROUGH = 1.2  # times a target: half widths from variances that are looked at
NEAREST = 8  # combinations of the smallest half widths from variances that are looked at
MAX_TRIES = 2000
ONE_VALUE = "only one value possible, error not measured"


@dataclass(frozen=True, slots=True)
class Choice:
    """Settings of a run, what it costs, and how well its torque is known.

    Attributes
    ----------
    values : dict of str to float
        Of all settings that were measured.
    total : Total
        Discretisation error at them.
    replicas : int
    scatter : float
        Relative standard deviation between replicas at these settings.
    statistical : float
        Half the 95 % interval of the replicas' mean, relative.
    seconds : float
        Processor time of all replicas [s].
    """

    values: dict[str, float]
    total: Total
    replicas: int
    scatter: float
    statistical: float
    seconds: float

    @property
    def half_width(self) -> float:
        """Relative half-width of the corrected torque."""
        return math.hypot(self.statistical, self.total.half_width)

    @property
    def parts(self) -> dict[str, float]:
        """Half widths by setting, of the replicas and of the interaction; the widest first."""
        parts = {STATISTICS: self.statistical} | self.total.widths
        return dict(sorted(parts.items(), key=lambda part: -part[1]))

    @property
    def largest(self) -> str:
        """Return the name of the widest part."""
        return next(iter(self.parts))

    @property
    def figure_of_merit(self) -> float:
        """1 / (error^2 processor time) [1/s], larger is better; the error is the half width over 1.96.

        Where many replicas are all the error it is nearly that of a run (`emclutch.results.statistics.Estimate`),
        whose error is the standard error; of four replicas the half width is 2 times 1.96 of these, and this a quarter.
        """
        return NORMAL**2 / (self.half_width**2 * self.seconds)

    def wall_seconds(self, cores: int) -> float:
        """Return the wall-clock time [s] of its replicas on some cores, one on each."""
        return self.seconds / self.replicas * math.ceil(self.replicas / cores)

    def cost_in_words(self, cores: int) -> str:
        """Return the processor time, and the wall-clock time on as many of `cores` as there are replicas for."""
        return format_cost(self.seconds, min(cores, self.replicas), self.wall_seconds(cores))

    def in_words(self) -> str:
        """Return cost, accuracy, largest part and settings."""
        values = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in self.values.items())
        return (
            f"about {self.replicas} replicas, {format_duration(self.seconds)} of processor time, for "
            f"{format_percent(self.half_width)}; largest part: {self.largest.replace('_', ' ')}, "
            f"{format_percent(self.parts[self.largest])}; {values}"
        )


@dataclass(frozen=True, slots=True)
class LimitingError:
    """Why no combination reaches a target.

    Attributes
    ----------
    setting : str
        That limits the accuracy; `STATISTICS` and `INTERACTION` stand beside the settings.
    half_width : float or None
        Its part at the best combination, relative; None: it was not measured.
    seconds : float or None
        Processor time of a study that may know enough [s]: noise falls as 1/sqrt(time), and values that it had no time
        for may lower the rest. None: more time does not help.
    reason : str
        Why it was not measured.
    best : Choice or None
        The combination that comes nearest.
    finer : float or None
        Value of the setting that such a study measures besides. `seconds` is then a lower bound, since the remaining
        error is not known before.
    needs_budget : bool
        Whether it was not measured for want of budget.
    """

    setting: str
    half_width: float | None
    seconds: float | None
    reason: str = ""
    best: Choice | None = None
    finer: float | None = None
    needs_budget: bool = False

    @property
    def limit(self) -> str:
        """Return what runs of grains reach, and which part of the error limits them, without a full stop."""
        if self.half_width is None or self.best is None:
            return f"the error of the setting {in_words(self.setting)} is not known: {self.reason}"
        part = f"scatter of {self.best.replicas} replicas" if self.setting == STATISTICS else in_words(self.setting)
        best, half = format_percent(self.best.half_width), format_percent(self.half_width)
        return f"runs of grains reach ± {best} at best, limited by the {part} (± {half})"

    def in_words(self, cores: int = 1) -> str:
        """Return what limits runs of grains, and what a study that may help takes; without the last full stop."""
        text = self.limit[:1].upper() + self.limit[1:]
        if self.half_width is not None and self.seconds is None and self.setting != STATISTICS:
            return f"{text}, which more replicas do not lower"
        return ". ".join(filter(None, (text, self.help_in_words(cores))))

    def help_in_words(self, cores: int = 1) -> str:
        """Return what a study that may help takes, without a full stop; empty where none does."""
        if self.half_width is None or self.seconds is None:
            return ""
        cost = format_cost(self.seconds, cores)
        if self.finer is None:
            return f"A longer study of about {cost} may reach it"
        finer = f"{in_words(self.setting)} {self.finer:.3g}"
        return f"A study with {finer} takes at least {cost}, and may not be enough"

    def budget(self, jobs: int, least: float = 0.0) -> float | None:
        """Return the wall-clock time [s] to give a study that may help, `least` [s] or more; None where none does."""
        if self.seconds is None and not self.needs_budget:
            return None
        return max(least, comfortable_budget((self.seconds or 0.0) / jobs))


def comfortable_budget(least: float) -> float:
    """Return a wall-clock time [s] a quarter above `least` [s] or more: whole 5 min, from 2 h on half hours."""
    minutes = 5 * math.ceil(1.25 * least / 300.0)
    return 60.0 * (minutes if minutes < 120 else 30 * math.ceil(minutes / 30.0))


def budget_option(seconds: float) -> str:
    """Return a budget [s] of `comfortable_budget` as the value of an option: ``75min``, ``2.5h``."""
    return f"{seconds / 60.0:.0f}min" if seconds < 7200.0 else f"{seconds / 3600.0:g}h"


class Combinations:
    """All combinations of the values that a study has measured, as arrays over them.

    Attributes
    ----------
    cost : (m,) array
        Processor time of a replica over that at the scene's own settings.
    scatter : (m,) array
        Relative standard deviation between replicas.
    discretisation : (m,) array
        Half width of the discretisation error, from its variance.
    """

    def __init__(self, study: AccuracyStudy) -> None:
        self.study = study
        known = [one for one in study.settings if one.name in study.told]
        noisy = [one for one in known if one.basis is not Basis.MOMENTS]
        self._settings = [one for one in known if one.basis is Basis.MOMENTS] + noisy
        found = [_candidates(study, one, MAX_VALUES) for one in self._settings]
        most = MAX_VALUES
        while most > 1 and math.prod(map(len, found[-len(noisy) :] if noisy else [])) > (
            MAX_COMBINATIONS // MAX_WITHOUT_NOISE
        ):
            most -= 1
            found = [_candidates(study, one, most) for one in self._settings]
        self._candidates = found
        self._chosen = np.zeros((1, 0), dtype=np.int8)
        self.cost, self.scatter = np.ones(1), np.full(1, study.scatter)
        self._variance, self._shared = np.zeros(1), np.zeros(1)
        self._squares, self._fourth = np.zeros(1), np.zeros(1)  # sums of powers of the errors
        for setting, candidates in zip(self._settings, found, strict=True):
            self._combine(candidates)
            if setting.basis is Basis.MOMENTS:
                self._keep_frontier()
        interaction = np.maximum(0.0, 0.5 * (self._squares**2 - self._fourth))
        half = np.sqrt(NORMAL**2 * (self._variance + self._shared**2) + PAIRS**2 * interaction)
        own = study.total(study.told)
        place = int(np.argmin(np.abs(np.log(self.cost)) + np.abs(self._own_distance())))
        self.discretisation = half * (own.half_width / half[place] if half[place] > 0.0 else 1.0)

    def _own_distance(self) -> np.ndarray:
        """Return how many values of each combination are not the scene's own (m,)."""
        own = [
            next((n for n, one in enumerate(some) if setting.is_own(one.measured.value)), 0)
            for setting, some in zip(self._settings, self._candidates, strict=True)
        ]
        return (self._chosen != np.array(own, dtype=np.int8)).sum(axis=1)

    def _combine(self, candidates: list[_Candidate]) -> None:
        """Combine what there is with the values of one more setting."""
        size, count = len(self.cost), len(candidates)
        column = np.tile(np.arange(count, dtype=np.int8), size)[:, None]
        self._chosen = np.hstack([np.repeat(self._chosen, count, axis=0), column])
        self.cost = np.multiply.outer(self.cost, [one.cost for one in candidates]).ravel()
        self.scatter = np.multiply.outer(self.scatter, [one.scatter for one in candidates]).ravel()
        self._variance = np.add.outer(self._variance, [one.variance for one in candidates]).ravel()
        self._shared = np.add.outer(self._shared, [one.shared for one in candidates]).ravel()
        self._squares = np.add.outer(self._squares, [one.bias**2 for one in candidates]).ravel()
        self._fourth = np.add.outer(self._fourth, [one.bias**4 for one in candidates]).ravel()

    def _keep_frontier(self) -> None:
        """Keep what no cheaper combination is as accurate as."""
        order = np.lexsort((self._variance, self.cost))
        least = np.minimum.accumulate(self._variance[order])
        kept = order[np.r_[True, self._variance[order][1:] < least[:-1]]]
        if len(kept) > MAX_WITHOUT_NOISE:
            kept = kept[np.linspace(0, len(kept) - 1, MAX_WITHOUT_NOISE).round().astype(int)]
        self._chosen, self.cost, self.scatter = self._chosen[kept], self.cost[kept], self.scatter[kept]
        self._variance, self._shared = self._variance[kept], self._shared[kept]
        self._squares, self._fourth = self._squares[kept], self._fourth[kept]

    def statistical(self, replicas: int) -> np.ndarray:
        """Return the half widths of the replicas' mean (m,)."""
        return statistical_half_width(self.study, 1.0, replicas) * self.scatter

    def choice(self, number: int, replicas: int) -> Choice:
        """Return a combination with a number of replicas."""
        chosen = [
            (setting.name, one[place].measured)
            for setting, one, place in zip(self._settings, self._candidates, self._chosen[number], strict=True)
        ]
        return choice_of(self.study, dict(chosen), replicas, float(self.scatter[number]), float(self.cost[number]))

    def reaching(self, target: float) -> Iterator[Choice]:
        """Yield what reaches a half width, the cheapest first; each combination with the fewest replicas that do."""
        cost, replicas = np.full(len(self.cost), np.inf), np.zeros(len(self.cost), dtype=int)
        for n in REPLICAS:
            first = (np.hypot(self.statistical(n), self.discretisation) <= ROUGH * target) & (replicas == 0)
            replicas[first], cost[first] = n, n * self.cost[first]
        waiting = [(float(cost[n]), int(n), int(replicas[n])) for n in np.flatnonzero(replicas)]
        heapq.heapify(waiting)
        tries = 0
        while waiting and tries < MAX_TRIES:
            _, number, count = heapq.heappop(waiting)
            choice, tries = self.choice(number, count), tries + 1
            if choice.half_width <= target:
                yield choice
            elif count < REPLICAS[-1] and choice.total.half_width < target:
                more = next(n for n in REPLICAS if n > count)
                heapq.heappush(waiting, (more * float(self.cost[number]), number, more))

    def nearest(self) -> Choice:
        """Return the most accurate combination."""
        half = np.hypot(self.statistical(REPLICAS[-1]), self.discretisation)
        nearest = (self.choice(int(n), REPLICAS[-1]) for n in np.argsort(half)[:NEAREST])
        return min(nearest, key=lambda one: one.half_width)

    def frontier(self) -> tuple[np.ndarray, np.ndarray]:
        """Return processor times [s] and half widths (k,) of the combinations that no cheaper one is as accurate as."""
        seconds = np.concatenate([n * self.cost for n in REPLICAS]) * self.study.seconds
        half = np.concatenate([np.hypot(self.statistical(n), self.discretisation) for n in REPLICAS])
        order = np.lexsort((half, seconds))
        seconds, half = seconds[order], half[order]
        kept = np.r_[True, half[1:] < np.minimum.accumulate(half)[:-1]]
        return seconds[kept], half[kept]


def recommended(study: AccuracyStudy, target: float) -> Choice | LimitingError:
    """Return the cheapest settings that reach a half width of the torque's 95 % interval, relative; or why none do."""
    return next(reaching(study, target), None) or limiting_error(study, target)


def reaching(study: AccuracyStudy, target: float) -> Iterator[Choice]:
    """Yield all settings that reach a half width, the cheapest first; none where a setting was not measured.

    A scene may refuse some of them together, since settings are measured one at a time.
    """
    if not unknown_of(study):
        yield from Combinations(study).reaching(target)


def limiting_error(study: AccuracyStudy, target: float) -> LimitingError:
    """Return by what the most accurate combination is limited: by noise, or by what more replicas do not lower."""
    if unknown := unknown_of(study):
        (setting, reason), *others = unknown.items()
        more = f"; nor was {', '.join(name for name, _ in others)} measured" if others else ""
        return LimitingError(setting, None, None, reason + more, needs_budget=setting in study.over_budget)
    best = Combinations(study).nearest()
    noise = best.total.noise
    room = target**2 - (best.half_width**2 - noise**2)
    errors = best.total.parts
    if room > 0.0 and noise > 0.0:
        setting = max(errors, key=lambda name: errors[name].noise)
        return LimitingError(setting, best.parts[setting], _spent(study) * noise**2 / room, best=best)
    lasting = {
        name: math.sqrt(max(0.0, half**2 - (errors[name].noise ** 2 if name in errors else 0.0)))
        for name, half in best.parts.items()
    }
    setting = max(lasting, key=lambda name: lasting[name])
    with_finer = _with_finer_value(study, study.setting(setting))
    if with_finer is None:
        return LimitingError(setting, best.parts[setting], None, best=best)
    finer, seconds = with_finer
    least = noise * math.sqrt(_spent(study) / seconds)  # its noise alone must come below the target
    seconds *= max(1.0, least / target) ** 2
    return LimitingError(setting, best.parts[setting], seconds, best=best, finer=finer)


def _with_finer_value(study: AccuracyStudy, setting: MeasuredSetting | None) -> tuple[float, float] | None:
    """Return a finer value of a setting, and the processor time of a study with it [s]; None: it has none."""
    values = () if setting is None else setting.values
    finest = min((one.step_size for one in values if one.result is not None), default=0.0)
    left = [(one.seconds, one.value) for one in values if one.step_size < finest and not one.failure]
    return (min(left)[1], _spent(study) + FINER * min(left)[0]) if left else None


def unknown_of(study: AccuracyStudy) -> dict[str, str]:
    """Return the settings whose error at the scene's own value is not known, with the reason."""
    failed = {
        one.name: "; ".join(f"{measured.value:.4g}: {measured.failure}" for measured in one.values if measured.failure)
        or ("torques of different signs" if sum(bool(measured.result) for measured in one.values) > 1 else ONE_VALUE)
        for one in study.settings
        if one.own_step_size is None
    }
    return study.unknown | failed


def own_choice(study: AccuracyStudy, replicas: int = OWN_REPLICAS) -> Choice:
    """Return the scene's own settings, with a number of replicas."""
    return choice_of(study, {}, replicas, study.scatter)


def choice_with(study: AccuracyStudy, setting: MeasuredSetting, at: MeasuredValue, replicas: int) -> Choice | None:
    """Return the scene's own settings but for one; None where its error is not known."""
    if at.result is None or study.draws(setting.name, at.step_size) is None:
        return None
    scatter = study.scatter * _scatter_ratio(study, setting, at)
    return choice_of(study, {setting.name: at}, replicas, scatter, at.cost)


def choice_of(
    study: AccuracyStudy, measured: Mapping[str, MeasuredValue], replicas: int, scatter: float, cost: float = 1.0
) -> Choice:
    """Return the scene's own settings but for some; `cost` is that of a replica over one at the scene's own."""
    total = study.total(study.told | {name: one.step_size for name, one in measured.items()})
    values = {one.name: one.own for one in study.settings} | {name: one.value for name, one in measured.items()}
    total = replace(total, unknown=unknown_of(study))
    statistical = statistical_half_width(study, scatter, replicas)
    return Choice(values, total, replicas, scatter, statistical, study.seconds * cost * replicas)


def statistical_half_width(study: AccuracyStudy, scatter: float, replicas: int) -> float:
    """Return half the 95 % interval of a mean of replicas, as wide as the rule that ends a run takes it.

    Their scatter counts together with that of the study. Where the study does not know the start-up, it is the half
    width for which the rule may end a run that does not drift, if all scatter is fluctuation within a replica: a slope
    of noise makes its ends differ by sqrt(12) times its mean (`emclutch.results.replicated_mean.steadiness`).
    """
    error, freedom = scatter / math.sqrt(replicas), study.freedom + replicas - 1
    half = student(freedom, 1.0 - STOPPING_ALLOWANCE * 0.025) * error
    if "start_up" in study.told:
        return half
    drift = (1.0 + student(3 * replicas - 1, DRIFT_CONFIDENCE)) * math.sqrt(12.0) * error
    return max(half, drift / DRIFT_LIMIT)


def _spent(study: AccuracyStudy) -> float:
    """Return the processor time of the replicas and solutions of a study [s]."""
    others = [
        measured
        for setting in study.settings
        if setting.basis is not Basis.START_UP
        for measured in setting.values
        if setting.basis is Basis.MOMENTS or not setting.is_own(measured.value)
    ]
    return study.replicas * study.seconds + sum(one.replicas * one.seconds for one in others)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A value: cost and scatter over those at the scene's own, its error, the variance of that without the part by
    the mean at the scene's own settings, and the standard deviation by that mean, with its sign."""

    measured: MeasuredValue
    cost: float
    scatter: float
    bias: float
    variance: float
    shared: float

    @property
    def spread(self) -> float:
        """Variance of its error."""
        return self.variance + self.shared**2


def _candidates(study: AccuracyStudy, setting: MeasuredSetting, most: int) -> list[_Candidate]:
    """Return values with an error, from coarse to fine, the scene's own among them; at most so many."""
    level = study.posterior.level[0]
    unit = (level - level.mean()) / max(float(level.std()), 1e-300)
    found = []
    for measured in setting.values:
        found_error = None if measured.result is None else study.draws(setting.name, measured.step_size)
        if found_error is None or (setting.basis is Basis.START_UP and measured.value < setting.own * (1.0 - REL_TOL)):
            continue  # an average that begins in the start-up drifts, and a run goes on until it knows by how much
        draws, error = found_error
        shared = float(unit @ draws[0]) / len(unit) if setting.basis is Basis.TORQUE else 0.0
        variance = (error.half_width / NORMAL) ** 2 - shared**2  # tails count as in an interval
        ratio = _scatter_ratio(study, setting, measured)
        found.append(_Candidate(measured, measured.cost, ratio, error.bias, max(0.0, variance), shared))
    own = next((one for one in found if setting.is_own(one.measured.value)), None)
    here = study.error(setting.name)
    if own is not None and here is not None and abs(here.bias) + here.half_width <= NEGLIGIBLE:
        found = [one for one in found if one.measured.step_size >= own.measured.step_size]  # a finer one gains nothing
    while len(found) > most:  # those that others beat, then those with the smallest difference to their neighbour
        others = [one for one in found if not setting.is_own(one.measured.value)]
        dominated = [one for one in others if any(_dominates(other, one) for other in found)]
        found.remove(dominated[0] if dominated else min(others[:-1] or others, key=lambda one: abs(math.log(one.cost))))
    return found


def _scatter_ratio(study: AccuracyStudy, setting: MeasuredSetting, measured: MeasuredValue) -> float:
    """Return the scatter of replicas at a value over that at the scene's own settings: more grains scatter less."""
    if setting.basis is not Basis.TORQUE or study.scatter <= 0.0 or measured.error <= 0.0:
        return 1.0
    return measured.error * math.sqrt(measured.replicas) / study.scatter


def _dominates(other: _Candidate, one: _Candidate) -> bool:
    return other is not one and other.cost <= one.cost and other.scatter <= one.scatter and other.spread <= one.spread
