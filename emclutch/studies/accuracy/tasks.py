"""Tasks of an accuracy study, for any process: one replica at one value, or the field of a frozen packing.

Each has a folder of its own, whose ``result.json`` is written at the end in one step: it tells what is done from what
is to be done again. A task depends on its scene and its seed alone.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results import OutputError, RunFolder
from emclutch.results.atomic_file import replace_json, replaced
from emclutch.results.columns import TIME, TORQUE_DISC
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.run_end import seconds_of
from emclutch.results.steady_torque import durations
from emclutch.scene.case import Case, case_from
from emclutch.scene.errors import SceneError
from emclutch.scene.scaled import STRAIN
from emclutch.simulation.forecast.space import NotEnoughSpace
from emclutch.simulation.run import run
from emclutch.simulation.window_state import WindowState
from emclutch.studies.accuracy.frozen_state import frozen_state
from emclutch.studies.tasks import StopAsked

if TYPE_CHECKING:
    import pandas

RESULT, GRAINS = "result.json", "grains.npz"


@dataclass(frozen=True, slots=True)
class AccuracyTask:
    """Input of one task, as plain data.

    Attributes
    ----------
    data, path, trust_scripts : of its case, as of `emclutch.studies.tasks.PointTask`
    study : str
        Folder of the study.
    folder : str
        Of the task, below it.
    starts : tuple
        Strains (``strain 9``) or times [s] from which on the torque is averaged, the scene's own first.
    keeps_grains : bool
        Whether the grains at the end are kept for tasks without noise.
    grains : str
        File of the frozen packing, below the study's folder; empty: the task is a replica.
    own_key : str
        For a frozen packing, whose moments and feedback are solved far more finely than the scene says: the key
        of a tolerance that is kept all the same.
    """

    data: dict[str, Any]
    path: str | None
    trust_scripts: bool
    study: str
    folder: str
    starts: tuple[float | str, ...] = ()
    keeps_grains: bool = False
    grains: str = ""
    own_key: str = ""

    @property
    def target(self) -> Path:
        """Return the task's folder."""
        return Path(self.study) / self.folder

    @property
    def case(self) -> Case:
        """Return the scene."""
        path = None if self.path is None else Path(self.path)
        return case_from(self.data, None, path, trust_scripts=self.trust_scripts)


@dataclass(frozen=True, slots=True)
class TaskResult:
    """Outcome of one task.

    Attributes
    ----------
    value : float or None
        Mean torque from the scene's own start-up on [N m], or sum of squared moments of a frozen packing [A^2 m^4].
    means : list of float
        Mean torque from each of the task's starts on [N m].
    seconds, wall : float
        Processor time and wall-clock time [s].
    grains, steps : int
    failure : str
        Why there is no value.
    """

    result: float | None
    seconds: float
    wall: float
    means: list[float] = field(default_factory=list)
    grains: int = 0
    steps: int = 0
    failure: str = ""


STOPPED = "stopped"
"""What a task returns that was asked to stop: it begins afresh in a study that continues."""


def result_in(folder: Path) -> TaskResult | None:
    """Return the result of a task; None where it is not done."""
    try:
        return TaskResult(**json.loads((folder / RESULT).read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(f"cannot read {folder / RESULT}: {error}; remove {folder}, then continue") from None


def perform(task: AccuracyTask) -> TaskResult | str:
    """Do a task and write its result; what the scene fails of is part of it. OutputError for what the disk does.

    Returns why it is not done, where it is asked to stop or memory or disk are short now.
    """
    asked = StopAsked(Path(task.study))
    if asked.stop_asked:
        return STOPPED
    if task.target.is_dir():  # of a process that was ended
        shutil.rmtree(task.target)
    begin, failure = (process_time(), perf_counter()), ""
    try:
        result, means, grains, steps = _squared_moments(task) if task.grains else _replica(task, asked)
    except (Interrupted, KeyboardInterrupt):
        return STOPPED
    except (RunError, SceneError, RuntimeError, ValueError) as error:
        if isinstance(error.__cause__, NotEnoughSpace):  # what the machine lacks today is no property of the value
            return str(error.__cause__)
        result, means, grains, steps, failure = None, [], 0, 0, _in_short(error)
    seconds, wall = process_time() - begin[0], perf_counter() - begin[1]
    found = TaskResult(result, seconds, wall, means, grains, steps, failure)
    task.target.mkdir(parents=True, exist_ok=True)
    replace_json(task.target / RESULT, asdict(found))
    return found


def _replica(task: AccuracyTask, asked: StopAsked) -> tuple[float | None, list[float], int, int]:
    """Return the mean torque from the first start on, from each of them, grains and steps."""
    keep = _LastGrains(task.target / GRAINS) if task.keeps_grains else None
    result = run(task.case, out=task.target, threads=1, progress=asked, callback=keep)
    history = result.history
    means = [mean_from(history, _time(start, RunFolder(task.target))) for start in task.starts]
    return means[0], means, int(result.summary["grains"]), int(history["steps"].sum())


def _squared_moments(task: AccuracyTask) -> tuple[float | None, list[float], int, int]:
    """Return the sum of squared moments of a frozen packing, and their number."""
    with np.load(Path(task.study) / task.grains) as kept:
        position, radius = kept["position"], kept["radius"]
    return frozen_state(task.case, position, 2.0 * radius, own_key=task.own_key).squared_moments, [], len(position), 0


def mean_from(history: pandas.DataFrame, start: float) -> float:
    """Return the time mean of the torque on the disc [N m] from a time [s] on; of a window that it cuts, its part."""
    duration = np.asarray(durations(history))
    end = history[TIME].to_numpy()
    inside = np.clip(end - start, 0.0, duration)
    if not inside.sum() > 0.0:
        raise ValueError(f"the run ended at {end[-1] if end.size else 0.0:.4g} s, before its average begins")
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
        raise ValueError(f"the run has no shear rate, and averages from {start}")
    return time


def _in_short(error: Exception) -> str:
    return " ".join(str(error).split("\n(log:")[0].split())


def strain_of(start: float | str) -> float | None:
    """Return the strain of a start; None of a time."""
    head = STRAIN.format("")
    return float(start.removeprefix(head)) if isinstance(start, str) else None
