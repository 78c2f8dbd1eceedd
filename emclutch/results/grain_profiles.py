"""``profiles.csv``: what the grains do across the gap, one row a bin, averaged over the steady part of a run.

Column names carry no unit; unit and meaning of each are in `PROFILE_COLUMNS`. A quantity that a bin does not have (no
grain, nothing that presses) is an empty cell; one that no bin has, such as an angular speed in a box, has no column.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError

if TYPE_CHECKING:
    import pandas

    from particles.diagnostics.profiles import Profile

PROFILE_COLUMNS: dict[str, tuple[str, str]] = {
    "low": ("m", "lower edge of the bin, in the coordinate that `along` names"),
    "high": ("m", "upper edge of the bin"),
    "position": ("m", "mean coordinate of the bin's grains"),
    "solid_fraction": ("1", "fraction of the bin that grains fill"),
    "velocity": ("m/s", "mean velocity of the grains along the flow (phi in a ring, x in a box)"),
    "angular_speed": ("rad/s", "mean speed of the grains about z"),
    "spin": ("rad/s", "mean spin of the grains about z"),
    "temperature": ("m2/s2", "a third of the mean square of the velocity's fluctuation"),
    "shear_rate": ("1/s", "slope of the mean flow across the gap"),
    "pressure": ("Pa", "a third of the trace of the stress, motion included"),
    "normal_stress": ("Pa", "normal stress across the gap, compression positive"),
    "shear_stress": ("Pa", "positive where the far side drives the near one along the flow"),
    "mu": ("1", "|shear stress| over pressure"),
    "inertial_number": ("1", "|shear rate| times d sqrt(density/pressure)"),
    "torque": ("N m", "carried by contacts towards the near side, whole device (in a box a shear force, N)"),
    "contacts": ("1", "contacts in the bin at a moment, in what is simulated"),
}
SLIP = "slip_"


def profile_column(name: str) -> tuple[str, str]:
    """Unit and meaning of a column of profiles.csv; `slip_<body>` for every body of the device."""
    if name.startswith(SLIP):
        return "m/s", f"velocity of the grains relative to the {name.removeprefix(SLIP)} turning along"
    return PROFILE_COLUMNS[name]


def profile_table(profile: Profile) -> dict[str, np.ndarray]:
    """The columns that a profile has, in the order of `PROFILE_COLUMNS`, slips after the speeds."""
    table: dict[str, np.ndarray] = {}
    for name in PROFILE_COLUMNS:
        values = getattr(profile, name)
        if name == "angular_speed" and np.all(np.isnan(values)):
            continue
        table[name] = values
        if name == "angular_speed":
            table |= {SLIP + body: slip for body, slip in profile.slip.items()}
    return table


def write_profiles(folder: str | Path, profiles: Sequence[Profile]) -> Path:
    """Write ``profiles.csv`` into ``folder``: one profile after another, by `along`.

    Raises
    ------
    OutputError
        Without a profile, or where they were averaged over different numbers of moments.
    """
    if not profiles:
        raise OutputError("no profile to write: the run took none; set output.profiles = true")
    if len({profile.moments for profile in profiles}) > 1:
        raise OutputError("profiles of one file must be averaged over the same moments")
    import pandas

    tables = [pandas.DataFrame({"along": one.along, "moments": one.moments, **profile_table(one)}) for one in profiles]
    path = Path(folder) / "profiles.csv"
    known = pandas.concat(tables, ignore_index=True).replace([math.inf, -math.inf], math.nan)
    replace_text(path, known.to_csv(index=False, lineterminator="\n"))
    return path


def read_profiles(path: str | Path) -> dict[str, pandas.DataFrame]:
    """The profiles of a file by coordinate, each a table whose ``attrs["units"]`` holds the units of its columns."""
    import pandas

    found = {}
    rows = pandas.read_csv(path, dtype=str)  # as text: numbers are read to the last bit by float()
    for along, own in rows.groupby("along", sort=False):
        table = own.drop(columns=["along", "moments"]).reset_index(drop=True).astype(float)
        table.attrs["units"] = {name: profile_column(name)[0] for name in table}
        table.attrs["moments"] = int(own["moments"].iloc[0])
        found[str(along)] = table
    return found
