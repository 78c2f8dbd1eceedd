"""A study whose processes are killed at random moments, 150 times: no point is lost, and its tables are the same.

``python tests/hard/study_kills.py`` takes five minutes. The runs are stubs that go on step by step, with a checkpoint
after each; everything else is the program's. Killed is a child process, the call alone, or all of it; now and then a
second call is at a point of its own beside the first, as of a job array.
"""

import os
import random
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import pandas
import psutil

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.studies import point
from emclutch.studies.sweep import sweep

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
KILLS, POINTS, STEPS, PAUSE = 150, 200, 20, 1.0  # steps of a point; longest time between two kills [s]
SECONDS = "STUDY_KILLS_SECONDS"  # least time of a step; only processes of the disturbed study have it
run_point = point.run_point


def stub(case, *, out, resume, **_):
    folder, state = RunFolder.create(out, case.toml(), resume=resume), case.scene.contact.friction
    with (folder.path / "begun.txt").open("a") as file:
        file.write("x")
    first, state = read_checkpoint(folder.checkpoint)["known"] if resume else (0, state)
    with HistoryWriter(folder.history, resume_time=1e-3 * first if resume else None) as history:
        for step in range(first + 1, STEPS + 1):
            time.sleep(random.uniform(1.0, 2.5) * float(os.environ.get(SECONDS, 0.0)))
            state = 3.9 * state * (1.0 - state)
            history.append({"time": 1e-3 * step, "torque_disc": state})
            write_checkpoint(folder.checkpoint, {"known": (step, state)})
    torque = {"mean": state, "standard_error": 0.1, "converged": True, "reason": ""}
    folder.write_summary({"torque": torque, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}})
    return load_result(folder.path)


def run_stub(*task):
    point.run, point.draw_missing = stub, lambda *_: False
    return run_point(*task)


def begin(study, out, *option):
    words = [sys.executable, __file__, str(study), str(out), *map(str, option)]
    with (out.parent / "said.log").open("a") as said:
        return psutil.Popen(words, env=os.environ | {SECONDS: "0.02"}, stdin=subprocess.DEVNULL, stderr=said)


def disturb(study, out, chance):
    main, others, kills = begin(study, out, "jobs", 4), [], 0
    while kills < KILLS:
        time.sleep(chance.uniform(0.0, PAUSE))
        if main.poll() is not None:
            main = begin(study, out, "jobs", 4)
        with suppress(psutil.NoSuchProcess):
            at_work = [child for child in main.children() if any("history" in one.path for one in child.open_files())]
            if not at_work:
                continue  # a process takes longer to begin than to be killed
            if chance.random() < 0.1:
                others.append(begin(study, out, "point", chance.randrange(POINTS)))
            others, draw = [other for other in others if other.poll() is None], chance.random()
            alone = main if draw < 0.1 else chance.choice(at_work + others)
            for victim in [main, *main.children(), *others] if draw < 0.05 else [alone]:
                victim.kill()
            kills += 1
    for process in (main, *others):
        if process.poll() is None:
            process.kill()
            process.wait()


def main(folder):
    began = time.monotonic()
    study, out, alone = (folder / name for name in ("study.toml", "out", "alone"))
    values = [round(0.1 + 0.8 * one / POINTS, 6) for one in range(POINTS)]
    study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = {values}\n')
    sweep(study, out=alone)
    disturb(study, out, random.Random(1))
    left = POINTS - sum('"done"' in path.read_text() for path in out.glob("*/row.json"))
    assert begin(study, out, "jobs", 4).wait() == 0, (folder / "said.log").read_text()[-4000:]
    for name in ("study.csv", "study.json"):
        assert (out / name).read_bytes() == (alone / name).read_bytes(), name
    time.sleep(5.0)
    assert not (out / "attempts").exists()
    assert not [one.pid for one in psutil.process_iter(["environ"]) if SECONDS in (one.info["environ"] or {})]
    names = pandas.read_csv(out / "study.csv")["folder"]
    twice = sum(sum(path.stat().st_size for path in out.glob(f"{name}*/begun.txt")) > 1 for name in names)
    words = f"{KILLS} kills; {POINTS} points, {POINTS - len(names)} lost, {twice} begun more than once, {left} left to"
    print(f"{words} the last call; {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    import study_kills  # by whose name children find it

    point.run_point = study_kills.run_stub
    if len(sys.argv) == 1:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
    else:
        sweep(sys.argv[1], out=sys.argv[2], resume=Path(sys.argv[2]).is_dir(), **{sys.argv[3]: int(sys.argv[4])})
