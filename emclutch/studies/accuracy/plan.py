"""Which packings an accuracy study runs within its budget.

1. Each knob gets a packing at the setting that tells most of its error for its cost, the cheapest knobs first; where
   that does not fit, at the next one. The half width of its error is g times the scatter between packings, and g
   follows from the order of the knob, the packings at the scene's own settings, and how many grains each has.
2. When these are run, half of the time that is left goes, one packing after the other, where it lowers the half widths
   of the total error most for its seconds: those at the scene's own settings and at the settings that come nearest to
   each target, by the sum of their logarithms. They are those of the posterior (`emclutch.results.setting_errors`) if
   the torques that are not known yet come out as it expects them. The other half then goes likewise, by all that was
   found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from emclutch.results.ladder import Basis, KnobLadder, Rung
from emclutch.results.setting_errors import NORMAL, SharedMean, own_place
from emclutch.studies.task_queue import makespan

MAX_PACKINGS = 64
"""Packings of one rung."""
BASE = ""
"""In place of a knob: the scene's own settings."""
OWN = (BASE, 0.0)
PARTICLES = 64
"""Draws of orders, scales and scatter that half widths are predicted with."""
LEAST = 1e-6
"""Half width, relative, below which nothing is to be gained."""
Key = tuple[str, float]
"""Knob and setting."""


@dataclass(frozen=True, slots=True)
class OfferedRung:
    """A setting of a knob that could be run.

    Attributes
    ----------
    setting, step_size : float
    seconds : float
        Processor time of a packing [s].
    variance : float
        Of a packing over that of the scene's own settings: grains there over grains here.
    """

    setting: float
    step_size: float
    seconds: float
    variance: float


@dataclass(frozen=True, slots=True)
class OfferedKnob:
    """A knob with what could be run.

    Attributes
    ----------
    name : str
    order : float or None
    limit : float
    own : OfferedRung
        The scene's own setting.
    rungs : tuple of OfferedRung
        All others.
    is_large : bool
        As of the knob.
    """

    name: str
    order: float | None
    limit: float
    own: OfferedRung
    rungs: tuple[OfferedRung, ...]
    is_large: bool = False

    def ladder(
        self, torques: Mapping[Key, float], count: Mapping[Key, int], scatter: float, freedom: float
    ) -> KnobLadder:
        """Return what its rungs are with some torques, of some numbers of packings each."""
        keys = [(OWN, self.own), *(((self.name, one.setting), one) for one in self.rungs)]
        made = [
            Rung(one.setting, one.step_size, torques[key], error, n, one.seconds, one.seconds / self.own.seconds)
            for key, one in keys
            if (n := count.get(key, 0)) and key in torques
            for error in (scatter * math.sqrt(one.variance / n),)
        ]
        rungs = tuple(sorted(made, key=lambda one: -one.step_size))
        own, large = self.own.setting, self.is_large
        return KnobLadder(self.name, "", Basis.TORQUE, own, self.order, self.limit, rungs, freedom, large)

    def ranked(self, base_packings: int) -> list[Key]:
        """Return its rungs, that which tells most of the error for its seconds first."""

        def merit(rung: OfferedRung) -> float:
            x, own = (h ** (self.order or 1.0) for h in (rung.step_size, self.own.step_size))
            return own / abs(x - own) * math.sqrt((1.0 / base_packings + rung.variance) * rung.seconds)

        return [(self.name, one.setting) for one in sorted(self.rungs, key=lambda one: (merit(one), one.setting))]


@dataclass(frozen=True, slots=True)
class Aim:
    """Settings whose error is to be lowered.

    Attributes
    ----------
    step_sizes : mapping of str to float
        By knob; of others the scene's own counts.
    rest : float
        Half width of the parts of their error that packings of the study do not lower.
    """

    step_sizes: Mapping[str, float] = field(default_factory=dict)
    rest: float = 0.0


@dataclass(frozen=True, slots=True)
class Torques:
    """What the packings so far have given.

    Attributes
    ----------
    means : mapping of Key to float
        Mean torque [N m] of a setting, and of the scene's own (`OWN`).
    scatter : float
        Relative standard deviation between packings of the scene's own settings.
    freedom : float
        Its degrees of freedom.
    """

    means: Mapping[Key, float]
    scatter: float
    freedom: float


def first_packings(knobs: Sequence[OfferedKnob], base_packings: int, room: float, jobs: int) -> tuple[Key, ...]:
    """Return a packing of each knob that fits into a wall-clock time `room` [s] of `jobs` processes, longest first.

    Knobs whose error is known to be large come first, then the cheapest. `base_packings` at the scene's own settings
    are there already.
    """
    seconds = _seconds_of(knobs, 0.0)
    large = {one.name for one in knobs if one.is_large}
    ranked = {one.name: one.ranked(base_packings) for one in knobs if one.rungs}
    chosen: list[Key] = []
    for name in sorted(ranked, key=lambda one: (one not in large, seconds[ranked[one][0]], one)):
        for one in ranked[name]:
            more = _longest_first([*chosen, one], seconds)
            if makespan([seconds[key] for key in more], jobs) <= room:
                chosen = more
                break
    return tuple(chosen)


def more_packings(
    knobs: Sequence[OfferedKnob],
    count: Mapping[Key, int],
    found: Torques,
    base_seconds: float,
    room: float,
    jobs: int,
    aims: Sequence[Aim],
) -> tuple[Key, ...]:
    """Return what else fits into a wall-clock time `room` [s], longest first; a pure function of what is given.

    `count` packings are there already, with the torques `found`; one more of the scene's own takes `base_seconds`.
    `aims`: settings whose error is to be lowered.
    """
    seconds, count = _seconds_of(knobs, base_seconds), dict(count)
    knobs = [
        one for one in knobs if one.rungs and own_place(one.ladder(found.means, count, found.scatter, 1.0)) is not None
    ]
    chosen: list[Key] = []
    open_to = set(seconds) if knobs else set()

    prediction = _Prediction(knobs, found, count, aims) if knobs else None

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
        if count.get(best, 0) >= MAX_PACKINGS or makespan([seconds[one] for one in longer], jobs) > room:
            open_to.discard(best)
            continue
        chosen = longer
        count[best] = count.get(best, 0) + 1
    return tuple(chosen)


class _Prediction:
    """Half widths of the total error of some settings with more packings, the torques coming out as expected."""

    def __init__(
        self, knobs: Sequence[OfferedKnob], found: Torques, count: Mapping[Key, int], aims: Sequence[Aim]
    ) -> None:
        self._knobs, self._scatter, self._aims = knobs, found.scatter, aims
        model = self._model(found.means, count, found.freedom)
        draws = model.posterior(np.random.default_rng(0))
        self._u = draws.u[:: len(draws.u) // PARTICLES]
        self._evidence = model.log_evidence(self._u)
        self._torques = dict(found.means)
        for one in knobs:
            here = model.direction(self._u, one.name, one.own.step_size)
            for rung in one.rungs:
                step = model.direction(self._u, one.name, rung.step_size) - here
                self._torques.setdefault(
                    (one.name, rung.setting), found.means[OWN] * math.exp(float(model.moments(self._u, step)[0].mean()))
                )

    def half_widths(self, count: Mapping[Key, int], freedom: float) -> list[float]:
        """Return those at each of the settings, of so many packings."""
        model = self._model(self._torques, count, freedom)
        log_weight = model.log_evidence(self._u) - self._evidence
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        halves = []
        for aim in self._aims:
            at = {one.name: aim.step_sizes.get(one.name, one.own.step_size) for one in self._knobs}
            direction = np.sum([model.direction(self._u, name, h) for name, h in at.items()], axis=0)
            mean, variance = model.moments(self._u, direction)
            variance = variance + sum(model.new_deviation(self._u, name, h) ** 2 for name, h in at.items())
            halves.append(NORMAL * math.sqrt(float(weight @ (variance + (mean - weight @ mean) ** 2))))
        return halves

    def _model(self, torques: Mapping[Key, float], count: Mapping[Key, int], freedom: float) -> SharedMean:
        return SharedMean([one.ladder(torques, count, self._scatter, freedom) for one in self._knobs])


def left_out(knobs: Sequence[OfferedKnob], packings: Sequence[Key]) -> dict[str, float]:
    """Return the knobs without a packing, and the processor time that the least of them needs [s]."""
    run = {name for name, _ in packings}
    return {one.name: min(rung.seconds for rung in one.rungs) for one in knobs if one.rungs and one.name not in run}


def _seconds_of(knobs: Sequence[OfferedKnob], base_seconds: float) -> dict[Key, float]:
    return {(one.name, rung.setting): rung.seconds for one in knobs for rung in one.rungs} | {OWN: base_seconds}


def _longest_first(packings: Sequence[Key], seconds: Mapping[Key, float]) -> list[Key]:
    return sorted(packings, key=lambda one: (-seconds[one], one))


def packings_for(difference: float, scatter: float) -> int:
    """Return how many packings of each of two settings tell such a relative difference from none, 95 %."""
    return max(1, math.ceil(2.0 * (1.96 * scatter / difference) ** 2))
