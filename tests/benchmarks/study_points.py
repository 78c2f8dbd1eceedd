"""What a study costs by its number of points: stub points of no work, in one process and in parts, then gathered.

    .venv/bin/python tests/benchmarks/study_points.py 100 1000 10000

For each number of points, of processor time in all: checking the study, its points in one process, loading its table,
as one object too, continuing it with all points done; the points in 4 parts, gathering them, and gathering again. With
it the peak memory of the process that gathers, its open files, and the files that the study itself has besides those of
its points. The table in docs/how_to/studies.md is made by this.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CASE = Path(__file__).parents[2] / "cases" / "quickstart.toml"
PARTS = 4
STEPS = ("read", "sweep", "load", "xarray", "resume", "parts", "gather", "gather again")


def stub(case, *, out, resume, **_):
    """Write the files of a finished run."""
    from emclutch.results import HistoryWriter, RunFolder, load_result

    folder = RunFolder.create(out, case.toml(), resume=resume)
    torque = case.scene.contact.friction
    with HistoryWriter(folder.history) as history:
        history.append({"time": 1e-3, "torque_disc": torque})
    found = {"mean": torque, "standard_error": 0.01, "converged": True, "reason": "", "replicas": 4}
    folder.write_summary({"torque": found, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}, "current": 1.0})
    return load_result(folder.path)


def step(name, study, folder):
    """Do one step in a process of its own, and print its processor time [s], peak memory [MiB] and open files."""
    from emclutch.results.study_result import load_study
    from emclutch.scene.study import read_study
    from emclutch.studies import tasks
    from emclutch.studies.gather import gather
    from emclutch.studies.sweep import sweep

    tasks.run = stub
    began = time.process_time()
    if name == "read":
        read_study(study)
    elif name in ("sweep", "resume"):
        sweep(study, out=folder / "one", resume=name == "resume")
    elif name == "load":
        load_study(folder / "one")
    elif name == "xarray":
        load_study(folder / "one").to_xarray()
    elif name.startswith("part "):
        sweep(study, out=folder / "parts", part=(int(name.split()[1]), PARTS), resume=True)
    else:
        assert gather(study, folder / "parts").complete
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(time.process_time() - began, peak, len(os.listdir("/proc/self/fd")) - 1)


def measure(points):
    """Print a row of the table."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        study = folder / "study.toml"
        study.write_text(
            f'[study]\ncase = "{CASE}"\n[study.values]\n'
            f'"contact.friction" = {{ from = 0.1, to = 0.6, count = {points // 10} }}\n'
            f'"scene.seed" = {[*range(1, 11)]}\n'
        )
        for name in STEPS:
            names = [f"part {number}" for number in range(1, PARTS + 1)] if name == "parts" else [name]
            rows = []
            for one in names:
                answer = subprocess.run(
                    [sys.executable, __file__, "--step", one, str(study), place],
                    check=True, capture_output=True, text=True,
                )  # fmt: skip
                rows.append([float(word) for word in answer.stdout.split()])
            (seconds, *_), (_, peak, opened) = map(sum, zip(*rows, strict=True)), map(max, zip(*rows, strict=True))
            cells = points, name, f"{seconds:.2f}", f"{1e3 * seconds / points:.2f}", f"{peak:.0f}", f"{opened:.0f}"
            print(f"| {' | '.join(map(str, cells))} |", flush=True)
        for name in ("one", "parts"):
            own = [path for path in (folder / name).rglob("*") if not any(p.startswith("point-") for p in path.parts)]
            print(f"{name}: {len(own)} files besides those of the points", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--step":
        step(sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4]))
    else:
        print("| points | step | processor time [s] | a point [ms] | peak memory [MiB] | open files |")
        print("|---|---|---|---|---|---|")
        for number in map(int, sys.argv[1:]):
            measure(number)
