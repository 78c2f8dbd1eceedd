"""Checkpoints of a run: everything that a bit-exact continuation needs, written while it marches."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from coupling import Simulation, WindowRow
from emclutch.results.checkpoint import write_checkpoint
from emclutch.simulation.early_end import EarlyEnd
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.snapshots import Snapshots

if TYPE_CHECKING:
    from emclutch.simulation.profile_average import ProfileAverage

CHECKPOINT_SECONDS = 60.0  # wall-clock between checkpoints; a crash costs no more than this


class Checkpoints:
    """Callback of the loop that writes checkpoints, and ends the loop where the run is to stop.

    One is written after the first window, the last one, and when `CHECKPOINT_SECONDS` have passed.

    Parameters
    ----------
    request : RunRequest
    windows : int
        Of the whole run.
    early : EarlyEnd
    snapshots : Snapshots
        Its record is written before each checkpoint.
    profiles : ProfileAverage or None
    """

    def __init__(
        self,
        request: RunRequest,
        windows: int,
        early: EarlyEnd,
        snapshots: Snapshots,
        profiles: ProfileAverage | None,
    ) -> None:
        self._request, self._windows, self._early = request, windows, early
        self._snapshots, self._profiles = snapshots, profiles
        self._case_text = request.case.toml()
        self._last = perf_counter()

    def __call__(self, simulation: Simulation, row: WindowRow) -> bool:
        stopped = self._request.is_stopped()
        done = simulation.window >= self._windows or self._early.has_come
        late = perf_counter() - self._last > CHECKPOINT_SECONDS
        if self._request.case.scene.output.checkpoint and (stopped or done or simulation.window == 1 or late):
            self._snapshots.flush()
            save_checkpoint(self._request.folder.checkpoint, simulation, self._case_text, self._profiles)
            self._last = perf_counter()
        return stopped


def save_checkpoint(path: Path, simulation: Simulation, case_text: str, profiles: ProfileAverage | None = None) -> None:
    """Write everything that a bit-exact continuation needs."""
    state = {
        "case": case_text,
        "window": simulation.window,
        "steps_per_update": simulation.steps_per_update,
        "steps": simulation.steps,
        "dem": simulation.motion.state(),  # of DEM or DVI
        "rows": simulation.rows_state(),
        "magnetised": None if simulation.magnetised is None else simulation.magnetised.state(),
        "source": None if simulation.source is None else simulation.source.state(),
    }
    if profiles is not None:
        state["profiles"] = profiles.state()
    write_checkpoint(path, state)
