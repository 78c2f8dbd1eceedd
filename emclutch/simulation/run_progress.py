"""Progress messages of a run, to the listener and into its log."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RunProgress:
    """The progress of one run.

    Attributes
    ----------
    listener : object with ``update(fraction, text)``, or None
        It may also have ``announce(text)`` and ``stop_asked``, see `emclutch.run`.
    """

    listener: Any = None

    def update(self, fraction: float, text: str) -> None:
        """Show how far the run is, and what it does."""
        if self.listener is not None:
            self.listener.update(fraction, text)

    def announce(self, text: str, level: int = logging.INFO) -> None:
        """Log a line, and show it where the listener can."""
        log.log(level, "%s", text)
        if (announce := getattr(self.listener, "announce", None)) is not None:
            announce(text)

    @property
    def stop_asked(self) -> bool:
        """True if the listener wants the run to stop."""
        return bool(getattr(self.listener, "stop_asked", False))
