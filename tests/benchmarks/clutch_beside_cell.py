"""Shear stress against field: a periodic cell of iron and the powder clutch, run in and over the rim, in one figure.

    python tests/benchmarks/clutch_beside_cell.py docs/clutch_beside_cell.png

draws the tables of docs/powder_stress.md (the cell) and docs/sensitivities.md (the clutch). Their grains saturate at
different magnetisations, so fields are over Ms and stresses over mu_0 Ms^2; the cell is taken at the clutch's fill, in
between its own two, by the line through both. It prints what the clutch has beside the cell.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from field import MU_0

DOCS = Path(__file__).resolve().parents[2] / "docs"
CELL_MS, CLUTCH_MS = 1.7e6, 1.3e6  # [A/m], docs/powder_stress.md and cases/powder_clutch.toml


def table(page: str, heading: str) -> list[list[str]]:
    """Cells of the rows of the table of a page of docs whose heading begins so."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(heading)) + 2
    rows = []
    for line in lines[begin:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip(" *") for cell in line.strip("|").split("|")])
    return rows


def number(cell: str) -> float:
    """The first number of a cell, without its error; NaN where there is none."""
    found = re.match(r"-?\d*\.?\d+", cell)
    return float(found.group()) if found else np.nan


class Cell:
    """tau [Pa] of the sheared cell: power laws between its fields, a line between its fills."""

    def __init__(self) -> None:
        rows = np.array(
            [[number(row[k]) for k in (0, 1, 2)] for row in table("powder_stress.md", "| fill | H [kA/m] | tau")]
        )
        self.fills = np.unique(rows[:, 0])
        self.H = 1e3 * rows[rows[:, 0] == self.fills[0], 1]
        self.tau = np.array([1e3 * rows[rows[:, 0] == fill, 2] for fill in self.fills])

    def at(self, H: np.ndarray | float, fill: float) -> np.ndarray:
        """At fields [A/m] within its own and one fill."""
        low, high = (np.exp(np.interp(np.log(H), np.log(self.H), np.log(tau))) for tau in self.tau)
        share = (fill - self.fills[0]) / (self.fills[1] - self.fills[0])
        return (1.0 - share) * low + share * high


def clutch() -> dict[str, np.ndarray]:
    """Rows (H [A/m], tau [Pa], fill) of the powder clutch, by how its powder began."""
    run_in = [
        [1e3 * number(row[3]), 1e3 * number(row[2]), number(row[4])]
        for row in table("sensitivities.md", "| current [A] | run in")
    ]
    rim, smooth = [], []
    for row in table("sensitivities.md", "| current [A] | torque [N m] | shear stress"):
        into = smooth if "rolling" in row[0] else rim
        into.append([1e3 * number(row[3]), 1e3 * number(row[2]), number(row[4])])
    named = {"run in (four packings)": run_in, "begun over the rim": rim, "over the rim, no rolling friction": smooth}
    return {name: np.array([row for row in rows if row[0] > 0.0]) for name, rows in named.items()}


def main() -> None:
    """Table and figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="?", default="clutch_beside_cell.png")
    cell, of_cell, of_clutch = Cell(), MU_0 * CELL_MS**2, MU_0 * CLUTCH_MS**2
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    H = np.geomspace(cell.H[0], cell.H[-1], 100)
    axes.fill_between(H / CELL_MS, *(cell.at(H, fill) / of_cell for fill in cell.fills), color="0.85", lw=0.0)
    axes.plot(
        H / CELL_MS, cell.at(H, 0.382) / of_cell, color="0.35", label="sheared cell, fill 0.38 (band: 0.32 to 0.45)"
    )
    for (name, rows), marker in zip(clutch().items(), "osD", strict=True):
        axes.plot(rows[:, 0] / CLUTCH_MS, rows[:, 1] / of_clutch, marker, ms=6, label=f"powder clutch, {name}")
        for field, tau, fill in rows:
            own = cell.at(field / CLUTCH_MS * CELL_MS, fill) / of_cell
            print(f"{name}: {1e-3 * field:.0f} kA/m, fill {fill:.2f}: {tau / of_clutch / own:.2f} of the cell's stress")
    axes.set(xscale="log", yscale="log", xlabel="H/Ms", ylabel="shear stress / ($\\mu_0$ Ms²)")
    axes.set_title("A cell without walls and rolling friction, and the clutch", loc="left", fontsize=10)
    axes.grid(alpha=0.3, lw=0.4, which="both")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(parser.parse_args().picture, dpi=130)


if __name__ == "__main__":
    main()
