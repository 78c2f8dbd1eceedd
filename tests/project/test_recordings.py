"""Two recordings are compared by keys, values and printed lines."""

import json

from recordings import RECORDINGS, compare


def recording(folder, values, printed, table="time,torque\n0.1,1.0\n"):
    case = folder / "quickstart"
    (case / "run").mkdir(parents=True)
    (case / "run" / "summary.json").write_text(json.dumps(values))
    (case / "run" / "history.csv").write_text(table)
    (case / "0-run.txt").write_text(f"--- output\n{printed}\n--- error\n")
    return folder


def test_a_recording_equals_itself_but_for_the_machine(tmp_path):
    old = recording(tmp_path / "old", {"torque": {"mean": 1.0}, "seconds": {"total": 3.0}}, "took 3 s")
    new = recording(tmp_path / "new", {"torque": {"mean": 1.0 + 1e-12}, "seconds": {"total": 4.0}}, "took 4 s")
    assert list(compare(old, new, {}, text=True)) == []


def test_keys_values_columns_and_lines_that_differ_are_listed(tmp_path):
    old = recording(tmp_path / "old", {"packings": 4, "torque": {"mean": 1.0}, "gone": 1}, "4 packings")
    new = recording(tmp_path / "new", {"replicas": 4, "torque": {"mean": 1.1}}, "4 replicas", "time,T\n0.1,1.0\n")
    assert sorted(compare(old, new, {"packings": "replicas"}, text=True)) == sorted([
        "quickstart: - run/summary.json: gone = 1", "quickstart: ~ run/summary.json: torque.mean: 1.0 -> 1.1",
        "quickstart: - run/history.csv: torque = 1.0", "quickstart: + run/history.csv: T = 1.0",
        "quickstart/0-run: -4 packings", "quickstart/0-run: +4 replicas",
    ])  # fmt: skip


def test_the_cases_are_those_that_the_reports_are_judged_by():
    assert {"quickstart", "brake", "disc_clutch", "switch_on", "lock_up", "slotted_disc", "heat", "hysteresis",
            "sheared_box", "centrifugal_dem", "centrifugal_dvi", "study", "accuracy"} <= set(RECORDINGS)  # fmt: skip
