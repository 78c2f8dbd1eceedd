"""Discretisation error of a run: that of its settings by the study of its device, else the reason why not."""

import math
from dataclasses import replace

import pytest
from made_up_study import cell, contact_step, study

import emclutch
from emclutch.results.accuracy_studies import VARIABLE, save_accuracy_study
from emclutch.results.accuracy_study import Basis, MeasuredSetting, MeasuredValue, SettingError, Total
from emclutch.results.statistics import Estimate
from emclutch.scene.case import load_case
from emclutch.settings import settings_of
from emclutch.settings.powder import SAME_WIDTH
from emclutch.simulation.discretisation_error import (
    corrected,
    device_of,
    discretisation_error,
    extrapolated,
    is_reached,
    setting_values,
    total_at,
)
from emclutch.simulation.plan import make_plan

TORQUE = Estimate(2.0, 0.05, 20, 1e-3, 1e-3, True, "steady", replicas=4, degrees_of_freedom=1e6)


@pytest.mark.parametrize(("change", "error", "reached"), [
    ({}, {}, True), ({"converged": False}, {}, False), ({}, {"total_error": 0.06}, False),
    ({}, {"unknown": {"sector": "not measured"}}, False), ({}, {"total_error": None}, False),
])  # fmt: skip
def test_a_target_is_reached_by_a_steady_torque_with_all_errors_known(change, error, reached):
    assert is_reached(0.05, replace(TORQUE, **change), {"total_error": 0.04, "unknown": {}} | error) == reached


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where accuracy studies are looked for in one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "accuracy_studies"))
    return tmp_path / "accuracy_studies"


def planned(**entries):
    case = cell(**entries)
    return case, make_plan(case)[1]


@pytest.mark.parametrize("entries", [
    {"scene__seed": 8}, {"time__steps_per_contact": 40.0}, {"contact__stiffness": "80 kN/m"}, {"time__end": "1 ms"},
    {"particles__sector": "30 deg"}, {"effects__dipoles__update_every": 30}, {"accuracy__replicas": 3},
    {"output__pictures": True},
])  # fmt: skip
def test_a_device_is_the_same_with_other_numerical_settings(entries):
    assert device_of(cell(**entries)) == device_of(cell())


def test_keys_of_a_setting_are_those_that_its_entries_set():
    counted = {"particles__solid_fraction": None, "particles__count": 140, "particles__stands_for": "60 um"}
    for entries in ({}, counted, {"contact__stiffness": None}, {"time__average_from": None}):
        case, plan = planned(**entries)
        for setting in settings_of(case.scene):
            own = setting.own(case.scene, plan)
            assert set(setting.entries(case.scene, plan, own)) <= set(setting.keys(case.scene))


def test_grains_that_are_counted_are_of_the_device_by_their_volume():
    counted = {"particles__solid_fraction": None, "particles__count": 140, "particles__stands_for": "60 um"}
    finer = counted | {"particles__diameter": "0.2 mm", "particles__count": round(140 * 1.5**3)}
    assert device_of(cell(**counted)) == device_of(cell(**finer))
    assert device_of(cell(**counted)) != device_of(cell(**counted | {"particles__count": 120}))


@pytest.mark.parametrize("entries", [
    {"contact__friction": 0.1}, {"geometry__outer_radius": 11.3e-3}, {"particles__diameter": "0.29 mm"},
    {"effects__saturation": None}, {"motion__rotor__speed": "5000 rpm"}, {"particles__stands_for": "60 um"},
])  # fmt: skip
def test_another_device_is_another_one(entries):
    assert device_of(cell(**entries)) != device_of(cell())


def test_the_size_of_grains_that_stand_for_others_is_numerical_and_the_speed_is_not():
    coarse = {"particles__stands_for": "60 um", "accuracy__inertial_number": 0.05}
    finer = coarse | {"particles__diameter": "0.2 mm"}
    assert device_of(cell(**coarse)) == device_of(cell(**finer))
    assert device_of(cell(**coarse)) != device_of(cell(**coarse | {"motion__rotor__speed": "5000 rpm"}))


def test_current_and_mesh_are_not_of_the_device():
    case = load_case("cases/quickstart.toml")
    other = case.with_values({"coil.current": "0.5 A", "field.size_factor": 1.4, "scene.seed": 9})
    assert device_of(case) == device_of(other)


def test_a_run_has_the_error_of_its_study(folder, tmp_path):
    case = cell(time__end="0.65 ms")
    device = device_of(case)
    unknown = {"sector": "no time"}
    file = save_accuracy_study(study(device, contact_step(0.04, 0.001), drive={"coil.current": 1.0}, unknown=unknown))
    summary = emclutch.run(case, out=tmp_path / "run").summary
    error = summary["discretisation_error"]
    assert error["bias"] == pytest.approx(0.04, abs=0.002) and error["parts"]["contact_step"]["value"] == 20.0
    known = error["accuracy_study"]
    assert known["file"] == str(file) and "coil.current = 1.0 instead of None" in known["note"]
    assert error["unknown"]["sector"] == "no time" and "discretisation_error_note" not in summary
    assert error["best_estimate"]["mean"] == pytest.approx(summary["torque"]["mean"] / (1.0 + error["bias"]))
    relative = summary["torque"]["standard_error"] / summary["torque"]["mean"]
    assert summary["figure_of_merit"] == pytest.approx(1.0 / (relative**2 * summary["seconds"]["processor"]))


def test_values_of_the_run_count_and_far_ones_are_reported(folder):
    case, plan = planned(time__steps_per_contact=90.0)
    save_accuracy_study(study(device_of(case), contact_step(0.04, 0.001)))
    error = discretisation_error(case, plan, TORQUE)["discretisation_error"]
    assert error["bias"] == pytest.approx(math.exp(math.log(1.04) * (20.0 / 90.0) ** 2) - 1.0, rel=0.1)
    assert error["extrapolated"] == {"contact_step": "2.2 times as fine as the finest that was measured"}


def test_a_sector_of_finer_grains_has_the_error_of_one_as_wide(folder):
    """In diameters it has twice as many; one of as many diameters is half as wide, and coarser."""
    own = {"particles__stands_for": "60 um", "particles__sector": "40 deg"}
    case, plan = planned(**own)
    values = setting_values(case, plan)
    widths = {name: values[name] for name in ("grains_per_gap", "sector")}
    settings = [
        MeasuredSetting(name, "", Basis.TORQUE, one, 2.0, 0.0,
                   tuple(MeasuredValue(f * one, 1.0 / (f * one), 1.0 + 0.04 / f**2, 0.001, 4, 1.0) for f in (1.0, 2.0)))
        for name, one in widths.items()
    ]  # fmt: skip
    known = study(device_of(case), *settings)
    here = total_at(known, widths, plan).parts["sector"]
    finer, fine_plan = planned(**own, particles__diameter=0.5 * case.scene.grains.diameter)
    there = {name: setting_values(finer, fine_plan)[name] for name in widths}
    assert there["sector"] == pytest.approx(2.0 * widths["sector"], rel=SAME_WIDTH)
    assert total_at(known, there, fine_plan).parts["sector"] == here
    narrow = total_at(known, there | {"sector": widths["sector"]}, fine_plan).parts["sector"]
    assert narrow.bias == pytest.approx(4.0 * here.bias, rel=0.3)


def test_a_given_time_step_has_no_known_error(folder):
    case, plan = planned(time__step=1e-7)
    save_accuracy_study(study(device_of(case), contact_step(0.04)))
    error = discretisation_error(case, plan, TORQUE)["discretisation_error"]
    assert "time.step is given" in error["unknown"]["contact_step"] and error["parts"] == {}
    assert not is_reached(0.5, TORQUE, error)


def test_more_steps_a_contact_keep_the_time_between_evaluations_of_the_moments():
    (setting,) = (one for one in settings_of(cell().scene) if one.name == "contact_step")
    case, plan = planned(effects__dipoles__update_every=30)
    entries = setting.entries(case.scene, plan, 40.0)
    assert entries == {"time.steps_per_contact": 40.0, "effects.dipoles.update_every": 60}
    case, plan = planned(effects__dipoles__update_every=None)
    assert setting.entries(case.scene, plan, 40.0) == {"time.steps_per_contact": 40.0}


def test_statistics_and_discretisation_add_in_quadrature():
    total = Total({"sector": SettingError(0.25, 0.03), "overlap": SettingError(0.0, 0.0)}, {}, SettingError(0.25, 0.03))
    found = corrected(TORQUE, total)
    statistics = TORQUE.half_width() / 2.0
    assert found["total_error"] == pytest.approx(math.hypot(statistics, 0.03))
    assert found["best_estimate"] == {"mean": 1.6, "half_width": pytest.approx(1.6 * found["total_error"])}
    assert found["largest_part"] == {"name": "statistics", "half_width": statistics}
    coarser = corrected(TORQUE, Total({"sector": SettingError(0.25, 0.1)}, {}, SettingError(0.25, 0.1)))
    assert coarser["largest_part"]["name"] == "sector"


def test_without_a_study_the_command_is_named_and_a_damaged_one_is_no_failure(folder):
    case, plan = planned()
    none = discretisation_error(case, plan, TORQUE)
    assert none["discretisation_error"] is None
    assert "run it with: emclutch accuracy CASE, in up to " in none["discretisation_error_note"]
    device = device_of(case)
    folder.mkdir()
    for text in ("{", "[]", '"text"', "{}", study(device, contact_step(0.1)).to_json().replace("0.05", '"x"')):
        (folder / f"{device}.json").write_text(text)
        damaged = discretisation_error(case, plan, TORQUE)
        assert damaged["discretisation_error"] is None and "measure again" in damaged["discretisation_error_note"]


def test_a_start_up_is_known_by_where_the_run_began_to_average():
    case, plan = planned(time__average_from=None)
    assert setting_values(case, plan)["start_up"] == 9.0 and setting_values(case, plan, 20.0)["start_up"] == 20.0
    assert extrapolated(study("", contact_step(0.1)), {"start_up": 9.0}) == {}
