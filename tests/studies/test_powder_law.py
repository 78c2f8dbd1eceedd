"""`emclutch powder-law`: cells of a powder as a study, their law in the scene, and messages of bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results.errors import OutputError, RunError
from emclutch.scene.errors import SceneError
from emclutch.simulation.forecast.powder_law import powder_of, shipped_laws
from emclutch.studies import powder_law as study
from emclutch.studies.design_search import expectation_of
from field import MU_0

CASES = Path(__file__).resolve().parents[2] / "cases"
COARSE = {"field.size_factor": 4.0, "field.gap_layers": 3}
STRONGER = 1.2
"""Stress of the made-up powder over that of the shipped law."""


def quickstart(**values):
    return emclutch.load_case(CASES / "quickstart.toml", COARSE | values)


def made_up(task, folder, progress):
    """The row of a cell of a powder with another amplitude, without a run."""
    scene = task.case.scene
    H, fill, n = scene.prescribed_field.field_strength, scene.particles.solid_fraction, task.options["height"]
    law, Ms = shipped_laws().nearest(*powder_of(scene))[0], scene.particles.saturation
    mu_r = 1.0 + 8.0 * fill
    B = MU_0 * mu_r * H
    tau = STRONGER * float(law.stress(np.array(B), Ms, fill, n))
    if fill < study.FILL_RANGE[0]:
        raise RunError("the cell has a shear stress of 0 Pa")
    return dict.fromkeys(study.COLUMNS, 0.1) | {
        "field_strength": H, "solid_fraction": fill, "grains_per_gap": n, "seed": task.options["seed"],
        "shear_stress": tau, "standard_error": 0.01 * tau, "flux_density": B, "relative_permeability": mu_r,
        "demagnetising_factor": float("nan"), "inertial_number": 0.1,
    }  # fmt: skip


@pytest.fixture
def cells(monkeypatch):
    monkeypatch.setattr(study, "measure_cell", made_up)


def command(*words):
    return CliRunner().invoke(app, ["powder-law", *map(str, words)], env={"COLUMNS": "500"})


def test_a_shipped_law_that_covers_the_powder_is_taken_and_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    brake = emclutch.load_case(CASES / "powder_clutch.toml", COARSE)
    found = emclutch.powder_law(brake)
    assert found.folder is None and found.law.cells > 20 and not list(tmp_path.iterdir())
    assert found.before.real == expectation_of(brake).real
    text = "\n".join(one.text for one in found.report().statements())
    assert "shipped" in text and "Nothing was measured" in text and "N m" in text


def test_the_law_of_cells_is_used_by_the_scene_and_by_no_other_powder(tmp_path, cells):
    """Grains of another diameter are the same powder; those of another friction are not, and the torque is a guess."""
    case = quickstart()
    found = emclutch.powder_law(case, out=tmp_path / "law", jobs=1)
    law = {"particles.powder_law": str(tmp_path / "law" / "powder_law.json")}
    assert len(found.cells) == len(study.ORDER) and found.law.powder == powder_of(case.scene)
    ratio = found.after.torque / found.before.torque
    assert ratio == pytest.approx(STRONGER, rel=0.03) and not found.after.real.is_guess
    assert expectation_of(quickstart(**law)).real == found.after.real
    finer = expectation_of(quickstart(**law, **{"particles.diameter": "0.2 mm"}))
    assert "measured law" in finer.law and not finer.real.is_guess
    other = expectation_of(quickstart(**law, **{"contact.friction": 0.5}))
    assert other.real.is_guess and "contact.friction = 0.5 for" in other.law
    rough = expectation_of(quickstart(**law, **{"effects.dipoles.surface_gap": 0.02}))
    assert rough.real.is_guess and "effects.dipoles.surface_gap = 0.02 for 0.003" in rough.law
    assert expectation_of(quickstart(**{"effects.dipoles.surface_gap": 0.02})).real.is_guess
    table = pandas.read_csv(tmp_path / "law" / "cells.csv")
    assert list(table.shear_stress) == [row["shear_stress"] for row in found.cells]
    page = (tmp_path / "law" / "index.html").read_text()
    assert page.count("<img") == 1 and "over the law" in page
    assert json.loads((tmp_path / "law" / "report.json").read_text())["law"]["cells"] == len(found.cells)


@pytest.mark.parametrize(
    "values",
    [{"effects.twisting_friction.coefficient": 0.1}, {"effects.dipoles.model": "mutual"},
     {"contact.wall_friction": 0.1}, {"particles.susceptibility": 3000}, {"effects.dipoles.surface_gap": 0.02}],
)  # fmt: skip
def test_powder_that_no_shipped_law_is_of_has_no_range_of_shipped_powders(values, tmp_path, cells):
    """Its friction is as unknown as that of others, and no law has its stress at another one."""
    law = {"particles.powder_law": str(tmp_path / "law" / "powder_law.json")}
    emclutch.powder_law(quickstart(**values), out=tmp_path / "law", jobs=1)
    assert expectation_of(quickstart(), unknown_powder=True).unknown_powder is not None
    found = expectation_of(quickstart(**values, **law), unknown_powder=True)
    assert not found.real.is_guess and found.unknown_powder is None


def test_with_cohesion_coarse_grains_have_no_law_of_the_real_ones(tmp_path, cells):
    """A pull makes a stress that depends on the diameter and, over mu_0 Ms^2, on the temperature."""
    pull = {"effects.cohesion.force": "1 uN"}
    law = {"particles.powder_law": str(tmp_path / "law" / "powder_law.json")}
    emclutch.powder_law(quickstart(**pull), out=tmp_path / "law", jobs=1)
    coarse = expectation_of(quickstart(**pull, **law))
    assert coarse.real.is_guess and "grains of 0.25 mm, real ones have 0.06 mm" in coarse.law
    own = {**pull, **law, "particles.stands_for": None}
    assert not expectation_of(quickstart(**own)).real.is_guess
    warm = expectation_of(quickstart(**own, **{"field.temperature": "150 degC"}))
    assert warm.real.is_guess and "particles.saturation" in warm.law


def test_the_law_in_the_scene_is_taken_where_it_is_of_its_powder(tmp_path, cells, monkeypatch):
    monkeypatch.chdir(tmp_path)
    emclutch.powder_law(quickstart(), out="law", jobs=1, budget=1e-9)
    law = {"particles.powder_law": str(tmp_path / "law" / "powder_law.json")}
    found = emclutch.powder_law(quickstart(**law))
    assert found.folder is None and found.law.measured and found.before.unknown_powder is None
    with pytest.raises(SceneError, match="measure the powder first"):
        emclutch.powder_law(quickstart(**{"particles.powder_law": "none.json"}))


def test_nothing_is_measured_in_the_folder_of_something_else(tmp_path):
    (tmp_path / "map.csv").touch()
    with pytest.raises(OutputError, match="it has no cells; name the folder of an emclutch powder-law"):
        emclutch.powder_law(quickstart(), out=tmp_path, resume=True)
    assert [path.name for path in tmp_path.iterdir()] == ["map.csv"]


def test_a_law_is_continued_with_more_cells_and_without_those_that_are_done(tmp_path, cells, monkeypatch):
    few = emclutch.powder_law(quickstart(), out=tmp_path / "law", jobs=1, budget=1e-9)
    assert len(few.cells) == 3
    measured = []
    monkeypatch.setattr(study, "measure_cell", lambda task, *rest: measured.append(task.name) or made_up(task, *rest))
    more = emclutch.powder_law(quickstart(), out=tmp_path / "law", jobs=1, resume=True)
    assert len(measured) == len(more.cells) - 3 and more.cells[:3] == few.cells
    assert more.law.errors[0] < few.law.errors[0]


def test_cells_that_fail_are_named_and_others_count(tmp_path, cells):
    strengths, fills = [60e3, 120e3], [0.2, 0.38, 0.45]
    found = emclutch.powder_law(quickstart(), out=tmp_path / "law", fields=strengths, fills=fills, jobs=1)
    assert len(found.cells) == 8 and len(found.failures) == 4
    text = "\n".join(one.text for one in found.report().statements())
    assert "has failed: the cell has a shear stress of 0 Pa" in text
    with pytest.raises(RunError, match="0 cells are done, 3 are needed; continue with: emclutch powder-law"):
        emclutch.powder_law(quickstart(), out=tmp_path / "none", fields=[6e4], fills=[0.2, 0.21], jobs=1)


def test_one_field_with_one_fill_has_cells_enough_for_a_law(tmp_path, cells):
    found = emclutch.powder_law(quickstart(), out=tmp_path / "law", fields=[6e4], fills=[0.38], jobs=1)
    assert [row["seed"] for row in found.cells] == [1, 2, 3] and np.isfinite(found.law.errors).all()
    with pytest.raises(SceneError, match="together with fills only"):
        emclutch.powder_law(quickstart(), out=tmp_path / "half", fields=[6e4], jobs=1)
    assert not (tmp_path / "half").exists()


def test_a_fit_of_the_fill_is_by_the_measured_law_and_one_of_the_friction_by_shipped_ones(tmp_path, cells):
    """A law is of one friction: others leave it out, and are no guess of another powder."""
    emclutch.powder_law(quickstart(), out=tmp_path / "law", jobs=1)
    case = quickstart(**{"particles.powder_law": str(tmp_path / "law" / "powder_law.json")})
    torques = [(I, expectation_of(case.with_values({"coil.current": I})).torque) for I in (0.4, 0.7, 1.0)]
    rows = "".join(f"{I},{T},{0.02 * T}\n" for I, T in torques)
    (tmp_path / "curve.csv").write_text(f"current [A],torque [N m],error [N m]\n{rows}")
    known = {"friction": 0.3, "rolling_friction": 0.2}
    of_fill = emclutch.fit(case, tmp_path / "curve.csv", **known, fill=(0.35, 0.48), out=tmp_path / "fill").fit
    assert of_fill.parameters[0].value == pytest.approx(case.scene.particles.solid_fraction, abs=5e-3)
    assert not of_fill.is_guess and not of_fill.guess_at.any()
    of_friction = emclutch.fit(case, tmp_path / "curve.csv", rolling_friction=0.2, out=tmp_path / "friction")
    assert not of_friction.fit.is_guess and not of_friction.expected.real.is_guess
    assert of_friction.case.scene.particles.powder_law is None


def test_no_cell_is_thinner_than_three_of_the_largest_grains(tmp_path, cells):
    """Four mean grains of a powder of wide sizes are less than three of its largest."""
    sizes = {"kind": "percentiles", "d10": "0.1 mm", "d50": "0.15 mm", "d90": "0.25 mm"}
    wide = quickstart(**{"particles.diameter": None, "particles.sizes": sizes, "particles.sector": "9 deg"})
    grains, found = wide.scene.particles, emclutch.powder_law(wide, out=tmp_path / "law", jobs=1)
    heights = np.array([row["grains_per_gap"] for row in found.cells]) * grains.mean_diameter
    assert 4.0 * grains.mean_diameter < 3.0 * grains.largest_diameter <= heights.min() * (1.0 + 1e-9)
    assert found.law is not None and not found.after.real.is_guess


def test_without_faces_there_is_a_table_and_no_law(tmp_path, cells):
    found = emclutch.powder_law(quickstart(), out=tmp_path / "box", walls="none", jobs=1)
    own = ("field_strength", "solid_fraction", "seed")
    assert len({tuple(row[name] for name in own) for row in found.cells}) == len(found.cells)  # none is run twice
    assert found.law is None and found.after is None and not (tmp_path / "box" / "powder_law.json").exists()
    assert (tmp_path / "box" / "powder_law.png").stat().st_size > 10_000


def test_a_cell_of_grains_has_the_stress_of_its_scene(tmp_path):
    """A cell of half a strain: the row is that of the run's own summary, B = mu_0 mu_r H."""
    task = study._tasks(quickstart(), [(40e3, 0.3, 4, 1)], "steel")[0]
    values = {"time.end": "strain 0.5", "time.average_from": "strain 0.1", "output.energy_budget": True}
    short = task._replace(case=task.case.with_values(values))
    (tmp_path / "cell").mkdir()
    row = study.measure_cell(short, tmp_path / "cell", None)
    own = emclutch.load_result(tmp_path / "cell").summary
    assert row["shear_stress"] == own["shear_stress"] and row["grains"] == own["grains"]
    assert row["flux_density"] == pytest.approx(own["flux_density"], rel=1e-12)
    assert set(row) == set(study.COLUMNS)


def test_a_powder_without_attraction_has_no_law():
    with pytest.raises(SceneError, match=r"needs grains that attract .* add \[effects.dipoles\]"):
        emclutch.powder_law(CASES / "thesis" / "centrifugal_held.toml")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--walls", "glass"), "choose one of steel, none"),
        (("--field", "80 kA/m"), "together with --fill only"),
        (("--field", "80 kA/m", "--fill", "0.9"), "--fill"),
        (("--fill", "0.9"), "<= 0.58"),
        (("--field", "1 A"), "80 kA/m"),
        (("--budget", "soon"), "--budget"),
        (("--resume", "--out", "nowhere"), "nothing to resume"),
    ],
)
def test_bad_input_is_told_with_its_remedy(words, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = command(CASES / "quickstart.toml", *words)
    assert result.exit_code == 2 and text in result.output and "Traceback" not in result.output, result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "text"),
    [(None, "cannot be read"), ("{}", "is no law of a powder"), ('{"version": 0, "powder": 1}', "is no law")],
)
def test_a_file_that_is_no_law_is_refused_with_its_key(content, text, tmp_path):
    path = tmp_path / "law.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SceneError, match=r"particles\.powder_law") as caught:
        expectation_of(quickstart(**{"particles.powder_law": str(path)}))
    assert text in str(caught.value) and "emclutch powder-law" in str(caught.value)
