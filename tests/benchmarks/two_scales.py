"""Runs of the grains in whole devices, with which torques of the law of the powder are compared.

    python tests/benchmarks/two_scales.py docs/two_scales.csv [--processes 2]
    python tests/benchmarks/two_scales.py docs/two_scales.csv --predict
    python tests/benchmarks/two_scales.py docs/two_scales.csv --table
    python tests/benchmarks/two_scales.py docs/two_scales.csv --sizes
    python tests/benchmarks/two_scales.py docs/two_scales.csv --picture docs/two_scales.png

Each line of the table is one run of one replica on one core, two to five minutes. Lines that are in the file already
are kept and not run again. Twenty devices, held out, are drawn by a seed over the ranges of the law, ten drums and
ten disc clutches: no law is fitted to them, and all are in the table. Columns: what the device is; the torque, mean of
both shafts from one shear strain to another, and its standard error within the run [N m]; mean H [A/m], B [T],
solid fraction and inertial number between the poles; number of grains; processor time [s]. `--predict` writes beside
them what `emclutch check` expects of the scene's own grains, with its 95 % interval, its solid fraction between the
poles and the errors of which the interval consists; `--table` prints the lines for the documentation, and what they
have together.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from gap_cells import append_rows
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from emclutch.device_model.device import Device, build_device
from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT
from emclutch.results.fits import NORMAL
from emclutch.scene.case import Case, case_from, load_case
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
from emclutch.simulation.run import run

CASES = Path(__file__).parents[2] / "cases"
SEED = 20261129  # of the devices that are drawn
Row = dict[str, Any]
DEVICE = (
    "name", "use", "base", "gap", "radius", "pole", "across", "current", "friction", "rolling_friction",
    "susceptibility", "saturation", "spread", "fill", "sector", "inertial_number", "seed", "from_strain", "to_strain",
)  # fmt: skip
COMMON: Row = {
    "field": {"source": "coil"},
    "motion": {"rotor": {"speed": "100 rpm"}, "disc": {"speed": 0.0}},
    "effects": {
        "magnetic_force": {}, "dipoles": {"model": "near_field", "cutoff": 2.5}, "saturation": {}, "wall_images": {},
        "back_reaction": {},
    },
    "contact": {"restitution": 0.5},
}  # fmt: skip
OUTPUT: Row = {
    "accuracy.replicas": 1, "output.pictures": False, "output.snapshots": 1, "output.formats": ["hdf5"],
    "output.energy_budget": False, "output.checkpoint": False,
}  # fmt: skip


def drawn(seed: int, use: str, count: int) -> list[Row]:
    """Devices over the ranges of the law: [mm], [A], [MA/m], else without unit; drums and discs in turn."""
    random = np.random.default_rng(seed)
    rows = []
    for k in range(count):
        across, gap = round(float(random.uniform(6.0, 10.0)), 1), round(float(random.uniform(0.6, 1.4)), 2)
        width = float(random.uniform(20.0, 28.0))  # of a pole, in grains
        field = float(np.exp(random.uniform(np.log(40e3), np.log(200e3))))  # about, between the poles [A/m]
        radius = round(float(random.uniform(12.0, 40.0)), 1)
        powder = {
            "friction": round(float(random.uniform(0.2, 0.7)), 2),
            "rolling_friction": round(float(random.uniform(0.0, 0.5)), 2),
            "susceptibility": round(float(np.exp(random.uniform(np.log(150.0), np.log(1000.0))))),
            "saturation": round(float(random.uniform(1.2, 1.8)), 2),
            "fill": round(float(random.uniform(0.32, 0.46)), 3),
        }  # fmt: skip
        base = ("drum", "disc")[k % 2]
        rows.append(device(f"{use} {k + 1}", use, base, across, width, field, gap, radius, seed=100 + k, **powder))
    return rows


def device(
    name: str, use: str, base: str, across: float, width: float, field: float, gap: float = 1.0, radius: float = 20.0,
    **values: float,
) -> Row:  # fmt: skip
    """A line of a device with a pole `width` grains wide, at about the field [A/m]; values of other columns."""
    row: Row = {
        "name": name, "use": use, "base": base, "gap": gap, "radius": radius, "pole": round(width * gap / across, 2),
        "across": across, "current": round(field * 2.2e-3 * gap / 500.0, 3), "friction": 0.3, "rolling_friction": 0.2,
        "susceptibility": 273.0, "saturation": 1.3, "spread": 1.0, "fill": 0.40, "sector": max(8, ceil(across)),
        "inertial_number": 0.1, "seed": 1, "from_strain": 4, "to_strain": 14,
    }  # fmt: skip
    return row | values


def planned() -> list[Row]:
    """All lines, in the order in which they are run."""
    rows = drawn(1, "fit", 12)
    spills = [(0.3, 0.2), (0.6, 0.05), (0.6, 0.54)]  # friction and rolling friction
    rows += [
        device(f"friction {mu}, rolling {rolling}, fill {fill}; {base}", "spill", base, 6.0, 20.0, 120e3, fill=fill,
               friction=mu, rolling_friction=rolling)
        for base, fills in (("drum", (0.44, 0.36, 0.48)), ("disc", (0.44,)))
        for fill in fills
        for mu, rolling in spills
    ]  # fmt: skip
    rows += [
        device("fill 0.44, weak field; drum", "spill", "drum", 6.0, 20.0, 40e3, fill=0.44),
        device("fill 0.44, 10 grains per gap; drum", "spill", "drum", 10.0, 33.0, 120e3, fill=0.44),
    ]
    rows += drawn(SEED, "held out", 20)
    limits: list[Row] = [
        {"friction": 0.5, "rolling_friction": 0.6}, {"friction": 0.5, "rolling_friction": 0.9}, {"fill": 0.22},
        {"fill": 0.28}, {"susceptibility": 100.0}, {"susceptibility": 2000.0},
        {"inertial_number": 0.02, "to_strain": 9}, {"inertial_number": 0.5}, {"spread": 3.0},
    ]  # fmt: skip
    for k, changes in enumerate(limits):
        name = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in changes.items())
        rows += [
            device(f"{name}; {base}", "limit", base, 6.0, 20.0, 120e3, **changes)
            for base in (("drum", "disc") if k % 2 else ("drum",))
        ]
    rows += [
        device(f"pole of {width} grains, {across} across, seed {seed}", "edge", "drum", across, width, 120e3, seed=seed)
        for across, seeds in ((6.0, (1, 2)), (4.0, (1,)))
        for width in (5, 10, 20, 40)
        for seed in seeds[: 1 if width == 40 else 2]
    ]
    rows += [
        device(f"sector {sector}, seed {seed}", "sector", "drum", 6.0, 20.0, 120e3, sector=sector, seed=seed)
        for sector in (6, 12, 18)
        for seed in (1, 2, 3)
    ]
    for base, across, currents in (("quickstart", 8, (0.6, 1.0)), ("powder_clutch", 6, (0.2, 0.6, 0.94, 1.2))):
        rows += [
            dict.fromkeys(DEVICE, "") | {
                "name": f"{base}, {current} A, {across} across", "use": "shipped", "base": base, "gap": 1.0,
                "across": across, "current": current, "sector": 8, "seed": 1, "inertial_number": 0.1, "from_strain": 4,
                "to_strain": 12,
            }
            for current in currents
        ]  # fmt: skip
    return rows


def case_of(row: Row) -> Case:
    """The scene of a line; an empty value is that of its case."""
    given = {key: row[key] if key in ("name", "use", "base") or row[key] == "" else float(row[key]) for key in DEVICE}
    diameter = f"{given['gap'] / given['across']:.6g} mm" if given["gap"] else ""
    if diameter and given["spread"] and given["spread"] > 1.0:
        middle = 2.0 * given["gap"] / given["across"] / (1.0 + given["spread"])
        ends = {"min": f"{middle:.6g} mm", "max": f"{given['spread'] * middle:.6g} mm"}
        sizes: Row = {"particles.sizes": {"kind": "uniform"} | ends, "particles.diameter": None}
    else:
        sizes = {"particles.diameter": diameter}
    values = {
        "scene.seed": int(given["seed"]), "coil.current": given["current"],
        "contact.friction": given["friction"], "effects.rolling_friction.coefficient": given["rolling_friction"],
        "particles.susceptibility": given["susceptibility"],
        "particles.saturation": given["saturation"] and 1e6 * given["saturation"],
        "particles.solid_fraction": given["fill"], "particles.sector": f"{given['sector']:g} diameters",
        "accuracy.inertial_number": given["inertial_number"], "time.average_from": f"strain {given['from_strain']:g}",
        "time.end": f"strain {given['to_strain']:g}",
    } | sizes  # fmt: skip
    values = {key: value for key, value in values.items() if value != ""} | OUTPUT
    if given["base"] not in ("drum", "disc"):
        case = load_case(CASES / f"{given['base']}.toml")
        mass: Row = {"particles.mass": None} if "particles.solid_fraction" in values else {}
        return case.with_values(values | mass | {"time.until": None, "particles.initial_velocity": "sheared"})
    if not given["rolling_friction"]:
        del values["effects.rolling_friction.coefficient"]
    return case_from(COMMON | {"scene": {"title": row["name"]}} | _device(given), values)


def _device(row: Row) -> Row:
    """Tables of a small drum, or of a disc between two faces, around a gap and poles [mm]."""
    gap, radius, pole, drum = row["gap"], row["radius"], row["pole"], row["base"] == "drum"
    steel = 3.0 + 0.1 * radius
    thickness = 2.0 * pole + 3.0 * gap if drum else 1.5 * steel
    ring = 3.0 * gap if drum else 0.5 * thickness
    sizes = {
        "disc_radius": radius, "disc_thickness": thickness, "gap": gap if drum else 1.0,
        "face_gap": 1.0 if drum else gap,
        "seal_radius": radius - 1.0 if drum else radius - pole, "rotor_wall": steel, "ring_width": ring,
        "cover_thickness": 2.0 if drum else 1.5 * steel, "clearance": 0.3, "coil_width": 0.7 * thickness + 1.0,
        "coil_height": 8.0, "yoke": 1.5 * steel, "shaft_radius": 0.2 * radius,
    }  # fmt: skip
    return {
        "geometry": {"kind": "drum" if drum else "clutch"} | {key: f"{value:.6g} mm" for key, value in sizes.items()},
        "coil": {"turns": 500, "current": 0.0},
        "particles": {"region": "poles" if drum else "faces", "initial_velocity": "sheared", "diameter": "1 mm"},
    }


def measured(row: Row) -> Row:
    """Run a line's device and return the line with what the run has."""
    with tempfile.TemporaryDirectory() as folder:
        found = run(case_of(row), out=Path(folder) / "run", threads=1).summary
    return row | {
        "torque": f"{found['torque']['mean']:.5g}", "standard_error": f"{found['torque']['standard_error']:.3g}",
        "field_strength": f"{found['field_strength_powder']:.5g}", "flux_density": f"{found['gap_flux_density']:.5g}",
        "zone_fill": f"{found['fill_powder']:.5g}", "zone_inertial_number": f"{found['inertial_number']:.3g}",
        "grains": found["grains"], "processor_seconds": f"{found['seconds']['processor']:.0f}",
    }  # fmt: skip


def expected(row: Row) -> tuple[ExpectedTorque, Device]:
    """What is expected of a line's device."""
    case = case_of(row)
    device = build_device(case.scene)
    return expected_torque(case.scene, device, expected_magnetisation(case, device)[0]), device


def predicted(row: Row) -> Row:
    """Return a line with what is expected of it."""
    found, device = expected(row)
    assert found.scene is not None
    error = np.log(found.scene.high / found.scene.mean) / NORMAL
    return row | {
        "predicted": f"{found.scene.mean:.5g}", "predicted_error": f"{error:.3g}",
        "nominal_fill": f"{device.fill.solid_fraction:.4g}", "guess": "" if found.parts else found.law,
    }  # fmt: skip


def print_sizes(rows: list[Row]) -> None:
    """Compare two corrections to grains of 60 um: that of the law, and 1 + a/n^2 on the law's torque of these."""
    (a, *_), real, found = COEFFICIENT, 60e-6, []
    for row in rows:
        case = case_of(row)
        case = case.with_values({"particles.stands_for": real})
        device = build_device(case.scene)
        law = expected_torque(case.scene, device, expected_magnetisation(case, device)[0], unknown_powder=False)
        if law.size_excess is None or law.scene is None or law.torque is None:
            continue
        n, finest = device.shear_gap / case.scene.grains.mean_diameter, device.shear_gap / real
        general = law.torque * (1.0 + a / n**EXPONENT) / (1.0 + a / finest**EXPONENT)
        found.append((row["use"], *(np.log(float(row["torque"]) / torque) for torque in (law.scene.mean, general))))
    print("| devices | number | by the law | by 1 + a/n² |")
    print("|---|---|---|---|")
    for use in (*dict.fromkeys(one[0] for one in found), "all"):
        own = np.array([one[1:] for one in found if use in (one[0], "all")])
        parts = [
            f"{np.exp(mean):.3f}, {100.0 * sd:.1f} %" for mean, sd in zip(own.mean(0), own.std(0, ddof=1), strict=True)
        ]
        print(f"| {use} | {len(own)} | {' | '.join(parts)} |")
    own = np.array([one[1:] for one in found])
    x, y = own[:, 1] - own[:, 0], own[:, 1]
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    error = NORMAL * float(np.sqrt(((y - slope * x) ** 2).sum() / (len(x) - 2) / (x @ x)))
    print(f"\nslope of ln(run by 1 + a/n²) over ln(law's correction by 1 + a/n²): {slope:.2f} ± {error:.2f}")


def misfit(rows: list[Row]) -> np.ndarray:
    """ln(torque of the run / predicted), with the error of both and that of the prediction alone, (3, n)."""
    torque, error, law, law_error = (
        np.array([float(row[name]) for row in rows])
        for name in ("torque", "standard_error", "predicted", "predicted_error")
    )
    return np.array([np.log(torque / law), np.hypot(error / torque, law_error), law_error])


def print_table(rows: list[Row]) -> None:
    """Print the lines as Markdown, and how many lie in their interval."""
    print("| device | friction | rolling friction | susceptibility | grains per gap "
          "| run [N m] | law [N m] | its 95 % interval | run/law |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for row, miss, _, half in zip(rows, *misfit(rows), strict=True):
        powder = " | ".join(row[name] for name in ("friction", "rolling_friction", "susceptibility"))
        run, error, law = (float(row[name]) for name in ("torque", "standard_error", "predicted"))
        outside = " **outside**" if abs(miss) > NORMAL * half else ""
        print(f"| {row['name']}, {row['base']} | {powder} | {float(row['across']):.3g} | ", end="")
        print(f"{run:.4g} ± {NORMAL * error:.1g} | ", end="")
        print(f"{law:.4g} | ± {100.0 * np.expm1(NORMAL * half):.0f} % | {np.exp(miss):.3f}{outside} |")
    for use in dict.fromkeys(row["use"] for row in rows):
        miss, _, half = misfit([row for row in rows if row["use"] == use])
        within, scatter = int((np.abs(miss) < NORMAL * half).sum()), miss.std(ddof=1) if len(miss) > 1 else 0.0
        print(f"{use}: {within} of {len(miss)} in their interval, run/law {np.exp(miss.mean()):.3f}", end="")
        print(f", standard deviation {scatter:.1%}")


def draw(rows: list[Row], path: Path) -> None:
    """Draw torque of runs over the predicted one, against the predicted one."""
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    looks = {"fit": ("C0", "o"), "held out": ("C3", "s"), "shipped": ("C2", "^")}
    for use, (color, marker) in looks.items():
        own = [row for row in rows if row["use"] == use]
        if own:
            miss, _, half = misfit(own)
            law = np.array([float(row["predicted"]) for row in own])
            axes.errorbar(law, np.exp(miss), np.exp(miss) * np.sinh(NORMAL * half), fmt=marker, color=color, ms=5, lw=1,
                          capsize=2, label=f"{use}, {len(own)} devices")  # fmt: skip
    axes.axhline(1.0, color="k", lw=0.8)
    axes.set(xscale="log", xlabel="torque by the law of the powder [N m]", ylabel="torque of the run / by the law",
             title="Torque of runs over torque by the law")  # fmt: skip
    axes.legend(frameon=False, ncols=3, loc="upper center")
    axes.set_ylim(0.5, 1.6)
    FigureCanvasAgg(figure).print_png(path)


def write_rows(path: Path, rows: list[Row]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_rows(path: Path) -> list[Row]:
    """Lines of a table."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table_file", metavar="table", type=Path, help="the file (.csv)")
    parser.add_argument("--processes", type=int, default=2, help="runs at a time, one core each")
    parser.add_argument("--predict", action="store_true", help="write what is expected beside the runs")
    parser.add_argument("--table", action="store_true", help="print the table for the documentation")
    parser.add_argument("--sizes", action="store_true", help="compare corrections to the size of the real grains")
    parser.add_argument("--picture", type=Path, help="draw the runs over the law (.png)")
    asked = parser.parse_args()
    if asked.predict:
        write_rows(asked.table_file, [predicted(row) for row in read_rows(asked.table_file)])
        return
    if asked.sizes:
        print_sizes(read_rows(asked.table_file))
        return
    if asked.table or asked.picture:
        rows = read_rows(asked.table_file)
        if asked.table:
            print_table(rows)
        if asked.picture:
            draw(rows, asked.picture)
        return
    done = {row["name"] for row in read_rows(asked.table_file)} if asked.table_file.exists() else set()
    waiting = [partial(measured, row) for row in planned() if row["name"] not in done]
    append_rows(asked.table_file, waiting, asked.processes)


if __name__ == "__main__":
    main()
