"""Drag of seals and bearings opposes the slip: on the disc it acts the way the rotor turns against it."""

from pathlib import Path
from types import SimpleNamespace

import pandas
import pytest

from emclutch.results import load_result, quantities
from emclutch.scene.case import load_case
from emclutch.scene.motion import MotionSection
from emclutch.simulation.check import check
from emclutch.simulation.discretisation_error import device_of
from emclutch.studies.tables import row_of
from tests.results.written_run import written_run


def history(rotor, disc):
    return pandas.DataFrame({"rotor_speed": [0.0, rotor], "disc_speed": [0.0, disc]})


def test_drag_has_the_sign_of_the_slip_and_is_nothing_where_it_is_off():
    def of(given, table, torque=1.0):
        motion = SimpleNamespace(drag_torque=given)
        case = SimpleNamespace(scene=SimpleNamespace(motion=motion))
        return quantities.drag.of(SimpleNamespace(case=case, history=table, torque=SimpleNamespace(mean=torque)))

    def drag(table):
        return of(0.2, table)["drag_torque"]

    assert drag(history(100.0, 0.0)) == 0.2
    assert drag(history(0.0, 100.0)) == -0.2  # the disc is the faster one, and is braked
    assert drag(history(-100.0, 0.0)) == -0.2
    assert drag(pandas.DataFrame({"disc_speed": [1.0]})) == 0.0  # no second shaft
    locked = of(0.2, history(50.0, 50.0), 1.5)
    assert locked == {"drag_torque": 0.0, "torque_with_drag": 1.5}  # a point without slip keeps its columns
    assert of(0.2, history(1.0, 0.0), None)["torque_with_drag"] is None
    assert of(0.0, history(100.0, 0.0)) == {}


def test_a_free_shaft_has_it_in_its_load():
    free = {"free": {"inertia": "1e-5 kg m^2"}}
    assert MotionSection.model_validate({"rotor": {"speed": "10 rpm"}, "drag_torque": "0.1 N m"}).drag_torque == 0.1
    with pytest.raises(ValueError, match=r"add it to free\.load_torque"):
        MotionSection.model_validate({"rotor": {"speed": "10 rpm"}, "disc": free, "drag_torque": "0.1 N m"})


def test_check_says_that_the_expected_torque_is_without_it():
    case = load_case(Path(__file__).parents[2] / "cases" / "quickstart.toml")
    said = check(case.with_values({"motion.drag_torque": "0.1 N m"})).decisions["drag"]
    assert said.startswith("motion.drag_torque = 0.1 N m is not in the expected torque. Subtract it from torques")
    assert "drag" not in check(case).decisions


def test_it_is_no_other_device_for_what_was_measured_of_its_settings():
    case = load_case(Path(__file__).parents[2] / "cases" / "quickstart.toml")
    assert device_of(case) == device_of(case.with_values({"motion.drag_torque": "0.1 N m"})) == "b53c187edf86ca92"


def test_it_has_its_columns_in_a_studys_table_where_it_is_given(tmp_path):
    folder = written_run(tmp_path / "point-000")
    text = folder.case.read_text() + "\n[time]\nend = 0.2\n"
    folder.case.write_text(text)
    without = row_of(load_result(folder.path), "")
    assert not {"drag_torque", "torque_with_drag"} & set(without)
    folder.write_summary(folder.read_summary() | {"drag_torque": -0.2, "torque_with_drag": without["torque"] - 0.2})
    result = load_result(folder.path)
    row = row_of(result, "")
    assert row["drag_torque"] == -0.2 and row["torque_with_drag"] == pytest.approx(row["torque"] - 0.2)
    assert {name: row[name] for name in without} == without  # interval and all else are those of the powder
    assert "with 0.2 N m of drag (motion.drag_torque)" in str(result.verdict)
