"""``wall_pressure.csv``: load of the walls by the grains, one row a bin of a wall, mean of the steady part of a run.

Unit and meaning of each column are in `WALL_COLUMNS`. A wall that is not divided has no `along`, `low`, `high`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.atomic_file import replace_text

if TYPE_CHECKING:
    import pandas

    from particles.diagnostics.wall_pressure import WallPressure

WALL_COLUMNS: dict[str, tuple[str, str]] = {
    "wall": ("", "name of the wall"),
    "body": ("", "the body that it turns with"),
    "along": ("", "coordinate along the wall"),
    "low": ("m", "lower edge of the bin in that coordinate"),
    "high": ("m", "upper edge of the bin"),
    "area": ("m2", "of the bin, whole device"),
    "pressure": ("Pa", "normal force of the contacts over the area"),
    "shear_stress": ("Pa", "force of the contacts along the flow (phi; x in a box) over the area"),
    "mu": ("1", "|shear stress| over pressure"),
    "normal_force": ("N", "of the contacts on the wall, whole device, pressing positive"),
    "torque": ("N m", "of the contacts on the wall about z, whole device (nothing in a box)"),
    "contacts": ("1", "contacts in the bin at a moment, in what is simulated"),
}


def wall_table(load: WallPressure, walls: Sequence[Any]) -> pandas.DataFrame:
    """Return the rows of all bins; ``attrs["units"]`` has the units."""
    import pandas

    bins = load.bins
    with np.errstate(divide="ignore", invalid="ignore"):
        mu = np.where(load.pressure > 0.0, np.abs(load.shear_stress) / load.pressure, np.nan)
    table = pandas.DataFrame({
        "wall": [walls[k].name for k in bins.wall],
        "body": [walls[k].body for k in bins.wall],
        "along": [("r", "z", "")[bins.coordinate[k]] for k in bins.wall],
        "low": bins.low, "high": bins.high, "area": bins.area,
        "pressure": load.pressure, "shear_stress": load.shear_stress, "mu": mu, "normal_force": load.normal_force,
        "torque": load.torque if bins.in_ring else np.nan, "contacts": load.contacts,
    })  # fmt: skip
    table.attrs["units"] = {name: unit for name, (unit, _) in WALL_COLUMNS.items() if unit}
    return table


def write_wall_pressure(folder: str | Path, load: WallPressure, walls: Sequence[Any]) -> Path:
    """Write ``wall_pressure.csv`` into ``folder``."""
    path = Path(folder) / "wall_pressure.csv"
    replace_text(path, wall_table(load, walls).to_csv(index=False, lineterminator="\n"))
    return path


def read_wall_pressure(path: str | Path) -> pandas.DataFrame:
    """Return the table of a file, with its units."""
    import pandas

    table = pandas.read_csv(path, keep_default_na=True)
    table.attrs["units"] = {name: unit for name, (unit, _) in WALL_COLUMNS.items() if unit}
    return table
