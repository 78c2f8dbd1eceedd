"""What a study costs by its number of points: stub points of no work, in one process, in four, through dask.

    .venv/bin/python tests/benchmarks/study_points.py 100 1000 10000

For each number of points, of processor time in all: checking the study, its points in one process, loading its table,
as one object too, continuing it with all points done, making its tables again; listing the commands of a job array; the
points four at a time in child processes, and on three workers of a dask scheduler (extra `dask`). Of the points in one
process the stubs' own time is given besides, of the others that of the study's own process and that of all processes
elsewhere, the stubs with it. With it the peak memory of the process, its open files at the end, and how many files a
point has, and the study besides. docs/how_to/studies.md quotes it.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import psutil

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.study_result import load_study
from emclutch.scene.study import read_study
from emclutch.studies import point
from emclutch.studies.sweep import collect, commands, sweep

ROOT = Path(__file__).parents[2]
CASE = ROOT / "cases" / "quickstart.toml"
STEPS = ("read", "sweep", "load", "xarray", "resume", "collect", "list", "jobs", "dask")
run_point = point.run_point
spent = []


def stub(case, *, out, resume, **_):
    """Write the files of a finished run."""
    began = time.process_time()
    folder = RunFolder.create(out, case.toml(), resume=resume)
    torque = case.scene.contact.friction
    with HistoryWriter(folder.history) as history:
        history.append({"time": 1e-3, "torque_disc": torque})
    found = {"mean": torque, "standard_error": 0.01, "converged": True, "reason": "", "replicas": 4}
    folder.write_summary({"torque": found, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}, "current": 1.0})
    spent.append(time.process_time() - began)
    return load_result(folder.path)


def run_stub(*task):
    """A stub point, also in the child of a worker."""
    point.run = stub
    return run_point(*task)


@contextmanager
def cluster(folder):
    """Yield the address of a scheduler with three workers."""
    address, processes = "tcp://127.0.0.1:8760", []

    def begin(what, *options):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options, "--no-dashboard"]
        with (folder / f"{what}.log").open("ab") as log:
            processes.append(subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": path}))

    path = os.pathsep.join([str(ROOT), str(Path(__file__).parent)])
    try:
        begin("scheduler", "--host", "127.0.0.1", "--port", "8760")
        for _ in range(3):
            begin("worker", address, "--no-nanny", "--nthreads", "1", "--local-directory", str(folder))
        yield address
    finally:
        for process in processes:
            process.kill()
            process.wait()


def below():
    """Processor time of all living processes below this one [s]."""
    return sum(sum(one.cpu_times()[:2]) for one in psutil.Process().children(recursive=True))


def step(name, study, folder):
    """Do one step in a process of its own; print times here and elsewhere [s], peak memory [MiB] and open files."""
    import study_points  # by whose name children find it

    point.run_point = study_points.run_stub
    elsewhere = 0.0
    began = time.process_time()
    if name == "read":
        read_study(study)
    elif name in ("sweep", "resume"):
        sweep(study, out=folder / "one", resume=name == "resume")
        elsewhere = sum(study_points.spent)
    elif name == "load":
        load_study(folder / "one")
    elif name == "xarray":
        load_study(folder / "one").to_xarray()
    elif name == "collect":
        assert collect(study, folder / "one").is_complete
    elif name == "list":
        assert commands(read_study(study), folder / "none")
    elif name == "jobs":
        sweep(study, out=folder / "jobs", jobs=4)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        elsewhere = used.ru_utime + used.ru_stime
    else:
        from emclutch.studies.dask_executor import dask_executor

        with cluster(folder) as address, dask_executor(address, timeout=300.0) as executor:
            sweep(study, out=folder / "dask", executor=executor)
            elsewhere = below()
    own = time.process_time() - began - (elsewhere if name == "sweep" else 0.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(own, elsewhere, f"{peak:.0f}", len(os.listdir("/proc/self/fd")) - 1)


def measure(points):
    """Print the rows of a number of points."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        study = folder / "study.toml"
        study.write_text(
            f'[study]\ncase = "{CASE}"\n[study.values]\n'
            f'"contact.friction" = {{ from = 0.1, to = 0.6, count = {points // 10} }}\n'
            f'"scene.seed" = {[*range(1, 11)]}\n'
        )
        for name in STEPS:
            command = [sys.executable, __file__, "--step", name, str(study), place]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            *seconds, peak, opened = done.stdout.split()
            other = "the stubs" if name == "sweep" else f"{name}, elsewhere"
            for what, one in zip((name, other), map(float, seconds), strict=True):
                if one > 0.0:
                    cells = points, what, f"{one:.2f}", f"{1e3 * one / points:.2f}", peak, opened
                    print(f"| {' | '.join(map(str, cells))} |", flush=True)
        for name in ("one", "jobs", "dask"):
            paths = [path.relative_to(folder / name) for path in (folder / name).rglob("*")]
            of_points = sum(path.parts[0][0].isdigit() for path in paths)
            print(f"{name}: {of_points / points:.1f} files and folders a point, and {len(paths) - of_points} besides")


if __name__ == "__main__":
    if sys.argv[1] == "--step":
        step(sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4]))
    else:
        print("| points | step | processor time [s] | a point [ms] | peak memory [MiB] | open files |")
        print("|---|---|---|---|---|---|")
        for number in map(int, sys.argv[1:]):
            measure(number)
