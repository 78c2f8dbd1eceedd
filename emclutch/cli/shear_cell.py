"""`emclutch shear-cell`: shear stress and permeability of a powder against the field, from its grains alone."""

from __future__ import annotations

import io
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.atomic_file import json_values, replace_bytes, replace_json, replace_text
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.figure import make_logarithmic
from emclutch.results.progress import Progress
from emclutch.results.report.report import Report, Shown, Statements, Table, note
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import number_or_text, read_list
from emclutch.simulation.forecast.sheared_points import (
    UNITS,
    StressOfField,
    carlson_stress,
    kept_point,
    sheared_point,
    stress_of_field,
)

if TYPE_CHECKING:
    from coupling.powder_cell import ShearParameters
    from field.laws.powder_law import GrainLaw

_FIELD = Quantity("a field strength", "A/m", "80 kA/m", 0.0, 1e7, open_minimum=True)
_FILL = Quantity("a solid fraction", "", "0.32", 0.0, 0.58, open_minimum=True)
_MS = Quantity("a magnetisation", "A/m", "1.7 MA/m", 0.0, 1e7, open_minimum=True)


def grains_of(material: str | None, chi: float | None, Ms: str | None) -> tuple[str, GrainLaw]:
    """Name and law of the grains: of a powder by its name, or of susceptibility and saturation.

    Raises
    ------
    SceneError
        Both or neither, an unknown name, a number out of range.
    """
    from field.laws.materials import grain_material
    from field.laws.powder_law import GrainLaw

    given = {option: f"{value}" for option, value in (("--chi", chi), ("--ms", Ms)) if value is not None}
    if material is not None and given:
        message = f"is the grains' susceptibility or saturation, and {material!r} has its own; remove one of the two"
        raise SceneError([Fault(option, value, message) for option, value in given.items()], "command line")
    if material is None and not given:
        message = "needs the name of a powder (`emclutch materials` lists them), or --chi and --ms of the grains"
        raise SceneError([Fault("shear-cell", "", message)], "command line")
    if len(given) == 1:
        ((option, value),) = given.items()
        message = "needs --ms, the saturation, e.g. --ms '1.7 MA/m'" if option == "--chi" else (
            "needs --chi, the susceptibility, e.g. --chi 1000")  # fmt: skip
        raise SceneError([Fault(option, value, message)], "command line")
    try:
        if material is not None:
            return material, grain_material(material)[0]
        assert chi is not None and Ms is not None
        return f"chi {chi:g}", GrainLaw(chi, _MS.read(number_or_text(Ms)))
    except ValueError as error:
        raise SceneError([Fault("" if material else "--chi, --ms", "", str(error))], "command line") from None


def points_of(
    law: GrainLaw,
    fill: str,
    field_strength: str,
    *,
    seeds: int,
    grains: int,
    strain: float,
    friction: float,
    rolling: float,
    model: str,
) -> list[ShearParameters]:
    """Every fill with every field with every seed; SceneError where one cannot be read or is out of range."""
    from coupling.grain_law_table import MODELS
    from coupling.powder_cell import ShearParameters

    if model not in MODELS:
        raise SceneError([Fault("--model", model, f"is not known; choose one of {', '.join(MODELS)}")], "command line")
    fills, strengths = (
        sorted(set(read_list(fill, _FILL, "--fill"))),
        sorted(set(read_list(field_strength, _FIELD, "--field"))),
    )
    return [
        ShearParameters(
            law=law,
            fill=phi,
            H=H,
            model=model,
            count=grains,
            seed=seed,
            strain=strain,
            friction=friction,
            rolling=rolling,
        )
        for phi in fills
        for H in strengths
        for seed in range(1, seeds + 1)
    ]


def shear_cell(
    name: str, points: list[ShearParameters], out: Path | None = None, *, quiet: bool = False
) -> tuple[Path, list[StressOfField]]:
    """Shear every point, or take it from the cache, and write table and picture after each.

    Parameters
    ----------
    name : str
        Of the powder, for title and folder.
    points : list of ShearParameters
    out : Path or None
        New folder; None: the next runs/<name>-shear-cell-<nnn>.
    quiet : bool
        No progress is shown.

    Returns
    -------
    Path, list of StressOfField
        The folder, with tau_of_field.csv, tau_of_field.png and shear_cell.json; the table's rows.

    Raises
    ------
    OutputError
        The folder is there already.
    SceneError
        A cell too small for its fill.
    """
    _check(points)
    folder = new_folder(out, f"{name.replace(' ', '-')}-shear-cell")
    folder.mkdir(parents=True)
    done: list[dict[str, Any]] = []
    with Progress(f"{name}: {len(points)} points", stream=io.StringIO() if quiet else None) as progress:
        # what is there already comes first: a table at once
        for number, point in enumerate(sorted(points, key=lambda one: kept_point(one) is None)):
            text = f"{name}: fill {point.fill:g}, {point.H / 1e3:g} kA/m, seed {point.seed}"
            progress.update(number / len(points), text)
            done.append(sheared_point(point, partial(_update, progress, number, len(points))))
            rows = _write(folder, name, done, points[0])
        progress.update(1.0, f"{name}: {len(points)} points")
    _draw(folder / "tau_of_field.png", name, rows)
    return folder, rows


def _update(progress: Progress, number: int, of: int, part: float) -> None:
    progress.update((number + part) / of)


def _check(points: list[ShearParameters]) -> None:
    """Refuse cells that are too small before the first is sheared."""
    from coupling.powder_cell import min_count

    short = sorted({(p.fill, min_count(p)) for p in points if p.count < min_count(p)})
    if short:
        needed = "; ".join(f"{count} at a fill of {fill:g}" for fill, count in short)
        message = f"are too few: a grain would meet an image of its neighbours twice; at least {needed}"
        raise SceneError([Fault("--grains", str(points[0].count), message)], "command line")


def _write(folder: Path, name: str, done: list[dict[str, Any]], first: ShearParameters) -> list[StressOfField]:
    rows = stress_of_field(done)
    columns = [one.name for one in fields(StressOfField)]
    lines = [",".join(columns)]
    for row in rows:
        lines.append(",".join("" if value is None else f"{value:.6g}" for value in asdict(row).values()))
    replace_text(folder / "tau_of_field.csv", "\n".join(lines) + "\n")
    run = asdict(replace(first, law=None)) | {"law": repr(first.law)}
    for varied in ("fill", "H", "seed"):
        del run[varied]
    table = [asdict(row) for row in rows]
    replace_json(
        folder / "shear_cell.json", {"material": name, "units": UNITS, "run": run, "table": table, "points": done}
    )
    return rows


def as_data(name: str, folder: Path, rows: list[StressOfField]) -> dict[str, Any]:
    """The table for a machine."""
    return json_values(
        {"material": name, "units": UNITS, "table": [asdict(row) for row in rows], "folder": str(folder)}
    )


def cell_report(name: str, folder: Path, rows: list[StressOfField]) -> Report:
    """Return the shear stress across the field, a row a fill and a field."""
    report = Report(f"{name}: shear stress across the field", data=as_data(name, folder, rows),
                    closing=f"Results and pictures: {folder}")  # fmt: skip
    head = (
        "fill", "H [kA/m]", "tau [kPa]", "slope", "power [kPa]", "Carlson [kPa]", "mu_r at rest", "mu_r", "Carlson",
        "I",
    )  # fmt: skip
    table = [
        (
            f"{row.fill:g}", f"{row.H / 1e3:g}",
            f"{row.tau / 1e3:.3g}{'' if row.tau_error is None else f' ± {row.tau_error / 1e3:.2g}'}",
            "" if row.exponent is None else f"{row.exponent:.2f}", f"{row.power / 1e3:.3g}",
            f"{row.carlson_tau / 1e3:.3g}", f"{row.mu_r_at_rest:.2f}", f"{row.mu_r:.2f}", f"{row.carlson_mu_r:.2f}",
            f"{row.inertial_number:.1e}",
        )
        for row in rows
    ]  # fmt: skip
    report.add("Shear stress", Table(table, head, range(len(head))), Shown.TERMINAL)
    notes = [
        note("±: standard error, of few seeds. Slope: d ln tau/d ln H from the line above. I: inertial number."),
        note("Power: tau by what contacts dissipate. mu_r at rest: of the random packing; mu_r: sheared."),
        note("Carlson: fits for iron in oil (2005)."),
    ]
    return report.add("Columns", Statements(notes), Shown.TERMINAL)


def _draw(path: Path, name: str, rows: list[StressOfField]) -> None:
    """tau against H, both logarithmic, with Carlson's fit."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.2), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    fills = sorted({row.fill for row in rows})
    H_all = np.array([row.H for row in rows])
    H = np.geomspace(0.7 * H_all.min(), 1.4 * H_all.max(), 100)
    for number, fill in enumerate(fills):
        own = [row for row in rows if row.fill == fill and row.tau > 0.0]
        color = f"C{number}"
        error = [2.0 * (row.tau_error or 0.0) / 1e3 for row in own]
        axes.errorbar(
            [row.H / 1e3 for row in own], [row.tau / 1e3 for row in own], yerr=error, color=color, marker="o", ms=4,
            lw=1.4, capsize=3, label=f"sheared cell, fill {fill:g}",
        )  # fmt: skip
        fit = carlson_stress(fill, H)
        axes.plot(H / 1e3, np.asarray(fit) / 1e3, color=color, lw=1.0, ls="--", label=f"Carlson, fill {fill:g}")
    axes.set(xlabel="H [kA/m]", ylabel="shear stress [kPa]")
    make_logarithmic(axes)
    axes.set_title(
        f"{name}: shear stress across the field\n"
        "full: from the grains, two standard errors; dashed: Carlson's fit for iron in oil",
        fontsize=10,
    )
    axes.grid(True, which="both", lw=0.3, alpha=0.5)
    axes.legend(fontsize=8, frameon=False)
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    replace_bytes(path, drawn.getvalue())
