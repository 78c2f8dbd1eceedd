"""Seconds estimated over seconds measured, of shipped cases at a short length.

    python tests/benchmarks/predicted_cost.py [NAME ...] [--most 30]

Each case runs on one thread to its end, or for so many seconds of processor time, in which it is measured from the
second window on: in the first one kernels are compiled. The first column of ratios is the estimate before the run for
the same windows, the second one the pace of the first hundredth of them, as `emclutch.simulation.pace` takes it.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numba

import coupling.window_budget
from coupling import run_staggered
from emclutch import Case, load_case
from emclutch.simulation.assembly import assemble
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.observables import Observables
from emclutch.simulation.pace import SHARES, WINDOWS
from emclutch.simulation.plan import make_plan

CASES = Path(__file__).resolve().parents[2] / "cases"
PARTS = ("field", "magnetic", "contact")
ONE = {"accuracy.replicas": 1, "time.until": None}
COARSE = {"particles.diameter": "0.3 mm", "particles.sector": "2 deg"}
BY_DVI = {"contact.method": "dvi", "particles.count": 200}
SHORT = {
    "quickstart": ("quickstart", ONE | {"time.end": "2 ms"}),
    "powder_clutch, 0.3 mm": ("powder_clutch", ONE | COARSE | {"time.end": "3 ms"}),
    "lock_up": ("lock_up", {"time.end": "8 ms"}),
    "switch_on": ("switch_on", {}),
    "centrifugal": ("thesis/centrifugal", {"time.end": "0.6 s"}),
    "centrifugal by DVI": ("thesis/centrifugal", BY_DVI | {"time.end": "1.4 s"}),
    "electromagnetic": ("thesis/electromagnetic", {"time.end": "50 ms"}),
    "electromagnetic by DVI": ("thesis/electromagnetic", BY_DVI | {"time.end": "0.2 s"}),
}
"""A shipped case and what is changed in it."""


class Clock:
    """Callback that keeps the seconds of each window from the second on, and stops the run after so many."""

    def __init__(self, most: float) -> None:
        self.most, self.begin, self.end = most, 0.0, 0.0
        self.seconds: list[dict[str, float]] = []

    def __call__(self, simulation, row) -> bool:
        if simulation.window == 1:
            self.begin = row.time
        else:
            self.seconds.append({part: getattr(row.seconds, part) or 0.0 for part in PARTS})
        self.end = row.time
        return sum(sum(one.values()) for one in self.seconds) > self.most


def ratios(case: Case, most: float) -> str:
    """Measure a case, and return its line of the table."""
    device, plan = make_plan(case, threads=1)
    simulation, clock = assemble(device, plan), Clock(most)
    run_staggered(simulation, plan.end, (clock,), (Observables(case.scene, device),))
    totals = [sum(one.values()) for one in clock.seconds]
    spent, share = sum(totals), (clock.end - clock.begin) / plan.end
    early = totals[: max(WINDOWS, round(SHARES[0] * len(totals)))]
    late = early[len(early) // 2 :]
    by_part = {part: sum(one[part] for one in clock.seconds) for part in PARTS}
    each = "  ".join(
        f"{share * plan.cost.loop[part] / by_part[part]:5.2f}" if by_part[part] else "    -" for part in PARTS
    )
    pace = sum(late) / len(late) * len(totals) / spent
    before = share * sum(plan.cost.loop.values())
    return f"{len(totals):7} {before:9.2f} {spent:9.2f} {before / spent:6.2f}   {each}   {pace:6.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="seconds estimated over seconds measured")
    parser.add_argument("names", nargs="*", default=list(SHORT))
    parser.add_argument("--most", type=float, default=30.0)
    given = parser.parse_args()
    numba.set_num_threads(1)
    coupling.window_budget.perf_counter = time.process_time  # other programs on the machine are not what is asked for
    print(f"this machine takes {slowness():.2g} times the reference's time")
    print(f"{'case':24} windows estimated  measured  ratio   ratio of {', '.join(PARTS)}   by pace")
    for name in given.names:
        path, changes = SHORT[name]
        print(f"{name:24} {ratios(load_case(CASES / f'{path}.toml').with_values(changes), given.most)}", flush=True)


if __name__ == "__main__":
    main()
