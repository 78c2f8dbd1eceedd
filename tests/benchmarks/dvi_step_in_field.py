"""From which step on does the stress of a magnetised powder by DVI depend on the step, and do its springs matter?

The periodic box of docs/how_to/sheared_box.md, 117 grains of 0.2 mm at a fill of 0.35, is sheared at an inertial number
of about 0.05 across 80 and 300 kA/m. By DEM at the default stiffness, at twice and four times it, each with its step;
by DVI on the springs of the default stiffness with steps from the default to 100 us, and without springs from four
times the default on. A line is the mean shear stress of one replica over strains of 2 to 5; all settings have the
same seeds.

    python tests/benchmarks/dvi_step_in_field.py tests/benchmarks/dvi_step_in_field.csv [--fields 80 300] [--replicas 4]
    python tests/benchmarks/dvi_step_in_field.py tests/benchmarks/dvi_step_in_field.csv --table --picture docs/NAME.png

A line of the file is one replica. Lines that are there already are kept, so that what was interrupted goes on. One
core needs about three minutes for a field and replica.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pandas as pd

import emclutch
from emclutch.results.errors import RunError
from emclutch.results.fits import student
from emclutch.scene.case import Case, case_from
from emclutch.simulation.plan import make_plan

D, EDGE = 0.2e-3, 5.6  # m, diameters
BEGIN, END = 2.0, 5.0  # strains of the average
FIELDS = (80.0, 300.0)  # kA/m
STIFFER = (1.0, 2.0, 4.0)
FRACTIONS = (1.0, 2.0, 4.0, 8.0)  # of the default step; beyond them
LONG = (20e-6, 40e-6, 100e-6)  # s
SCENE: dict[str, Any] = {
    "scene": {"title": "powder across a field"},
    "geometry": {"kind": "sheared_box", "size": 3 * [EDGE * D], "inertial_number": 0.05},
    "field": {"source": "uniform", "field_strength": 80e3, "direction": "z", "means": "macroscopic"},
    "particles": {"diameter": D, "solid_fraction": 0.35},
    "effects": {
        "magnetic_force": {}, "dipoles": {"model": "near_field", "cutoff": 2.5}, "saturation": {},
        "rolling_friction": {},
    },
    "time": {"end": f"strain {END:g}"},
    "accuracy": {"replicas": 1},
    "output": {
        "pictures": False, "snapshots": 0, "formats": [], "checkpoint": False, "profiles": False,
        "energy_budget": False,
    },
}  # fmt: skip
COLUMNS = (
    "field", "method", "stiffness", "step", "of_default", "seed", "stress", "normal_stress", "contacts", "overlap",
    "sweeps", "missed_share", "seconds", "failure",
)  # fmt: skip


def settings(field: float) -> list[dict[str, Any]]:
    """What is run in a field [kA/m], cheap runs first: entries of the scene, and the columns that name them."""
    base = case_from(SCENE, {"field.field_strength": 1e3 * field})
    k = make_plan(base)[1].contact.stiffness.value
    by_dvi = {"contact.method": "dvi", "contact.dvi.allowed_misses": 1.0}
    default = make_plan(base.with_values(by_dvi))[1].dt
    dem = [
        _setting(field, {} if factor == 1.0 else {"contact.stiffness": factor * k}, method="dem", stiffness=factor)
        for factor in STIFFER
    ]
    dvi, rigid = (
        [
            _setting(
                field,
                by_dvi | springs | {"contact.dvi.step": factor * default, "contact.dvi.allow_long_step": True},
                method="dvi",
                stiffness=stiffness,
                of_default=factor,
            )
            for factor in factors
        ]
        for stiffness, springs, factors in (
            (1.0, {}, (*(step / default for step in reversed(LONG)), *reversed(FRACTIONS))),
            (np.inf, {"contact.dvi.springs": False}, (*(step / default for step in reversed(LONG)), 4.0)),
        )
    )
    return [dem[0], *dvi, *rigid, *dem[1:]]


def _setting(field: float, values: dict[str, Any], **names: Any) -> dict[str, Any]:
    values = {"field.field_strength": 1e3 * field} | values
    return {"values": values, "names": {"field": field, "of_default": 1.0} | names}


def key_of(row: dict[str, Any]) -> tuple[str, ...]:
    """What a line of the file is told by."""
    numbers = (f"{float(row[name]):.4g}" for name in ("field", "stiffness", "of_default", "seed"))
    return (str(row["method"]), *numbers)


def measured(case: Case, threads: int = 1) -> dict[str, float | str]:
    """Means of a replica over strains of `BEGIN` to the end; of a run that stops only why it does."""
    with tempfile.TemporaryDirectory() as place:
        try:
            result = emclutch.run(case, out=Path(place) / "run", threads=threads)
        except RunError as error:
            return {"step": make_plan(case)[1].dt, "failure": str(error).splitlines()[0][:120]}
        history, dt = result.history, float(result.summary["dt"])
    late = history[history["shear_strain"] > BEGIN]
    weights = late["steps"]
    found: dict[str, float | str] = {
        "step": dt,
        "stress": float(np.average(late["shear_stress"], weights=weights)),
        "normal_stress": float(np.average(late["normal_stress_z"], weights=weights)),
        "contacts": float(np.average(late["contacts_per_grain"], weights=weights)),
        "overlap": float(late["max_overlap"].max()),
        "seconds": float(history["processor_time"].sum()),
        "failure": "",
    }
    if "sweeps" in history:
        found["sweeps"] = float(np.average(history["sweeps"], weights=history["steps"]))
        found["missed_share"] = float(history["missed_steps"].sum() / history["steps"].sum())
    return found


def write_table(path: Path, fields: list[float], replicas: int) -> None:
    """Run what is missing in the table; every line is written when it is known."""
    kept = set()
    if path.exists():
        with path.open(newline="") as file:
            kept = {key_of(row) for row in csv.DictReader(file)}
    else:
        path.write_text(",".join(COLUMNS) + "\n")
    work = [one for same in zip(*(settings(field) for field in fields), strict=True) for one in same]
    for one, seed in product(work, range(1, replicas + 1)):
        row = one["names"] | {"seed": seed}
        if key_of(row) in kept:
            continue
        row |= measured(case_from(SCENE, one["values"] | {"scene.seed": seed}))
        row = {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()}
        with path.open("a", newline="") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(row)
        print(",".join(f"{row.get(name, '')}" for name in COLUMNS), flush=True)


def table_of(path: Path) -> pd.DataFrame:
    """A row for each field, method, stiffness and step: stress [Pa] and its ratio to DEM's at the default stiffness.

    Half widths are of 95 % intervals by the scatter between replicas of one setting, pooled over all settings of a
    field: few replicas each suffice. Histories part within a strain of a few per cent, so that replicas of two settings
    are independent though they begin alike.
    """
    rows, names = pd.read_csv(path), ["field", "method", "stiffness", "of_default"]
    found = []
    for _, here in rows.groupby("field"):
        good = here.dropna(subset=["stress"])
        groups = good.groupby(names)["stress"]
        freedom = int((groups.count() - 1).sum())
        scatter = np.sqrt(((good.stress / groups.transform("mean") - 1.0) ** 2).sum() / freedom)
        spread = student(freedom) * scatter  # of one replica, relative
        line = good[(good.method == "dem") & (good.stiffness == 1.0)]["stress"]
        for key, group in here.groupby(names):
            kept = group.dropna(subset=["stress"])
            n, ratio = len(kept), kept.stress.mean() / line.mean()
            entry = dict(zip(names, key, strict=True)) | {"replicas": n, "stopped": len(group) - n}
            entry |= {"step": group.step.mean(), "stress": kept.stress.mean(), "ratio": ratio}
            entry["stress_half"] = kept.stress.mean() * spread / n**0.5 if n else np.nan
            entry["ratio_half"] = ratio * spread * (1.0 / n + 1.0 / len(line)) ** 0.5 if n else np.nan
            for name in ("contacts", "overlap", "sweeps", "missed_share", "seconds"):
                entry[name] = kept[name].mean()
            found.append(entry)
    return pd.DataFrame(found)


def draw(path: Path, table: pd.DataFrame) -> None:
    """Stress against step for each field: DVI with error bars, DEM's three stiffnesses, the default step."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    fields = sorted(table.field.unique())
    figure, every = pyplot.subplots(1, len(fields), figsize=(5.0 * len(fields), 4.0), layout="constrained")
    for axes, field in zip(np.atleast_1d(every), fields, strict=True):
        here = table[table.field == field]
        dem, dvi = here[here.method == "dem"], here[(here.method == "dvi") & np.isfinite(here.stiffness)]
        rigid = here[np.isinf(here.stiffness)]
        line = dem[dem.stiffness == 1.0].iloc[0]
        low, high = (1e-3 * (line.stress + sign * line.stress_half) for sign in (-1, 1))
        axes.axhspan(low, high, color="0.9", label="DEM, 95 % interval")
        for one, mark in zip(dem.itertuples(), "osD", strict=False):
            axes.errorbar(1e6 * one.step, 1e-3 * one.stress, 1e-3 * one.stress_half, fmt=f"k{mark}",
                          label=f"DEM, stiffness × {one.stiffness:g}", markersize=4)  # fmt: skip
        axes.errorbar(1e6 * dvi.step, 1e-3 * dvi.stress, 1e-3 * dvi.stress_half, fmt="C0o-", label="DVI, with springs",
                      markersize=4)  # fmt: skip
        axes.errorbar(1e6 * rigid.step, 1e-3 * rigid.stress, 1e-3 * rigid.stress_half, fmt="C3^",
                      label="DVI, rigid grains")  # fmt: skip
        default = dvi[dvi.of_default == 1.0].step.iloc[0]
        axes.axvline(1e6 * default, color="C0", linestyle=":", label="default step of DVI")
        axes.set_xscale("log")
        axes.set_ylim(0.0, None)
        axes.set_xlabel("time step [µs]")
        axes.set_ylabel("shear stress [kPa]")
        axes.set_title(f"Magnetised powder at {field:g} kA/m", loc="left", fontsize=10)
        axes.grid(alpha=0.3)
    np.atleast_1d(every)[0].legend(fontsize=8)
    figure.savefig(path, dpi=150)


def main() -> None:
    """The file, the table, the picture."""
    parser = argparse.ArgumentParser(description="shear stress of a magnetised powder against the step of DVI")
    parser.add_argument("file", type=Path)
    parser.add_argument("--fields", type=float, nargs="+", default=list(FIELDS), help="[kA/m]")
    parser.add_argument("--replicas", type=int, default=4)
    parser.add_argument("--table", action="store_true", help="print the table of what is in the file, run nothing")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    numba.set_num_threads(1)
    if not given.table:
        write_table(given.file, given.fields, given.replicas)
    table = table_of(given.file)
    print(table.to_string(index=False, float_format=lambda x: f"{x:.4g}"))
    if given.picture is not None:
        draw(given.picture, table)


if __name__ == "__main__":
    main()
