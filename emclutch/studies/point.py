"""A point of a study: a run in a folder with a readable name, as ``003_current=0.8A_7f3a9c01d2``.

The name has the point's number, its values, and a digest of its scene without what a continued run may change, as its
end. By the digest a point is found again where values are inserted, removed, put in another order or written in another
unit, and keeps its name; one whose scene has changed gets a folder of its own.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import shutil
from collections.abc import Collection, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder, load_result
from emclutch.results.atomic_file import json_values
from emclutch.results.columns import TIME
from emclutch.results.history import last_time, whole_rows
from emclutch.results.run_end import seconds_of
from emclutch.results.run_folder import next_aside
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat, flat_scene
from emclutch.scene.input_files import file_contents
from emclutch.scene.replica_count import replica_count
from emclutch.scene.study import StudySection
from emclutch.scene.timing import instant_in_words
from emclutch.simulation.pictures import draw_missing
from emclutch.simulation.resume import may_change
from emclutch.simulation.run import run
from emclutch.simulation.threads import threads_of_a_process
from emclutch.studies.accuracy.target import cases_of
from emclutch.studies.attempt import attempts_in
from emclutch.studies.study import DONE, FAILED, FILES, Row, Task, TaskProgress
from emclutch.studies.tables import row_of

log = logging.getLogger(__name__)
SUMMARY = "summary.json"
DIGITS, LONGEST = 10, 80
"""Of the digest in a name, hexadecimal, and characters of the values there."""


def tasks_of(
    study: StudySection,
    folder: Path,
    numbers: Sequence[int] | None = None,
    *,
    progress: Any = None,
    measure: bool = False,
    **options: Any,
) -> list[Task]:
    """Return the points of a study as tasks, those that are there under their names.

    Parameters
    ----------
    study : StudySection
    folder : Path
        Of its results.
    numbers : sequence of int
        Of the points that are wanted, from 0; default: all.
    progress, measure : as of `emclutch.studies.accuracy.target.cases_of`.
    options : of `run_point`, the same for all points.

    Points of one scene are one task.
    """
    before = study.predecessors()
    asked_for = range(len(before)) if numbers is None else numbers
    wanted = sorted({*asked_for, *(first for n in asked_for if (first := before[n]) is not None)})
    there = {name.rpartition("_")[2]: name for name in names_in(folder)}
    short = _short_names([key for key, entries in study.values.items() if len(entries) > 1] or study.values)
    names: dict[int, str] = {}
    tasks = []
    asked = (case.scene.accuracy.target for _, case in study.cases(wanted))
    points = cases_of(study, progress, measure=measure, numbers=wanted)
    for number, target, (values, case) in zip(wanted, asked, points, strict=True):
        whole = flat(case.resolved()) | file_contents(case.scene)
        kept = {key: entry for key, entry in whole.items() if not may_change(key) or _is_in(key, study.values)}
        words = ",".join(f"{name}={_compact(values[key])}" for key, name in short.items() if _is_short(values[key]))
        digest = _digest(kept)[:DIGITS]
        parts = (f"{number:0{max(3, len(str(len(before) - 1)))}d}", words[:LONGEST], digest)
        names[number] = name = there.setdefault(digest, "_".join(filter(None, parts)))
        own = {"values": values, "target": target, **options}
        first = before[number]
        after = "" if first is None else names[first]
        tasks.append(Task(name, case, run_point, own, after, _digest(whole), SUMMARY))
    return [task for number, task in zip(wanted, tasks, strict=True) if number in asked_for]


def names_in(folder: Path) -> list[str]:
    """Return the names of the points that a study's folder has, begun ones among them."""
    with suppress(FileNotFoundError):
        return [*attempts_in(folder), *(path.name for path in folder.iterdir() if re.match(r"\d{3,}_", path.name))]
    return []


def run_point(task: Task, folder: Path, progress: TaskProgress) -> dict[str, Any]:
    """Run a point, or continue it from its checkpoint, and return its row of ``study.csv``.

    Options: `values` of the study's keys, `target` of accuracy that the settings were chosen for, `threads` of the
    kernels or None, `processes` of the study on this machine, `force`.
    """
    run_folder, options, case = RunFolder(folder), task.options, task.case
    end = None
    if not is_done(folder, case):
        if run_folder.summary.is_file() and not _has_summary(run_folder):
            run_folder.summary.rename(damaged := folder / f"damaged-{SUMMARY}")
            log.warning("%s: %s is damaged and kept as %s", task.name, SUMMARY, damaged.name)
        threads, processes = options.get("threads"), options.get("processes", 1)
        if threads is None and processes > 1:
            threads = threads_of_a_process(processes * replica_count(case.scene))
        start = _study_of(folder, task.name) / task.after if task.after else None
        run(
            case, out=folder, threads=threads, progress=progress, resume=_continues(task, folder), start=start,
            force=options.get("force", False), accuracy_target=options["target"],
        )  # fmt: skip
        end = case.scene.span.end
    else:
        try:
            if draw_missing(run_folder, case):
                log.info("%s had no pictures: they are drawn", task.name)
        except OutputError as error:  # its numbers are there: no reason to end the study
            log.warning("%s has no pictures, and they cannot be drawn: %s", task.name, error)
    return row_of(load_result(folder), task.name, end)


def is_done(folder: Path, case: Case) -> bool:
    """Return True if a folder holds a finished run of a case, or of one with an equivalent end.

    That is a later end, or an earlier one before which the torque was known as well as the scene requires
    (`time.until`).

    Raises
    ------
    OutputError
        The run has gone beyond the end that it is to have now: that cannot be taken back.
    """
    run_folder = RunFolder(folder)
    if not run_folder.case.is_file():
        return False
    old_text, text = run_folder.read_case(), case.toml()
    if old_text == text:
        return _has_summary(run_folder)
    old, new = flat_scene(old_text), flat_scene(text)
    keys = differing_keys(old, new)
    before, now = (seconds_of(one.get("time.end", 0.0), run_folder) for one in (old, new))
    is_later = before is not None and now is not None and before > now
    if _has_summary(run_folder) and (not keys or keys == ["time.end"]):
        if not keys or is_later:
            return True
        return run_folder.read_summary().get("until", {}).get("reached", False)
    if is_later and run_folder.checkpoint.is_file() and run_folder.history.is_file():
        times = run_folder.read_history()[TIME]
        if now is not None and len(times) and (reached := float(times.iloc[-1])) > now:
            raise OutputError(
                f"{folder} has run to {reached:.4g} s, and the study now ends at {now:g} s: its torque is the mean of "
                f"a longer run; set time.end to {before:g} s or later, or begin a new study with --out"
            )
    return False


def _has_summary(folder: RunFolder) -> bool:
    """True if the run has a summary that can be read: a damaged one is written again from the last checkpoint."""
    try:
        return bool(folder.read_summary())
    except OutputError:
        return False


def row_in(task: Task, folder: Path) -> Row | None:
    """Return the row of a point, also of one that was continued alone since; None where it has not ended.

    One whose files cannot be read has failed.
    """
    row = task.row(folder)
    try:
        if row is None and is_done(folder, task.case):
            return Row(DONE, json_values(row_of(load_result(folder), task.name)))
    except OutputError as error:
        return Row(FAILED, reason=str(error), kind=FILES)
    return row


def time_reached(task: Task, study: Path) -> float:
    """Return the simulated time [s] from which a point continues; infinity where it is done, 0 where it restarts."""
    folder = study / task.name
    row = row_in(task, folder)
    if row is not None and row.state == DONE:
        return inf
    if not folder.is_dir():
        folder = next(iter(attempts_in(study).get(task.name, [])), folder)
    return (last_time(folder / "history.csv") or 0.0) if RunFolder(folder).checkpoint.is_file() else 0.0


def _continues(task: Task, folder: Path) -> bool:
    """Return True if a point continues from its checkpoint; what lies in its folder without one is put aside."""
    if RunFolder(folder).checkpoint.is_file():
        log.info("%s continues from its checkpoint to %s", task.name, instant_in_words(task.case.scene.span.end))
        return True
    left = [*folder.iterdir()]
    if whole_rows(RunFolder(folder).history) > 0:
        aside = next_aside(_study_of(folder, task.name) / task.name)
        aside.mkdir()
        for path in left:
            path.rename(aside / path.name)
        log.warning("%s has no checkpoint to continue from: restarted, its files are kept as %s", task.name, aside.name)
    else:  # it was killed before the end of its first window
        for path in left:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        log.info("%s starts", task.name)
    return False


def _study_of(folder: Path, name: str) -> Path:
    """Return the folder of the study in which an attempt at a point lies."""
    return folder.resolve().parents[1 + name.count("/")]


def _short_names(values: Collection[str]) -> dict[str, str]:
    """Return the shortest ends of keys that tell them from each other."""
    found = {}
    for key in values:
        parts = key.split(".")
        ends = [".".join(parts[-n:]) for n in range(1, len(parts) + 1)]
        found[key] = next(end for end in ends if sum(f".{other}".endswith(f".{end}") for other in values) == 1)
    return found


def _is_short(value: Any) -> bool:
    return not isinstance(value, (dict, list))


def _compact(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return re.sub(r"[^A-Za-z0-9.+_-]", "", text)[:20]


def _digest(entries: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(entries, sort_keys=True, default=str).encode()).hexdigest()


def _is_in(key: str, tables: Collection[str]) -> bool:
    return any(key == table or key.startswith(f"{table}.") for table in tables)
