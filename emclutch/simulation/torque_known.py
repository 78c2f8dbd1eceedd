"""`time.until`: a run ends once its torque is known well enough, at the same window in all replicas.

Whether it is known is asked at a few times that all replicas can name beforehand, each a quarter later than the one
before: often enough to stop in time, seldom enough that the asking does not choose a lucky moment. Each replica waits
until the others have come so far, reads their histories up to that time and computes the same answer: the end depends
neither on how fast they are nor on who asks.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results import read_history
from emclutch.results.statistics import Estimate, more_time
from emclutch.results.steady_torque import LEAST_STRAIN, SteadyConditions, steady_torque
from emclutch.scene.torque_target import TorqueTarget

if TYPE_CHECKING:
    import pandas

    from coupling import Simulation
    from emclutch.device.device import Device
    from emclutch.scene.model import Scene
    from emclutch.simulation.replicas import Replicas

log = logging.getLogger(__name__)
FIRST = 0.02  # of the longest run
LATER = 1.25  # factor between one asking and the next
POLL = 0.05  # s, between looks at the others' histories


def asked_at(end: float) -> list[float]:
    """Times [s] at which a run that ends at `end` [s] at the latest asks whether its torque is known."""
    times = [FIRST * end]
    while LATER * times[-1] < end:
        times.append(LATER * times[-1])
    return times


def earliest_end(scene: Scene, device: Device, end: float) -> float:
    """The first time [s] at which the torque can be known of a run that ends at `end` [s] at the latest.

    A steady part that begins with the run, or where it is averaged from, must have sheared the gap by `LEAST_STRAIN`.
    """
    strain_rate = scene.motion.largest_slip * device.shear_radius / device.shear_gap if device.shear_gap else 0.0
    least = (scene.span.average_from or 0.0) + (LEAST_STRAIN / strain_rate if strain_rate else 0.0)
    return next((at for at in asked_at(end) if at >= least), end)


def is_known(torque: Estimate, target: TorqueTarget) -> bool:
    """Whether a torque is steady, and its 95 % interval narrow enough."""
    half = torque.half_width()
    return torque.converged and half is not None and torque.mean is not None and half <= target.half_width(torque.mean)


@dataclass(slots=True)
class TorqueKnown:
    """Callback of the loop that ends it; `reached` says whether it has."""

    target: TorqueTarget
    conditions: SteadyConditions
    replicas: Replicas
    end: float
    is_stopped: Callable[[], bool]
    reached: bool = False

    def __call__(self, simulation: Simulation, row: dict[str, Any] | None = None) -> bool:
        now = simulation.motion.time
        before = now - simulation.steps_per_update * simulation.updates * simulation.motion.dt
        start = self.conditions.average_from or 0.0
        due = [at for at in asked_at(self.end) if before < at <= now and at > start]
        return self.ask(due[-1]) if due else False

    def ask(self, at: float) -> bool:
        """Whether the torque is known at a time [s]; False too where the run is to stop for another reason."""
        histories = []
        for path in self.replicas.histories:
            while (found := _history_until(path, at)) is None:
                if self.is_stopped():
                    return False
                time.sleep(POLL)
            histories.append(found)
        torque = steady_torque(histories[0], self.conditions, histories[1:])
        self.reached = is_known(torque, self.target)
        half = torque.half_width()
        log.info(
            "t = %.4g s: torque %s N m, half its 95 %% interval %s N m, asked for %s; %s",
            float(histories[0]["time"].iloc[-1]),
            "unknown" if torque.mean is None else f"{torque.mean:.4g}",
            "unknown" if half is None else f"{half:.2g}",
            self.target,
            torque.reason,
        )
        return self.reached


def _history_until(path: Path, at: float) -> pandas.DataFrame | None:
    """The rows of a history up to the first that ends at `at` [s] or later; None where it has not come so far."""
    history = read_history(path) if path.is_file() else None
    if history is None or not len(history) or history["time"].iloc[-1] < at:
        return None
    return history.iloc[: int(history["time"].searchsorted(at)) + 1]


def how_it_ended(torque: Estimate, target: TorqueTarget, history: pandas.DataFrame) -> dict[str, Any]:
    """What the summary says of `time.until`: asked, reached, half width [N m], and where it was not reached, why."""
    half = torque.half_width()
    found: dict[str, Any] = {"asked": str(target), "reached": is_known(torque, target), "half_width": half}
    if not found["reached"]:
        found["reason"] = _why_not(torque, target, half, float(history["time"].iloc[-1]))
    return found


def _why_not(torque: Estimate, target: TorqueTarget, half: float | None, end: float) -> str:
    """Why a torque is not known well enough at the end [s] of its run, and what helps."""
    if not torque.converged or half is None or torque.mean is None:
        return torque.reason
    wanted = target.half_width(torque.mean)
    if abs(torque.mean) <= half and not target.absolute:
        return (
            f"there is no torque that differs from 0 ({torque.mean:.2g} +- {half:.2g} N m), so no share of it can be "
            f"reached; give a torque beside it: until = '{target} or 0.01 N m'"
        )
    more = max(2, round(torque.replicas * (half / wanted) ** 2))
    if (torque.degrees_of_freedom or 0.0) < 2.0 * (torque.replicas - 1):
        return (
            f"packings differ by {torque.packing_share or 0.0:.2g} N m, which no longer run mends; "
            f"raise accuracy.replicas from {torque.replicas} to about {more}"
        )
    longer = end + (more_time(torque, end, wanted) or 0.0)
    return f"time.end = {end:.3g} s is too early; estimate: {longer:.2g} s will do, or more accuracy.replicas"
