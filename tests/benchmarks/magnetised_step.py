"""What a step of a powder clutch costs with all that is magnetic, beside the same contacts without; and by part.

    python tests/benchmarks/magnetised_step.py [--copies 8] [--windows 2] [--run FOLDER]

The clutch is that of cases/powder_clutch.toml with the grains of this comparison (`GRAINS`), whatever those of the
case are, after a millisecond of shear: a sector of 1.5 degrees is run for so long once and kept, and so many turned
copies of it stand side by side in a wider one, 8 for 21 000 grains; or the grains are those of the last snapshot of a
finished run (`--run`). Where so many do not divide the ring, it is the next smaller number that does. Some updates come
first, in which moments, field and lists are found, then whole windows are measured: field, moments, lists and contacts,
as a run has them in its steady part.

The bare step is that of the same grains, walls and contacts without magnetism: the pull of the last update, held, keeps
the contacts that they have; without it the powder would fly apart. Processor time, one thread.
"""

from __future__ import annotations

import argparse
import os
import time
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numba
import numpy as np

import coupling.window_budget
from coupling import Simulation, WindowRow, run_staggered
from coupling.magnetised_grains import MomentRow
from emclutch import Case, load_case
from emclutch.results.record import Record
from emclutch.simulation.assembly import assemble, simulation_of
from emclutch.simulation.plan import make_plan
from particles import DEM, Grains

CLUTCH = Path(__file__).resolve().parents[2] / "cases" / "powder_clutch.toml"
KEPT = Path(__file__).resolve().parents[2] / "runs" / "bench"  # sheared powder, a file for each case
GRAINS = {"particles.diameter": "0.2 mm", "particles.sector": "1.5 deg"}
SHEARED = 1e-3  # s
COPIES = 8
STARTING = 3  # updates before what is measured
FAR_END = 1.0  # s: the callbacks stop a run long before
BARE = 100  # steps: about as long as a list lasts
ARRAYS = ("position", "radius", "velocity", "angular_velocity", "magnetic_moment")
PARTS = ("field", "magnetic", "contact")


@dataclass(frozen=True, slots=True)
class StepCost:
    """Of one step of `grains` grains [us], processor time.

    Attributes
    ----------
    parts : dict
        `field`, `magnetic` (moments and held forces) and `contact` (the DEM's steps, near pulls and lists in them).
    bare : float
        Without magnetism.
    contacts, bare_contacts : float
        Between grains, a grain.
    sweeps : float
        Of the moments, an update.
    """

    grains: int
    parts: dict[str, float]
    bare: float
    contacts: float
    bare_contacts: float
    sweeps: float

    @property
    def whole(self) -> float:
        """All parts [us]."""
        return sum(self.parts.values())

    def in_words(self) -> str:
        """Ratio and parts in nanoseconds a grain."""
        each = ", ".join(f"{name} {1e3 * cost / self.grains:.0f}" for name, cost in self.parts.items())
        bare = 1e3 * self.bare / self.grains
        return (
            f"{self.whole / self.bare:.2f} times a bare step; ns a grain: {each}, bare {bare:.0f};"
            f" contacts a grain {self.contacts:.2f}, bare {self.bare_contacts:.2f}; {self.sweeps:.1f} sweeps an update"
        )


def quiet(case: Case, values: dict[str, Any]) -> Case:
    """The case with other values, without pictures and snapshots."""
    return case.with_values({"output.snapshots": 0, "output.pictures": False} | values)


def sheared_powder(case: Case, time: float) -> dict[str, np.ndarray]:
    """Arrays of the grains of one sector after a time [s] of shear, kept for the next sitting."""
    kept = KEPT / f"sheared_powder_{zlib.crc32(f'{case.toml()}{time}'.encode()):08x}.npz"
    if not kept.exists():
        simulation = assemble(*make_plan(case))
        run_staggered(simulation, time)
        KEPT.mkdir(parents=True, exist_ok=True)
        np.savez(kept, **{name: getattr(simulation.motion.grains, name) for name in ARRAYS})
    with np.load(kept) as file:
        return {name: file[name] for name in ARRAYS}


def of_run(folder: Path) -> dict[str, np.ndarray]:
    """Arrays of the grains in the last snapshot of a run."""
    record = Record.open(folder / "run.h5")
    frame = record.grains(len(record.frames()) - 1)
    return {name: frame[name] for name in ARRAYS if name in frame}


def side_by_side(arrays: dict[str, np.ndarray], sector: float, copies: int) -> dict[str, np.ndarray]:
    """The grains of so many neighbouring sectors [rad]: each the first one's, turned."""
    turned = {name: [values] for name, values in arrays.items()}
    for k in range(1, copies):
        c, s = np.cos(k * sector), np.sin(k * sector)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        for rows in turned.values():
            rows.append(rows[0] @ turn if rows[0].ndim == 2 else rows[0])
    return {name: np.concatenate(rows) for name, rows in turned.items()}


def sheared_simulation(
    copies: int = COPIES,
    folder: Path | None = None,
    values: dict[str, Any] | None = None,
    time: float = SHEARED,
) -> Simulation:
    """The clutch with grains that have been sheared, with other values than the case's or for another time [s]."""
    alone = quiet(load_case(CLUTCH), GRAINS | (values or {})) if folder is None else load_case(folder / "case.toml")
    particles = alone.scene.particles
    assert particles.sector is not None
    copies = whole_copies(particles.n_sectors, copies)
    case = quiet(alone, {"particles.sector": 2.0 * np.pi / (particles.n_sectors // copies)})
    arrays = side_by_side(sheared_powder(alone, time) if folder is None else of_run(folder), particles.sector, copies)
    grains = Grains.create(
        arrays["position"], arrays["radius"], case.scene.particles.density,
        velocity=arrays["velocity"], angular_velocity=arrays["angular_velocity"],
    )  # fmt: skip
    grains.magnetic_moment = arrays.get("magnetic_moment")
    return simulation_of(*make_plan(case), grains)


def whole_copies(sectors: int, most: int) -> int:
    """At most so many neighbouring sectors that the ring is two or more of them as one."""
    return max((k for k in range(1, most + 1) if sectors % k == 0 and sectors >= 2 * k), default=1)


def step_cost(simulation: Simulation, windows: int = 2) -> StepCost:
    """Of so many windows in the middle of a run."""
    dem, steps = simulation.motion, simulation.steps
    assert isinstance(dem, DEM)
    rows: list[WindowRow] = []
    bare: list[float] = []
    with patch.object(coupling.window_budget, "perf_counter", time.process_time):
        simulation.steps = STARTING * simulation.steps_per_update
        run_staggered(simulation, FAR_END, [lambda simulation, row: True])
        simulation.steps = steps
        for _ in range(windows):
            run_staggered(simulation, FAR_END, [lambda simulation, row: rows.append(row) or True])
            seconds, bare_contacts = bare_step(dem)
            bare.append(seconds)
    steps = sum(row.steps for row in rows)
    parts = {name: 1e6 * sum(getattr(row.seconds, name) for row in rows) / steps for name in PARTS}
    n = dem.grains.count
    return StepCost(
        n, parts, float(np.mean(bare)), rows[-1].n_contacts / n, bare_contacts / n,
        sum(row.part(MomentRow).moment_sweeps for row in rows) / (windows * steps / simulation.steps_per_update),
    )  # fmt: skip


def bare_step(dem: DEM, repeats: int = 3) -> tuple[float, float]:
    """Microseconds of a step of the same grains, walls and contacts without magnetism, and its contacts.

    A list is made in each repeat, as often as one is in such a run. The grains stand afterwards where they stood.
    """
    state, attraction, seconds, contacts = dem.state(), dem.attraction, [], 0
    assert attraction is not None  # by its first update
    for _ in range(repeats + 1):  # the first compiles
        dem.external_force, dem.attraction = attraction.per_grain["total_force"].copy(), None
        dem.invalidate()
        begin = time.process_time()
        totals = dem.run(BARE)
        seconds.append(time.process_time() - begin)
        contacts = totals.n_contacts
        dem.attraction = attraction
        dem.restore(state)
    return 1e6 * float(np.median(seconds[1:])) / BARE, float(contacts)


def main() -> None:
    """One line."""
    parser = argparse.ArgumentParser(description="cost of a step of a powder clutch, beside the same contacts without")
    parser.add_argument("--copies", type=int, default=COPIES)
    parser.add_argument("--windows", type=int, default=2)
    parser.add_argument("--run", type=Path, help="folder of a finished run whose last snapshot gives the grains")
    given = parser.parse_args()
    numba.set_num_threads(1)
    cost = step_cost(sheared_simulation(given.copies, given.run), given.windows)
    print(f"{cost.grains} grains: {cost.whole:.0f} us a step, {cost.in_words()}")


if __name__ == "__main__":
    main()
