"""Threads and how they wait change no bit: `python tests/hard/threads.py FOLDER [CASE ...]`.

Every shipped case, shortened to a few windows, is run with 1, 2 and 4 threads that wait asleep, and with 2 and 4 that
spin (`OMP_WAIT_POLICY`), each time in a process of its own. All that a run leaves and no clock is in must be the same,
to the last bit (`killed_run.record_of`). Of a study it is the last point. More threads than the machine has cores are
slow, but right.

The table (case, windows, threads and policies that were compared, what differs, processor seconds) is printed, and
stored as FOLDER/threads.csv. Exit code 1: something differs.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from killed_run import LONGEST, ROOT, differences, record_of, table_of

import emclutch
from emclutch.scene.case import Case
from emclutch.simulation.plan import make_plan

CASES = ROOT / "cases"
REFERENCE = (1, "passive")
OTHERS = ((2, "passive"), (4, "passive"), (2, "active"), (4, "active"))
MAX_THREADS = max(threads for threads, _ in OTHERS)
WINDOWS = 3
QUIET = {"output.pictures": False, "output.snapshots": 1, "accuracy.replicas": 1, "time.average_from": None}


def shipped() -> list[Path]:
    """All cases that move grains but those that are there to break the program, which `stability.py` runs.

    A search of a design runs another case of these, as a study does.
    """
    there = (path for path in CASES.rglob("*.toml") if path.parent.name not in ("hard", "validation"))
    texts = {path: path.read_text(encoding="utf-8") for path in there}
    return sorted(path for path, text in texts.items() if "\n[particles]" in text or "[study]" in text)


def scene_of(path: Path) -> Case:
    """A case; of a study its last point."""
    if "[study]" in path.read_text(encoding="utf-8"):
        return list(emclutch.read_study(path).cases())[-1][1]
    return emclutch.load_case(path)


def shortened(path: Path) -> Case:
    """A case of a few of its own windows."""
    case = scene_of(path)
    plan = make_plan(case)[1]
    window = plan.division.length
    return case.with_values({**QUIET, "time.window": window, "time.end": WINDOWS * window, "time.until": None})


def run(scene: Path, folder: Path, threads: int, policy: str) -> dict[str, Any]:
    """What a run leaves, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": policy}
    environment["NUMBA_NUM_THREADS"] = str(MAX_THREADS)
    environment.pop("OMP_NUM_THREADS", None)
    command = [sys.executable, "-c", "from emclutch.cli.main import main; main()", "run", str(scene)]
    done = subprocess.run(
        [*command, "--out", str(folder), "--threads", str(threads)], env=environment, cwd=ROOT, text=True,
        capture_output=True, timeout=LONGEST, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise AssertionError(f"{scene} with {threads} threads ended with {done.returncode}:\n{done.stderr}")
    return record_of(folder)


def compared(path: Path, folder: Path) -> dict[str, Any]:
    """The row of the table."""
    begin = os.times()
    scene = folder / "scene.toml"
    case = shortened(path)
    scene.write_text(case.toml(), encoding="utf-8")
    run(scene, folder / "compiled", *REFERENCE)  # what is not in the cache: machine code of two compilations may differ
    reference = run(scene, folder / "reference", *REFERENCE)
    wrong = {
        f"{threads} {policy}: {name}"
        for threads, policy in OTHERS
        for name in differences(run(scene, folder / f"{threads}-{policy}", threads, policy), reference)
    }
    spent = [after - before for before, after in zip(begin, os.times(), strict=True)][:4]
    return {
        "case": str(path.relative_to(CASES)), "grains": make_plan(case)[1].count, "windows": WINDOWS,
        "compared": ", ".join(f"{threads} {policy}" for threads, policy in OTHERS), "parts": len(reference),
        "differ": len(wrong), "which": "; ".join(sorted(wrong)[:4]), "seconds": round(sum(spent)),
    }  # fmt: skip


def main(folder: Path, names: list[str]) -> int:
    """Compare the cases of those names, all if there is none; the exit code."""
    chosen = [path for path in shipped() if not names or path.stem in names]
    rows = table_of(chosen, compared, folder / "threads.csv")
    differ = sum(row["differ"] for row in rows)
    print(f"{len(rows)} cases with {len(OTHERS)} choices of threads each; {differ} parts of records differ")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
