"""Seconds predicted over seconds measured, of every shipped case.

    python tests/benchmarks/predicted_cost.py [CASE.toml ...] [--share 0.02]
    python tests/benchmarks/predicted_cost.py --runs FOLDER [FOLDER ...]

The first form runs a share of each case's windows (of a study those of its first and its last point) on one thread and
counts processor time, from the second window on: in the first one kernels are compiled. The prediction is that of the
same windows. A coil that is switched on later, or shot that falls first, needs a larger share, up to 1. The second form
reads finished runs, with the threads that they had and what else ran beside them.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numba

import coupling.window_budget
from coupling import run_staggered
from emclutch import Case, load_case, read_study
from emclutch.simulation.assembly import assemble
from emclutch.simulation.forecast.cost import predict
from emclutch.simulation.forecast.machine_speed import MachineSpeed, machine_speed
from emclutch.simulation.observables import Observables
from emclutch.simulation.plan import make_plan
from particles import ParticleError

CASES = Path(__file__).resolve().parents[2] / "cases"
PARTS = ("field", "magnetic", "contact")


def scenes(paths: list[Path]) -> Iterator[tuple[str, Case]]:
    """Name and case of every scene; of a study its first and its last point."""
    for path in paths:
        if "[study]" not in path.read_text(encoding="utf-8"):
            yield path.stem, load_case(path)
            continue
        points = list(read_study(path).cases())
        for values, case in (points[0], points[-1]):
            yield f"{path.stem} ({', '.join(map(str, values.values()))})", case


class Windows:
    """Callback that adds up the parts of windows 2 to `last`, and then stops the run."""

    def __init__(self, last: int) -> None:
        self.last, self.begin, self.end = last, 0.0, 0.0
        self.spent = dict.fromkeys(PARTS, 0.0)

    def __call__(self, simulation, row) -> bool:
        if simulation.window == 1:
            self.begin = row.time
        else:
            for part in PARTS:
                self.spent[part] += getattr(row.seconds, part) or 0.0
        self.end = row.time
        return simulation.window >= self.last


def measured(case: Case, share: float, machine: MachineSpeed) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds predicted and measured of the parts."""
    device, plan = make_plan(case)
    simulation = assemble(case, device, plan)
    windows = Windows(max(4, round(share * plan.windows)))
    run_staggered(simulation, plan.end, (windows,), (Observables(case.scene, device),))
    cost = predict(case.scene, device, plan.dt, (plan.steps_per_update, plan.updates, plan.windows), 1, machine)
    before, after = cost.until(windows.begin), cost.until(windows.end)
    return {part: after[part] - before[part] for part in PARTS}, windows.spent


def of_runs(folders: list[Path]) -> None:
    """The table of finished runs: wall-clock time."""
    print(f"{'run':40} {'predicted':>9} {'measured':>9} {'ratio':>6}")
    for folder in folders:
        seconds = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["seconds"]
        if "predicted" in seconds:
            predicted = seconds["predicted"]["total"]
            print(
                f"{folder.name:40} {predicted:9.1f} {seconds['whole_run']:9.1f} {predicted / seconds['whole_run']:6.2f}"
            )


def main() -> None:
    """One of the tables."""
    parser = argparse.ArgumentParser(description="seconds predicted over seconds measured")
    parser.add_argument("cases", type=Path, nargs="*")
    parser.add_argument("--share", type=float, default=0.02)
    parser.add_argument("--runs", type=Path, nargs="+", default=[])
    given = parser.parse_args()
    if given.runs:
        of_runs(given.runs)
        return
    numba.set_num_threads(1)
    coupling.window_budget.perf_counter = time.process_time  # other programs on the machine are not what is asked for
    speed = machine_speed()
    alone = MachineSpeed(speed.loops, speed.solves, speed.cores, 0.0)
    print(speed.in_words())
    print(f"{'case':44} {'predicted':>9} {'measured':>9} {'ratio':>6}   ratio of " + ", ".join(PARTS))
    for name, case in scenes(given.cases or sorted(CASES.rglob("*.toml"))):
        try:
            predicted, spent = measured(case, given.share, alone)
        except ParticleError as error:
            print(f"{name:44} {error}", flush=True)
            continue
        total, sure = sum(predicted.values()), sum(spent.values())
        each = "  ".join(f"{predicted[part] / spent[part]:5.2f}" if spent[part] else "    -" for part in PARTS)
        print(f"{name:44} {total:9.2f} {sure:9.2f} {total / sure:6.2f}   {each}", flush=True)


if __name__ == "__main__":
    main()
