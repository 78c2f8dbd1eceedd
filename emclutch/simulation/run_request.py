"""Input of one run: its scene, its open folder, and its options."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from emclutch.scene.case import Case
from emclutch.simulation.open_folder import OpenFolder
from emclutch.simulation.replicas import Replicas
from emclutch.simulation.run_progress import RunProgress

if TYPE_CHECKING:
    from emclutch.results import RunFolder
    from emclutch.simulation.replicas import ReplicaControl
    from emclutch.simulation.warm_start import StartingGrains
    from emclutch.simulation.window_state import WindowState


@dataclass(frozen=True, slots=True)
class RunRequest:
    """One replica's run; what the user asks for is explained at `emclutch.run`.

    Attributes
    ----------
    case : Case
    opened : OpenFolder
    progress : RunProgress
    replicas : Replicas
        All of the run, seen from this one.
    stop : threading.Event
        Set where the run is to end with a checkpoint.
    tune_threads : bool
        It may take fewer threads where fewer pay.
    force : bool
    grains : StartingGrains or None
        None packs its own.
    callback : callable or None
    control : ReplicaControl or None
        Of one of the other replicas.
    target : float or None
        Total error that the settings were chosen for, relative.
    """

    case: Case
    opened: OpenFolder
    progress: RunProgress
    replicas: Replicas
    stop: threading.Event
    tune_threads: bool
    force: bool
    grains: StartingGrains | None
    callback: Callable[[WindowState], object] | None = None
    control: ReplicaControl | None = None
    target: float | None = None

    @property
    def folder(self) -> RunFolder:
        """Of the run."""
        return self.opened.folder

    @property
    def how_to_go_on(self) -> str:
        """Command to type after a run that was stopped or failed for reasons other than the scene."""
        return f"continue with: emclutch run {self.folder.path} --resume"

    def is_stopped(self) -> bool:
        """True if the run is to end after its present window, for the user or because another replica has failed."""
        if self.progress.stop_asked:
            self.stop.set()
        return self.stop.is_set() or bool(self.replicas.failure())
