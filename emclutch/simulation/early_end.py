"""Early end of a run: its torque is known, its control says so, or the user's callback."""

from __future__ import annotations

from dataclasses import dataclass

from emclutch.simulation.planned_run import PlannedRun
from emclutch.simulation.replicas import ReplicaControl
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.stopping_rule import stopping_rule
from emclutch.simulation.torque_trigger import TorqueTrigger
from emclutch.simulation.window_state import UserCallback


@dataclass(frozen=True, slots=True)
class EarlyEnd:
    """The callbacks that may end a run; None where there is none.

    Attributes
    ----------
    trigger : TorqueTrigger or None
        Of a run whose scene has `time.until`.
    control : ReplicaControl or None
        Of one of the other replicas.
    asked : UserCallback or None
    """

    trigger: TorqueTrigger | None
    control: ReplicaControl | None
    asked: UserCallback | None

    @property
    def callbacks(self) -> tuple[TorqueTrigger | ReplicaControl | UserCallback, ...]:
        """All that there are."""
        return tuple(one for one in (self.trigger, self.control, self.asked) if one is not None)

    @property
    def torque_is_known(self) -> bool:
        """True if it has ended the run."""
        return self.trigger is not None and self.trigger.reached

    @property
    def is_by_callback(self) -> bool:
        """True if the user's callback has ended the run."""
        return self.asked is not None and self.asked.stopped

    @property
    def has_come(self) -> bool:
        """True if the run ends with the present window."""
        ended = self.trigger is not None and self.trigger.ended
        return ended or (self.control is not None and self.control.reached) or self.is_by_callback


def early_end(request: RunRequest, planned: PlannedRun, reached: float) -> EarlyEnd:
    """Rule that may end the run of a scene before its last window; it continues from the time `reached` [s]."""
    plan, replicas = planned.plan, request.replicas
    trigger = asked = None
    replicas.tolerance = 0.5 * plan.division.length
    rule = stopping_rule(plan.scene, planned.device, plan.end)
    if request.control is None and rule is not None:
        first = rule.first(replicas.count, reached - replicas.tolerance)
        replicas.request(first.count, first.length)
        trigger = TorqueTrigger(rule, planned.conditions, replicas, request.progress, request.is_stopped, first)
    elif request.control is None:
        replicas.request(replicas.count, plan.end)
    if request.callback is not None:
        asked = UserCallback(request.callback, plan.windows)
    return EarlyEnd(trigger, request.control, asked)
