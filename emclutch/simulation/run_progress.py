"""Progress messages of a run, to the listener and into its log."""

from __future__ import annotations

import logging
from collections.abc import Callable
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

    def say(self, fraction: float, text: str) -> None:
        """Return how far the run is, and what it does."""
        if self.listener is not None:
            self.listener.update(fraction, text)

    def announce(self, text: str) -> None:
        """A line that stays, in the log too."""
        log.info("%s", text)
        if self.tell is not None:
            self.tell(text)

    @property
    def tell(self) -> Callable[[str], None] | None:
        """Return what shows a line that stays; None where nobody does."""
        return getattr(self.listener, "announce", None)

    @property
    def stop_asked(self) -> bool:
        """True if the listener wants the run to stop."""
        return bool(getattr(self.listener, "stop_asked", False))
