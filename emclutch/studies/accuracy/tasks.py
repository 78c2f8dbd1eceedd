"""What the tasks of an accuracy study measure: one replica at one value, or the moments of a frozen packing.

A task depends on its scene and its seed alone. The values of its row are `torque`, the mean from the scene's own
start-up on [N m]; `means`, that from each of several starts on [N m]; `moments`, the sum of squared moments of a frozen
packing [A^2 m^4]; `grains` and `steps`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results import RunFolder
from emclutch.results.atomic_file import replaced
from emclutch.results.columns import TIME, TORQUE_DISC
from emclutch.results.errors import RunError
from emclutch.results.run_end import seconds_of
from emclutch.results.steady_torque import durations
from emclutch.scene.scaled import STRAIN
from emclutch.simulation.run import run
from emclutch.simulation.window_state import WindowState
from emclutch.studies.accuracy.frozen_state import frozen_state
from emclutch.studies.attempt import clear_attempt

if TYPE_CHECKING:
    import pandas

    from emclutch.studies.study import Task, TaskProgress

GRAINS = "grains.npz"


def measure_replica(task: Task, folder: Path, progress: TaskProgress) -> dict[str, Any]:
    """Run a replica afresh on one thread.

    Options: `starts`, strains (``strain 9``) or times [s] from which on the torque is averaged, the scene's own first;
    `keeps_grains`, whether the grains at the end are kept for tasks without noise.

    Raises
    ------
    RunError
        The run ends before an average begins.
    """
    clear_attempt(folder)  # of what a process has left that was ended
    keep = _LastGrains(folder / GRAINS) if task.options.get("keeps_grains") else None
    result = run(task.case, out=folder, threads=1, progress=progress, callback=keep)
    history = result.history
    means = [mean_from(history, _time(start, RunFolder(folder))) for start in task.options["starts"]]
    steps = int(history["steps"].sum())
    return {"torque": means[0], "means": means, "grains": int(result.summary["grains"]), "steps": steps}


def measure_moments(task: Task, folder: Path, progress: TaskProgress) -> dict[str, Any]:
    """Solve the moments of a frozen packing.

    Options: `grains`, file of the packing; `own_key`, key of a tolerance that is kept, where moments and feedback are
    solved far more finely than the scene says.

    Raises
    ------
    RunError
        Field or moments do not converge.
    """
    with np.load(task.options["grains"]) as kept:
        position, radius = kept["position"], kept["radius"]
    try:
        found = frozen_state(task.case, position, 2.0 * radius, own_key=task.options["own_key"])
    except (RuntimeError, ValueError) as error:
        raise RunError(str(error)) from error
    return {"moments": found.squared_moments, "grains": len(position)}


def mean_from(history: pandas.DataFrame, start: float) -> float:
    """Return the time mean of the torque on the disc [N m] from a time [s] on; of a window that it cuts, its part."""
    duration = np.asarray(durations(history))
    end = history[TIME].to_numpy()
    inside = np.clip(end - start, 0.0, duration)
    if not inside.sum() > 0.0:
        raise RunError(f"the run ended at {end[-1] if end.size else 0.0:.4g} s, before its average begins")
    return float(inside @ history[TORQUE_DISC].to_numpy() / inside.sum())


class _LastGrains:
    """Callback of a run that keeps the grains after its last window, in the order of their numbers."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, state: WindowState) -> bool:
        if state.window == state.windows:
            order = np.argsort(state.particle_id)
            with replaced(self._path) as new, new.open("wb") as file:
                np.savez(file, position=state.position[order], radius=state.radius[order])
        return False


def _time(start: float | str, folder: RunFolder) -> float:
    time = seconds_of(start, folder)
    if time is None:
        raise RunError(f"the run has no shear rate, and averages from {start}")
    return time


def strain_of(start: float | str) -> float | None:
    """Return the strain of a start; None of a time."""
    head = STRAIN.format("")
    return float(start.removeprefix(head)) if isinstance(start, str) else None
