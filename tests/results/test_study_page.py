"""The page of a study says what each point is at, draws each torque where it belongs, and loads nothing."""

import xml.etree.ElementTree as ElementTree

import pandas
import pytest
from emclutch.results.report.content import study_page as content_page
from emclutch.results.report.study_page import FailedPoint, StudyState, study_page, write_study_page
from matplotlib.figure import Figure
from written_run import written_study

from emclutch.results import RunFolder, load_result
from emclutch.results.pictures.torque_curves import BEST, _draw_torques
from emclutch.results.report.render import html
from emclutch.results.study_folder import read_study
from emclutch.results.study_result import best_estimate_lines
from emclutch.results.study_table import DONE, FAILED, RUNNING, WAITING, PointRow
from emclutch.results.torque_curves import torque_curves
from emclutch.studies.tables import row_of

CURRENT, FRICTION = "coil.current", "contact.friction"
SVG = "{http://www.w3.org/2000/svg}"


def state_of(folder, **changes):
    """2 x 3 points: four done, one of them without a verdict; one failed, one runs, ..."""
    currents, frictions = ["0.5 A", "1 A", "2 A"], [0.2, 0.4]
    values = {FRICTION: frictions, CURRENT: currents}
    whole = [(f, i) for f in frictions for i in currents]
    rows = [
        {FRICTION: f, CURRENT: i, "torque": 10.0 * f * float(i.split()[0]), "standard_error": 0.1, "low": None,
         "high": None, "converged": k != 1}
        for k, (f, i) in enumerate(whole[:4])
    ]  # fmt: skip
    points = [PointRow(f"friction {f}, current {i}") for f, i in whole]
    for point, row in zip(points, rows, strict=False):
        point.state, point.torque, point.converged, point.seconds = DONE, row["torque"], row["converged"], 75.0
    points[4].state, points[5].state, points[5].fraction = FAILED, RUNNING, 0.25
    (folder / "point-004").mkdir(exist_ok=True)
    (folder / "point-004" / "run.log").write_text("\n".join(f"line {k}" for k in range(50)))
    failures = [FailedPoint(folder / "point-004", points[4].label, "grains <overlap>; raise contact.stiffness")]
    given = {"title": "A <b>study</b>", "values": values, "names": [f"point-{k:03d}" for k in range(6)],
             "points": points, "rows": rows, "failures": failures, "seconds_left": 150.0,
             "is_running": True}  # fmt: skip
    return StudyState(folder, **(given | changes))


def drawing(page):
    return ElementTree.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])


def test_each_torque_is_drawn_at_its_current_and_the_axes_are_linear(tmp_path):
    svg = drawing(study_page(state_of(tmp_path)))
    dots = [(float(dot.get("cx")), float(dot.get("cy"))) for dot in svg.iter(f"{SVG}circle")]
    assert len(dots) == 4 and len(list(svg.iter(f"{SVG}polyline"))) == 2
    x, y = zip(*dots, strict=True)  # friction 0.2 at 0.5, 1, 2 A: 1, 2, 4 N m; friction 0.4 at 0.5 A: 2 N m
    assert x[3] == x[0] and y[3] == y[1]
    assert x[2] - x[1] == pytest.approx(2.0 * (x[1] - x[0]), abs=0.2)
    assert y[2] - y[1] == pytest.approx(2.0 * (y[1] - y[0]), abs=0.2) and y[1] < y[0]
    known = [dot.get("fill") != "#ffffff" for dot in svg.iter(f"{SVG}circle")]
    assert known == [True, False, True, True]
    texts = [text.text for text in svg.iter(f"{SVG}text")]
    assert "coil.current [A]" in texts and "friction 0.2" in texts
    ends = [float(line.get(name)) for line in svg.iter(f"{SVG}line") for name in ("x1", "y1", "x2", "y2")]
    assert min(ends) >= 0.0 and max(ends) <= 720.0


def test_it_tells_states_failures_with_their_last_lines_and_the_time_left(tmp_path):
    page = study_page(state_of(tmp_path))
    for words in ("4 done", "1 running", "1 failed", "6 points, about 2 min left", "running, 25 %", "not converged",
                  "line 49", "grains &lt;overlap&gt;", "A &lt;b&gt;study&lt;/b&gt;",
                  'http-equiv="refresh"'):  # fmt: skip
        assert words in page, words
    assert "line 43" not in page and "<script" not in page and "src=" not in page
    over = study_page(state_of(tmp_path, seconds_left=None, is_running=False))
    assert "refresh" not in over and "min left" not in over


def test_a_study_of_thousands_is_a_page_of_bounded_size(tmp_path):
    """Points beyond the first are in the table; a sample is dots of one colour."""
    number = 5000
    rows = [{CURRENT: f"{1.0 + k} A", FRICTION: 0.1 + k, "torque": 1.0 + k} for k in range(number)]
    values = {key: [row[key] for row in rows] for key in (CURRENT, FRICTION)}
    points = [PointRow(f"current {k}", DONE, 1.0, 1.0) for k in range(number)]
    names = [str(k) for k in range(number)]
    page = study_page(state_of(tmp_path, values=values, names=names, points=points, rows=rows))
    assert len(page) < 1_000_000 and "4700 more" in page
    assert not list(drawing(page).iter(f"{SVG}polyline"))


def test_without_numbers_to_draw_over_there_is_no_picture(tmp_path):
    values = {"effects.rolling_friction": ["off", {"coefficient": 0.2}]}
    rows = [{"effects.rolling_friction": "off", "torque": 1.0}]
    waiting = [PointRow("off", DONE, 1.0, 1.0), PointRow("on", WAITING)]
    state = state_of(tmp_path, values=values, names=["a", "b"], points=waiting, rows=rows)
    assert "<svg" not in study_page(state)
    assert write_study_page(state).read_text(encoding="utf-8").endswith("</html>")


def test_what_a_run_says_of_its_settings_a_study_says_of_its_points(tmp_path):
    """Grains that add 53 % to every torque: a line on the terminal and in both pages, a second curve in the picture."""
    folder = written_study(tmp_path, [2.0, 3.0])
    size = {"grain_size": {"note": "3 grains per gap", "across": 3.0, "torque_excess": 0.53,
                           "torque_excess_low": 0.44, "torque_excess_high": 0.62}}  # fmt: skip
    rows = []
    for row in pandas.read_csv(folder / "study.csv").to_dict("records"):
        run = RunFolder(folder / row["folder"])
        run.case.write_text(run.case.read_text() + "\n[time]\nend = 0.2\n")
        run.write_summary(run.read_summary() | size)
        rows.append(row | row_of({"coil.current": row["coil.current"]}, load_result(run.path)))
        assert rows[-1]["best_torque"] == pytest.approx(rows[-1]["torque"] / 1.53)
        assert rows[-1]["best_low"] < rows[-1]["best_torque"] < rows[-1]["best_high"]
    pandas.DataFrame(rows).to_csv(folder / "study.csv", index=False)
    (line,) = best_estimate_lines(folder)
    assert "change the raw torque of all points by +53 %" in line and "best_torque" in line
    assert line in html(content_page(read_study(folder), lambda result: ()))
    state = StudyState(folder, "a study", {"coil.current": ["1 A", "2 A"]}, [], [], rows)
    assert line in study_page(state)
    (curve,) = torque_curves(rows, "current", [])
    assert curve.best == pytest.approx(curve.torque / 1.53)
    axis = Figure().subplots()
    _draw_torques(axis, [curve], joined=True)
    assert BEST in axis.get_legend_handles_labels()[1]
    assert best_estimate_lines(written_study(tmp_path / "raw", [2.0])) == []
