"""Cheapest settings that reach a wanted accuracy, from the ladder of a device.

Every combination of the settings that were measured is looked at, with 2 to 24 packings. Its cost is that of a packing
at the scene's own settings, times the ratio of each setting, times the packings. Its half width has two parts in
quadrature: that of the packings' mean, t s / sqrt(n) with the scatter s of the ladder's and its own packings together
(smaller where a setting means more grains), and that of the discretisation (`emclutch.results.ladder.Total`), of a
torque that is divided by 1 + bias. All combinations are compared by the variances of their errors, with one covariance:
by the mean at the scene's own settings, which the errors share; what is chosen has its interval from the draws of all
errors. Where the ladder does not have the start-up, a run must exclude a drift by itself, which takes more packings
than their mean.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from emclutch.results.ladder import Basis, KnobLadder, Ladder, Rung, Total
from emclutch.results.replicated_mean import DRIFT_CONFIDENCE, DRIFT_LIMIT
from emclutch.results.setting_errors import PAIRS
from emclutch.results.statistics import STOPPING_ALLOWANCE
from emclutch.results.text import format_duration, per_cent
from emclutch.results.torque_curves import NORMAL

OWN_PACKINGS = 4
"""Of the scene's own settings, where nothing is asked for."""
PACKINGS = (2, 4, 6, 8, 12, 16, 24)
"""Numbers of packings that a run with `time.until` looks at (emclutch.simulation.stopping_rule)."""
STATISTICS = "statistics"
"""Name of the part that is no knob's: of the packings' mean."""
MAX_SETTINGS = 4  # of a knob that are combined with those of others
MAX_COMBINATIONS = 1_000_000
SAME = 1.0 - 1e-6
FINER = 2  # packings of a setting that a longer study measures besides
NEGLIGIBLE = 0.002
"""Error of the scene's own setting that makes finer ones pointless, whatever they are predicted to cost."""
MAX_WITHOUT_NOISE = 64  # combinations of the knobs without noise, on their frontier
ROUGH = 1.2  # times a target: half widths from variances that are looked at
NEAREST = 8  # combinations of the smallest half widths from variances that are looked at
MAX_TRIES = 2000


@dataclass(frozen=True, slots=True)
class Choice:
    """Settings of a run, what it costs, and how well its torque is known.

    Attributes
    ----------
    settings : dict of str to float
        Of all knobs that were measured.
    total : Total
        Discretisation error at them.
    packings : int
    scatter : float
        Relative standard deviation between packings at these settings.
    statistical : float
        Half the 95 % interval of the packings' mean, relative.
    seconds : float
        Processor time of all packings [s].
    """

    settings: dict[str, float]
    total: Total
    packings: int
    scatter: float
    statistical: float
    seconds: float

    @property
    def half_width(self) -> float:
        """Of the corrected torque, relative."""
        return math.hypot(self.statistical, self.total.half_width)

    @property
    def parts(self) -> dict[str, float]:
        """Half widths by knob, of the packings and of the interaction; the widest first."""
        parts = {STATISTICS: self.statistical} | self.total.widths
        return dict(sorted(parts.items(), key=lambda part: -part[1]))

    @property
    def largest(self) -> str:
        """Return the name of the widest part."""
        return next(iter(self.parts))

    @property
    def figure_of_merit(self) -> float:
        """1 / (error^2 processor time) [1/s], larger is better; the error is the half width over 1.96.

        Where many packings are all the error it is nearly that of a run (`emclutch.results.statistics.Estimate`),
        whose error is the standard error; of four packings the half width is 2 times 1.96 of these, and this a quarter.
        """
        return NORMAL**2 / (self.half_width**2 * self.seconds)

    def in_words(self) -> str:
        """Return cost, accuracy, largest part and settings."""
        settings = ", ".join(f"{name.replace('_', ' ')} {setting:.4g}" for name, setting in self.settings.items())
        return (
            f"about {self.packings} packings, {format_duration(self.seconds)} of processor time, for "
            f"{per_cent(self.half_width)}; largest part: {self.largest.replace('_', ' ')}, "
            f"{per_cent(self.parts[self.largest])}; {settings}"
        )


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why no combination reaches a target.

    Attributes
    ----------
    knob : str
        That limits the accuracy; `STATISTICS` and `INTERACTION` stand beside the knobs.
    half_width : float or None
        Its part at the best combination, relative; None: it was not measured.
    seconds : float or None
        Processor time of a study that may know enough [s]: what is noise falls as 1/sqrt(time), and settings that it
        had no time for may lower the rest. None: more time does not help.
    reason : str
        Why it was not measured.
    best : Choice or None
        The combination that comes nearest.
    at_least : bool
        `seconds` are what a finer setting takes, of which nobody knows what it will leave.
    """

    knob: str
    half_width: float | None
    seconds: float | None
    reason: str = ""
    best: Choice | None = None
    at_least: bool = False

    def in_words(self) -> str:
        """Return why a target is not reached."""
        if self.half_width is None:
            return f"not reachable by what was measured: limited by {self.knob}: {self.reason}"
        if self.knob == STATISTICS and self.best is not None:
            half = per_cent(self.half_width)
            return f"not reachable: {self.best.packings} packings have a {STATISTICS} part of ± {half}"
        half = per_cent(self.half_width)
        words = f"not reachable by what was measured: limited by {self.knob}, the part to lower first (± {half})"
        if self.seconds is not None:
            about = "more than" if self.at_least else "about"
            return f"{words}; a study of {about} {format_duration(self.seconds)} of processor time may know enough"
        return f"{words}, which more packings of the same settings do not lower"


class Combinations:
    """All combinations of a ladder's settings, as arrays over them.

    Attributes
    ----------
    cost : (m,) array
        Processor time of a packing over that at the scene's own settings.
    scatter : (m,) array
        Relative standard deviation between packings.
    discretisation : (m,) array
        Half width of the discretisation error, from its variance.
    """

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        known = [one for one in ladder.knobs if one.knob in ladder.told]
        noisy = [one for one in known if one.basis is not Basis.MOMENTS]
        self._knobs = [one for one in known if one.basis is Basis.MOMENTS] + noisy
        found = [_candidates(ladder, one, MAX_SETTINGS) for one in self._knobs]
        most = MAX_SETTINGS
        while most > 1 and math.prod(map(len, found[-len(noisy) :] if noisy else [])) > (
            MAX_COMBINATIONS // MAX_WITHOUT_NOISE
        ):
            most -= 1
            found = [_candidates(ladder, one, most) for one in self._knobs]
        self._candidates = found
        self._chosen = np.zeros((1, 0), dtype=np.int8)
        self.cost, self.scatter = np.ones(1), np.full(1, ladder.scatter)
        self._variance, self._shared = np.zeros(1), np.zeros(1)
        self._squares, self._fourth = np.zeros(1), np.zeros(1)  # sums of powers of the errors
        for knob, candidates in zip(self._knobs, found, strict=True):
            self._combine(candidates)
            if knob.basis is Basis.MOMENTS:
                self._keep_frontier()
        interaction = np.maximum(0.0, 0.5 * (self._squares**2 - self._fourth))
        half = np.sqrt(NORMAL**2 * (self._variance + self._shared**2) + PAIRS**2 * interaction)
        own = ladder.total(ladder.told)
        place = int(np.argmin(np.abs(np.log(self.cost)) + np.abs(self._own_distance())))
        self.discretisation = half * (own.half_width / half[place] if half[place] > 0.0 else 1.0)

    def _own_distance(self) -> np.ndarray:
        """Return how many settings of each combination are not the scene's own (m,)."""
        own = [
            next((n for n, one in enumerate(some) if knob.is_own(one.rung.setting)), 0)
            for knob, some in zip(self._knobs, self._candidates, strict=True)
        ]
        return (self._chosen != np.array(own, dtype=np.int8)).sum(axis=1)

    def _combine(self, candidates: list[_Candidate]) -> None:
        """Combine what there is with the settings of one more knob."""
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

    def statistical(self, packings: int) -> np.ndarray:
        """Return the half widths of the packings' mean (m,)."""
        return statistical_half_width(self.ladder, 1.0, packings) * self.scatter

    def choice(self, number: int, packings: int) -> Choice:
        """Return a combination with a number of packings."""
        chosen = [
            (knob.knob, one[place].rung)
            for knob, one, place in zip(self._knobs, self._candidates, self._chosen[number], strict=True)
        ]
        return choice_of(self.ladder, dict(chosen), packings, float(self.scatter[number]), float(self.cost[number]))

    def reaching(self, target: float) -> Iterator[Choice]:
        """Yield what reaches a half width, the cheapest first; each combination with the fewest packings that do."""
        cost, packings = np.full(len(self.cost), np.inf), np.zeros(len(self.cost), dtype=int)
        for n in PACKINGS:
            first = (np.hypot(self.statistical(n), self.discretisation) <= ROUGH * target) & (packings == 0)
            packings[first], cost[first] = n, n * self.cost[first]
        waiting = [(float(cost[n]), int(n), int(packings[n])) for n in np.flatnonzero(packings)]
        heapq.heapify(waiting)
        tries = 0
        while waiting and tries < MAX_TRIES:
            _, number, count = heapq.heappop(waiting)
            choice, tries = self.choice(number, count), tries + 1
            if choice.half_width <= target:
                yield choice
            elif count < PACKINGS[-1] and choice.total.half_width < target:
                more = next(n for n in PACKINGS if n > count)
                heapq.heappush(waiting, (more * float(self.cost[number]), number, more))

    def nearest(self) -> Choice:
        """Return the most accurate combination."""
        half = np.hypot(self.statistical(PACKINGS[-1]), self.discretisation)
        nearest = (self.choice(int(n), PACKINGS[-1]) for n in np.argsort(half)[:NEAREST])
        return min(nearest, key=lambda one: one.half_width)

    def frontier(self) -> tuple[np.ndarray, np.ndarray]:
        """Return processor times [s] and half widths (k,) of the combinations that no cheaper one is as accurate as."""
        seconds = np.concatenate([n * self.cost for n in PACKINGS]) * self.ladder.seconds
        half = np.concatenate([np.hypot(self.statistical(n), self.discretisation) for n in PACKINGS])
        order = np.lexsort((half, seconds))
        seconds, half = seconds[order], half[order]
        kept = np.r_[True, half[1:] < np.minimum.accumulate(half)[:-1]]
        return seconds[kept], half[kept]


def recommended(ladder: Ladder, target: float) -> Choice | Obstacle:
    """Return the cheapest settings that reach a half width of the torque's 95 % interval, relative; or why none do."""
    return next(reaching(ladder, target), None) or obstacle(ladder, target)


def reaching(ladder: Ladder, target: float) -> Iterator[Choice]:
    """Yield all settings that reach a half width, the cheapest first; none where a knob was not measured.

    A scene may refuse some of them together, since settings are measured one at a time.
    """
    if not unknown_of(ladder):
        yield from Combinations(ladder).reaching(target)


def obstacle(ladder: Ladder, target: float) -> Obstacle:
    """Return by what the most accurate combination is limited: by noise, or by what more packings do not lower."""
    if unknown := unknown_of(ladder):
        (knob, reason), *others = unknown.items()
        more = f"; nor was {', '.join(name for name, _ in others)} measured" if others else ""
        return Obstacle(knob, None, None, reason + more)
    best = Combinations(ladder).nearest()
    noise = best.total.noise
    room = target**2 - (best.half_width**2 - noise**2)
    errors = best.total.parts
    if room > 0.0 and noise > 0.0:
        knob = max(errors, key=lambda name: errors[name].noise)
        return Obstacle(knob, best.parts[knob], _spent(ladder) * noise**2 / room, best=best)
    lasting = {
        name: math.sqrt(max(0.0, half**2 - (errors[name].noise ** 2 if name in errors else 0.0)))
        for name, half in best.parts.items()
    }
    knob = max(lasting, key=lambda name: lasting[name])
    finer = _with_finer_settings(ladder, ladder.knob(knob))
    if finer is not None:  # and its noise alone must come below the target
        finer = max(finer, _spent(ladder) * (noise / target) ** 2)
    return Obstacle(knob, best.parts[knob], finer, best=best, at_least=True)


def _with_finer_settings(ladder: Ladder, knob: KnobLadder | None) -> float | None:
    """Return the processor time of a study with a finer setting of a knob than this one [s]; None: it has no finer."""
    rungs = () if knob is None else knob.rungs
    finest = min((one.step_size for one in rungs if one.value is not None), default=0.0)
    left = [one.seconds for one in rungs if one.step_size < finest and not one.failure]
    return _spent(ladder) + FINER * min(left) if left else None


def unknown_of(ladder: Ladder) -> dict[str, str]:
    """Return the knobs whose error at the scene's own setting is not known: why."""
    failed = {
        one.knob: "; ".join(f"{rung.setting:.4g}: {rung.failure}" for rung in one.rungs if rung.failure)
        or ("torques of different signs" if sum(bool(rung.value) for rung in one.rungs) > 1 else "no other setting")
        for one in ladder.knobs
        if one.own_step_size is None
    }
    return ladder.unknown | failed


def own_choice(ladder: Ladder, packings: int = OWN_PACKINGS) -> Choice:
    """Return the scene's own settings, with a number of packings."""
    return choice_of(ladder, {}, packings, ladder.scatter)


def choice_with(ladder: Ladder, knob: KnobLadder, rung: Rung, packings: int) -> Choice | None:
    """Return the scene's own settings but for one; None where its error is not known."""
    if rung.value is None or ladder.draws(knob.knob, rung.step_size) is None:
        return None
    scatter = ladder.scatter * _scatter_ratio(ladder, knob, rung)
    return choice_of(ladder, {knob.knob: rung}, packings, scatter, rung.cost)


def choice_of(ladder: Ladder, rungs: Mapping[str, Rung], packings: int, scatter: float, cost: float = 1.0) -> Choice:
    """Return the scene's own settings but for some; `cost` is that of a packing over one at the scene's own."""
    total = ladder.total(ladder.told | {name: one.step_size for name, one in rungs.items()})
    settings = {one.knob: one.own for one in ladder.knobs} | {name: one.setting for name, one in rungs.items()}
    total = replace(total, unknown=unknown_of(ladder))
    statistical = statistical_half_width(ladder, scatter, packings)
    return Choice(settings, total, packings, scatter, statistical, ladder.seconds * cost * packings)


def statistical_half_width(ladder: Ladder, scatter: float, packings: int) -> float:
    """Return half the 95 % interval of a mean of packings, as wide as the rule that ends a run takes it.

    Their scatter counts together with that of the ladder. Where the ladder does not know the start-up, it is the half
    width for which the rule may end a run that does not drift, if all scatter is fluctuation within a packing: a slope
    of noise makes its ends differ by sqrt(12) times its mean (`emclutch.results.replicated_mean.steadiness`).
    """
    from scipy.special import stdtrit

    error, freedom = scatter / math.sqrt(packings), ladder.freedom + packings - 1
    half = float(stdtrit(freedom, 1.0 - STOPPING_ALLOWANCE * 0.025)) * error
    if "start_up" in ladder.told:
        return half
    drift = (1.0 + float(stdtrit(3 * packings - 1, DRIFT_CONFIDENCE))) * math.sqrt(12.0) * error
    return max(half, drift / DRIFT_LIMIT)


def _spent(ladder: Ladder) -> float:
    """Return the processor time of the packings and solutions that a ladder comes from [s]."""
    rungs = [
        rung
        for knob in ladder.knobs
        if knob.basis is not Basis.LATER
        for rung in knob.rungs
        if knob.basis is Basis.MOMENTS or not knob.is_own(rung.setting)
    ]
    return ladder.packings * ladder.seconds + sum(rung.packings * rung.seconds for rung in rungs)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A setting: cost and scatter over those at the scene's own, its error, the variance of that without the part by
    the mean at the scene's own settings, and the standard deviation by that mean, with its sign."""

    rung: Rung
    cost: float
    scatter: float
    bias: float
    variance: float
    shared: float

    @property
    def spread(self) -> float:
        """Variance of its error."""
        return self.variance + self.shared**2


def _candidates(ladder: Ladder, knob: KnobLadder, most: int) -> list[_Candidate]:
    """Return settings with an error, from coarse to fine, the scene's own among them; at most so many."""
    level = ladder.posterior.level[0]
    unit = (level - level.mean()) / max(float(level.std()), 1e-300)
    found = []
    for rung in knob.rungs:
        found_error = None if rung.value is None else ladder.draws(knob.knob, rung.step_size)
        if found_error is None or (knob.basis is Basis.LATER and rung.setting < knob.own * SAME):
            continue  # an average that begins in the start-up drifts, and a run goes on until it knows by how much
        draws, error = found_error
        shared = float(unit @ draws[0]) / len(unit) if knob.basis is Basis.TORQUE else 0.0
        variance = (error.half_width / NORMAL) ** 2 - shared**2  # tails count as in an interval
        ratio = _scatter_ratio(ladder, knob, rung)
        found.append(_Candidate(rung, rung.cost, ratio, error.bias, max(0.0, variance), shared))
    own = next((one for one in found if knob.is_own(one.rung.setting)), None)
    here = ladder.error(knob.knob)
    if own is not None and here is not None and abs(here.bias) + here.half_width <= NEGLIGIBLE:
        found = [one for one in found if one.rung.step_size >= own.rung.step_size]  # a finer one gains nothing
    while len(found) > most:  # those that others beat, then those with the smallest difference to their neighbour
        others = [one for one in found if not knob.is_own(one.rung.setting)]
        beaten = [one for one in others if any(_beats(other, one) for other in found)]
        found.remove(beaten[0] if beaten else min(others[:-1] or others, key=lambda one: abs(math.log(one.cost))))
    return found


def _scatter_ratio(ladder: Ladder, knob: KnobLadder, rung: Rung) -> float:
    """Return how much packings of a rung differ, over those at the scene's own settings: more grains scatter less."""
    if knob.basis is not Basis.TORQUE or ladder.scatter <= 0.0 or rung.error <= 0.0:
        return 1.0
    return rung.error * math.sqrt(rung.packings) / ladder.scatter


def _beats(other: _Candidate, one: _Candidate) -> bool:
    return other is not one and other.cost <= one.cost and other.scatter <= one.scatter and other.spread <= one.spread
