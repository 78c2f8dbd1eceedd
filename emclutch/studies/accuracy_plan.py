"""Which packings an accuracy study runs within its budget.

The half width of a knob's error at the scene's own setting is s g: s is how much packings scatter, and g follows from
the law of the knob, the packings of its rungs, and how many grains each has. s is the same in all knobs, so that what
is run follows from the g and from what a packing costs, before anything is known of torques:

1. Each knob gets a packing at the setting that tells most of its error for its cost, the cheapest knobs first; where
   that does not fit, at the next one.
2. Each gets one at another setting too, by which its law is checked.
3. What is left goes, one packing after the other, where it lowers the sum of all g^2 most for its seconds: to a rung,
   or to the scene's own settings, which count in all knobs.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from emclutch.results.ladder import Basis, KnobLadder, Rung

MAX_PACKINGS = 64
"""Packings of one rung."""
BASE = ""
"""In place of a knob: the scene's own settings."""


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
    """

    name: str
    order: float | None
    limit: float
    own: OfferedRung
    rungs: tuple[OfferedRung, ...]

    def spread(self, packings: Mapping[tuple[str, float], int]) -> float:
        """Return g above, of the numbers of packings by knob and setting; infinite where nothing is known."""
        rungs = [self._rung(self.own, packings.get((BASE, 0.0), 0))]
        rungs += [self._rung(one, packings.get((self.name, one.setting), 0)) for one in self.rungs]
        counted = tuple(sorted((one for one in rungs if one.packings), key=lambda one: -one.step_size))
        ladder = KnobLadder(self.name, "", Basis.TORQUE, self.own.setting, self.order, self.limit, counted)
        return math.inf if len(counted) < 2 or ladder.own_error is None else ladder.own_error.half_width

    def ranked(self, base_packings: int) -> list[tuple[str, float]]:
        """Return its rungs, that which tells most of the error for its seconds first."""

        def merit(rung: OfferedRung) -> float:
            spread = self.spread({(BASE, 0.0): base_packings, (self.name, rung.setting): 1})
            return spread * math.sqrt(rung.seconds)

        return [(self.name, one.setting) for one in sorted(self.rungs, key=lambda one: (merit(one), one.setting))]

    @staticmethod
    def _rung(one: OfferedRung, packings: int) -> Rung:
        error = math.sqrt(one.variance / packings) if packings else math.inf
        return Rung(one.setting, one.step_size, 1.0, error, packings, one.seconds)


@dataclass(frozen=True, slots=True)
class Allocation:
    """What is to be run.

    Attributes
    ----------
    packings : tuple of (knob, setting)
        In the order in which they are begun; (`BASE`, 0) is another packing at the scene's own settings.
    left_out : dict of str to float
        Knobs that do not fit in, and the processor time that the least of them needs [s].
    """

    packings: tuple[tuple[str, float], ...]
    left_out: dict[str, float]


def allocate(
    knobs: Sequence[OfferedKnob], base_packings: int, base_seconds: float, room: float, jobs: int
) -> Allocation:
    """Share out a wall-clock time `room` [s] of `jobs` processes, see above; a pure function of what is given.

    `base_packings` at the scene's own settings are there already; one more takes `base_seconds`.
    """
    seconds = {(one.name, rung.setting): rung.seconds for one in knobs for rung in one.rungs}
    seconds[BASE, 0.0] = base_seconds
    count = {(BASE, 0.0): base_packings}
    order: list[tuple[str, float]] = []
    ranked = {one.name: one.ranked(base_packings) for one in knobs if one.rungs}
    left_out: dict[str, float] = {}

    def fits(more: Sequence[tuple[str, float]]) -> bool:
        return makespan([seconds[one] for one in (*order, *more)], jobs) <= room

    for again in (False, True):
        for name in sorted(ranked, key=lambda one: (seconds[ranked[one][0]], one)):
            if name in left_out:
                continue
            chosen = next((one for one in ranked[name] if one not in count and fits([one])), None)
            if chosen is not None:
                order.append(chosen)
                count[chosen] = 1
            elif not again:
                left_out[name] = min(seconds[one] for one in ranked[name])
    measured = [one for one in knobs if one.name in ranked and one.name not in left_out]
    extra: list[tuple[str, float]] = []
    open_to = {(one.name, rung.setting) for one in measured for rung in one.rungs} | {(BASE, 0.0)}

    def gain(packing: tuple[str, float]) -> float:
        more = count | {packing: count.get(packing, 0) + 1}
        moved = [one for one in measured if packing[0] in (BASE, one.name)]
        return sum(one.spread(count) ** 2 - one.spread(more) ** 2 for one in moved) / seconds[packing]

    while measured and open_to:
        best = max(sorted(open_to), key=gain)
        longer = sorted([*extra, best], key=lambda one: (-seconds[one], one))  # the short ones last fill the gaps
        if count.get(best, 0) >= MAX_PACKINGS or not fits(longer):
            open_to.discard(best)
            continue
        extra = longer
        count[best] = count.get(best, 0) + 1
    return Allocation((*order, *extra), left_out)


def makespan(seconds: Sequence[float], jobs: int) -> float:
    """Return the time until tasks are done that are begun in this order [s], `jobs` at a time."""
    ends = [0.0] * max(1, jobs)
    for one in seconds:
        heapq.heappush(ends, heapq.heappop(ends) + one)
    return max(ends)


def packings_for(difference: float, scatter: float) -> int:
    """Return how many packings of each of two settings tell such a relative difference from none, 95 %."""
    return max(1, math.ceil(2.0 * (1.96 * scatter / difference) ** 2))
