"""`emclutch powder-law`: the law of a scene's powder, measured by cells of its grains.

A cell is some hundred grains of the scene's powder in a given field, sheared between two faces of steel
(`geometry.kind = "sheared_box"`, `walls = "steel"`). The cells lie about the field and the fill that the powder has in
the scene. Their stresses give the powder's own coefficients of the law (`emclutch.simulation.forecast.powder_law`),
which a scene uses by `particles.powder_law`. With `walls = "none"` the powder is sheared without faces, and there is a
table of its stress, but no law.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import logging
import os
import shlex
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.device_model.device import build_device
from emclutch.device_model.materials import saturation_of
from emclutch.devices.sheared_box import MIN_LAYERS
from emclutch.results import OutputError
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.fits import NORMAL
from emclutch.results.pictures.powder_law import powder_law_picture
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import (
    Links,
    Mark,
    Picture,
    Report,
    Shown,
    Statement,
    Statements,
    Table,
    note,
    warning,
)
from emclutch.results.run_folder import RunFolder
from emclutch.scene.case import Case, as_case, case_from
from emclutch.scene.errors import Fault, SceneError, bad_input_for
from emclutch.scene.fill import fill_of
from emclutch.scene.flat import flat
from emclutch.scene.input_files import file_contents
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_list, seconds_of
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, fill_between_poles
from emclutch.simulation.forecast.powder_law import (
    BASE_INERTIA,
    MIN_CELLS,
    RANGES,
    PowderLaw,
    law_of,
    powder_entries,
    powder_of,
)
from emclutch.simulation.run import run
from emclutch.studies.attempt import ATTEMPTS, clear_attempt
from emclutch.studies.design_search import expectation_of
from emclutch.studies.study import DONE, FAILED, Row, Study, Task, TaskProgress, checked_jobs, child_processes
from field import MU_0

if TYPE_CHECKING:
    from emclutch.results import Progress

log = logging.getLogger(__name__)
LAW, CELLS = "powder_law.json", "cells.csv"
BUDGET = 600.0
"""Default wall-clock time of the cells [s]."""

EDGE, ROOM = 8.0, 5.9
"""Edge of a cell along the faces in mean diameters, and in largest diameters at least."""

STRAINS = ("strain 5", "strain 15")
"""From which is averaged, and at which a cell ends."""

FIELDS, FILLS = (1.0, 0.4, 0.16), (1.0, 0.8, 1.2)
"""Of the cells over those of the scene."""

FIELD_RANGE = (0.012, 0.17)
"""H/Ms of the cells that the law was fitted to."""

FILL_RANGE = (0.25, RANGES["fill"][1])

ORDER: tuple[tuple[int, int, int, int], ...] = (
    (0, 0, 8, 1), (1, 0, 8, 1), (0, 2, 8, 1), (0, 1, 8, 1), (0, 0, 8, 2), (0, 0, 4, 1), (0, 2, 8, 2), (0, 1, 8, 2),
    (0, 0, 12, 1), (2, 0, 8, 1), (1, 2, 8, 1), (1, 1, 8, 1), (0, 2, 4, 1), (0, 2, 12, 1), (1, 0, 8, 2), (2, 2, 8, 1),
    (2, 1, 8, 1), (0, 0, 8, 3), (0, 2, 8, 3), (0, 0, 12, 2), (1, 2, 8, 2),
)  # fmt: skip
"""Cells by the numbers of their field and fill, grains between the faces, and seed: the most useful ones first."""

COLUMNS = (
    "field_strength", "solid_fraction", "grains_per_gap", "seed", "shear_stress", "standard_error", "normal_stress",
    "flux_density", "relative_permeability", "demagnetising_factor", "inertial_number", "shear_strain", "grains",
    "processor_seconds",
)  # fmt: skip
"""Of cells.csv, in SI."""

EFFECTS = (
    "magnetic_force", "dipoles", "saturation", "rolling_friction", "twisting_friction", "cohesion",
)  # fmt: skip
"""Of the scene that a cell has too."""

_FIELD = Quantity("a field strength", "A/m", "80 kA/m", 0.0, 1e7, open_minimum=True)
_FILL = Quantity("a solid fraction", "", "0.32", 0.0, 0.58, open_minimum=True)
PARTICLES = ("diameter", "sizes", "density", "susceptibility", "saturation", "law")
OUTPUT = {"pictures": False, "snapshots": 1, "formats": ["hdf5"], "energy_budget": False, "checkpoint": False}


@dataclass(frozen=True, slots=True)
class PowderLawResult(Reported):
    """The law of a powder, with the cells that it was fitted to.

    Attributes
    ----------
    folder : Path or None
        With powder_law.json, cells.csv, powder_law.png and index.html; None where a known law covers the powder.
    case : Case
        The scene of the powder.
    law : PowderLaw or None
        None without faces.
    cells : tuple of dict
        Rows of cells.csv.
    failures : dict of str to str
        Reasons by the names of the cells that have failed.
    before, after : ExpectedTorque or None
        Of the scene by the law known before and by the measured one; None of a scene without a device.
    """

    folder: Path | None
    case: Case
    law: PowderLaw | None
    cells: tuple[dict[str, Any], ...] = ()
    failures: dict[str, str] | None = None
    before: ExpectedTorque | None = None
    after: ExpectedTorque | None = None

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Columns of the cells, as `PowderLaw.fit` takes them."""
        found = {name: np.array([row[name] for row in self.cells], dtype=float) for name in COLUMNS}
        return found | {"saturation": np.full(len(self.cells), saturation_of(self.case.scene))}

    def stress_by_law(self, row: dict[str, Any], law: PowderLaw) -> float:
        """Return the law's stress [Pa] at the flux density of a cell."""
        fill, n, inertia = (row[name] for name in ("solid_fraction", "grains_per_gap", "inertial_number"))
        return float(law.stress(np.array(row["flux_density"]), saturation_of(self.case.scene), fill, n, inertia))

    def report(self) -> Report:
        """Return the law's error, the torque by it, the cells, and how a scene uses it; data in SI."""
        law, torques = self.law, {"shipped": self.before, "measured": self.after}
        data = {
            "case": self.case.name, "folder": None if self.folder is None else str(self.folder),
            "law": None if law is None else {"powder": law.powder, "coefficients": law.coefficients.tolist(),
                                             "errors": law.errors.tolist(), "cells": law.cells},
            "expected_torque": {name: one.as_dict() for name, one in torques.items() if one is not None},
            "cells": list(self.cells), "failures": self.failures or {},
        }  # fmt: skip
        report = Report(f"Law of the powder: {self.case.name}", data=data, folder=self.folder)
        report.add("Result", Statements([*self._statements()]), Shown.TERMINAL)
        if self.folder is None:
            return report
        report.add("Picture", Picture("shear stress over flux density", self.folder / "powder_law.png"), Shown.PAGE)
        head = ["H [kA/m]", "fill", "grains per gap", "seed", "B [T]", "mu_r", "tau [kPa]", "± 95 %"]
        rows = []
        for row in self.cells:
            error = NORMAL * row["standard_error"] / row["shear_stress"]
            found = [f"{row['field_strength'] / 1e3:.4g}", f"{row['solid_fraction']:.3f}", f"{row['grains_per_gap']:g}",
                     f"{row['seed']}", f"{row['flux_density']:.3f}", f"{row['relative_permeability']:.3g}",
                     f"{row['shear_stress'] / 1e3:.3g}", f"{100.0 * error:.1f} %"]  # fmt: skip
            rows.append(found + ([f"{row['shear_stress'] / self.stress_by_law(row, law):.3f}"] if law else []))
        head += ["over the law"] if law else []
        report.add("Cells", Table(rows, head, range(len(head))), Shown.TERMINAL if law is None else Shown.PAGE)
        files = [(CELLS, "all cells in SI")] + ([(LAW, "the law, for particles.powder_law")] if law else [])
        return report.add("Files", Links(files), Shown.PAGE)

    def _statements(self) -> Iterator[Statement]:
        law, device, path = self.law, self.after or self.before, self.case.path or "CASE"
        if law is not None:
            words = "friction {:.3g}, rolling friction {:.3g}, susceptibility {:.4g}".format(*law.powder)
            how = "measured" if law.measured else "shipped"
            yield Statement(Mark.GOOD, f"Law of the powder with {words}: {how}, {law.cells} cells.")
            yield note(f"Cells deviate from it by {100.0 * law.deviation:.2g} % (standard deviation).")
        else:
            yield Statement(Mark.GOOD, f"{len(self.cells)} cells without faces: their stress is no law of a device.")
        if device is not None and device.real is not None:
            mark = Mark.WARNING if device.real.is_guess else Mark.GOOD
            yield Statement(mark, f"Expected torque of the scene: {device.real.in_words()}.")
            if device.real.is_guess:
                yield note(f"{device.law[:1].upper()}{device.law[1:]}.")
        if self.after is not None and self.before is not None and self.before.real is not None:
            yield note(f"By the shipped laws: {self.before.real.in_words()}.")
        for name, reason in (self.failures or {}).items():
            yield warning(f"{name} has failed: {reason}")
        if self.folder is None:
            yield note(f"Nothing was measured. To measure it: emclutch powder-law {path} --budget '10 min'")
        elif law is not None:
            file = os.path.relpath(self.folder / LAW, Path(path).parent)
            words = shlex.join([str(path), "--current", "0.1 A:1 A", "--set", f"particles.powder_law={file}"])
            yield note(f"Next, with the currents of the device: emclutch map {words}, or with this key in the scene.")


def powder_law(
    case: Case | str | Path,
    *,
    budget: float | str | None = None,
    walls: str = "steel",
    fields: Sequence[float] = (),
    fills: Sequence[float] = (),
    out: str | Path | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> PowderLawResult:
    """Measure the law of a scene's powder by cells of its grains, or return the known one that covers it.

    A known law is that of `particles.powder_law`, or a shipped one with cells of the same friction, rolling friction
    and susceptibility. It is returned where no argument but `case` is given.

    Parameters
    ----------
    case : Case, or the path of a scene file
        Of a device, or of a box that is sheared.
    budget : wall-clock time of this call [s], or a text "20 min", by default `BUDGET`; the first three cells are
        measured whatever it is.
    walls : ``"steel"``, or ``"none"`` for cells without faces, which have a table of stresses and no law.
    fields, fills : field strengths [A/m] and solid fractions [-] of the cells, each with each; default: about those
        that the powder has in the scene.
    out : folder; default: the next powder_laws/<case>-<nnn>.
    jobs : cells at a time, each in a process of its own; default: the cores.
    executor : where cells are measured instead, as of `emclutch.sweep`.
    resume : continue in the folder: cells that are done are kept.
    progress : takes the part of the cells, or of the budget, that is done.

    Raises
    ------
    SceneError
        Faults of the scene; its powder has no law; its cells are not valid.
    OutputError
        The folder is not empty, or there is nothing to resume in it.
    RunError
        Fewer than three cells are done.
    Interrupted
        Ctrl-C; the cells that are done stay.
    """
    case, at_a_time = as_case(case), checked_jobs(jobs)
    budget = seconds_of(budget, "budget")
    scene = case.scene
    case.need_grains()
    if walls not in ("steel", "none"):
        raise SceneError([Fault("--walls", walls, "is not known; choose one of steel, none")], "powder-law")
    if scene.effects.attraction is None or not scene.effects.saturate or scene.grains.packing == "file":
        needs = "needs grains that attract one another and saturate, and no packing from a file, to have a law; add "
        message = f"{needs}[effects.dipoles] and [effects.saturation]"
        raise SceneError([Fault("powder-law", "", message)], str(case.path or "scene"))
    asked = budget is not None or fields or fills or resume or walls == "none" or out is not None
    known, doubts = law_of(scene)
    if known.cells and not doubts and not asked:
        device = None if scene.geometry.is_periodic else expectation_of(case)
        return PowderLawResult(None, case, known, before=device)
    unmeasured = case.with_values({"particles.powder_law": None})
    before = None if scene.geometry.is_periodic else expectation_of(unmeasured)
    shipped, doubts = law_of(unmeasured.scene)
    if bool(fields) != bool(fills):
        given, missing = ("fields", "fills")[:: 1 if fields else -1]
        raise SceneError([Fault(given, "", f"choose the cells together with {missing} only; give both")], "powder-law")
    if not fields:
        H, fill = _operating_point(unmeasured, before)
        low, high = (end * saturation_of(scene) for end in FIELD_RANGE)
        fields = [min(max(part * H, low), high) for part in FIELDS]
        fills = [min(max(part * fill, FILL_RANGE[0]), FILL_RANGE[1]) for part in FILLS]
        order = ORDER
    else:
        fields, fills = sorted(set(fields)), sorted(set(fills))
        seeds = range(1, 1 + max(2, ceil(MIN_CELLS / (len(fields) * len(fills)))))
        order = tuple((i, k, 8, seed) for seed in seeds for i in range(len(fields)) for k in range(len(fills)))
    thinnest = ceil(MIN_LAYERS * scene.grains.largest_diameter / scene.grains.mean_diameter - 1e-9)
    cells_of = [(fields[i], fills[k], max(n, thinnest) if walls == "steel" else 8, seed) for i, k, n, seed in order]
    tasks = _tasks(unmeasured, cells_of, walls)
    folder = Path(out) if out is not None else RunFolder.next_path(case.name, "powder_laws")
    if resume and not folder.is_dir():
        raise OutputError(f"nothing to resume in {folder}: there is no such folder; name the law's folder with --out")
    if resume and not [*folder.glob("H=*"), *folder.glob(f"{ATTEMPTS}/H=*")]:
        raise OutputError(f"nothing to resume in {folder}: it has no cells; name the folder of an emclutch powder-law")
    with child_processes(at_a_time) if executor is None else nullcontext(executor) as workers:
        cells = _Cells(folder, workers, None if workers is executor else at_a_time, budget or BUDGET, progress)
        with cells.opened(resume):
            cells.total = len(tasks)
            cells.run(tasks)
    rows = [cells.rows[task.name] for task in tasks if task.name in cells.rows]
    done = tuple(row.values for row in rows if row.state == DONE)
    failures = {name: row.short_reason for name, row in cells.rows.items() if row.state == FAILED}
    how = f"continue with: emclutch powder-law {case.path or 'CASE'} --out {folder} --resume"
    if cells.stopped:
        raise Interrupted(f"stopped with {len(done)} cells done; {how}")
    if len(done) < MIN_CELLS:
        reasons = "".join(f"{name}: {reason}\n" for name, reason in failures.items())
        raise RunError(f"{reasons}{len(done)} cells are done, {MIN_CELLS} are needed; {how}")
    result = PowderLawResult(folder, unmeasured, None, done, failures, before)
    if walls == "steel":
        prior = replace(shipped, powder=powder_of(scene))
        result = replace(result, law=prior.fit(result.columns, powder_entries(scene), bool(doubts)))
        assert result.law is not None
        result.law.write(folder / LAW)
        if before is not None:
            measured = unmeasured.with_values({"particles.powder_law": str((folder / LAW).resolve())})
            result = replace(result, after=expectation_of(measured))
    _write(result)
    return result


def chosen_cells(fields: str | None, fills: str | None) -> tuple[list[float], list[float]]:
    """Return field strengths [A/m] and solid fractions [-] of lists in text; SceneError for what is none."""
    H = [] if fields is None else read_list(fields, _FIELD, "--field")
    return sorted(set(H)), sorted(set([] if fills is None else read_list(fills, _FILL, "--fill")))


def _write(result: PowderLawResult) -> None:
    """Write table, picture and page into the folder."""
    assert result.folder is not None
    table = io.StringIO()
    writer = csv.DictWriter(table, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(result.cells)
    replace_text(result.folder / CELLS, table.getvalue())
    title = f"{result.case.scene.scene.title}: shear stress of the powder"
    law, Ms = result.law, saturation_of(result.case.scene)
    stress = None if law is None else lambda B, fill, n: law.stress(B, Ms, fill, n)
    powder_law_picture(result.folder / "powder_law.png", result.columns, stress, title)
    report = result.report()
    replace_json(result.folder / "report.json", report.data)
    write_index(report)


def _operating_point(case: Case, expected: ExpectedTorque | None) -> tuple[float, float]:
    """Return field [A/m] and solid fraction of the powder in a scene; SceneError without a field."""
    scene = case.scene
    if expected is None:
        field = scene.prescribed_field
        H, fill = (
            0.0 if field is None else abs(field.field_strength),
            fill_of(scene.shape(), scene.grains).solid_fraction,
        )
    else:
        with bad_input_for(case.path):
            device = build_device(scene)
        real = scene.grains.real_diameter or scene.grains.mean_diameter
        H, fill = expected.H, fill_between_poles(device, law_of(scene)[0], real)
    if H == 0.0:
        message = "needs a field across the powder; give the scene one, or --field and --fill"
        raise SceneError([Fault("powder-law", "", message)], str(case.path or "scene"))
    return H, fill


def _tasks(case: Case, cells: Sequence[tuple[float, float, int, int]], walls: str) -> list[Task]:
    """Return a task for each cell of field [A/m], solid fraction, grains between the faces and seed; SceneError."""
    whole: dict[str, Any] = case.resolved()
    tasks: dict[str, Task] = {}
    d, largest = case.scene.grains.mean_diameter, case.scene.grains.largest_diameter
    effects = {name: table for name, table in whole["effects"].items() if name in EFFECTS}
    particles = {name: whole["particles"][name] for name in PARTICLES if name in whole["particles"]}
    edge = max(EDGE * d, ROOM * largest)
    for H, fill, n, seed in cells:
        height = edge if walls == "none" else n * d
        data = {
            "scene": {"title": "Powder between two faces of steel", "seed": seed},
            "geometry": {"kind": "sheared_box", "size": [edge, edge, height], "inertial_number": BASE_INERTIA},
            "field": {"source": "uniform", "direction": "z", "means": "macroscopic", "field_strength": H,
                      "temperature": whole["field"]["temperature"]},
            "particles": particles | {"solid_fraction": fill},
            "contact": whole["contact"],
            "effects": effects,
            "time": {"average_from": STRAINS[0], "end": STRAINS[1]},
            "accuracy": {"replicas": 1},
            "output": OUTPUT,
        }  # fmt: skip
        if walls == "steel":
            data["geometry"]["walls"] = walls
            data["effects"] = effects | {"wall_images": {}}
        cell = case_from(data)
        described = json.dumps([flat(cell.resolved()), file_contents(cell.scene)], sort_keys=True, default=str)
        digest = hashlib.sha256(described.encode()).hexdigest()
        name = f"H={H / 1e3:.4g}kA,fill={fill:.3f},n={n},seed={seed}_{digest[:8]}"
        tasks[name] = Task(name, cell, measure_cell, {"height": height / d, "seed": seed}, "", digest)
    return [*tasks.values()]


def measure_cell(task: Task, folder: Path, progress: TaskProgress) -> dict[str, Any]:
    """Run a cell on one thread and return its row of cells.csv.

    Options: `height` of the cell in mean diameters, `seed`.

    Raises
    ------
    RunError
        It has no shear stress above 0.
    """
    clear_attempt(folder)  # of what a process has left that was ended
    begun = time.process_time()
    scene, found = task.case.scene, run(task.case, out=folder, threads=1, progress=progress).summary
    tau, mu_r = found["shear_stress"], found.get("relative_permeability")
    H = scene.prescribed_field.field_strength  # type: ignore[union-attr]
    if not tau or tau <= 0.0 or not mu_r:
        raise RunError(f"the cell has a shear stress of {tau} Pa; its powder does not hold together")
    return {
        "field_strength": H, "solid_fraction": fill_of(scene.shape(), scene.grains).solid_fraction,
        "grains_per_gap": task.options["height"], "seed": task.options["seed"], "shear_stress": tau,
        "standard_error": found["shear_stress_error"] or 0.0, "normal_stress": found["normal_stress"]["mean"],
        "flux_density": MU_0 * mu_r * H, "relative_permeability": mu_r,
        "demagnetising_factor": found.get("demagnetising_factor") or float("nan"),
        "inertial_number": found["inertial_number_of_shear_stress"], "shear_strain": found["shear_strain"],
        "grains": found["grains"], "processor_seconds": time.process_time() - begun,
    }  # fmt: skip


class _Cells(Study):
    """Cells until a budget is spent."""

    def __init__(self, folder: Path, executor: Executor | None, at_a_time: int | None, budget: float, progress: Any):
        super().__init__(folder, executor, at_a_time)
        self.budget, self.progress, self.total = budget, progress, 0
        self.start, self.count = time.monotonic(), 0

    def may_begin(self, task: Task) -> bool:
        """True for the first cells, and as long as one more ends within the budget."""
        spent, done = time.monotonic() - self.start, [row.wall for row in self.rows.values() if row.wall > 0.0]
        longest = max(done, default=0.0)
        return self.count < MIN_CELLS or spent + longest <= self.budget

    def begun(self, task: Task) -> None:
        self.count += 1

    def ended(self, task: Task, row: Row, kept: bool) -> None:
        self.count += kept
        if row.state == DONE and not kept:
            log.info("%s: %.4g kPa in %.3g s", task.name, row.values["shear_stress"] / 1e3, row.seconds)

    def look(self, running: Sequence[Task]) -> None:
        if self.progress is not None:
            done = sum(row.state == DONE for row in self.rows.values())
            part = max(done / self.total, min(0.97, (time.monotonic() - self.start) / self.budget))
            self.progress.update(part, f"{done} cells done, of {MIN_CELLS} to {self.total}")
