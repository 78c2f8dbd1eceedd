"""Results of a run, read from its folder."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.best_estimate import best_estimate
from emclutch.results.columns import SHEAR_STRESS, TORQUE_DISC
from emclutch.results.errors import OutputError
from emclutch.results.report.render import Reported
from emclutch.results.report.report import Report, Statement
from emclutch.results.report.run_report import run_report
from emclutch.results.report.verdict import verdict
from emclutch.results.run_folder import RunFolder
from emclutch.results.statistics import Estimate
from emclutch.results.steady_stress import steady_stress
from emclutch.results.steady_torque import SteadyConditions, steady_torque

if TYPE_CHECKING:
    import pandas

    from emclutch.results.record import Record


class Result(Reported):
    """The results of a run. `run` and `load_result` return it; files are read when they are first needed.

    Parameters
    ----------
    folder : RunFolder
        Folder of the run; ``folder.path`` is its path.
    summary : dict
        Content of ``summary.json`` where it is not written yet.
    """

    def __init__(self, folder: RunFolder, summary: dict[str, Any] | None = None) -> None:
        self.folder = folder
        if summary is not None:
            self.summary = summary
        self._history: pandas.DataFrame | None = None
        self._torque: Estimate | None = None

    @property
    def history(self) -> pandas.DataFrame:
        """Table of the coupling windows, a row each, values in SI; `emclutch.results.COLUMNS` has all columns.

        Raises
        ------
        OutputError
            The run has no window yet.
        """
        if self._history is None:
            history = self.folder.read_history()
            if not len(history):
                failed = self.folder.read_failure()
                resume = f"continue with: emclutch run {self.folder.path} --resume"
                how = resume if failed is None else failed.in_words()
                raise OutputError(f"{self.folder.history} has no window yet; {how}")
            self._history = history
        return self._history

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``, values in SI; empty where the run ended before it was written."""
        return self.folder.read_summary()

    @property
    def stopped(self) -> str | None:
        """Why the run ended before the end of its scene (a callback), and when; None where it did not."""
        return self.summary.get("stopped")

    @property
    def torque(self) -> Estimate:
        """Raw torque on the disc [N m], mean over the steady part of all replicas, with its interval.

        It is that of the summary. Of a run without one it is computed from the history so far.

        Raises
        ------
        OutputError
            The scene has no disc, or the run no window yet.
        """
        written = self.summary.get("torque")
        if self._torque is None and written is not None:
            self._torque = Estimate.from_dict(written)
        if self._torque is None:
            history = self.history
            if TORQUE_DISC not in history:
                raise OutputError(f"{self.folder.history} has no torque_disc: the scene has no disc")
            self._torque = steady_torque(history, self.conditions, self.other_histories)
        return self._torque

    @property
    def stress(self) -> Estimate:
        """Shear stress [Pa] of a sheared periodic box, mean and interval as of `torque`.

        Raises
        ------
        OutputError
            The scene is no sheared box, or the run has no window yet.
        """
        written = self.summary.get("stress")
        if written is not None:
            return Estimate.from_dict(written)
        if SHEAR_STRESS not in self.history:
            raise OutputError(f"{self.folder.history} has no shear_stress: the scene is no sheared box")
        return steady_stress((self.history, *self.other_histories), self.conditions).shear

    @property
    def steady(self) -> Estimate | None:
        """`stress` of a sheared periodic box, else `torque`; None where the scene has neither."""
        if SHEAR_STRESS in self.history:
            return self.stress
        return self.torque if TORQUE_DISC in self.history else None

    @property
    def best(self) -> Estimate:
        """Best estimate of the torque [N m]: `torque` corrected for the error of the numerical settings.

        Its interval contains what is left of that error. It is the raw torque where the error of the settings is not
        known, and the stress [Pa] in a sheared box. Raises as `torque` and `stress` do.
        """
        return self.stress if SHEAR_STRESS in self.history else best_estimate(self.torque, self.summary)

    @property
    def other_histories(self) -> list[pandas.DataFrame]:
        """Histories of the other replicas so far, tables as `history`."""
        folders = (RunFolder(path) for path in self.folder.replica_folders())
        found = [folder.read_history() for folder in folders if folder.history.is_file()]
        return [history for history in found if len(history)]

    @property
    def conditions(self) -> SteadyConditions:
        """The scene's part of the verdict, from ``plan.json``; of a folder without one, what the scene itself says."""
        plan = self.folder.read_plan()
        if "steady_torque" in plan:
            return SteadyConditions.from_dict(plan["steady_torque"])
        scene = self.folder.read_scene() if self.folder.case.is_file() else {}
        return SteadyConditions(average_from=scene.get("time", {}).get("average_from"))

    @property
    def verdict(self) -> list[Statement]:
        """Statements that `emclutch run` prints at its end: best estimate, what it leaves out, raw torque, balances.

        Each has a `mark` (good, note, warning or unusable) and a `text`.

        Raises
        ------
        OutputError
            The run has no window yet.
        """
        return verdict(self)

    def report(self) -> Report:
        """Return the report on the run. Raises OutputError where the run has no window yet."""
        return run_report(self)

    def open_record(self) -> Record:
        """Open the HDF5 record (``run.h5``) for reading; use it in a ``with`` block."""
        from emclutch.results.record import Record

        return Record.open(self.folder.record)

    def __repr__(self) -> str:
        return f"Result({str(self.folder.path)!r})"


def load_result(folder: str | Path) -> Result:
    """Read the run in a folder.

    Raises
    ------
    OutputError
        The folder is that of no run, or its run failed before its first window; the message says why.
    """
    run = RunFolder(folder)
    if not run.history.is_file():
        if Path(folder).is_file():
            parent = Path(folder).parent
            remedy = f"give its folder, {parent}" if RunFolder(parent).history.is_file() else "name the folder of a run"
            raise OutputError(f"{folder} is a file; {remedy}")
        if (failed := run.read_failure()) is not None:
            raise OutputError(f"{folder}: {failed.in_words()}")
        if (Path(folder) / "study.csv").is_file():
            raise OutputError(f"{folder} is a study; read it with emclutch.load_study, or name the folder of a point")
        if (Path(folder) / "map.json").is_file():
            how = "emclutch map CASE --current A:B --with TABLE lays a measured table over it"
            raise OutputError(f"{folder} is a torque map, with its picture map.png, no run; {how}")
        if run.is_begun() and (run.provenance.is_file() or not [*Path(folder).glob("*plan.json")]):  # that of a study
            how = f"continue it with emclutch run {folder} --resume"
            raise OutputError(f"{folder}: the run ended before its first window, or is still in it; if it ended, {how}")
        what = f"has no {run.history.name}" if Path(folder).exists() else "is not there"
        raise OutputError(f"{folder} {what}; name the folder of a run, or of a study with a point that is done")
    return Result(run)
