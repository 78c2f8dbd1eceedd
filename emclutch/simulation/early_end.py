"""What ends a run before its last window: its torque is known, or the user's callback wants no more."""

from __future__ import annotations

from dataclasses import dataclass

from emclutch.simulation.planned_run import PlannedRun
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.torque_known import TorqueKnown
from emclutch.simulation.window_state import UserCallback


@dataclass(frozen=True, slots=True)
class EarlyEnd:
    """The callbacks that may end a run; None where the scene, or the user, has no such.

    Attributes
    ----------
    known : TorqueKnown or None
    asked : UserCallback or None
    """

    known: TorqueKnown | None
    asked: UserCallback | None

    @property
    def callbacks(self) -> tuple[TorqueKnown | UserCallback, ...]:
        """Those that there are."""
        return tuple(one for one in (self.known, self.asked) if one is not None)

    @property
    def torque_is_known(self) -> bool:
        """Whether it has ended the run."""
        return self.known is not None and self.known.reached

    @property
    def is_by_callback(self) -> bool:
        """Whether the user's callback has ended the run."""
        return self.asked is not None and self.asked.stopped

    @property
    def has_come(self) -> bool:
        """Whether the run ends with the present window."""
        return self.torque_is_known or self.is_by_callback


def early_end(request: RunRequest, planned: PlannedRun) -> EarlyEnd:
    """What may end the run of a scene before its last window."""
    until, plan = request.case.scene.span.until, planned.plan
    known = asked = None
    if until is not None:
        known = TorqueKnown(until, planned.conditions, request.replicas, plan.end, request.is_stopped)
    if request.callback is not None:
        asked = UserCallback(request.callback, plan.windows)
    return EarlyEnd(known, asked)
