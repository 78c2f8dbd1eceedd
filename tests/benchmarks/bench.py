"""How fast is it? One table of the simulator's kinds of work beside their peers, in one sitting; `make bench`.

    python tests/benchmarks/bench.py [--only start dem dvi field moments step] [--rounds 1] [--sizes 1000 10000 100000]

Ten minutes on two idle cores, with compiled kernels; `--rounds 1` is a quick look. The peers, LAMMPS and NGSolve, come
with the extra `bench`; who is not here is said in the table. Each sitting is a line of JSON in `history.jsonl` beside
this file: date, versions, machine, load before and after, rows. Between sittings compare ratios, not times, and only of
idle machines.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the rows that run in this process

import bench_rows
from bench_rows import Row

from emclutch.scene.replica_count import cores_at_hand
from emclutch.simulation.forecast.machine_speed import slowness

HISTORY = Path(__file__).with_name("history.jsonl")
KINDS = ("start", "dem", "dvi", "field", "moments", "step")
PACKAGES = ("numpy", "scipy", "numba", "scikit-fem", "cvxopt", "ngsolve")
HEADER = (
    f"{'what':26} {'N':>7} {'threads':>7} {'clock':9} {'unit':22} {'emclutch':>8}  {'beside':24} {'theirs':>8} "
    f"{'faster':>7}"
)


def rows(kinds: list[str], rounds: int, sizes: tuple[int, ...]) -> Iterator[Row]:
    """The rows of the kinds asked for; Chrono's times are scaled by the row of LAMMPS before them."""
    lammps = None
    if "start" in kinds:
        yield from bench_rows.start_rows(rounds)
    if "dem" in kinds:
        for row in bench_rows.dem_rows(rounds, sizes):
            if (row.n, row.threads) == (1000, 1):
                lammps = row.theirs
            yield row
    if "dvi" in kinds:
        yield from bench_rows.dvi_rows(rounds, lammps)
    for kind, made in (
        ("field", bench_rows.field_rows),
        ("moments", bench_rows.moment_rows),
        ("step", bench_rows.step_rows),
    ):
        if kind in kinds:
            yield from made(rounds)


def sitting(rounds: int) -> dict:
    """What must be known of a sitting to read its rows later."""
    from scene_a_rounds import lammps_version

    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=HISTORY.parent, capture_output=True, text=True, check=False
    )
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit.stdout.strip(),
        "versions": {"python": platform.python_version(), "lammps": lammps_version()} | {
            name: _version(name) for name in PACKAGES
        },
        "machine": {"cpu": cpu_name(), "cores": cores_at_hand(), "slowness": slowness()},
        "rounds": rounds,
        "load_before": os.getloadavg()[0],
    }  # fmt: skip


def cpu_name() -> str:
    """Return the model of the processor, as the system names it."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def as_line(reported: dict, found: list[Row]) -> str:
    """A sitting and its rows as the line of the history."""
    names = ("what", "n", "threads", "clock", "unit", "ours", "peer", "theirs", "faster", "remark")
    table = [{name: getattr(row, name) for name in names} for row in found]
    return json.dumps(reported | {"load_after": os.getloadavg()[0], "rows": table})


def main() -> None:
    """The table, row by row, and the line of the history."""
    parser = argparse.ArgumentParser(description="one table of speeds beside the peers")
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--sizes", type=int, nargs="+", choices=tuple(bench_rows.WINDOWS), default=[1000, 10_000])
    parser.add_argument("--history", type=Path, default=HISTORY)
    given = parser.parse_args()
    import numba

    numba.set_num_threads(1)
    reported = sitting(given.rounds)
    machine, versions = reported["machine"], reported["versions"]
    peers = ", ".join(f"{name} {one}" for name, one in versions.items() if one is not None)
    print(f"{reported['date']}, {reported['commit']}; {peers}")
    print(f"{machine['cpu']}, {machine['cores']} cores, load {reported['load_before']:.1f}")
    print(HEADER, flush=True)
    found = []
    for row in rows(given.only, given.rounds, tuple(given.sizes)):
        print(row.in_words(), flush=True)
        found.append(row)
    with given.history.open("a", encoding="utf-8") as file:
        file.write(as_line(reported, found) + "\n")
    print(f"load now {os.getloadavg()[0]:.1f}; added to {given.history}")


if __name__ == "__main__":
    main()
