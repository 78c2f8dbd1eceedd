"""A sign of life before a run's first window ends."""

from __future__ import annotations

import threading
from typing import Any

from coupling import Simulation, WindowRow

SECONDS = 2.0  # between two signs


class Heartbeat:
    """Reports the grains' time from a thread of its own until `stop`, which is a callback of the loop.

    The loop reports whole windows. The first one may take a minute: kernels are compiled in it, and a window of many
    grains has many steps.

    Parameters
    ----------
    progress : object with ``update(fraction, text)``, or None
        Called from the other thread between entering and `stop`, and by nobody else then.
    simulation : Simulation
    end : float
        Time at the end of the run [s].
    """

    def __init__(self, progress: Any, simulation: Simulation, end: float) -> None:
        self._progress, self._simulation, self._end = progress, simulation, end
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Heartbeat:
        if self._progress is not None:
            self._thread.start()
        return self

    def stop(self, simulation: Simulation | None = None, row: WindowRow | None = None) -> None:
        """Be silent from now on; the arguments are those of a callback of `run_staggered`."""
        if not self._stopped.is_set():
            self._stopped.set()
            if self._thread.is_alive():
                self._thread.join()

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _beat(self) -> None:
        steps = self._simulation.motion.step_count
        while not self._stopped.wait(SECONDS):
            if self._simulation.motion.step_count > steps:  # else what was said last is still what is waited for
                steps = self._simulation.motion.step_count
                time = self._simulation.motion.time
                self._progress.update(time / self._end, f"t = {time * 1e3:.3g} ms, in the first window")
