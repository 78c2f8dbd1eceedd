"""A result prints itself: each number defined once, the number to quote first, each statement once, text only shown."""

import importlib
import json
import pkgutil

import pandas
import pytest
from made_up_study import cell
from written_run import undefined, written_run

import emclutch
from emclutch.results import load_result
from emclutch.results.quantities import QUANTITIES, UNITS
from emclutch.results.report.render import Reported, html, markdown, terminal
from emclutch.results.report.report import Mark, Picture, Report, Shown, Statement, Statements, Table, Text
from emclutch.results.statistics import Estimate
from emclutch.results.study_folder import write_about

HOSTILE = "<script>alert(1)</script> | [a](http://b) `c`"
ERROR = {"bias": 0.23, "half_width": 0.08, "total_error": 0.085, "unknown": {}, "extrapolated": {}, "next": None,
         "largest_part": {"name": "grains_per_gap", "half_width": 0.08},
         "accuracy_study": {"note": "", "file": "a", "date": ""}}  # fmt: skip
KNOWN = Estimate(2.0, 0.03, 4, 1e-3, 0.02, True, "steady", replicas=4, status="converged").as_dict()
RISE = {"final_current": 1.0, "current_rise_time": 15e-3, "current_rise_time_90": 34.5e-3}
LOOP = {"rising": 1.0, "falling": 1.2, "share": 0.5, "ratio": 1.2, "width": 0.2, "half_width": 0.1}
RAMP = {"loop": [LOOP], "area": None, "residual": None, "largest_current": 2.0}
RANGE = {"low": 1.1, "high": 3.9}


def test_every_result_reports_itself():
    for module in pkgutil.walk_packages(emclutch.__path__, "emclutch."):
        if not module.name.endswith(("__main__", "paraview_scene")):  # a script for ParaView's own Python
            importlib.import_module(module.name)
    classes = Reported.__subclasses__()
    assert len(classes) >= 10 and all("report" in vars(one) for one in classes)
    shown = {getattr(emclutch, name) for name in emclutch.__all__ if name.endswith("Result")}
    assert shown <= set(classes)


def test_each_renderer_says_a_statement_once_and_only_shows_foreign_text(tmp_path):
    table = Table([[HOSTILE, "2 N m"]], ("of", "torque"), (1,))
    report = Report(HOSTILE, folder=tmp_path, closing="Page: index.html")
    said = [Statement(Mark.GOOD, "Torque: 2 N m."), Statement(Mark.WARNING, HOSTILE)]
    report.add("Result", Statements(said), Shown.TERMINAL)
    report.add("Points", table, Shown.TERMINAL).add("Log", Text("a line of the log"), Shown.PAGE)
    report.add("Nothing", [None, Table([]), Statements([]), Text("")])
    report.add("Drawn", Picture("torque", draw=lambda path: pytest.fail("drawn")))
    shown = terminal(report)
    assert shown.count("Torque: 2 N m.") == shown.count("2 N m\n") == 1 and "a line of the log" not in shown
    assert shown.splitlines()[-1] == "Page: index.html" and HOSTILE in shown
    assert "a line of the log" in terminal(report, details=True)
    page, text = html(report.up_to(Shown.PAGE)), markdown(report, tmp_path)
    for written in (page, text):
        assert "<script" not in written and written.count("Torque: 2 N m.") == 1 and ">Nothing<" not in written
    assert "](http" not in text and "\\|" in text


def test_a_row_of_a_stacked_table_is_a_paragraph_and_details_name_no_command_for_details(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    rows = [
        ("gravity", "off", "weight", "no", "0.1 %", "a long criterion (below 10)"),
        ("dipoles", "on", "forces", "", "", ""),
    ]
    head = ("effect", "", "what it is", "relevant in this run?", "effect on the torque", "criterion (limit)")
    report = Report("A scene", closing="All: --details").add("Effects", Table(rows, head, stacked=True))
    lines = [line.split(maxsplit=2) for line in terminal(report, details=True).splitlines()]
    assert lines == [
        ["Effects"], ["gravity:", "off", "weight"], ["relevant", "in", "this run: no; effect on the torque: 0.1 %"],
        ["a", "long", "criterion (below 10)"], ["dipoles:", "on", "forces"],
    ]  # fmt: skip
    assert terminal(report) == "All: --details"


def test_each_number_of_a_run_is_defined_with_its_unit(tmp_path):
    """What ``summary.json`` has beside numbers are parts, whose names are known as well."""
    summary = emclutch.run(cell(time__end="0.2 ms", time__average_from=None), out=tmp_path / "run", threads=1).summary
    assert undefined(summary) == set()
    assert summary["units"] == {key: unit for key, unit in UNITS.items() if key.split(".")[0] in summary}
    assert [one["text"] for one in summary["verdict"]] == [one.text for one in load_result(tmp_path / "run").verdict]


def test_the_units_of_a_study_are_those_of_its_quantities(tmp_path):
    write_about(tmp_path, "", {}, 1)
    units = json.loads((tmp_path / "study.json").read_text())["units"]
    assert all(units[one.column] == (one.unit or "1") for one in QUANTITIES if one.column)
    assert len({one.key for one in QUANTITIES}) == len(QUANTITIES)


@pytest.mark.parametrize(
    ("written", "changed", "columns", "mark", "headline", "next_line"),
    [
        ({}, {"torque": KNOWN, "discretisation_error": ERROR, "expected_torque_unknown_powder": RANGE}, {}, Mark.GOOD,
         "Torque on the disc: 1.63 N m ± 9.3 % (95 %).",
         "If friction and fill of the powder were unknown: 1.1 to 3.9 N m (90 % range, by the law of the powder); "
         "emclutch powder finds the friction."),
        ({}, {"torque": KNOWN, "slip": 10.0, "current": 0.5}, {}, Mark.GOOD,
         "Torque on the disc: 2 N m ± 4.8 % (95 %), at 0.5 A and 95.49 rpm of slip.", "Friction and fill"),
        ({}, {}, {}, Mark.WARNING, "Torque on the disc: 2.00", "One replica: the scatter between replicas is not in"),
        ({"windows": 10}, {}, {}, Mark.UNUSABLE, "Torque on the disc not known, mean so far 2.01 N m: ",
         "Next: run to 20 ms, another 5 s of processor time: "),
        ({}, RISE, {"current": [1.0]}, Mark.GOOD, "Current: 63 % of its final 1 A at 15 ms, 90 % at 34.5 ms.", ""),
        ({}, {"current_rise_time": None, "current_rise_time_note": "it is 0.5 A"}, {}, Mark.UNUSABLE,
         "The rise of the current is not over at the end of the run: it is 0.5 A; run longer.", ""),
        ({}, {"lock_up_time": 0.1}, {"rotor_speed": [10.0], "disc_speed": [10.0]}, Mark.GOOD,
         "The output locks at 100 ms and turns at 95.49 rpm at the end.", ""),
        ({}, {"torque_against_current": RAMP}, {}, Mark.NOTE, "Torque on the disc at 1 A: 1 N m rising, 1.2 N m", ""),
        ({}, {"stress": KNOWN | {"mean": 2e4, "standard_error": 300.0}}, {"shear_stress": [2e4]}, Mark.GOOD,
         "Shear stress: 20 kPa ± 4.8 % (95 %).", ""),
        ({"finished": False}, {}, {}, Mark.UNUSABLE, "The run is not finished: it has reached 200 ms.",
         "Continue with"),
    ],
    ids=["known with the settings' error", "known without", "one replica", "not converged", "transient", "not over",
         "lock-up", "ramp of current", "sheared box", "not finished"],
)  # fmt: skip
def test_the_number_to_quote_comes_first(tmp_path, written, changed, columns, mark, headline, next_line):
    folder = written_run(tmp_path / "run", **written)
    if changed:
        folder.write_summary(folder.read_summary() | changed)
    table = pandas.read_csv(folder.history)
    table.assign(**{name: values[0] for name, values in columns.items()}).to_csv(folder.history, index=False)
    result = load_result(folder.path)
    first, second, *_ = result.verdict
    assert first.mark is mark and first.text.startswith(headline) and second.text.startswith(next_line)
    shown = terminal(result.report())
    assert shown.startswith(f"{first.mark.sign} {first.text}\n")
    assert shown.splitlines()[-1] == f"Page: {folder.index}"
    texts = [one.text for one in result.verdict]
    assert len(set(texts)) == len(texts) and all(text[-1] == "." and not text[0].islower() for text in texts)
    assert all(len(text.split()) <= 25 for text in texts if text != second.text)  # it may name a folder


def test_a_run_that_fails_says_why_and_that_continuing_does_not_help(tmp_path):
    folder = written_run(tmp_path / "run", finished=False)
    folder.write_failure("raise contact.stiffness")
    first = load_result(folder.path).verdict[0]
    assert first.mark is Mark.UNUSABLE
    assert first.text.startswith("The run failed after 200 ms: raise contact.stiffness; ")
