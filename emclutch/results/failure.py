"""That a run has failed for its scene, kept in its folder: resumed, it is the same bit for bit and fails again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from emclutch.results.time_unit import time_in_words

CURE = "the same scene fails there again: change it and start it again with another --out"


@dataclass(frozen=True, slots=True)
class Failure:
    """The error that ended a run.

    Attributes
    ----------
    time : float or None
        End of its last window [s]; None: it had none.
    reason : str
        With the remedy.
    """

    time: float | None
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"time": self.time, "reason": self.reason}

    def in_words(self) -> str:
        """Return when and why, and that going on helps nothing."""
        when = "before its first window" if self.time is None else f"after {time_in_words(self.time)}"
        return f"the run failed {when}: {self.reason.rstrip('.')}; {CURE}"
