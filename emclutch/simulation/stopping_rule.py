"""`time.until`: when a run ends, and until then whether it takes more time or more replicas.

A run begins with a few replicas of the first length (`emclutch.scene.replica_count.automatic_count`): four, or two
where the scene has the scatter between replicas from an accuracy study with more than three degrees of freedom. That
scatter is of means up to `time.end`, which is then the only length. At each look the torque of all replicas is judged
(`emclutch.results.steady_torque`). Where its interval is not narrow enough, or its drift not excluded:

- all replicas continue to the next length, 1.5 times the last one and at most `time.end`, where that is estimated to
  need less simulated time than more replicas, or where the torque has a significant drift;
- else the length stays, and more replicas are run: 6, 8, 12, 16, 24, ... (`COUNTS`), at most `accuracy.max_replicas`.

A run of one replica ends where its own error is small enough, but its torque does not count as known: the scatter
between replicas is not in that error.

Looks are few, and both ways to continue are decided by numbers that all replicas share, so that the end depends neither
on the speed of the machine nor on the number of cores. How often such runs are right:
tests/results/test_stopping_rule.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.replicated_mean import (
    Steadiness,
    drifts_significantly,
    may_be_zero,
    more_replicas_suffice,
    more_time_suffices,
    steadiness,
)
from emclutch.results.statistics import REPLICAS, Estimate
from emclutch.scene.replica_count import AUTOMATIC, max_replica_count, replica_count
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.torque_target import TorqueTarget
from emclutch.simulation.scaled_slip import strain_rate

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene

COUNTS = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64)
FIRST_LENGTH = 3.0  # times the start-up that is known
ALONE = 0.125  # of time.end: taken for the start-up of a run of one replica of which nothing is known
CONFIRMED = 8  # replicas whose mean tells a start-up that lasts from a chance
LONGER = 1.5  # factor between lengths


@dataclass(frozen=True, slots=True)
class Stop:
    """End the run."""

    reached: bool


@dataclass(frozen=True, slots=True)
class GoOn:
    """Run `count` replicas to the time `length` [s] before the next look."""

    count: int
    length: float


def lengths(end: float, start_up: float) -> tuple[float, ...]:
    """Times [s] of the looks of a run that ends at `end` [s] at the latest.

    `start_up` [s] is what is known of the start-up; 0: nothing, and there is one look, since no statistics of a shorter
    run tell a slow start-up from a steady signal.
    """
    if start_up <= 0.0:
        return (end,)
    length = FIRST_LENGTH * start_up
    found = []
    while length < end / 1.1:  # a last length that is hardly longer is not worth a look
        found.append(length)
        length *= LONGER
    return (*found, end)


def is_known(torque: Estimate, target: TorqueTarget) -> bool:
    """True if a torque is steady, and its 95 % interval narrow enough."""
    if not torque.converged or torque.mean is None or not _is_narrow(torque, target):
        return False
    return steadiness(torque, target.half_width(torque.mean)) is Steadiness.STEADY


def _is_narrow(torque: Estimate, target: TorqueTarget) -> bool:
    """True if half the 95 % interval is as narrow as asked for."""
    half = torque.half_width()
    return half is not None and torque.mean is not None and half <= target.half_width(torque.mean)


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """The rule of one run.

    Attributes
    ----------
    target : TorqueTarget
    lengths : tuple of float
        Times [s] of the looks, rising; the last one is the end of the longest run.
    max_count : int
        Largest number of replicas.
    """

    target: TorqueTarget
    lengths: tuple[float, ...]
    max_count: int

    def first(self, count: int = AUTOMATIC, reached: float = 0.0) -> GoOn:
        """First request; of a run that continues, from the time `reached` [s] on."""
        length = next((one for one in self.lengths if one >= reached * (1.0 - 1e-9)), self.lengths[-1])
        return GoOn(min(count, self.max_count), length)

    def after(self, torque: Estimate, now: GoOn) -> GoOn | Stop:
        """Decide by the torque of `now.count` replicas up to `now.length`."""
        if is_known(torque, self.target):
            return Stop(True)
        if torque.steady_alone and _is_narrow(torque, self.target):
            return Stop(False)
        longer = [one for one in self.lengths if one > now.length * (1.0 + 1e-9)]
        more = [one for one in COUNTS if now.count < one <= self.max_count] if now.count > 1 else []
        wanted = 0.0 if torque.mean is None else self.target.half_width(torque.mean)
        drifts = drifts_significantly(torque, wanted)
        if torque.standard_error is None or (drifts and (longer or torque.exclude_drift)):
            more = []  # after a start-up that is known, and in a run that can be no longer, a drift may be chance
        if torque.starts_up and now.count >= CONFIRMED:
            more = []
        if longer and (not more or self._time_is_cheaper(torque, now, longer, more, wanted)):
            return GoOn(now.count, longer[0])
        return GoOn(more[0], now.length) if more else Stop(False)

    def _time_is_cheaper(
        self, torque: Estimate, now: GoOn, longer: Sequence[float], more: Sequence[int], wanted: float
    ) -> bool:
        """True if running all replicas longer is estimated to need less simulated time than more replicas."""
        if torque.is_steady and not torque.drift_error:  # what is missing are balance and shear
            return True
        if not more_replicas_suffice(torque, more[-1], wanted):
            return True
        count = next(one for one in more if more_replicas_suffice(torque, one, wanted))
        by_count = (count - now.count) * now.length
        length = next((one for one in longer if more_time_suffices(torque, one, wanted)), None)
        return length is not None and now.count * (length - now.length) <= by_count


def stopping_rule(scene: Scene, device: Device, end: float) -> StoppingRule | None:
    """The rule of `time.until` in a scene whose longest run ends at `end` [s]; None where it has none."""
    until = scene.span.until
    if until is None:
        return None
    count, rate = max_replica_count(scene), strain_rate(scene, device)
    start_up = scene.span.average_time or (start_up_strain(scene) / rate if rate else 0.0)
    if count == 1 and not start_up:
        start_up = ALONE * end
    times = (end,) if scene.accuracy.replica_scatter else lengths(end, start_up)
    return StoppingRule(until, times, count)


def looks_several_times(scene: Scene, device: Device, end: float) -> bool:
    """True if the rule of `time.until`, where there is one, may look more than once at a run until `end` [s]."""
    rule = stopping_rule(scene, device, end)
    return rule is not None and (len(rule.lengths) > 1 or rule.max_count > replica_count(scene))


def enough(torque: Estimate, wanted: float, end: float) -> tuple[int | None, float | None]:
    """Return the replicas, and the end [s], of which either is estimated to reach the half width `wanted` [N m]."""
    if torque.replicas < 2:
        half = torque.half_width()
        if half is None or not torque.steady_alone:
            return None, None
        return (REPLICAS, None) if half <= wanted else (None, end * (half / wanted) ** 2)
    counts = [] if drifts_significantly(torque, wanted) else [one for one in COUNTS if one > torque.replicas]
    count = next((one for one in counts if more_replicas_suffice(torque, one, wanted)), None)
    times = end * np.array([1.5, 2.0, 3.0, 5.0, 10.0])
    time = next((one for one in times if more_time_suffices(torque, float(one), wanted)), None)
    return count, time


def remedy(torque: Estimate, target: TorqueTarget, end: float) -> str:
    """Return why a torque, or stress, is not known well enough at the end of its run at `end` [s], and what helps."""
    half = torque.half_width()
    if half is None or torque.mean is None:
        return torque.in_words()
    wanted = target.half_width(torque.mean)
    if may_be_zero(torque) and not target.absolute:
        return (
            f"the {target.quantity} does not differ from 0 ({torque.mean:.2g} ± {half:.2g} {target.unit}), so no "
            f"percentage of it can be reached; give a {target.quantity} as well: until = '{target} or {target.example}'"
        )
    if torque.replicas < 2:
        time = enough(torque, wanted, end)[1]
        if time is None:
            return torque.in_words()
        short = f"± {half:.2g} {target.unit}; ± {wanted:.2g} {target.unit} was requested"
        return f"{short}; raise time.end to about {time:.2g} s; {torque.in_words()}"
    if drifts_significantly(torque, wanted):
        return f"{torque.status}: {torque.reason}; raise time.end above {end:.3g} s: more replicas do not help"
    if torque.missing or (not torque.converged and torque.drift_error is None):
        return torque.in_words()
    count, time = enough(torque, wanted, end)
    ways = [f"accuracy.max_replicas (or replicas) to {count}"] if count else []
    ways += [f"time.end to {time:.2g} s"] if time else []
    text = f"± {half:.2g} {target.unit}; ± {wanted:.2g} {target.unit} was requested"
    if steadiness(torque, wanted) is not Steadiness.STEADY:
        text += f"; {torque.status}"
    return f"{text}; estimate: raise {' or '.join(ways)}" if ways else f"{text}; ask for less"
