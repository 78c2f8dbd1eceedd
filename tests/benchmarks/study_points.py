"""What a study costs by its number of points: stub points of no work, in one process, in parts, through dask.

    .venv/bin/python tests/benchmarks/study_points.py 100 1000 10000

For each number of points, of processor time in all: checking the study, its points in one process, loading its table,
as one object too, continuing it with all points done; the points in parts of at least 25, four at a time, 40 at most,
gathering them, and gathering again; the points on three workers of a dask scheduler (extra `dask`), and of that the
study's own process, and scheduler and workers with their children. With it the peak memory of the process, its open
files at the end, and how many files a point has, and the study besides. docs/how_to/studies.md
quotes it.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil

CASE = Path(__file__).parents[2] / "cases" / "quickstart.toml"
STEPS = ("read", "sweep", "load", "xarray", "resume", "parts", "gather", "gather again", "dask")


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


def run_stub(task, progress=None):
    """A stub point in the child of a worker."""
    from emclutch.studies import tasks

    tasks.run = stub
    return tasks.run_leased_point(task, progress)


def on_dask(study, folder):
    """Run the study on three workers, and return the processor time of the scheduler and of them [s]."""
    sys.path.append(str(Path(__file__).parent))  # where workers find it too
    import study_points
    from study_on_dask import Cluster

    from emclutch.studies import dask_executor, sweep

    sweep.run_leased_point = study_points.run_stub
    cluster = Cluster(folder, 8760)
    try:
        with dask_executor.DaskExecutor(cluster.address, timeout=300.0) as executor:
            sweep.sweep(study, out=folder / "dask", executor=executor)
        processes = [psutil.Process(one.pid) for one in (cluster.scheduler, *cluster.workers)]
        processes += [child for one in processes for child in one.children(recursive=True)]
        return sum(sum(one.cpu_times()[:2]) for one in processes)
    finally:
        cluster.close()


def step(name, study, folder):
    """Do one step in a process of its own, and print its processor time [s], peak memory [MiB] and open files."""
    elsewhere = 0.0
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
        sweep(study, out=folder / "parts", part=(int(name.split()[1]), int(name.split()[2])), resume=True)
    elif name == "dask":
        elsewhere = on_dask(study, folder)
    else:
        assert gather(study, folder / "parts").complete
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(time.process_time() - began, peak, len(os.listdir("/proc/self/fd")) - 1, elsewhere)


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
        parts = min(40, max(1, points // 25))
        for name in STEPS:
            names = [f"part {number} {parts}" for number in range(1, parts + 1)] if name == "parts" else [name]

            def answer(one, study=study, place=place):
                command = [sys.executable, __file__, "--step", one, str(study), place]
                done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
                return [float(word) for word in done.stdout.split()]

            with ThreadPoolExecutor(4) as at_a_time:
                rows = list(at_a_time.map(answer, names))
            (seconds, *_, elsewhere), (_, peak, opened, _) = map(sum, zip(*rows, strict=True)), map(
                max, zip(*rows, strict=True))  # fmt: skip
            words = f"{parts} parts" if name == "parts" else name
            for what, spent in ((words, seconds), ("dask, scheduler and workers", elsewhere))[: 1 + bool(elsewhere)]:
                cells = points, what, f"{spent:.2f}", f"{1e3 * spent / points:.2f}", f"{peak:.0f}", f"{opened:.0f}"
                print(f"| {' | '.join(map(str, cells))} |", flush=True)
        for name in ("one", "parts", "dask"):
            paths = [path.relative_to(folder / name) for path in (folder / name).rglob("*")]
            of_points = sum(path.parts[0].startswith("point-") for path in paths)
            print(f"{name}: {of_points / points:.1f} files and folders a point, and {len(paths) - of_points} besides")


if __name__ == "__main__":
    if sys.argv[1] == "--step":
        step(sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4]))
    else:
        print("| points | step | processor time [s] | a point [ms] | peak memory [MiB] | open files |")
        print("|---|---|---|---|---|---|")
        for number in map(int, sys.argv[1:]):
            measure(number)
