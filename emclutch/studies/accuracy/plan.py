"""Which replicas an accuracy study runs within its budget.

1. Each setting gets a replica at the value that tells most of its error for its cost, the cheapest settings first;
   where that does not fit, at the next one. The half width of its error is g times the scatter between replicas; g
   follows from the order of convergence, the replicas at the scene's own settings, and how many grains each has.
2. When these are run, half of the time that is left goes, one replica after the other, where it lowers the half widths
   of the total error most for its seconds: those at the scene's own settings and at the settings that come nearest to
   each target, by the sum of their logarithms. They are those of the posterior (`emclutch.results.setting_errors`) if
   the torques that are not known yet come out as it expects them. The other half then goes likewise, by all that was
   found.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from emclutch.results.accuracy_study import Basis, MeasuredSetting, MeasuredValue
from emclutch.results.fits import NORMAL
from emclutch.results.setting_errors import SharedMean, own_place

MAX_REPLICAS = 64
"""Largest number of replicas at one value."""
BASE = ""
"""In place of a setting's name: the scene's own settings."""
OWN = (BASE, 0.0)
PARTICLES = 64
"""Draws of orders, scales and scatter that half widths are predicted with."""
LEAST = 1e-6
"""Half width, relative, below which nothing is to be gained."""
Key = tuple[str, float]
"""Name of a setting, and its value."""


@dataclass(frozen=True, slots=True)
class OfferedValue:
    """A value of a setting that could be run.

    Attributes
    ----------
    value, step_size : float
    seconds : float
        Processor time of a replica [s].
    variance : float
        Of a replica over that at the scene's own settings: grains there over grains here.
    """

    value: float
    step_size: float
    seconds: float
    variance: float


@dataclass(frozen=True, slots=True)
class OfferedSetting:
    """A setting with the values that could be run.

    Attributes
    ----------
    name : str
    order : float or None
    limit : float
    own : OfferedValue
        The scene's own value.
    values : tuple of OfferedValue
        All others.
    is_large : bool
        As of the setting.
    """

    name: str
    order: float | None
    limit: float
    own: OfferedValue
    values: tuple[OfferedValue, ...]
    is_large: bool = False

    def measured(
        self, torques: Mapping[Key, float], count: Mapping[Key, int], scatter: float, freedom: float
    ) -> MeasuredSetting:
        """Return the setting as measured by some torques, of some numbers of replicas each."""
        keys = [(OWN, self.own), *(((self.name, one.value), one) for one in self.values)]
        made = [
            MeasuredValue(one.value, one.step_size, torques[key], error, n, one.seconds, one.seconds / self.own.seconds)
            for key, one in keys
            if (n := count.get(key, 0)) and key in torques
            for error in (scatter * math.sqrt(one.variance / n),)
        ]
        values = tuple(sorted(made, key=lambda one: -one.step_size))
        own, large = self.own.value, self.is_large
        return MeasuredSetting(self.name, "", Basis.TORQUE, own, self.order, self.limit, values, freedom, large)

    def ranked(self, base_replicas: int) -> list[Key]:
        """Return its values, that which tells most of the error for its seconds first."""

        def merit(offered: OfferedValue) -> float:
            x, own = (h ** (self.order or 1.0) for h in (offered.step_size, self.own.step_size))
            return own / abs(x - own) * math.sqrt((1.0 / base_replicas + offered.variance) * offered.seconds)

        return [(self.name, one.value) for one in sorted(self.values, key=lambda one: (merit(one), one.value))]


@dataclass(frozen=True, slots=True)
class Aim:
    """Settings whose error is to be lowered.

    Attributes
    ----------
    step_sizes : mapping of str to float
        By setting; of others the scene's own counts.
    rest : float
        Half width of the parts of their error that replicas of the study do not lower.
    """

    step_sizes: Mapping[str, float] = field(default_factory=dict)
    rest: float = 0.0


@dataclass(frozen=True, slots=True)
class Torques:
    """Torques of the replicas so far.

    Attributes
    ----------
    means : mapping of Key to float
        Mean torque [N m] at a value, and at the scene's own settings (`OWN`).
    scatter : float
        Relative standard deviation between replicas at the scene's own settings.
    freedom : float
        Its degrees of freedom.
    """

    means: Mapping[Key, float]
    scatter: float
    freedom: float


def first_replicas(settings: Sequence[OfferedSetting], base_replicas: int, room: float, jobs: int) -> tuple[Key, ...]:
    """Return a replica of each setting that fits into a wall-clock time `room` [s] of `jobs` processes, longest first.

    Settings whose error is known to be large come first, then the cheapest. `base_replicas` at the scene's own settings
    are there already.
    """
    seconds = _seconds_of(settings, 0.0)
    large = {one.name for one in settings if one.is_large}
    ranked = {one.name: one.ranked(base_replicas) for one in settings if one.values}
    chosen: list[Key] = []
    for name in sorted(ranked, key=lambda one: (one not in large, seconds[ranked[one][0]], one)):
        for one in ranked[name]:
            more = _longest_first([*chosen, one], seconds)
            if makespan([seconds[key] for key in more], jobs) <= room:
                chosen = more
                break
    return tuple(chosen)


def more_replicas(
    settings: Sequence[OfferedSetting],
    count: Mapping[Key, int],
    found: Torques,
    base_seconds: float,
    room: float,
    jobs: int,
    aims: Sequence[Aim],
) -> tuple[Key, ...]:
    """Return what else fits into a wall-clock time `room` [s], longest first; a pure function of what is given.

    `count` replicas are there already, with the torques `found`; one more of the scene's own takes `base_seconds`.
    `aims`: settings whose error is to be lowered.
    """
    seconds, count = _seconds_of(settings, base_seconds), dict(count)
    settings = [one for one in settings if one.values]
    settings = [one for one in settings if own_place(one.measured(found.means, count, found.scatter, 1.0)) is not None]
    chosen: list[Key] = []
    open_to = set(seconds) if settings else set()

    prediction = _Prediction(settings, found, count, aims) if settings else None

    def log_half_widths(count: Mapping[Key, int]) -> float:
        freedom = found.freedom + sum(max(n, 1) - 1 for n in count.values()) - begun
        halves = [] if prediction is None else prediction.half_widths(count, freedom)
        return sum(math.log(max(math.hypot(half, aim.rest), LEAST)) for half, aim in zip(halves, aims, strict=True))

    begun = sum(max(n, 1) - 1 for n in count.values())
    while open_to:
        now = log_half_widths(count)
        gains = {
            one: (now - log_half_widths(count | {one: count.get(one, 0) + 1})) / seconds[one] for one in sorted(open_to)
        }
        best = max(gains, key=lambda one: gains[one])
        longer = _longest_first([*chosen, best], seconds)  # the short ones last fill the gaps
        if gains[best] <= 0.0:
            break
        if count.get(best, 0) >= MAX_REPLICAS or makespan([seconds[one] for one in longer], jobs) > room:
            open_to.discard(best)
            continue
        chosen = longer
        count[best] = count.get(best, 0) + 1
    return tuple(chosen)


class _Prediction:
    """Half widths of the total error of some settings with more replicas, the torques coming out as expected."""

    def __init__(
        self, settings: Sequence[OfferedSetting], found: Torques, count: Mapping[Key, int], aims: Sequence[Aim]
    ) -> None:
        self._settings, self._scatter, self._aims = settings, found.scatter, aims
        model = self._model(found.means, count, found.freedom)
        draws = model.posterior(np.random.default_rng(0))
        self._u = draws.u[:: len(draws.u) // PARTICLES]
        self._evidence = model.log_evidence(self._u)
        self._torques = dict(found.means)
        for one in settings:
            here = model.direction(self._u, one.name, one.own.step_size)
            for v in one.values:
                step = model.direction(self._u, one.name, v.step_size) - here
                expected = found.means[OWN] * math.exp(float(model.moments(self._u, step)[0].mean()))
                self._torques.setdefault((one.name, v.value), expected)

    def half_widths(self, count: Mapping[Key, int], freedom: float) -> list[float]:
        """Return those at each of the settings, with so many replicas."""
        model = self._model(self._torques, count, freedom)
        log_weight = model.log_evidence(self._u) - self._evidence
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        halves = []
        for aim in self._aims:
            at = {one.name: aim.step_sizes.get(one.name, one.own.step_size) for one in self._settings}
            direction = np.sum([model.direction(self._u, name, h) for name, h in at.items()], axis=0)
            mean, variance = model.moments(self._u, direction)
            variance = variance + sum(model.new_deviation(self._u, name, h) ** 2 for name, h in at.items())
            halves.append(NORMAL * math.sqrt(float(weight @ (variance + (mean - weight @ mean) ** 2))))
        return halves

    def _model(self, torques: Mapping[Key, float], count: Mapping[Key, int], freedom: float) -> SharedMean:
        return SharedMean([one.measured(torques, count, self._scatter, freedom) for one in self._settings])


def left_out(settings: Sequence[OfferedSetting], replicas: Sequence[Key]) -> dict[str, float]:
    """Return the settings without a replica, with the processor time of their cheapest value [s]."""
    run = {name for name, _ in replicas}
    return {one.name: min(v.seconds for v in one.values) for one in settings if one.values and one.name not in run}


def _seconds_of(settings: Sequence[OfferedSetting], base_seconds: float) -> dict[Key, float]:
    return {(one.name, v.value): v.seconds for one in settings for v in one.values} | {OWN: base_seconds}


def _longest_first(replicas: Sequence[Key], seconds: Mapping[Key, float]) -> list[Key]:
    return sorted(replicas, key=lambda one: (-seconds[one], one))


def replicas_for(difference: float, scatter: float) -> int:
    """Return how many replicas at each of two values tell such a relative difference from none, 95 %."""
    return max(1, math.ceil(2.0 * (NORMAL * scatter / difference) ** 2))

def makespan(seconds: Sequence[float], jobs: int) -> float:
    """Return the time until tasks are done that are begun in this order [s], `jobs` at a time."""
    ends = [0.0] * max(1, jobs)
    for one in seconds:
        heapq.heappush(ends, heapq.heappop(ends) + one)
    return max(ends)
