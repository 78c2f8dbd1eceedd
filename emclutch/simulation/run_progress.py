"""Progress messages of a run, to the listener and into its log."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RunProgress:
    """The progress of one run.

    Attributes
    ----------
    listener : object with ``update(fraction, text)``, or None
        It may also have ``status(text)`` and ``stop_asked``, see `emclutch.run`.
    """

    listener: Any = None

    def update(self, fraction: float, text: str) -> None:
        """Show how far the run is, and what it does."""
        if self.listener is not None:
            self.listener.update(fraction, text)

    def log(self, text: str, level: int = logging.INFO) -> None:
        """Log a line, and show it where the listener can."""
        log.log(level, "%s", text)
        if (status := getattr(self.listener, "status", None)) is not None:
            status(text)

    @property
    def stop_asked(self) -> bool:
        """True if the listener wants the run to stop."""
        return bool(getattr(self.listener, "stop_asked", False))


SECONDS = 2.0  # between two signs of life in the first window


class Heartbeat:
    """Reports the grains' time from a thread of its own until `stop`, which is a callback of the loop.

    The loop reports whole windows. The first one may take a minute: kernels are compiled in it, and a window of many
    grains has many steps.

    Parameters
    ----------
    progress : object with ``update(fraction, text)``, or None
        Called from the other thread between entering and `stop`, and by nobody else then.
    simulation : Simulation
    share : callable
        Fraction of the run that is done at a time [s].
    """

    def __init__(self, progress: Any, simulation: Simulation, share: Callable[[float], float]) -> None:
        self._progress, self._simulation, self._share = progress, simulation, share
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
                self._progress.update(self._share(time), f"t = {time * 1e3:.3g} ms, in the first window")
