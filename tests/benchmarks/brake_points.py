"""Points of the size of grains, the speed and the band of a clutch: a line for each run of it.

    python tests/benchmarks/brake_points.py RUN... [--from 3] > tests/benchmarks/brake_points.csv

Each folder is a run of one replica at constant speeds and current. The torque is the mean of both shafts' torques, by
time, from a shear strain on (`--from`) to the end; its standard error is that of the means of batches of a strain of
0.6, four of them at the least, and leaves out the scatter between replicas. `drift` is the mean of the second half of
the stretch over that of the first, less 1. The inertial number is the expected one, of the magnetic pressure. Columns
are those of tests/benchmarks/brake_band.py, and what each run was.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

import emclutch
from emclutch.device_model.device import build_device
from emclutch.simulation.plan import make_plan

STRAIN = 0.6  # of a batch


def point(folder: Path, first: float) -> dict[str, object]:
    """Return the line of a run, averaged from a shear strain on."""
    case = emclutch.load_case(folder / "case.toml")
    result = emclutch.load_result(folder)
    device, scene, history = build_device(case.scene), case.scene, result.history
    duration = np.diff(history["time"], prepend=0.0)
    slip = (history["rotor_speed"] - history["disc_speed"]).abs().to_numpy()
    strain = np.cumsum(duration * slip) * device.shear_radius / device.shear_gap
    late = strain >= first
    torque = 0.5 * (history["torque_disc"] - history["torque_rotor"]).to_numpy()[late]
    weight, covered = duration[late], strain[-1] - first
    if covered < 4 * STRAIN:
        raise SystemExit(f"{folder} has a shear strain of {strain[-1]:.3g}, less than {first + 4 * STRAIN:g}")
    batches = np.array_split(np.arange(len(torque)), int(covered / STRAIN))
    means = np.array([np.average(torque[one], weights=weight[one]) for one in batches])
    halves = [np.average(torque[one], weights=weight[one]) for one in np.array_split(np.arange(len(torque)), 2)]
    _, plan = make_plan(case.with_values({"accuracy.inertial_number": 0.05}), device)
    rolling = scene.effects.rolling_friction
    return {
        "run": folder.name,
        "friction": scene.contact.friction,
        "rolling_friction": 0.0 if rolling is None else rolling.coefficient,
        "fill": f"{device.fill.mass:.6g}",
        "across": f"{device.shear_gap / scene.grains.mean_diameter:.4g}",
        "current": scene.coil.current.largest,
        "torque": f"{np.average(torque, weights=weight):.4g}",
        "standard_error": f"{means.std(ddof=1) / np.sqrt(len(means)):.2g}",
        "drift": f"{halves[1] / halves[0] - 1.0:.3f}",
        "from_strain": f"{first:g}",
        "to_strain": f"{strain[-1]:.3g}",
        "inertial_number": f"{plan.scaled.own:.2g}",
        "grains": result.summary["grains"],
        "sectors": scene.grains.n_sectors,
        "seed": scene.scene.seed,
        "field_strength": f"{result.summary['field_strength_powder']:.4g}",
        "processor_seconds": f"{result.summary['seconds']['total']:.0f}",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--from", dest="first", type=float, default=3.0, help="shear strain from which is averaged")
    given = parser.parse_args()
    rows = [point(folder, given.first) for folder in given.runs]
    writer = csv.DictWriter(sys.stdout, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


if __name__ == "__main__":
    main()
