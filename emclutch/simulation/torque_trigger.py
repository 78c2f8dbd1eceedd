"""`time.until` in a run: the callback that looks at the torque of all replicas and asks for more time, or more of them.

The rule is `emclutch.simulation.stopping_rule`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from emclutch.results.changing_drive import changing_drive
from emclutch.results.columns import TIME
from emclutch.results.replicated_mean import may_be_zero
from emclutch.results.steady_stress import steady_measure
from emclutch.results.steady_torque import SteadyConditions
from emclutch.simulation.forecast.cost import format_rough_time
from emclutch.simulation.replicas import Replicas
from emclutch.simulation.run_progress import RunProgress
from emclutch.simulation.stopping_rule import GoOn, Stop, StoppingRule, enough, is_known, remedy

if TYPE_CHECKING:
    import pandas

    from coupling import Simulation, WindowRow
    from emclutch.results.statistics import Estimate
    from emclutch.scene.torque_target import TorqueTarget

log = logging.getLogger(__name__)


@dataclass(slots=True)
class TorqueTrigger:
    """Callback of the loop that ends a run once its torque is known, or asks for more of it.

    Attributes
    ----------
    rule : StoppingRule
    conditions : SteadyConditions
    replicas : Replicas
    progress : RunProgress
    is_stopped : callable
        Whether the run is to stop for another reason.
    now : GoOn
        What is run before the next look.
    ended, reached : bool
        Whether the rule has ended the run, and whether because the torque is known.
    """

    rule: StoppingRule
    conditions: SteadyConditions
    replicas: Replicas
    progress: RunProgress
    is_stopped: Callable[[], bool]
    now: GoOn
    ended: bool = False
    reached: bool = False
    _began: float = field(default_factory=time.monotonic)
    _simulated: float = 0.0

    def __call__(self, simulation: Simulation, row: WindowRow | None = None) -> bool:
        """Look where the requested time has come; True ends the run."""
        here = simulation.motion.time
        while not self.ended and here >= self.now.length - self.replicas.tolerance:
            if not self.replicas.wait(self.is_stopped, lambda: self._update(here)):
                return False
            self._look()
        return self.ended

    def _look(self) -> None:
        """Judge the torque of all replicas up to the requested time, and decide what follows."""
        now, histories = self.now, self.replicas.histories(self.now.length)
        torque = steady_measure(histories, self.conditions)
        following = self.rule.after(torque, now)
        self._report(torque, following)
        if isinstance(following, Stop):
            self.ended, self.reached = True, following.reached
            self.replicas.finish()
            return
        if following.count > now.count:  # the length stays: those that wait there are done
            self.replicas.finish([number for number in self.replicas.processes if number < now.count])
        self.now = following
        self.replicas.request(following.count, following.length)

    def _report(self, torque: Estimate, following: GoOn | Stop) -> None:
        """Report torque (or stress) with its interval, the requested one, the replicas and what is left."""
        now, half, target = self.now, torque.half_width(), self.rule.target
        replicas = f"{now.count} replica{'s' * (now.count > 1)} to {1e3 * now.length:.3g} ms"
        if torque.mean is None:
            text = f"raw {target.quantity} unknown, {replicas}"
        else:
            wanted = target.half_width(torque.mean)
            requested = f"; ± {wanted:.2g} {target.unit} was requested" if wanted else ""
            error = ", error unknown" if half is None else f" (95 %{requested})"
            mean = f"{torque.mean:.4g}" if half is None else f"{torque.mean:.4g} ± {half:.2g}"
            text = f"raw {target.quantity} {mean} {target.unit}{error}, {replicas}"
        if isinstance(following, Stop):
            text += ": time.until reached" if following.reached else f"; {torque.in_words()}"
        else:
            done, left = now.count * now.length, following.count * following.length - now.count * now.length
            seconds = (time.monotonic() - self._began) * left / max(done - self._simulated, 1e-300)
            what = f"{following.count} replicas" if following.count > now.count else f"{1e3 * following.length:.3g} ms"
            text += f"; {torque.status}; next look at {what}, in about {format_rough_time(seconds)}"
        self.progress.log(text)

    def _update(self, here: float) -> None:
        there = self.replicas.have_reached() + 1
        text = f"{there} of {self.now.count} replicas have reached {1e3 * self.now.length:.3g} ms"
        self.progress.update(self.replicas.share_done(here), text)


def how_it_ended(torque: Estimate, history: pandas.DataFrame, target: TorqueTarget) -> dict[str, Any]:
    """Return `time.until` for the summary: asked, reached, half width [N m] or [Pa], and why it was not reached."""
    reached = is_known(torque, target)
    found: dict[str, Any] = {"asked": str(target), "reached": reached, "half_width": torque.half_width()}
    if not reached and (changing := changing_drive(history, torque.start)):
        found["reason"] = changing
    elif not reached:
        end = float(history[TIME].iloc[-1])
        found["reason"] = remedy(torque, target, end)
        if torque.mean is not None and (target.absolute or not may_be_zero(torque)):
            found["replicas"], found["end"] = enough(torque, target.half_width(torque.mean), end)
    return found
