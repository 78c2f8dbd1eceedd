"""A study of cheap points as an array of forty processes, some of them killed or started twice: the same tables.

``python tests/hard/study_parts.py [POINTS]`` prints what a point costs beside its run. The runs are stubs that write
the files of one; everything else is the program's: scenes, folders, leases, tables.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.checkpoint import write_checkpoint
from emclutch.results.errors import OutputError
from emclutch.results.folder_lock import locked_folder
from emclutch.scene.study import read_study
from emclutch.studies import sweep as study_sweep
from emclutch.studies import tasks
from emclutch.studies.gather import gather
from emclutch.studies.sweep import sweep

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
PARTS, KILLED, TWICE = 40, 10, 10
SECONDS = 0.02  # of a stub


def stub(case, *, out, resume, **_):
    """The files of a finished run, under its lock."""
    with locked_folder(out):
        folder = RunFolder.create(out, case.toml(), resume=resume)
        with HistoryWriter(folder.history) as history:
            history.append({"time": case.scene.time.end, "torque_disc": case.scene.contact.friction})
        time.sleep(SECONDS)
        with (folder.path / "runs.txt").open("a") as file:  # one line each time that it is run
            file.write(f"{os.getpid()}\n")
        write_checkpoint(folder.checkpoint, {})
        torque = {"mean": case.scene.contact.friction, "standard_error": 0.1, "converged": True, "reason": ""}
        folder.write_summary({"torque": torque, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}})
    return load_result(folder.path)


def killed_in_its_second(case, *, out, resume, **more):
    """The stub, and the second time half of it."""
    if killed_in_its_second.calls:
        with locked_folder(out):
            RunFolder.create(out, case.toml(), resume=resume)
            os.kill(os.getpid(), signal.SIGKILL)
    killed_in_its_second.calls += 1
    return stub(case, out=out, resume=resume, **more)


killed_in_its_second.calls = 0


def begin_part(study: Path, out: Path, which: int, dies: bool = False) -> int:
    """Fork a process that runs a part, and return its number; `dies`: killed in the middle of its second point."""
    if pid := os.fork():
        return pid
    if dies:
        tasks.run = killed_in_its_second
    code = 1
    with contextlib.suppress(OutputError):  # points that another process is at
        sweep(study, out=out, part=(which, PARTS), resume=True)
        code = 0
    os._exit(code)


def main(points: int) -> None:
    tasks.run = stub
    study_sweep.draw_missing = lambda *_: False
    chosen = random.Random(1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        study = folder / "study.toml"
        values = [round(0.1 + 0.8 * one / points, 6) for one in range(points)]
        study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = {values}\n')
        alone = folder / "alone"
        sweep(read_study(study, part=(1, PARTS)), out=folder / "first", part=(1, PARTS))  # imports what all forks need
        began = time.process_time()
        sweep(study, out=alone)
        one = time.process_time() - began
        out = folder / "array"
        killed = chosen.sample(range(1, PARTS + 1), KILLED)
        running = [begin_part(study, out, which, which in killed) for which in range(1, PARTS + 1)]
        running += [begin_part(study, out, which) for which in chosen.sample(range(1, PARTS + 1), TWICE)]
        codes = [os.waitpid(pid, 0)[1] for pid in running]
        print(f"{sum(code == 9 for code in codes)} killed; ", *gather(study, out).lines(), sep="\n")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        for pid in [begin_part(study, out, which) for which in range(1, PARTS + 1)]:
            assert os.waitpid(pid, 0)[1] == 0
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        again = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        began = time.process_time()
        found = gather(study, out)
        gathered = time.process_time() - began
        assert found.complete and found.done == points
        twice = [path.parent.name for path in out.glob("point-*/runs.txt") if len(path.read_text().split()) > 1]
        assert not twice, twice
        for name in ("study.csv", "study.json"):
            assert (out / name).read_bytes() == (alone / name).read_bytes(), name
        total = used.ru_utime + used.ru_stime
        print(
            f"{points} points in {PARTS} parts, all started twice: {1e3 * total / points:.0f} ms of processor time a "
            f"point ({1e3 * again / points:.0f} ms the second time), {1e3 * gathered / points:.0f} ms to gather one; "
            f"in one process {1e3 * one / points:.0f} ms; same tables"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
