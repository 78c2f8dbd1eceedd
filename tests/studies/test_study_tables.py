"""Tables over the points of a study: averages over seeds, curves over currents and speeds, the live table."""

import io
import json

import numpy as np
import pandas
import pytest
from rich.console import Console
from written_run import written_study

from emclutch.results import HistoryWriter, OutputError
from emclutch.results.history import last_time
from emclutch.results.measured_table import keep_measured, measured_in
from emclutch.results.report.study_report import grain_size_lines, study_report
from emclutch.results.seed_average import averaged_over_seeds
from emclutch.results.study_result import load_study
from emclutch.results.study_table import FAILED, StudyTable
from emclutch.scene.study import StudySection
from emclutch.studies.tables import expected_band, write_torques

CURRENT, SEED, SPEED, VOLTAGE = "coil.current", "scene.seed", "motion.rotor.speed", "coil.voltage"
DIAMETER = "particles.diameter"


def study(**values):
    return StudySection(case="case.toml", values={key: list(options) for key, options in values.items()})


def row(torque, **more):
    return {"torque": torque, "standard_error": 0.05, "converged": True, "reason": "fine", **more}


def test_measured_points_and_the_expected_torque_are_laid_over_a_study(tmp_path):
    """Columns are current_A and torque_Nm; another unit is refused, and a band needs two currents."""
    table = tmp_path / "bench.csv"
    table.write_text("current_A,torque_Nm\n2,3\n1,2\n")
    assert measured_in(tmp_path) is None
    keep_measured(table, tmp_path)
    assert measured_in(tmp_path)["torque"].tolist() == [[1.0, 2.0], [2.0, 3.0]]
    table.write_text("current_A,torque [V]\n2,3\n")
    with pytest.raises(OutputError, match="'torque' is in 'V', which is unknown or of another quantity"):
        keep_measured(table, tmp_path)
    names = ("current", "expected_low", "expected_torque", "expected_high")
    rows = [dict(zip(names, row, strict=True)) for row in ((2.0, 1.0, 3.0, 9.0), (1.0, 0.5, 1.5, 4.5))]
    assert expected_band(rows).tolist() == [[1.0, 0.5, 1.5, 4.5], [2.0, 1.0, 3.0, 9.0]]
    assert expected_band(rows[:1]) is None


def test_the_interval_between_seeds_holds_the_mean_as_often_as_it_promises():
    """Student's: of 3 normal torques, in 95 % of 2000 draws, less three deviations; ± 1.96 errors hold it in 81 %."""
    rng, held, narrow = np.random.default_rng(2), 0, 0
    for _ in range(2000):
        rows = [row(torque, **{SEED: k}) for k, torque in enumerate(5.0 + rng.standard_normal(3))]
        (found,) = averaged_over_seeds(rows, SEED, [])
        held += found["low"] < 5.0 < found["high"]
        narrow += abs(found["torque"] - 5.0) < 1.96 * found["standard_error"]
    assert held / 2000 == pytest.approx(0.95, abs=3.0 * np.sqrt(0.95 * 0.05 / 2000))
    assert narrow / 2000 < 0.85


def test_one_seed_and_a_missing_torque_have_no_interval():
    alone = [row(2.0, **{SEED: seed}) | {"converged": False, "steady_alone": True} for seed in (1, 2)]
    assert averaged_over_seeds(alone, SEED, [])[0]["converged"]  # runs of one replica each, whose scatter seeds show
    assert not averaged_over_seeds(alone[:1], SEED, [])[0]["converged"]
    (one,) = averaged_over_seeds([row(2.0, **{SEED: 1})], SEED, [])
    assert (one["seeds"], one["torque"], one["standard_error"], one["low"]) == (1, 2.0, None, None)
    (none,) = averaged_over_seeds([row(None, **{SEED: 1}), row(2.0, **{SEED: 2})], SEED, [])
    assert none["torque"] is None and none["high"] is None


def test_curves_over_the_current_have_a_column_for_every_other_value(tmp_path):
    values = {CURRENT: ("2 A", "0 A", "1 A", "3 A"), "contact.friction": (0.1, 0.3), SEED: (1, 2)}
    currents = {"0 A": 0.0, "1 A": 1.0, "2 A": 2.0, "3 A": 3.0}
    rows = [
        row(friction * currents[i] + 1e-3 * seed, current=currents[i],
            **{CURRENT: i, "contact.friction": friction, SEED: seed})
        for i in values[CURRENT] for friction in values["contact.friction"] for seed in values[SEED]
    ]  # fmt: skip
    write_torques(tmp_path, study(**values), rows)
    table = pandas.read_csv(tmp_path / "torque_vs_current.csv")
    assert table["contact.friction"].tolist() == [0.1] * 4 + [0.3] * 4
    assert table["current"].tolist() == [0.0, 1.0, 2.0, 3.0] * 2 and (table["seeds"] == 2).all()
    assert table["torque"].to_numpy() == pytest.approx(table["contact.friction"] * table["current"] + 1.5e-3)
    assert len(pandas.read_csv(tmp_path / "study.csv")) == 16 and len(pandas.read_csv(tmp_path / "seeds.csv")) == 8
    curves = json.loads((tmp_path / "torque_vs_current.json").read_text())["curves"]
    assert [curve["values"] for curve in curves] == [{"contact.friction": 0.1}, {"contact.friction": 0.3}]
    assert [curve["linear_range"]["slope"] for curve in curves] == pytest.approx([0.1, 0.3])
    assert (tmp_path / "torque_vs_current.png").stat().st_size > 10_000


def test_a_study_of_voltages_is_drawn_over_the_current_that_they_reach(tmp_path):
    rows = [row(u / 24.0, current=u / 25.0, **{VOLTAGE: f"{u} V"}) for u in (24, 6, 12)]
    write_torques(tmp_path, study(**{VOLTAGE: ("24 V", "6 V", "12 V")}), rows)
    table = pandas.read_csv(tmp_path / "torque_vs_current.csv")
    assert table["current"].tolist() == [0.24, 0.48, 0.96] and table[VOLTAGE].tolist() == ["6 V", "12 V", "24 V"]


def test_one_current_or_none_reached_is_no_curve(tmp_path):
    write_torques(tmp_path, study(**{CURRENT: ("1 A",), "contact.friction": (0.1, 0.2)}), [row(1.0, current=1.0)])
    rows = [row(1.0, **{CURRENT: "1 A"})]  # no effect needs the field
    write_torques(tmp_path, study(**{CURRENT: ("1 A", "2 A")}), rows)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.csv"]


def test_a_study_of_grain_sizes_is_extrapolated_to_the_real_powder(tmp_path):
    """For each other value; the cost is that of all seeds, and one size has no table."""
    currents, across = {"1 A": 1.0, "2 A": 3.0}, {"0.25 mm": 4.0, "0.125 mm": 8.0, "0.0625 mm": 16.0}
    values = {DIAMETER: list(across), CURRENT: list(currents), SEED: [1, 2]}
    rows = [
        row(currents[i] * (10.0 + 50.0 / across[d] ** 2) * (1.0 + 1e-3 * (2 * seed - 3)), current=currents[i],
            seconds=7.0, grains=int(across[d] ** 3), grains_per_gap=across[d], real_grains_per_gap=50.0 / 3.0,
            inertial_number=0.05, **{DIAMETER: d, CURRENT: i, SEED: seed})
        for d in values[DIAMETER] for i in values[CURRENT] for seed in values[SEED]
    ]  # fmt: skip
    write_torques(tmp_path, study(**values), rows)
    table = pandas.read_csv(tmp_path / "grain_size.csv")
    assert len(table) == 6 and (table["seconds"] == 14.0).all() and (table["seeds"] == 2).all()
    assert table["grains"].tolist() == [64, 64, 512, 512, 4096, 4096] and (table["inertial_number"] == 0.05).all()
    assert (table["low"] < table["torque"]).all()
    curves = json.loads((tmp_path / "grain_size.json").read_text())["curves"]
    for curve, factor in zip(curves, (1.0, 3.0), strict=True):
        assert curve["law"]["limit"]["value"] == pytest.approx(10.0 * factor, rel=0.01)
        assert curve["law"]["real_torque"]["value"] == pytest.approx(10.18 * factor, rel=0.01)
        assert curve["law"]["order"]["low"] < 2.0 < curve["law"]["order"]["high"]
    assert [curve["values"] for curve in curves] == [{CURRENT: "1 A"}, {CURRENT: "2 A"}]
    assert grain_size_lines(tmp_path)[0].startswith("current 1 A: 3 grain sizes, 4 to 16 grains per gap: T = ")
    assert (tmp_path / "grain_size.png").stat().st_size > 10_000
    (tmp_path / "one").mkdir()
    write_torques(tmp_path / "one", study(**{**values, DIAMETER: ["0.25 mm"]}), rows[:4])
    assert not (tmp_path / "one" / "grain_size.csv").exists()


def test_the_law_of_the_grain_size_is_in_the_loaded_study_and_its_report(tmp_path):
    folder = written_study(tmp_path / "study", [3.0, 2.25, 2.0625])
    rows = pandas.read_csv(folder / "study.csv").drop(columns="coil.current").to_dict("records")
    values = {DIAMETER: ["0.25 mm", "0.125 mm", "0.0625 mm"]}
    sizes = [{DIAMETER: d, **one, "grains_per_gap": n, "real_grains_per_gap": None}
             for d, n, one in zip(values[DIAMETER], (4.0, 8.0, 16.0), rows, strict=True)]  # fmt: skip
    write_torques(folder, study(**values), sizes)
    loaded = load_study(folder)
    assert loaded.grain_size["grains_per_gap"].tolist() == [4.0, 8.0, 16.0]
    (curve,) = loaded.grain_size_laws
    limit = curve["law"]["limit"]
    assert limit["low"] < 2.0 < limit["high"] and curve["law"]["real_torque"] is None
    page = study_report(load_study(folder), lambda result: [])
    blocks = {one.heading: one.blocks for one in page.sections}
    assert blocks["Size of the grains"][0].text == curve["reason"]
    assert any(one.path == folder / "grain_size.png" for one in blocks["Pictures"])


def test_the_time_of_a_growing_history_is_that_of_its_last_whole_row(tmp_path):
    path = tmp_path / "history.csv"
    assert last_time(path) is None
    with HistoryWriter(path) as history:
        history.append({"torque_disc": 1.0, "time": 1e-3})
        history.append({"torque_disc": 1.0, "time": 2e-3})
    with path.open("a") as file:
        file.write("0.003,1")
    assert last_time(path) == 2e-3
    path.write_text("time,torque_disc\n")
    assert last_time(path) is None


def test_a_point_that_is_first_seen_at_its_end_leaves_no_time_to_estimate():
    table = StudyTable(stream=io.StringIO(), clock=lambda: 1.0)
    table.begin(["current 1 A"])
    table.set_running(0)
    table.set_fraction(0, 1.0)
    assert table.seconds_left() is None


def test_the_live_table_has_a_row_a_point_and_the_time_left():
    """Four points of 100 s, two at a time: after 100 s two are done, 100 s are left; a slow one prolongs that."""
    now = [0.0]
    table = StudyTable(stream=io.StringIO(), clock=lambda: now[0])
    table.begin(["current 1 A", "current 2 A", "current 3 A", "current 4 A"])
    for number in (0, 1):
        table.set_running(number)
        table.set_fraction(number, 1e-9)
    assert table.seconds_left() is None
    now[0] = 100.0
    table.set_done(0, 1.234, (1.178, 1.29), 100.0)
    table.set_done(1, 2.0, None, 100.0)
    assert table.seconds_left() == pytest.approx(100.0)
    for number in (2, 3):
        table.set_running(number)
        table.set_fraction(number, 1e-9)
    now[0] = 150.0
    table.set_fraction(2, 0.5)
    table.set_fraction(3, 0.1)
    assert table.seconds_left() == pytest.approx(450.0)
    table.set_ended(2, FAILED)
    page = io.StringIO()
    Console(file=page, width=100).print(table.table())
    for words in (
        "current 1 A",
        "1.234 N m (95 %: 1.178 to 1.290)",
        "failed",
        "running",
        "10 %",
        "2 done, 1 running, 1 failed",
        "min left",
    ):
        assert words in page.getvalue()


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_on_a_small_terminal_the_points_that_are_not_done_are_seen(monkeypatch):
    """Nine points on 10 lines, three of them of points; at the end all are printed."""
    monkeypatch.setenv("LINES", "10")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    with StudyTable(stream=Terminal()) as table:
        table.begin([f"current {k} A" for k in range(9)])
        for number in range(5):
            table.set_done(number, 1.0, (0.8, 1.2), 1.0)
        assert list(table.table().columns[0].cells) == ["current 5 A", "current 6 A", "current 7 A"]
        for number in range(5, 9):
            table.set_done(number, 1.0, (0.8, 1.2), 1.0)
        assert list(table.table().columns[0].cells) == ["current 6 A", "current 7 A", "current 8 A"]
    assert "current 0 A" in table.stream.getvalue()


def test_without_a_terminal_the_table_is_lines():
    stream = io.StringIO()
    with StudyTable(stream=stream) as table:
        table.begin(["friction 0.1", "friction 0.2"])
        table.set_done(0, 1.0, (0.8, 1.2), 3.0, kept=True)
        table.set_running(1)
        table.set_done(1, None, None, 3.0)
    lines = stream.getvalue().splitlines()
    assert lines[0] == " 50 %  1 of 2 points  friction 0.1 is kept: 1.00 N m (95 %: 0.80 to 1.20)"
    assert lines[1] == "100 %  2 of 2 points  friction 0.2 is done: no torque"
