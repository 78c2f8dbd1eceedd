"""Measures the table of gap cells: shear stress, pressure and flux of powder that is sheared between two steel faces.

    python tests/benchmarks/gap_cells.py docs/gap_cells.csv [--processes 2]
    python tests/benchmarks/gap_cells.py docs/gap_cells.csv --fits
    python tests/benchmarks/gap_cells.py docs/gap_cells.csv --picture docs/gap_cells.png
    python tests/benchmarks/gap_cells.py docs/gap_cells.csv --law emclutch/simulation/forecast/powder_laws.json

A line of the table is one run of a `sheared_box` with `walls = "steel"` (docs/how_to/sheared_box.md), on one core, a
minute for 370 grains. The cells of `CELLS` are measured in their order; lines that are in the file already are kept
and not run again, so that what was interrupted goes on. `--fits` measures nothing and prints the laws of the table;
`--law` writes those that `emclutch check` uses (`emclutch.simulation.forecast.powder_law`).

The powder is that of cases/powder_clutch.toml: friction 0.3, rolling friction 0.2, susceptibility 273, saturation
1.3 MA/m. Columns: field strength between the faces [A/m]; solid fraction as asked for (`grains` gives the exact one);
height of the gap and edge of the cell along both faces in diameters; seed; shear stress, mean of both faces, and its
standard error within the run [Pa]; pressure of the grains on the faces [Pa]; flux density [T]; magnetisation of the
grains [A/m]; demagnetising factor with which the grains' material has this magnetisation; inertial number of the shear
stress; shear strain averaged from and to; number of grains; processor time [s].
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2
from scipy.stats.qmc import Halton

from emclutch.results.fits import NORMAL
from emclutch.scene.case import case_from
from emclutch.simulation.forecast.powder_law import POWDERS, PowderLaws, shipped_laws
from emclutch.simulation.run import run
from particles.bulk_friction.friction_table import measured_table

LOOSE = 0.25
"""Fill at which no powder jams."""
DIAMETER, SUSCEPTIBILITY, SATURATION = 0.125e-3, 273.0, 1.3e6  # m, 1, A/m; of the powder of the first table
POWDER = ("friction", "rolling_friction", "susceptibility", "spread")
KEY = (*POWDER, "set_inertial_number", "field_strength", "fill", "height", "edge", "seed")
SCENE: dict[str, Any] = {
    "scene": {"title": "Powder between two faces of steel"},
    "geometry": {"kind": "sheared_box", "walls": "steel"},
    "field": {"source": "uniform", "direction": "z", "means": "macroscopic"},
    "particles": {"density": 7700.0, "saturation": SATURATION},
    "contact": {"restitution": 0.5},
    "effects": {
        "magnetic_force": {}, "dipoles": {"cutoff": 2.5}, "saturation": {}, "wall_images": {},
    },
    "accuracy": {"replicas": 1},
    "output": {"pictures": False, "snapshots": 1, "formats": ["hdf5"], "energy_budget": False, "checkpoint": False},
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the table.

    Attributes
    ----------
    field_strength : of the mean field between the faces [A/m].
    fill : solid fraction.
    height, edge : of the gap, and of the cell along both faces [diameters].
    seed : of the initial packing.
    start, end : shear strain from which is averaged, and at which the run ends.
    friction, rolling_friction, susceptibility : of the grains.
    spread : of the diameters, the largest over the smallest, all alike by number; 1: equal grains.
    set_inertial_number : by which the shear rate is found.
    """

    field_strength: float
    fill: float
    height: int = 8
    edge: int = 8
    seed: int = 1
    start: float = 5.0
    end: float = 15.0
    friction: float = 0.3
    rolling_friction: float = 0.2
    susceptibility: float = SUSCEPTIBILITY
    spread: float = 1.0
    set_inertial_number: float = 0.1

    @property
    def key(self) -> tuple[float, ...]:
        """Values of the columns `KEY`."""
        return tuple(float(getattr(self, name)) for name in KEY)

    def row(self) -> dict[str, object]:
        """Run it and return its line."""
        changes = {
            "scene.seed": self.seed, "contact.friction": self.friction,
            "particles.susceptibility": self.susceptibility,
            "geometry.inertial_number": self.set_inertial_number,
            "field.field_strength": self.field_strength, "particles.solid_fraction": self.fill,
            "geometry.size": [edge * DIAMETER for edge in (self.edge, self.edge, self.height)],
            "time.average_from": f"strain {self.start:g}", "time.end": f"strain {self.end:g}",
        }  # fmt: skip
        if self.rolling_friction:
            changes["effects.rolling_friction.coefficient"] = self.rolling_friction
        if self.spread == 1.0:
            changes["particles.diameter"] = DIAMETER
        else:
            ends = 2.0 * DIAMETER / (1.0 + self.spread) * np.array([1.0, self.spread])
            changes["particles.sizes"] = {"kind": "uniform", "min": float(ends[0]), "max": float(ends[1])}
        with tempfile.TemporaryDirectory() as folder:
            found = run(case_from(SCENE, changes), out=Path(folder) / "run", threads=1).summary
        return dict(zip(KEY, (f"{value:g}" for value in self.key), strict=True)) | {
            "shear_stress": f"{found['shear_stress']:.5g}", "standard_error": f"{found['shear_stress_error']:.3g}",
            "wall_pressure": f"{found['normal_stress']['mean']:.5g}", "flux_density": f"{found['flux_density']:.6g}",
            "magnetisation": f"{found['magnetisation']:.6g}",
            "demagnetising_factor": f"{found['demagnetising_factor'] or np.nan:.5g}",  # none of saturated grains
            "inertial_number": f"{found['inertial_number_of_shear_stress']:.3g}",
            "from_strain": f"{self.start:g}", "to_strain": f"{found['shear_strain']:.3g}",
            "grains": found["grains"], "processor_seconds": f"{found['seconds']['processor']:.0f}",
        }  # fmt: skip


GRID = [(H, fill) for H in (150e3, 60e3, 30e3, 220e3, 100e3) for fill in (0.38, 0.45, 0.30)]
SLOW = (220e3, 0.30)  # whose stress is steady from a strain of 12 to 25 on, by seed
FIVE = ((150e3, 0.38), (150e3, 0.45), (150e3, 0.30), (60e3, 0.38), (220e3, 0.38))  # for another powder
OF_REPOSE = (0.053, 0.228, 0.540)  # rolling friction that has an angle of repose of 25, 30, 34 degrees at friction 0.6
DRAWN = [  # friction and rolling friction of other powders, evenly spread
    (round(0.2 + 0.5 * float(x), 2), round(0.6 * float(y), 2)) for x, y in Halton(2, scramble=False).random(13)[1:]
]
OTHERS = ((150e3, 0.38), (60e3, 0.38), (150e3, 0.45))  # with other numbers of grains per gap
CELLS = (
    *(Cell(H, fill) for H, fill in GRID if (H, fill) != SLOW),
    *(Cell(150e3, 0.38, seed=seed) for seed in (2, 3)),
    *(Cell(*SLOW, seed=seed, start=25.0, end=35.0) for seed in (1, 2)),
    *(Cell(H, fill, height=4) for H, fill in OTHERS),
    Cell(150e3, 0.38, seed=4),
    Cell(150e3, 0.38, height=12, edge=12, end=13.0),
    *(Cell(H, fill, seed=2, start=15.0, end=25.0) for H, fill in ((150e3, 0.30), (220e3, 0.38))),
    Cell(150e3, 0.38, edge=12, end=13.0),
    Cell(60e3, 0.38, height=12, edge=12, end=13.0),
    Cell(150e3, 0.38, edge=16, end=13.0),
    Cell(150e3, 0.45, height=12, edge=12, end=13.0),
    *(Cell(H, fill, height=4, seed=2) for H, fill in OTHERS),
    Cell(150e3, 0.30, edge=16, start=20.0, end=30.0),
    *(
        Cell(H, fill, seed=2)
        for H, fill in GRID
        if (H, fill) not in (SLOW, (150e3, 0.38), (150e3, 0.30), (220e3, 0.38))
    ),
    *(Cell(H, fill, susceptibility=chi) for chi in (200.0, 999.0) for H, fill in FIVE),
    *(Cell(H, fill, friction=0.6, rolling_friction=rolling) for rolling in OF_REPOSE for H, fill in FIVE),
    *(Cell(150e3, 0.38, set_inertial_number=value) for value in (0.03, 0.3, 0.5)),
    *(Cell(150e3, fill, height=6, end=20.0) for fill in (0.30, 0.38, 0.45)),
    *(Cell(H, fill, height=4, end=25.0) for H, fill in ((150e3, 0.30), (60e3, 0.45), (220e3, 0.38))),
    *(
        Cell(150e3, fill, friction=friction, rolling_friction=rolling)
        for friction, rolling in DRAWN
        for fill in (0.31, 0.38, 0.45)
    ),
    *(Cell(150e3, fill, susceptibility=chi) for chi in (100.0, 500.0) for fill in (0.31, 0.38, 0.45)),
    *(Cell(150e3, fill, height=16, edge=12, end=13.0) for fill in (0.38, 0.45)),
    Cell(150e3, 0.30, height=12, edge=12, start=12.0, end=20.0),
    *(Cell(150e3, fill, friction=0.6, rolling_friction=OF_REPOSE[1], height=4, end=25.0) for fill in (0.38, 0.45)),
    *(Cell(150e3, fill, susceptibility=999.0, height=4, end=25.0) for fill in (0.38, 0.45)),
    *(Cell(150e3, fill, set_inertial_number=0.5) for fill in (0.30, 0.45)),
    *(Cell(150e3, fill, set_inertial_number=1.0) for fill in (0.38, 0.45)),
    *(Cell(15e3, fill) for fill in (0.38, 0.45)),
    *(
        Cell(150e3, fill, friction=friction, rolling_friction=0.0)
        for friction in (0.3, 0.6, 0.45)
        for fill in (0.31, 0.38, 0.45)
    ),
    *(
        Cell(H, 0.38, susceptibility=chi)
        for H, chi in ((60e3, 100.0), (30e3, 100.0), (30e3, 999.0), (30e3, 200.0), (30e3, 500.0))
    ),
    Cell(30e3, 0.45, susceptibility=999.0),
    *(Cell(H, 0.25) for H in (150e3, 60e3)),
    *(Cell(H, 0.50) for H in (150e3, 60e3)),
    *(Cell(H, fill, seed=2, friction=0.6, rolling_friction=rolling) for rolling in OF_REPOSE for H, fill in FIVE[:3]),
    *(Cell(H, fill, seed=2, susceptibility=chi) for chi in (200.0, 999.0) for H, fill in FIVE[:3]),
    *(Cell(150e3, fill, edge=12, spread=spread) for spread in (1.0, 3.0) for fill in (0.38, 0.45)),
)


Table = dict[str, np.ndarray]


def read_table(path: Path) -> Table:
    """Columns of the table; `solid_fraction` is the exact one, of the number of grains."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    return table | {"solid_fraction": table["grains"] * np.pi / 6.0 / (table["height"] * table["edge"] ** 2)}


def cells_of(table: Table, **values: float) -> Table:
    """Lines with these values of some columns."""
    chosen = np.all([table[name] == value for name, value in values.items()], axis=0)
    return {name: column[chosen] for name, column in table.items()}


def means_over_seeds(table: Table) -> Table:
    """One line for all seeds of a cell; its standard error is that of the mean."""
    cells = np.column_stack([table[name] for name in KEY if name != "seed"])
    _, which, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    means = {name: np.bincount(which.ravel(), column) / count for name, column in table.items()}
    return means | {"standard_error": np.sqrt(np.bincount(which.ravel(), table["standard_error"] ** 2)) / count}


def print_fits(table: Table, path: Path) -> None:
    """Print the laws of the table, each number with half of its 95 % interval."""
    laws = powder_laws(table, path)
    names = ("p", "m", "k", "l", "q", "r")
    pairs = zip(names, laws.common, NORMAL * laws.common_errors, strict=True)
    print(", ".join(f"{name} {value:.3f} ± {half:.3f}" for name, value, half in pairs), end="")
    print(f"; deviation of a cell {laws.deviation:.2%}; N_1 {laws.permeability[0]:.3f}, N_2 {laws.permeability[1]:.4f}")
    print("| friction | rolling friction | chi | cells | 100 A | phi_1 | N_0 |\n|---|---|---|---|---|---|---|")
    for (friction, rolling, chi), cells, own, error in zip(
        laws.powders, laws.cells, laws.own, NORMAL * laws.own_errors, strict=True
    ):
        A, fill = np.exp(own[:2])
        print(f"| {friction:g} | {rolling:g} | {chi:g} | {cells} | {100 * A:.2f} ± {100 * A * error[0]:.2f} | ", end="")
        print(f"{fill:.3f} ± {fill * error[1]:.3f} | {own[2]:.4f} |")
    left_out = np.sqrt((laws.left_out**2).mean(axis=0))
    print(f"a powder that is left out: A {left_out[0]:.1%}, phi_1 {left_out[1]:.1%}, N_0 {left_out[2]:.4f}")
    print_seeds(table)
    cells = means_over_seeds(of_brake(table))
    for k in range(len(cells["fill"])):
        one = {name: column[k : k + 1] for name, column in cells.items()}
        H, fill, n, edge = (one[name][0] for name in ("field_strength", "fill", "height", "edge"))
        base = cells_of(cells, field_strength=H, fill=fill, height=8, edge=8)
        if (n, edge) != (8, 8) and len(base["fill"]):
            ratio, half = ratio_of(one, base)
            print(f"{H:g} A/m, fill {fill}, height {n:g}, edge {edge:g}: {one['shear_stress'][0]:.4g} Pa, ", end="")
            print(f"{ratio:.3f} ± {half:.3f} of 8 and 8")
    print(f"{len(table['fill'])} cells, {table['processor_seconds'].sum():.0f} s of processor time")


def of_brake(table: Table) -> Table:
    """Cells of equal grains of the first powder at an inertial number of 0.1."""
    return cells_of(table, friction=0.3, rolling_friction=0.2, susceptibility=SUSCEPTIBILITY, spread=1.0,
                    set_inertial_number=0.1)  # fmt: skip


def powder_laws(table: Table, path: Path) -> PowderLaws:
    """Laws of the table's cells of equal grains."""
    cells = cells_of(table, spread=1.0)
    names = {"height": "grains_per_gap"}
    columns = {names.get(name, name): column for name, column in cells.items()}
    columns["saturation"] = np.full(len(cells["height"]), SATURATION)
    made = {
        "cells": path.name, "cells_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "processor_seconds": round(float(cells["processor_seconds"].sum())), "emclutch": version("emclutch"),
    }  # fmt: skip
    return PowderLaws.fit(columns, np.array(list(free_flowing())), made)


def draw(table: Table, path: Path) -> None:
    """Draw stress against flux density, and its rise by jamming against fill; the powder of the brake."""
    cells, law = means_over_seeds(of_brake(table)), shipped_laws().of(0.3, 0.2, SUSCEPTIBILITY)
    figure = Figure(figsize=(9.5, 3.9), layout="constrained")
    by_flux, by_fill = figure.subplots(1, 2)
    B, fills = np.geomspace(0.1, 1.0, 60), np.linspace(0.28, 0.5, 60)

    def stress(flux: float, fill: float, n: float) -> float:
        return float(law.stress(np.array([flux]), SATURATION, fill, n)[0])

    for k, fill in enumerate((0.30, 0.38, 0.45)):
        own = cells_of(cells, fill=fill, height=8, edge=8)
        by_flux.loglog(own["flux_density"], own["shear_stress"] / 1e3, "o", color=f"C{k}", ms=5)
        by_flux.loglog(B, law.stress(B, SATURATION, fill, 8.0) / 1e3, color=f"C{k}", lw=1.2, label=f"fill {fill:g}")
    by_flux.set(xlabel="flux density B [T]", ylabel="shear stress [kPa]", title="8 grains per gap")
    for k, n in enumerate((4, 8, 16)):
        own = cells_of(cells, height=n)
        loose = [stress(flux, LOOSE, n) for flux in own["flux_density"]]
        by_fill.plot(own["solid_fraction"], own["shear_stress"] / loose, "o", color=f"C{k}", ms=5)
        rise = [stress(0.6, fill, n) / stress(0.6, LOOSE, n) for fill in fills]
        by_fill.plot(fills, rise, color=f"C{k}", lw=1.2, label=f"{n} grains per gap")
    by_fill.axhline(2.0, color="0.5", lw=0.8, ls=":")
    by_fill.set(xlabel="fill", ylabel="stress / stress of loose powder at the same B", ylim=(0.8, 3.2), title="Jamming")
    for axes in (by_flux, by_fill):
        axes.legend(title="dots: cells, lines: law", fontsize=8, title_fontsize=8)
    figure.savefig(path, dpi=110)


def free_flowing() -> Iterator[tuple[float, float]]:
    """Friction and rolling friction of powders with an angle of repose of 25 to 34 degrees, all as likely.

    That is an «excellent» to «good» flow in R. L. Carr, Chem. Eng. 72 (1965) 163.
    """
    measured = measured_table()
    for angle in np.linspace(25.0, 34.0, 7):
        for friction in np.linspace(0.3, 0.7, 5):
            rolling = measured.rolling_for(np.sin(np.radians(angle)), friction)
            if rolling is not None:
                yield round(float(friction), 3), round(min(rolling, POWDERS["rolling friction"][1]), 3)


def ratio_of(one: Table, other: Table) -> tuple[float, float]:
    """Stress of a cell over that of another, and half of its 95 % interval by the errors within runs."""
    ratio = float(one["shear_stress"][0] / other["shear_stress"][0])
    relative = [cell["standard_error"][0] / cell["shear_stress"][0] for cell in (one, other)]
    return ratio, NORMAL * ratio * float(np.hypot(*relative))


def print_seeds(table: Table) -> None:
    """Print the scatter between seeds of each cell, and of all cells together."""
    squares, free = 0.0, 0
    names = [name for name in KEY if name != "seed"]
    for values in np.unique(np.column_stack([table[name] for name in names]), axis=0):
        stress = cells_of(table, **dict(zip(names, values, strict=True)))["shear_stress"]
        if len(stress) > 1:
            scatter, freedom = stress.std(ddof=1) / stress.mean(), len(stress) - 1
            squares, free = squares + scatter**2 * freedom, free + freedom
            print(*(f"{name} {value:g}" for name, value in zip(names, values, strict=True)), sep=", ", end=": ")
            print(f"{freedom + 1} seeds, {stress.mean():.4g} Pa, standard deviation {scatter:.2%}")
    if free:
        low, high = np.sqrt(squares / chi2.ppf([0.975, 0.025], free))
        within = np.sqrt(((table["standard_error"] / table["shear_stress"]) ** 2).mean())
        print(
            f"scatter between seeds {np.sqrt(squares / free):.2%} ({low:.2%} to {high:.2%}, {free} degrees of ", end=""
        )
        print(f"freedom); standard error within a run {within:.2%}")


def append_rows(table: Path, runs: Sequence[Callable[[], dict[str, Any]]], processes: int) -> None:
    """Append the line of each run to a table as soon as it is done."""
    with ProcessPoolExecutor(processes) as pool:
        for one in as_completed([pool.submit(run) for run in runs]):
            row, begins = one.result(), not table.exists()
            with table.open("a", newline="") as file:
                writer = csv.DictWriter(file, row, lineterminator="\n")
                if begins:
                    writer.writeheader()
                writer.writerow(row)
            print(",".join(str(entry) for entry in row.values()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path, help="the file (.csv)")
    parser.add_argument("--processes", type=int, default=2, help="cells at a time, one core each")
    parser.add_argument("--fits", action="store_true", help="print the laws of the table")
    parser.add_argument("--law", type=Path, help="write the laws of the powders to this file (.json)")
    parser.add_argument("--picture", type=Path, help="draw the cells and the law of the brake's powder (.png)")
    asked = parser.parse_args()
    if asked.picture is not None:
        draw(read_table(asked.table), asked.picture)
        return
    if asked.law is not None:
        powder_laws(read_table(asked.table), asked.table).write(asked.law)
        return
    if asked.fits:
        print_fits(read_table(asked.table), asked.table)
        return
    known = set()
    if asked.table.exists():
        with asked.table.open(newline="") as file:
            known = {tuple(float(row[name]) for name in KEY) for row in csv.DictReader(file)}
    append_rows(asked.table, [cell.row for cell in CELLS if cell.key not in known], asked.processes)


if __name__ == "__main__":
    main()
