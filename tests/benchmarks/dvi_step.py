"""From which step on does the torque of a centrifugal clutch by DVI stop depending on the step?

The device of cases/thesis/centrifugal_held.toml with 500 spheres of 10 to 15 mm: its output is held, the motor turns at
750 rpm (9.4 m/s at the drum), by DEM with its own step, and by DVI with steps from the thesis' 1 ms, at which a sphere
moves by its diameter, down to a sixth of a contact time (58 us for two of the lightest). A run that stops says why.

    python tests/benchmarks/dvi_step.py [--count 500] [--rpm 750] [--picture docs/dvi_step.png]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import emclutch
from emclutch.results.errors import RunError

CASE = Path(__file__).parents[2] / "cases" / "thesis" / "centrifugal_held.toml"
STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 6e-5, 4e-5, 2e-5, 1e-5)
BEGIN, END = 0.7, 1.4  # of the average [s]
BATCHES = 7


def held_torque(folder: Path, count: int, rpm: float, changes: dict) -> tuple[float, float, float, float]:
    """Mean torque [N m] on the held drum, its standard error, the step [s], and processor time [s]."""
    speed = {"times": ["0 s", "0.2 s", "0.5 s"], "values": ["0 rpm", "0 rpm", f"{rpm} rpm"]}
    settings = {
        "particles.count": count, "motion.rotor.speed": speed, "time.end": END,
        "output.snapshots": 0, "output.checkpoint": False,
    }  # fmt: skip
    case = emclutch.load_case(CASE, settings | changes)
    began = time.process_time()
    result = emclutch.run(case, out=folder)
    spent = time.process_time() - began
    late = result.history[result.history["time"] > BEGIN]["torque_disc"].to_numpy()
    means = [part.mean() for part in np.array_split(late, BATCHES)]
    return float(np.mean(means)), float(np.std(means, ddof=1) / BATCHES**0.5), result.summary["dt"], spent


def draw(path: Path, dem: tuple, rows: list[tuple], stopped: list[float], title: str) -> None:
    """Torque against step: DVI with error bars, DEM's band, and where runs stop."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.0, 4.2), layout="constrained")
    torque, error, step, _ = dem
    axes.axhspan(0.95 * torque, 1.05 * torque, color="0.9", label="DEM ± 5 %")
    axes.errorbar([1e6 * step], [torque], [error], fmt="ks", label="DEM")
    axes.errorbar([1e6 * r[2] for r in rows], [r[0] for r in rows], [r[1] for r in rows], fmt="o-", label="DVI")
    for k, value in enumerate(stopped):
        axes.axvline(1e6 * value, color="C3", linestyle=":", label="DVI stops: overlap above 10 %" if k == 0 else None)
    axes.set_xscale("log")
    axes.set_ylim(0.0, 1.15 * max(torque, *(r[0] for r in rows)))
    axes.set_xlabel("time step [µs]")
    axes.set_ylabel("torque on the held output [N m]")
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=150)


def main() -> None:
    """The table and, if asked for, the picture."""
    parser = argparse.ArgumentParser(description="torque of a centrifugal clutch against the step of DVI")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--rpm", type=float, default=750.0)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    rows, stopped = [], []
    with tempfile.TemporaryDirectory() as place:
        dem = held_torque(Path(place) / "dem", given.count, given.rpm, {})
        print(f"DEM  {1e6 * dem[2]:8.2f} us  {dem[0]:8.1f} +- {dem[1]:.1f} N m  {dem[3]:6.1f} s", flush=True)
        for step in STEPS:
            changes = {"contact.method": "dvi", "contact.dvi.step": step, "contact.dvi.allow_long_step": True}
            try:
                row = held_torque(Path(place) / f"dvi{1e6 * step:.0f}", given.count, given.rpm, changes)
            except RunError as error:
                stopped.append(step)
                print(f"DVI  {1e6 * step:8.2f} us  stops: {str(error).splitlines()[0][:150]}", flush=True)
                continue
            rows.append(row)
            away = 100.0 * (row[0] / dem[0] - 1.0)
            print(
                f"DVI  {1e6 * step:8.2f} us  {row[0]:8.1f} +- {row[1]:.1f} N m  {row[3]:6.1f} s  {away:+.1f} %",
                flush=True,
            )
    if given.picture is not None:
        draw(given.picture, dem, rows, stopped, f"Shot clutch with {given.count} spheres at {given.rpm:g} rpm")


if __name__ == "__main__":
    main()
