"""The page of a study says what each point is at, links to those that are done, and loads nothing from elsewhere."""

import pandas
import pytest
from matplotlib.figure import Figure
from written_run import written_study

from emclutch.results import RunFolder, load_result
from emclutch.results.pictures.torque_curves import BEST, _draw_torques
from emclutch.results.report.render import html, terminal, write_index
from emclutch.results.report.report import Shown
from emclutch.results.report.study_report import StudyState, best_estimate_lines, state_report, study_report
from emclutch.results.study_result import load_study
from emclutch.results.study_table import DONE, FAILED, RUNNING, PointRow
from emclutch.results.torque_curves import torque_curves
from emclutch.studies.tables import row_of


def state_of(folder, **changes):
    """6 points: four done, one of them without a verdict; one failed, one runs."""
    points = [PointRow(f"friction {f}, current {i}", DONE, 1.0, 10.0 * f * i, None, True, 75.0)
              for f in (0.2, 0.4) for i in (0.5, 1.0, 2.0)]  # fmt: skip
    points[1].converged = False
    points[4].state, points[5].state, points[5].fraction = FAILED, RUNNING, 0.25
    (folder / "point-004").mkdir(exist_ok=True)
    (folder / "point-004" / "run.log").write_text("\n".join(f"line {k}" for k in range(50)))
    given = {"title": "A <b>study</b>", "points": {f"point-{k:03d}": point for k, point in enumerate(points)},
             "failures": {"point-004": "grains <overlap>; raise contact.stiffness"}, "seconds_left": 150.0,
             "is_running": True}  # fmt: skip
    return StudyState(folder, **(given | changes))


def page_of(state):
    return write_index(state_report(state)).read_text(encoding="utf-8")


def test_it_tells_states_failures_with_their_last_lines_and_the_time_left(tmp_path):
    page = page_of(state_of(tmp_path))
    for words in ("4 of 6 points done, 1 running, 1 failed; about 2 min left", "running, 25 %", "not converged",
                  '<a href="point-000/index.html">point-000</a>', "2 N m", "line 49", "grains &lt;overlap&gt;",
                  "A &lt;b&gt;study&lt;/b&gt;", 'http-equiv="refresh"'):  # fmt: skip
        assert words in page, words
    assert "line 43" not in page and "<script" not in page and "src=" not in page and "point-004/index" not in page
    over = page_of(state_of(tmp_path, seconds_left=None, is_running=False))
    assert "refresh" not in over and "min left" not in over and over.rstrip().endswith("</html>")


def test_a_study_of_thousands_is_a_page_of_bounded_size(tmp_path):
    """Points beyond the first are in the table, failures beyond the first in theirs; the terminal has counts alone."""
    points = {f"point-{k}": PointRow(f"current {k}", DONE, 1.0, 1.0) for k in range(5000)}
    state = state_of(tmp_path, points=points, failures=dict.fromkeys(points, "no"))
    page = page_of(state)
    assert len(page) < 1_000_000 and "4700 more points" in page and "4980 more, in failures.csv" in page
    assert len(terminal(state_report(state)).splitlines()) < 10


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
        rows.append(row | row_of(load_result(run.path), run.path.name))
        assert rows[-1]["best_torque"] == pytest.approx(rows[-1]["torque"] / 1.53)
        assert rows[-1]["best_low"] < rows[-1]["best_torque"] < rows[-1]["best_high"]
    pandas.DataFrame(rows).to_csv(folder / "study.csv", index=False)
    (line,) = best_estimate_lines(folder)
    assert "change the raw torque of all points by +53 %" in line and "best_torque" in line
    report = study_report(load_study(folder), lambda result: ())
    assert terminal(report).count(line) == html(report.up_to(Shown.PAGE)).count(line) == 1
    assert line in page_of(state_of(folder))
    (curve,) = torque_curves(rows, "current", [])
    assert curve.best == pytest.approx(curve.torque / 1.53)
    axis = Figure().subplots()
    _draw_torques(axis, [curve], joined=True)
    assert BEST in axis.get_legend_handles_labels()[1]
    assert best_estimate_lines(written_study(tmp_path / "raw", [2.0])) == []
