"""Orders of a run to the process of one of its replicas: how far to go, to end, or to stop."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from emclutch.simulation.replicas import END

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow


class Orders:
    """Callback of the loop that waits at a time limit until another one is set; used from two threads.

    Parameters
    ----------
    limit : float
        Time [s] to march to first.
    tolerance : float
        [s]; a replica that comes so near has reached a time. It is that of the run which waits for it, whose windows
        may be shorter.

    Attributes
    ----------
    stopped : threading.Event
        Set where the replica is to end with a checkpoint.
    reached : bool
        Whether it has ended at its limit, with a result.
    """

    def __init__(self, limit: float, tolerance: float) -> None:
        self.stopped = threading.Event()
        self.reached = False
        self._limit, self._tolerance = limit, tolerance
        self._ended = False
        self._changed = threading.Condition()

    def take(self, line: str) -> None:
        """Take a line of the run: a time [s], or the order to end."""
        with self._changed:
            if line.strip() == END:
                self._ended = True
            else:
                self._limit = float(line)
            self._changed.notify_all()

    def stop(self) -> None:
        """End with a checkpoint."""
        with self._changed:
            self.stopped.set()
            self._changed.notify_all()

    def __call__(self, simulation: Simulation, row: WindowRow | None = None) -> bool:
        now = simulation.motion.time + self._tolerance
        with self._changed:
            self._changed.wait_for(lambda: self._limit > now or self._ended or self.stopped.is_set())
            self.reached = self._ended and self._limit <= now
        return self.reached
