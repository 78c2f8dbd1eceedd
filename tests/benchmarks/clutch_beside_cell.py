"""Shear stress against field: a periodic cell of iron and the powder clutch, run in and over the rim, in one figure.

    python tests/benchmarks/clutch_beside_cell.py docs/clutch_beside_cell.png

plots shear_stress.csv. Grains of cell and clutch saturate at different magnetisations, so fields are over Ms and
stresses over mu_0 Ms^2; the cell is taken at the clutch's fill, between its own two, by the line through both. It
prints the clutch's stress relative to the cell's.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from field import MU_0

TABLE = Path(__file__).with_name("shear_stress.csv")
CELL_MS, CLUTCH_MS = 1.7e6, 1.3e6  # [A/m], powder_iron and cases/powder_clutch.toml


def measured() -> dict[str, np.ndarray]:
    """Rows (H [A/m], tau [Pa], fill) of the cell and of the clutch, by how its powder began."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        name: np.array(
            [
                [1e3 * float(row["H [kA/m]"]), 1e3 * float(row["tau [kPa]"]), float(row["fill"])]
                for row in rows
                if row["what"] == name
            ]
        )
        for name in dict.fromkeys(row["what"] for row in rows)
    }


class Cell:
    """tau [Pa] of the sheared cell: power laws between its fields, a line between its fills."""

    def __init__(self, rows: np.ndarray) -> None:
        self.fills = np.unique(rows[:, 2])
        self.H = rows[rows[:, 2] == self.fills[0], 0]
        self.tau = np.array([rows[rows[:, 2] == fill, 1] for fill in self.fills])

    def at(self, H: np.ndarray | float, fill: float) -> np.ndarray:
        """At fields [A/m] within its own and one fill."""
        low, high = (np.exp(np.interp(np.log(H), np.log(self.H), np.log(tau))) for tau in self.tau)
        weight = (fill - self.fills[0]) / (self.fills[1] - self.fills[0])
        return (1.0 - weight) * low + weight * high


def main() -> None:
    """Table and figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="?", default="clutch_beside_cell.png")
    tables = measured()
    cell, of_cell, of_clutch = Cell(tables.pop("cell")), MU_0 * CELL_MS**2, MU_0 * CLUTCH_MS**2
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    H = np.geomspace(cell.H[0], cell.H[-1], 100)
    axes.fill_between(H / CELL_MS, *(cell.at(H, fill) / of_cell for fill in cell.fills), color="0.85", lw=0.0)
    axes.plot(
        H / CELL_MS, cell.at(H, 0.382) / of_cell, color="0.35", label="sheared cell, fill 0.38 (band: 0.32 to 0.45)"
    )
    for (name, rows), marker in zip(tables.items(), "osD", strict=True):
        axes.plot(rows[:, 0] / CLUTCH_MS, rows[:, 1] / of_clutch, marker, ms=6, label=f"powder clutch, {name}")
        for field, tau, fill in rows:
            own = cell.at(field / CLUTCH_MS * CELL_MS, fill) / of_cell
            print(f"{name}: {1e-3 * field:.0f} kA/m, fill {fill:.2f}: {tau / of_clutch / own:.2f} of the cell's stress")
    axes.set(xscale="log", yscale="log", xlabel="H/Ms", ylabel="shear stress / ($\\mu_0$ Ms²)")
    title = "A cell without walls and rolling friction, and the clutch (former contact model)"
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(alpha=0.3, lw=0.4, which="both")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(parser.parse_args().picture, dpi=130)


if __name__ == "__main__":
    main()
