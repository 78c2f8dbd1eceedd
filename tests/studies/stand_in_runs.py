"""Runs that take no time, and study files over them: what a study asks for is kept, and its files are there."""

import signal
import time
from pathlib import Path
from typing import NamedTuple

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.checkpoint import write_checkpoint
from emclutch.scene.input_files import hashed_input_files

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
FRICTION, SPEED = "contact.friction", "motion.rotor.speed"


class Asked(NamedTuple):
    point: int
    resume: bool
    end: float
    start: int | None
    friction: float
    threads: int | None


class StandInRuns:
    """Stands in for `run`: `acts` maps a point's friction to what it does with its progress before it writes its files.

    The torque is the friction, unless another one is given.
    """

    def __init__(self):
        self.acts, self.asked, self.torque = {}, [], None

    @property
    def points(self):
        return [one.point for one in self.asked]

    def __call__(self, case, *, out, threads, progress, resume, start, force, accuracy_target=None):
        friction, end = case.scene.contact.friction, case.scene.time.end
        start = None if start is None else number_of(start)
        self.asked.append(Asked(number_of(out), resume, end, start, friction, threads))
        folder = RunFolder.create(out, case.toml(), resume=resume)
        self.acts.get(friction, lambda progress: None)(progress)
        folder.write_provenance(input_files=hashed_input_files(case.scene))
        with HistoryWriter(folder.history) as history:
            history.append({"time": end, "torque_disc": friction})
        write_checkpoint(folder.checkpoint, {})
        torque = {"mean": self.torque or friction, "standard_error": 0.1, "converged": True, "reason": "", "start": 0.0}
        folder.write_summary({"torque": torque, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}})
        return load_result(folder.path)


def never_ends(task, folder, progress):
    """Look for no file that asks to stop, as while kernels compile; Ctrl-C ends it unless the task is deaf."""
    if not task.options["deaf"]:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    (folder / "begun").touch()
    time.sleep(60.0)


def number_of(folder):
    """The number of a point by its folder."""
    return int(Path(folder).name.partition("_")[0])


def folder_of(study, number):
    """The folder of a point that is at rest."""
    (found,) = (path for path in study.glob("[0-9]*_*") if number_of(path) == number and "set-aside" not in path.name)
    return found


def study_file(folder, values, settings=None, **own):
    """Write study.toml over some values, with entries of its tables [study.set] and [study]."""
    tables = (("study", {"case": str(GOOD)} | own), ("study.values", values), ("study.set", settings or {}))
    text = [f"[{name}]\n" + "".join(f'"{key}" = {entry!r}\n' for key, entry in table.items()) for name, table in tables]
    path = folder / "study.toml"
    path.write_text("".join(text))
    return path
