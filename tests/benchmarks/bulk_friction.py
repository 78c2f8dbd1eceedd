"""Measures the table of bulk friction that ships: tau/P of a dry powder against sliding and rolling friction.

    python tests/benchmarks/bulk_friction.py particles/bulk_friction/measured.csv [--seeds 2]

A line of the table is one run of `tests/benchmarks/steady_shear.py`, six seconds on one core; the whole takes ten
minutes with two seeds. Lines that are in the file already are kept and not run again: what was interrupted
goes on, and a seed more adds lines. `--check` prints instead how far the result moves with the number of
grains, the stiffness, the inertial number and the strain (another ten minutes).
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numba
from steady_shear import BulkFriction, SteadyShear, measure_bulk_friction

FRICTION = (0.5, 0.3, 0.7, 1.0, 0.2, 0.1)  # the middle first
ROLLING = (0.0, 0.1, 0.4, 1.0, 0.2, 0.05)
COLUMNS = (
    "friction", "rolling", "seed", "inertial_number", "strain", "bulk_friction", "error", "fill", "contacts", "overlap",
)  # fmt: skip
CHECKED = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.2), (0.7, 1.0))
VARIED = {
    "as the table": {},
    "twice the grains": {"count": 800},
    "twice the stiffness": {"stiffness": 1000.0},
    "twice the inertial number": {"inertial_number": 1e-2},
    "half of it": {"inertial_number": 2.5e-3},
    "a fifth of it": {"inertial_number": 1e-3},
    "twice the strain": {"strain": 4.0},
    "restitution 0.2": {"restitution": 0.2},
}


def line_of(shear: SteadyShear, found: BulkFriction) -> dict[str, object]:
    """Return a line of the table."""
    return {
        "friction": shear.friction, "rolling": shear.rolling, "seed": shear.seed,
        "inertial_number": shear.inertial_number, "strain": shear.strain,
        "bulk_friction": f"{found.mean:.5f}", "error": f"{found.error:.5f}", "fill": f"{found.fill:.4f}",
        "contacts": f"{found.contacts:.3f}", "overlap": f"{found.overlap:.4f}",
    }  # fmt: skip


def write_table(path: Path, seeds: int) -> None:
    """Run what is missing in the table; every line is written when it is known."""
    kept = set()
    if path.exists():
        with path.open(newline="") as file:
            rows = csv.DictReader(line for line in file if not line.startswith("#"))
            kept = {(float(row["friction"]), float(row["rolling"]), int(row["seed"])) for row in rows}
    else:
        p = SteadyShear(friction=0.0)
        head = (
            f"# Bulk friction tau/P by tests/benchmarks/steady_shear.py: {p.count} grains, k/(P d) {p.stiffness},\n"
            f"# restitution {p.restitution}, sizes +- {p.spread}; strain: averaged; error: of that mean. Made by\n"
            "# python tests/benchmarks/bulk_friction.py particles/bulk_friction/measured.csv\n"
        )
        path.write_text(head + ",".join(COLUMNS) + "\n")
    for seed in range(1, seeds + 1):
        # without sliding friction nothing makes a grain roll
        for friction, rolling in [(0.0, 0.0), *((a, b) for a in FRICTION for b in ROLLING)]:
            if (friction, rolling, seed) in kept:
                continue
            shear = SteadyShear(friction=friction, rolling=rolling, seed=seed)
            line = line_of(shear, measure_bulk_friction(shear))
            with path.open("a", newline="") as file:
                csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(line)
            print(",".join(str(entry) for entry in line.values()), flush=True)


def print_checks() -> None:
    """Print the result at other numbers of grains, stiffnesses, inertial numbers and strains."""
    for friction, rolling in CHECKED:
        for name, changed in VARIED.items():
            found = measure_bulk_friction(replace(SteadyShear(friction=friction, rolling=rolling), **changed))
            print(
                f"{friction} {rolling} {name}: {found.mean:.4f} +- {found.error:.4f}, sigma_zz/P {found.pressure:.4f}, "
                f"fill {found.fill:.4f}, contacts {found.contacts:.3f}, overlap {found.overlap:.4f}, "
                f"{found.steps} steps, {found.seconds:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path, nargs="?", help="the file (.csv)")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    numba.set_num_threads(1)
    if asked.check:
        print_checks()
    else:
        write_table(asked.table, asked.seeds)
