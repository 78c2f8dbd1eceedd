"""Steel that is driven beyond the unsaturated end of its table is reported by every command that solves its field."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.decision import warnings_of
from emclutch.results.report.render import terminal
from emclutch.results.report.verdict import verdict
from emclutch.results.run_folder import RunFolder
from emclutch.scene.case import load_case
from emclutch.simulation.check import check
from field.laws.magnetisation_curve import TableLaw
from field.laws.major_loop import MajorLoopLaw
from field.laws.materials import material, material_names
from field.laws.reluctivity import MU_0
from field.laws.table_end import TableEnd

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"
H, B = (0.0, 100.0, 1000.0, 2000.0), (0.0, 0.5, 0.7, 0.8)  # the last interval rises by 0.1 T/(1000 A/m) = 79.6 mu_0
SHORT = {
    "materials.short": {"law": "table", "H": list(H), "B": list(B)},
    "geometry.materials": {"rotor": "short", "disc": "short"},
    "field.size_factor": 2.0,
}
END = "the curve ends unsaturated at H = 2000 A/m, B = 0.8 T, where dB/dH is still 79.6 mu_0"
WEAK = {"coil.current": "0.1 A"}


@pytest.mark.parametrize("slope", [1.0, 2.0, 5.0, 80.0])
def test_a_table_ends_unsaturated_where_its_last_interval_is_steep(slope):
    """dB/dH there over mu_0 is that of the last two points; where J approaches J_s, none ends unsaturated."""
    points = np.array([0.0, 100.0, 1000.0, 2000.0]), np.array([0.0, 0.5, 1.0, 1.0 + 1000.0 * slope * MU_0])
    end = TableEnd.of(TableLaw(*points, "steel"))
    assert (end is not None) == (slope > 3.0)
    if end is not None:
        assert end.name == "steel" and (end.H, end.B) == pytest.approx((2000.0, points[1][-1]))
        assert end.slope == pytest.approx(slope, rel=1e-9)
        assert TableEnd.of(TableLaw(*points, "steel", J_s=2.0)) is None


def test_other_laws_end_saturated_but_for_a_loop():
    """No built-in material is continued too early; a tail below mu_0 is saturation; a loop ends as a table does."""
    assert all(TableEnd.of(material(name)) is None for name in material_names())
    tail = TableLaw(np.array([0, 100.0, 1e3, 2e3, 1e4]), np.array([0, 0.5, 0.7, 0.8, 0.8 + 4e3 * MU_0]), "tail")
    assert tail.warning and TableEnd.of(tail) is None
    field_strength = np.array([5000, 1000, 500, 100, 0, -50, -100, -200, -500, -1000, -5000.0])
    loop = np.array([1.7, 1.5, 1.45, 1.3, 1.1, 0.5, -0.8, -1.2, -1.4, -1.5, -1.7])
    end = TableEnd.of(MajorLoopLaw(field_strength, loop, "loop"))
    assert end is not None and end.B == pytest.approx(1.7) and 10.0 < end.slope < 200.0


def test_check_and_run_report_it(tmp_path):
    case = load_case(QUICKSTART, SHORT)
    found = check(case)
    (text,) = found.decisions["field"].warnings
    regions = ", ".join(rf"{region} \(short\) is driven to 0.8\d+ T" for region in ("rotor", "disc"))  # worst first
    assert re.match(rf"{regions}: {re.escape(END)}", text) and text in found.report().data["warnings"]
    assert "field" not in warnings_of(check(case.with_values(WEAK)).decisions)
    brief = {"time.end": "0.005 ms", "output.pictures": False, "accuracy.replicas": 1, "time.until": None}
    run = emclutch.run(case.with_values(brief), out=tmp_path / "run")
    warnings = run.summary["steel"]["warnings"]
    assert [text.split()[0] for text in warnings] == ["rotor"]
    assert any("Rotor (short) is driven to" in line.text for line in verdict(run))


def test_field_and_materials_report_it(tmp_path):
    (tmp_path / "short.csv").write_text("H [A/m], B [T]\n" + "".join(f"{h}, {b}\n" for h, b in zip(H, B, strict=True)))
    case = load_case(QUICKSTART, SHORT)
    listed = CliRunner().invoke(app, ["materials", str(tmp_path / "short.csv")])
    assert f"! short: {END}" in " ".join(listed.output.split())
    down = emclutch.field(case, [1.0, 0.1], out=tmp_path / "down")
    assert down.summary["at_last_current"]["largest_flux_density"] < 0.8
    assert [text.split()[0] for text in down.summary["warnings"]] == ["rotor"]  # of the largest current
    assert json.loads((tmp_path / "down" / "field.json").read_text())["warnings"] == down.summary["warnings"]
    assert emclutch.field(case, 0.1, out=tmp_path / "weak").summary["warnings"] == []
    found = emclutch.map(case, current="0.1 A, 1 A", out=tmp_path / "map")
    *_, warning = found.warnings
    assert warning.startswith("1 of 2 points drive steel beyond its table; the interval does not contain the error of")
    assert re.search(r"At coil current 1 A: rotor \(short\) is driven to 0.8\d+ T, disc \(short\) is driven", warning)
    assert [row["remark"] for row in found.rows if not row["is_guess"]] == ["beyond the table of short"]
    assert terminal(found.report()).startswith("! Largest torque")
    assert json.loads((tmp_path / "map" / "map.json").read_text())["warnings"] == found.warnings


def test_results_keep_the_doubts_of_a_table(tmp_path):
    """H in Oe that is said to be A/m: a permeability 20 times that of any steel."""
    table = {"law": "table", "H": [0, 1, 30, 999], "B": [0, 1, 2, 2.1]}
    case = load_case(QUICKSTART, SHORT | {"materials.short": table})
    emclutch.field(case, 0.1, out=tmp_path / "field")
    emclutch.map(case, current="0.1 A, 0.2 A", out=tmp_path / "map")
    for name in ("field/field.json", "field/index.html", "map/map.json", "map/index.html"):
        assert "that of steels 40 000 at most; is H in Oe?" in (tmp_path / name).read_text(encoding="utf-8")


def test_folders_keep_the_scene_and_the_files_of_its_materials(tmp_path):
    rows = "".join(f"{h}, {b}\n" for h, b in zip(H, B, strict=True))
    (tmp_path / "short.csv").write_text("H [A/m], B [T]\n" + rows)
    (tmp_path / "case.toml").write_text(QUICKSTART.read_text(encoding="utf-8"), encoding="utf-8")
    case = load_case(tmp_path / "case.toml", SHORT | {"materials.short": {"table": "short.csv"}})
    emclutch.field(case, 0.1, out=tmp_path / "field")
    emclutch.map(case, current="0.1 A, 0.2 A", out=tmp_path / "map")
    for name in ("field", "map"):
        assert load_case(tmp_path / name / "case.toml").scene == case.scene
        materials = json.loads((tmp_path / name / f"{name}.json").read_text())["materials"]
        assert (materials["rotor"], materials["housing"]) == ("short (short.csv)", "steel_1010")
        assert "short (short.csv)" in (tmp_path / name / "index.html").read_text(encoding="utf-8")
        assert not RunFolder(tmp_path / name).is_begun()  # no run to resume
    assert "disc: short (short.csv)" in check(case).decisions["materials"]
