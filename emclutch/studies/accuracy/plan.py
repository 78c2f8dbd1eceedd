"""Which packings an accuracy study runs within its budget.

1. Each knob gets a packing at the setting that tells most of its error for its cost, the cheapest knobs first; where
   that does not fit, at the next one. The half width of its error is g times the scatter between packings, and g
   follows from the law of the knob, the packings of its rungs, and how many grains each has.
2. When these are run, half of the time that is left goes, one packing after the other, where it lowers the half widths
   of the total error most for its seconds, by the torques and the scatter that were found: those at the scene's own
   settings and at the settings that come nearest to each target, by the sum of their logarithms. That is another
   packing of a setting, or of the scene's own, which count in all knobs, where noise dominates; a third setting where
   a large error may not follow its law. The other half then goes likewise, by all that was found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from emclutch.results.ladder import Basis, KnobError, KnobLadder, Rung, Total
from emclutch.studies.task_queue import makespan

MAX_PACKINGS = 64
"""Packings of one rung."""
BASE = ""
"""In place of a knob: the scene's own settings."""
OWN = (BASE, 0.0)
UNKNOWN = KnobError(0.0, 1.0)
"""Of a knob without a packing: any error is possible."""
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
        self, packings: Mapping[Key, int], found: Torques | None = None, freedom: float = math.inf
    ) -> KnobLadder:
        """Return what its rungs would be, of some numbers of packings.

        Without torques the half width of its error is g above. Torques of settings that were not run are what the law
        of the knob says by the others.
        """
        counts = {self.own: packings.get(OWN, 0)} | {
            one: packings.get((self.name, one.setting), 0) for one in self.rungs
        }
        if found is None:
            return self._ladder({one: (1.0, n) for one, n in counts.items() if n}, 1.0, freedom)
        known = {one: found.means[key] for one in counts if (key := self._key(one)) in found.means}
        law = self._ladder({one: (torque, counts[one]) for one, torque in known.items()}, found.scatter, freedom)
        here = law.own_error
        for one, n in counts.items():
            if n and one not in known:
                there = law.error(one.step_size)
                ratio = 1.0 if here is None or there is None else (1.0 + there.bias) / (1.0 + here.bias)
                known[one] = ratio * found.means[OWN]
        run = {one: (torque, counts[one]) for one, torque in known.items() if counts[one]}
        return self._ladder(run, found.scatter, freedom)

    def ranked(self, base_packings: int) -> list[Key]:
        """Return its rungs, that which tells most of the error for its seconds first."""

        def merit(rung: OfferedRung) -> float:
            error = self.ladder({OWN: base_packings, (self.name, rung.setting): 1}).own_error
            return math.inf if error is None else error.half_width * math.sqrt(rung.seconds)

        return [(self.name, one.setting) for one in sorted(self.rungs, key=lambda one: (merit(one), one.setting))]

    def _key(self, rung: OfferedRung) -> Key:
        return OWN if rung is self.own else (self.name, rung.setting)

    def _ladder(self, rungs: Mapping[OfferedRung, tuple[float, int]], scatter: float, freedom: float) -> KnobLadder:
        ordered = sorted(rungs.items(), key=lambda item: -item[0].step_size)
        made = tuple(
            Rung(one.setting, one.step_size, torque, scatter * math.sqrt(one.variance / n), n, one.seconds)
            for one, (torque, n) in ordered
        )
        return KnobLadder(self.name, "", Basis.TORQUE, self.own.setting, self.order, self.limit, made, freedom)


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
    knobs = [one for one in knobs if one.rungs]
    chosen: list[Key] = []
    open_to = set(seconds) if knobs else set()

    known: dict[tuple[object, ...], list[KnobError]] = {}

    def errors(knob: OfferedKnob, count: Mapping[Key, int], freedom: float) -> list[KnobError]:
        """Return its error at each of the settings."""
        packings = (count.get(OWN), *(count.get((knob.name, one.setting)) for one in knob.rungs))
        at = (knob.name, freedom, packings)
        if at not in known:
            ladder = knob.ladder(count, found, freedom)
            known[at] = [ladder.error(aim.step_sizes.get(knob.name, knob.own.step_size)) or UNKNOWN for aim in aims]
        return known[at]

    def log_half_widths(count: Mapping[Key, int]) -> float:
        freedom = found.freedom + sum(max(n, 1) - 1 for n in count.values()) - begun
        of_all = {one.name: errors(one, count, freedom) for one in knobs}
        halves = [Total({name: of[n] for name, of in of_all.items()}, {}).half_width for n in range(len(aims))]
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
