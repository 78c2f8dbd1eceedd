"""The folder of one run: which file lies where, and that none is overwritten by accident."""

from __future__ import annotations

import json
import logging
import os
import shutil
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.atomic_file import remove_unfinished, replace_json, replace_text
from emclutch.results.errors import OutputError
from emclutch.results.folder_lock import LOCK, has_files, locked_folder
from emclutch.results.history import last_time, read_history, whole_rows
from emclutch.results.provenance import provenance
from emclutch.results.text import format_time

if TYPE_CHECKING:
    import pandas

INDEX = "index.html"
LOGGERS = ("emclutch", "geometry", "field", "particles", "coupling")


RESTART_HINT = "the same scene fails there again: change it and start it again with another --out"


@dataclass(frozen=True, slots=True)
class Failure:
    """The error of its scene that ended a run; resumed, the run is the same bit for bit and fails again.

    Attributes
    ----------
    time : float or None
        End of its last window [s]; None: it had none.
    reason : str
        With the remedy.
    """

    time: float | None
    reason: str

    def in_words(self) -> str:
        """Time and reason, and that continuing does not help."""
        when = "before its first window" if self.time is None else f"after {format_time(self.time)}"
        return f"the run failed {when}: {self.reason.rstrip('.')}; {RESTART_HINT}"


class _File:
    """A file of a folder, by its name there."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, folder: RunFolder, owner: type) -> Path:
        return folder.path / self.name


class RunFolder:
    """Paths of a run's files, and what stands in them.

    ``RunFolder(path)`` names the files of an existing run; `create` makes the folder of a new one.

    Attributes
    ----------
    case : Path
        The resolved scene.
    provenance : Path
        Versions, commit, seed, mesh hash, threads, machine.
    history : Path
        One row a coupling window.
    index : Path
        The page of the conclusion, written when the run is done.
    failure : Path
        Why the run failed for its scene, where it did.
    plan : Path
        What was decided before the first window, as numbers and as words.
    record : Path
        Grains and observables.
    checkpoint : Path
        Complete state of the latest checkpoint.
    replicas : Path
        Folder of the other replicas; this run is the first one.
    particles, field, flux_lines, walls, contacts : Path
        For ParaView: grains, the field's cross-section, its flux lines, the walls that grains touch, and force chains
        in time. The numbered files of a series lie in a folder of its name.
    """

    case = _File("case.toml")
    provenance = _File("provenance.json")
    log = _File("run.log")
    history = _File("history.csv")
    summary = _File("summary.json")
    index = _File(INDEX)
    failure = _File("failure.json")
    plan = _File("plan.json")
    record = _File("run.h5")
    checkpoint = _File("checkpoint.h5")
    replicas = _File("replicas")
    mesh = _File("mesh.msh")
    particles = _File("particles.pvd")
    field = _File("field.pvd")
    flux_lines = _File("flux_lines.pvd")
    walls = _File("walls.pvd")
    contacts = _File("contacts.pvd")
    section_picture = _File("section.png")
    torque_picture = _File("torque.png")
    stress_picture = _File("stress.png")
    grains_picture = _File("grains.png")

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    @classmethod
    def create(cls, path: str | Path, case_toml_text: str, *, resume: bool = False) -> RunFolder:
        """Make the folder with its ``case.toml``, or open one to resume.

        On resuming with another scene text the old one is kept as ``case-1.toml``, ``case-2.toml``, …, and its summary
        and page as ``summary-1.json``, ``index-1.html``, …

        Raises
        ------
        OutputError : the folder holds files already and `resume` is False; there is nothing to resume;
            it cannot be written.
        """
        folder = cls(path)
        try:
            if folder.path.exists() and not folder.path.is_dir():
                raise OutputError(f"{folder.path} is a file; name a folder with --out")
            if resume:
                folder.has_checkpoint()
            if not resume and folder.path.is_dir() and has_files(folder.path):
                failed = folder.read_failure() is not None
                remedy = "continue it with --resume, or " if folder.is_begun() and not failed else ""
                remedy = "it has a run that failed: remove it, or " if failed else remedy
                raise OutputError(f"{folder.path} is not empty; {remedy}write elsewhere with --out")
            folder.path.mkdir(parents=True, exist_ok=True)
            for place in (folder.path, *(series.with_suffix("") for series in folder.series())):
                remove_unfinished(place)
            if folder.case.is_file() and folder.case.read_text(encoding="utf-8") != case_toml_text:
                number = 1
                while (older := folder.path / f"case-{number}.toml").exists():
                    number += 1
                for result in (folder.summary, folder.index):  # of the old scene: new ones come when the run ends
                    if result.is_file():
                        os.replace(result, result.with_stem(f"{result.stem}-{number}"))
                shutil.copy2(folder.case, older)  # there is a case.toml at every moment
            replace_text(folder.case, case_toml_text)
            folder.failure.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot write to {folder.path}: {error.strerror or error}; "
                "write elsewhere with --out, free disk space or fix the write permission"
            ) from error
        return folder

    def has_checkpoint(self) -> bool:
        """True if a run that is to be resumed has a checkpoint; if not, it was killed before.

        Such a run starts again in its folder: it has lost what was before the end of its first window, no more.

        Raises
        ------
        OutputError : there is nothing to resume.
        """
        if not self.is_begun():
            raise OutputError(
                f"nothing to resume in {self.path}: it has no {self.checkpoint.name}; "
                "start again without --resume, elsewhere with --out or after removing it"
            )
        return self.checkpoint.is_file()

    def is_begun(self) -> bool:
        """True if there is a run that can be resumed, without losing anything if it has no checkpoint."""
        done = any((self.path / f"{name}.json").is_file() for name in ("summary", "field", "transient", "map"))
        nothing_yet = self.case.is_file() and not done and whole_rows(self.history) <= 1
        return self.checkpoint.is_file() or nothing_yet

    def set_aside(self) -> Path:
        """Give the folder of a run that has no checkpoint another name, the next free one, and return that."""
        aside = next_aside(self.path)
        with locked_folder(self.path):  # nobody is at work in it
            os.rename(self.path, aside)
            (aside / LOCK).unlink()
        return aside

    def lacks_pictures(self) -> bool:
        """True if a run is done, was to draw pictures, lacks the last, and has the checkpoint to draw it of."""
        if not self.summary.is_file() or self.grains_picture.is_file() or not self.checkpoint.is_file():
            return False
        return bool(self.read_scene().get("output", {}).get("pictures", True))

    @staticmethod
    def next_path(case_stem: str, parent: str | Path = "runs") -> Path:
        """Return the first free ``runs/<case stem>-<nnn>`` after the highest number in use."""
        used = [0]
        if Path(parent).is_dir():
            for entry in Path(parent).iterdir():
                stem, _, number = entry.name.rpartition("-")
                if stem == case_stem and number.isdigit():
                    used.append(int(number))
        return Path(parent) / f"{case_stem}-{max(used) + 1:03d}"

    def replica_folders(self) -> list[Path]:
        """Return the folders of the other replicas that are there, in their order."""
        return sorted(self.replicas.glob("[0-9][0-9]")) if self.replicas.is_dir() else []

    def series(self) -> tuple[Path, ...]:
        """Return the files for ParaView."""
        return self.particles, self.field, self.flux_lines, self.walls, self.contacts

    def read_case(self) -> str:
        """Return ``case.toml``; OutputError where it cannot be read."""
        self.read_scene()
        return self.case.read_text(encoding="utf-8")

    def read_scene(self) -> dict[str, Any]:
        """Return the tables of ``case.toml``; OutputError where it cannot be read."""
        try:
            return tomllib.loads(self.case.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise OutputError(f"cannot read {self.case}: {error}; put it back, or start again with --out") from error

    def read_history(self) -> pandas.DataFrame:
        """Return ``history.csv``, see `emclutch.results.read_history`."""
        return read_history(self.history)

    def write_provenance(self, **known: Any) -> None:
        """Write ``provenance.json``; keywords as of `provenance.provenance`. A resumed run adds an entry.

        The first run's values stay at the top; later ones are listed under ``resumed``.
        """
        values = provenance(**known)
        if self.provenance.is_file():
            first = self.read_provenance()
            values = {**first, "resumed": [*first.get("resumed", []), values]}
        replace_json(self.provenance, values)

    def add_to_provenance(self, **known: Any) -> None:
        """Add entries to ``provenance.json``, or replace them."""
        replace_json(self.provenance, self.read_provenance() | known)

    def read_provenance(self) -> dict[str, Any]:
        """Return ``provenance.json``; empty where there is none.

        Raises
        ------
        OutputError : it is not what a run writes.
        """
        return _read_json(self.provenance)

    def grains_from(self) -> str | None:
        """Return the folder of the run whose grains this one began with; None where it packed its own."""
        return (self.read_provenance().get("grains_from") or {}).get("folder")

    def write_plan(self, values: dict[str, Any]) -> None:
        """Replace ``plan.json`` in one step."""
        replace_json(self.plan, values)

    def read_plan(self) -> dict[str, Any]:
        """Return ``plan.json``, or an empty dictionary where there is none; raises as `read_provenance`."""
        return _read_json(self.plan)

    def write_summary(self, values: dict[str, Any]) -> None:
        """Replace ``summary.json`` in one step; numbers that are not finite become null."""
        replace_json(self.summary, values)

    def read_summary(self) -> dict[str, Any]:
        """Return ``summary.json``, or an empty dictionary where there is none; raises as `read_provenance`."""
        return _read_json(self.summary)

    def write_failure(self, reason: str) -> None:
        """Write that the run fails for its scene, after the last window that it has; `read_failure` returns it."""
        with suppress(OSError):  # what it failed of is reported all the same
            replace_json(self.failure, asdict(Failure(last_time(self.history), reason)))

    def read_failure(self) -> Failure | None:
        """Failure of the run, None where it did not fail for its scene; raises as `read_provenance`."""
        found = _read_json(self.failure)
        return Failure(found.get("time"), str(found.get("reason", ""))) if found else None

    @contextmanager
    def logging(self, level: int = logging.INFO) -> Iterator[None]:
        """Append the messages of the five packages' loggers to ``run.log`` inside a ``with`` block."""
        with logging_to(self.log, LOGGERS, level):
            yield


def next_aside(folder: Path) -> Path:
    """Return the first free name ``FOLDER-set-aside-1``, ``-2``, ..."""
    number = 1
    while (aside := folder.with_name(f"{folder.name}-set-aside-{number}")).exists():
        number += 1
    return aside


def _read_json(path: Path) -> dict[str, Any]:
    """Return what `replace_json` wrote; empty where there is no file."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {path}: {error}; remove it, or start again with --out") from error
    if not isinstance(found, dict):
        raise OutputError(f"{path} is none that a run writes; remove it, or start again with --out")
    return found


class _Log(logging.FileHandler):
    """Log whose write errors are ignored: those who write results meet the same disk."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore the error."""

    def close(self) -> None:
        with suppress(OSError):
            super().close()


@contextmanager
def logging_to(path: Path, loggers: Iterable[str], level: int = logging.INFO) -> Iterator[None]:
    """Append the messages of some loggers to a file inside a ``with`` block."""
    handler = _Log(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    handler.setLevel(level)
    before = {}
    for name in loggers:
        logger = logging.getLogger(name)
        before[name] = logger.level
        logger.setLevel(min(level, logger.level) if logger.level else level)
        logger.addHandler(handler)
    try:
        yield
    finally:
        for name in loggers:
            logging.getLogger(name).removeHandler(handler)
            logging.getLogger(name).setLevel(before[name])
        handler.close()
