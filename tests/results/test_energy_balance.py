"""The residual of the energies is judged by all energy that went through a run, and contacts only lose energy."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from written_run import written_run

import emclutch
from emclutch.results import load_result, quantities
from emclutch.results.energy_balance import energy_made, energy_through, energy_warnings
from emclutch.results.report.report import Mark
from emclutch.scene.case import case_from

OTHER = {"steps": 1, "max_overlap": 0.0, "work_walls": 0.0}
MAGNETS = {
    "scene": {"title": "Two magnets that bounce"},
    "geometry": {"kind": "box", "size": ["6 mm", "6 mm", "10 mm"]},
    "field": {"source": "uniform", "field_strength": "50 kA/m", "direction": "z"},
    "particles": {"packing": "file", "packing_file": "pair.csv", "diameter": "0.2 mm", "susceptibility": 999.0,
                  "saturation": "1.7 MA/m"},
    "contact": {"friction": 0.0, "restitution": 1.0},
    "effects": {"magnetic_force": {}, "dipoles": {"model": "near_field", "cutoff": 3.0}, "saturation": {}},
    "time": {"end": "0.35 ms", "window": "10 us"},
    "output": {"snapshots": 0, "formats": [], "pictures": False, "checkpoint": False},
}  # fmt: skip


def history(**columns):
    count = len(next(iter(columns.values())))
    time = np.linspace(0.0, 1.0, count + 1)[1:]
    return pandas.DataFrame({"time": time, "dissipated": 0.0, "elastic_energy": 0.0, **OTHER, **columns})


def numerics(table):
    return quantities.numerics.of(SimpleNamespace(history=table))


def oscillating(name):
    """Energy E goes from kinetic to `name` and back, ten times, without loss; E/1000 is left over."""
    kinetic = 2.0 * np.sin(np.linspace(0.0, 10.0 * np.pi, 401)[1:]) ** 2
    work = np.diff(kinetic, prepend=0.0)
    other = {"magnetic_energy": -50.0 - kinetic} if name == "magnetic_energy" else {name: work}
    if name == "elastic_energy":
        other = {name: 2.0 - kinetic}
    return history(kinetic_energy=kinetic, energy_residual=np.full(400, 2e-3 / 400), **other)


@pytest.mark.parametrize("name", ["work_gravity", "magnetic_energy", "work_magnetic", "work_lagged", "elastic_energy"])
def test_what_energies_exchange_is_the_scale_of_a_balance_without_losses(name):
    """E of 2 J goes to and fro: the scale is E of the one and E of the other (or E alone where their sum is kept)."""
    table = oscillating(name)
    assert energy_through(table) == pytest.approx(2.0 if name == "elastic_energy" else 4.0, rel=1e-3)
    assert abs(numerics(table)["energy_residual_relative"]) == pytest.approx(5e-4, rel=1.0)
    lossy = table.assign(dissipated=1e-80)  # almost nothing is no scale
    assert numerics(lossy) == pytest.approx(numerics(table))


def test_where_nothing_moves_there_is_nothing_to_compare_with():
    still = history(kinetic_energy=np.zeros(4), energy_residual=np.zeros(4), magnetic_energy=np.full(4, -1.0))
    assert numerics(still)["energy_residual_relative"] is None and energy_made(still) == {}


def test_energy_that_contacts_make_over_the_run_is_a_warning_and_that_of_a_window_is_not():
    """An impact of -1 J in one window and +3 J in the next has lost 2 J; -3 J and +1 J have made 2 J of 10 J."""
    kinetic = {"kinetic_energy": np.full(2, 6.0), "energy_residual": np.zeros(2)}
    loses = history(dissipated_impact=[-1.0, 3.0], dissipated_sliding=[0.0, 0.0], **kinetic)
    makes = history(dissipated_impact=[-3.0, 1.0], dissipated_sliding=[0.0, 0.0], **kinetic)
    assert energy_made(loses) == {} and energy_warnings(loses, True) == []
    assert energy_made(makes) == {"dissipated_impact": 2.0}
    (text,) = energy_warnings(makes, True)
    assert text.startswith("contacts made 2 J of energy, 20 % of the energy supplied, exchanged and dissipated, by ")
    assert "by impact: " in text
    assert "contact.restitution" in text and "0.9 or less" in text and "contact.dvi.step" in text
    rounded = history(dissipated_impact=[-1e-12, 0.0], **kinetic)
    assert energy_made(rounded) == {}


def test_the_warning_stands_in_the_verdict(tmp_path):
    folder = written_run(tmp_path)
    folder.write_summary(folder.read_summary() | {"energy_made": {"dissipated_impact": 1.0, "warnings": ["Made."]}})
    assert "Made." in [one.text for one in load_result(tmp_path).verdict if one.mark is Mark.WARNING]


def test_a_balance_of_torques_is_not_off_where_the_disc_has_almost_no_torque(tmp_path):
    """1e-4 of the rotor's torque are left over: 0.01 %, though the disc has a millionth of it."""
    folder = written_run(tmp_path, mean=2.0, off=1e-4)
    table = pandas.read_csv(folder.history)
    table.assign(torque_disc=1e-6 * table["torque_disc"]).to_csv(folder.history, index=False)
    assert any("torque to 0.01 % of the largest torque" in one.text for one in load_result(tmp_path).verdict)


def test_two_magnets_that_bounce_close_their_balance(tmp_path):
    """Elastic, frictionless grains lose nothing: kinetic and magnetic energy are all that there is."""
    (tmp_path / "pair.csv").write_text("x [mm], y [mm], z [mm]\n0, 0, 4.87\n0, 0, 5.13\n")
    case = case_from(MAGNETS, {"particles.packing_file": str(tmp_path / "pair.csv")})
    result = emclutch.run(case, out=tmp_path / "run", threads=1)
    assert result.history["elastic_energy"].max() > 0.0  # they met
    written = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert abs(written["energy_residual_relative"]) < 0.01 and "energy_made" not in written
    assert any(one.text.startswith("Balances close: energy to ") for one in result.verdict)
