"""A study of three points, the commands that run it as processes of their own, and what they leave."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pandas
from killed_run import differences, record_of

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "cases" / "thesis" / "centrifugal_held.toml"
FRICTION = "contact.friction"
STUDY = f"""
[study]
case = "scene.toml"

[study.set]
"particles.count" = 8
"time.end" = "1.4 s"
"time.window" = "2 ms"
"output.snapshots" = 3
"output.pictures" = false
"output.formats" = ["hdf5"]
"accuracy.replicas" = 1
"motion.rotor.speed" = "500 rpm"
"contact.stiffness" = "12 MN/m"

[study.values]
"{FRICTION}" = [0.3, 0.33, 0.36]
"""
FATAL = 0.33
MIDDLE = 20_000  # bytes of a history of 300 000
NOT_OF_THE_POINT = ("seconds", "figure_of_merit", "folder")
WAIT = 200.0  # s; a test that needs it has failed
SITE = f'''"""Python reads this file first. It does what the variables of the environment ask for."""
import contextlib, errno, fcntl, glob, os, signal, socket, sys, time

fatal, unlocked, node = (os.environ.get(f"EMCLUTCH_TEST_{{name}}") for name in ("FATAL", "UNLOCKED", "NODE"))


def end_where_fatal(event, arguments):
    """The process kills itself where it is to write the history of that point, once another one could suffer."""
    if event == "open" and "history.csv" in str(arguments[0]) and arguments[2] & (os.O_WRONLY | os.O_RDWR):
        folder, last = os.path.dirname(arguments[0]), time.monotonic() + 30.0
        with open(os.path.join(folder, "case.toml")) as case:
            is_fatal = fatal in case.read()
        while is_fatal:
            if time.monotonic() > last or others_could_suffer(folder):
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(0.01)


def others_could_suffer(folder):
    """True if another point is in the first half of its run, or both are done."""
    while not os.path.exists(folder + "/study.log"):
        folder = os.path.dirname(folder)
    done = glob.glob(folder + "/**/summary.json", recursive=True)
    sizes = []
    for path in glob.glob(folder + "/**/history.csv", recursive=True):
        with contextlib.suppress(FileNotFoundError):  # it was moved
            sizes.append(os.path.getsize(path))
    return len(done) == 2 or any({MIDDLE} < size < 140000 for size in sizes)


def refusing(lock):
    def refuse(file, *arguments):
        number = file if isinstance(file, int) else file.fileno()
        if os.readlink(f"/proc/self/fd/{{number}}").startswith(unlocked):
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))
        return lock(file, *arguments)

    return refuse


if fatal:
    sys.addaudithook(end_where_fatal)
if unlocked:  # a folder
    fcntl.flock, fcntl.lockf = refusing(fcntl.flock), refusing(fcntl.lockf)
if node:
    own = os.uname()
    os.uname = lambda: os.uname_result((own[0], node, *own[2:]))
    socket.gethostname = lambda: node
'''


def study_in(folder: Path) -> Path:
    """The study's file, with a scene of its own beside it."""
    (folder / "scene.toml").write_text(SCENE.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return folder / "study.toml"


def until(condition: Callable[[], Any]) -> Any:
    """Wait until a condition holds, and return its value."""
    last = time.monotonic() + WAIT
    while not (value := condition()):
        assert time.monotonic() < last, "waited in vain"
        time.sleep(0.02)
    return value


class Command:
    """A process. It and all that it begins, children or not, have a mark in their environment.

    Parameters
    ----------
    folder : for what it says.
    words : Python module and arguments.
    environment : variables; those of `SITE` without what all of them begin with.
    """

    def __init__(self, folder: Path, *words: str, **environment: str) -> None:
        name, site = uuid.uuid4().hex, folder / "site"
        site.mkdir(exist_ok=True)
        (site / "sitecustomize.py").write_text(SITE, encoding="utf-8")
        self._said, self._mark, self._began = folder / f"{name}.log", f"EMCLUTCH_TEST_MARK={name}", time.time()
        asked = {key if "_" in key else f"EMCLUTCH_TEST_{key}": value for key, value in environment.items()}
        path = os.pathsep.join([str(site), str(ROOT)])
        with self._said.open("wb") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *words], stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd=folder,
                env={**os.environ, "PYTHONPATH": path, "EMCLUTCH_TEST_MARK": name, **asked},
            )  # fmt: skip

    @property
    def said(self) -> str:
        return self._said.read_text(encoding="utf-8")

    def processes(self) -> list[Path]:
        """In ``/proc``: those that live."""

        def is_marked(process: Path) -> bool:
            with suppress(OSError):
                return self._mark.encode() in (process / "environ").read_bytes().split(b"\0")
            return False

        return [process for process in Path("/proc").glob("[0-9]*") if is_marked(process)]

    def send(self, number: int) -> None:
        """Send a signal to all processes."""
        for process in self.processes():
            with suppress(ProcessLookupError):
                os.kill(int(process.name), number)

    def kill(self, alone: bool = False) -> None:
        """End all processes at once; or the first one alone, which leaves the others to themselves."""
        self.process.kill()
        while not alone and self.processes():
            self.send(signal.SIGKILL)
            time.sleep(0.02)
        self.process.wait()

    def until_in_the_middle(self, out: Path) -> None:
        """Wait until a point of a study has begun since this command has, and has come some way."""

        def is_begun(history: Path) -> bool:
            with suppress(FileNotFoundError):  # it was moved
                file = history.stat()
                is_done = history.with_name("summary.json").exists()
                return file.st_size > MIDDLE and file.st_mtime > self._began and not is_done
            return False

        def look() -> bool:
            assert self.process.poll() is None, self.said
            return any(is_begun(history) for history in out.rglob("history.csv"))

        until(look)

    def until_at_rest(self) -> None:
        """Wait until its processes, if they live, do nothing for a second."""

        def seconds() -> float:
            ticks = 0
            for process in self.processes():
                with suppress(OSError):
                    ticks += sum(map(int, (process / "stat").read_text().rpartition(")")[2].split()[11:13]))
            return ticks / os.sysconf("SC_CLK_TCK")

        def look() -> bool:
            before = seconds()
            time.sleep(1.0)
            return seconds() - before < 0.2

        until(look)

    def code(self) -> int:
        """Wait for its end; its code."""
        try:
            return self.process.wait(WAIT)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"it does not end; it has said:\n{self.said[-2000:]}") from None


class Commands:
    """Begins processes, and ends all of them at last."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._begun = folder, []

    def sweep(self, study: Path, out: Path, *options: str, **environment: str) -> Command:
        return self._begin("emclutch.cli.main", "sweep", str(study), "--out", str(out), *options, **environment)

    def scheduler(self, **environment: str) -> tuple[Command, str]:
        """A scheduler that gives up workers which it has not heard of for ten seconds, and its address."""
        file = self._folder / f"{uuid.uuid4().hex}.json"
        words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        environment["DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL"] = "10 s"
        command = self._begin("distributed.cli.dask_scheduler", *words, **environment)

        def address() -> str | None:
            with suppress(OSError, ValueError):  # the file is not there, or not yet whole
                return json.loads(file.read_text())["address"]

        return command, until(address)

    def worker(self, address: str, **environment: str) -> Command:
        words = [address, "--no-nanny", "--no-dashboard", "--nthreads", "1", "--local-directory", str(self._folder)]
        return self._begin("distributed.cli.dask_worker", *words, **environment)

    def end(self) -> None:
        for command in self._begun:
            command.kill()

    def _begin(self, *words: str, **environment: str) -> Command:
        self._begun.append(Command(self._folder, *words, **environment))
        return self._begun[-1]


def points_of(out: Path) -> dict[str, Any]:
    """What a study's table has of each point, and what lies in its folder, to the last bit and without clocks."""
    if not (out / "study.csv").is_file():
        return {}
    table = pandas.read_csv(out / "study.csv", dtype=str, keep_default_na=False)
    assert table[FRICTION].is_unique
    found: dict[str, Any] = {}
    for row in table.to_dict("records"):
        record = record_of(out / row["folder"])
        assert len(record) > 50
        record |= {f"table: {key}": text for key, text in row.items() if key not in NOT_OF_THE_POINT}
        found |= {f"{row[FRICTION]}: {name}": value for name, value in record.items()}
    return found


def failures(out: Path) -> list[tuple[float, str]]:
    """Friction and reason of the points that have failed."""
    if not (out / "failures.csv").is_file():
        return []
    table = pandas.read_csv(out / "failures.csv")
    return list(zip(table[FRICTION], table["reason"], strict=True))


def off(out: Path, whole: dict[str, Any]) -> list[str]:
    """Names of what is not the same in a study's folder and in a whole study, and reasons of what has failed there."""
    return differences(points_of(out), whole) + [reason for _, reason in failures(out)]
