"""Columns of a history: each quantity of a window's row has one, with a unit, and only what the scene has is there."""

import pickle
from dataclasses import fields, replace

import pandas
import pytest

from coupling.coil_row import CircuitRow, CoilRow, VoltageEddyRow
from coupling.magnetised_grains import MomentRow
from coupling.powder_feedback import FeedbackRow
from coupling.window_row import BodyRow, EnergyRow, SolverRow, WallClock, WindowRow
from emclutch.results import COLUMNS
from emclutch.results.columns import ROTOR_SPEED, TORQUE_DISC, columns_of
from emclutch.simulation.observables import FieldRow, GapRow, PoleField, PoleFill

PARTS = (CoilRow, CircuitRow, VoltageEddyRow, MomentRow, FeedbackRow, SolverRow, FieldRow, PoleField, PoleFill, GapRow)


def row(**changed):
    """A window of a disc and a housing."""
    given = dict(
        time=1e-3, bodies={"disc": BodyRow(2.0, 0.1, 0.02, 0.3), "housing": BodyRow(0.0, 0.0, 0.0, 0.0)},
        field_torque={}, other_torque={}, angular_momentum=0.0, torque_residual=0.0, energy=None,
        lagged_is_magnetic=True, field_solves=None, n_contacts=3, max_overlap=0.01, max_speed=1.0, solver=None,
        rebuilds=1, steps=10, seconds=WallClock(None, None, 0.5, 0.6, 0.9),
    )  # fmt: skip
    return WindowRow(**given | changed)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.__name__)
def test_every_quantity_of_a_part_is_a_column_with_a_unit(part):
    assert all(COLUMNS[each.name].unit for each in fields(part))


def test_a_quantity_that_the_scene_does_not_have_has_no_column():
    found = columns_of(row())
    assert found[TORQUE_DISC] == pytest.approx(0.42) and set(found) <= set(COLUMNS)
    assert not {ROTOR_SPEED, "housing_speed", "torque_field", "kinetic_energy", "field_solves", "wall_field"} & set(
        found
    )


def test_torque_of_the_field_is_that_on_the_grains_reversed_and_reported_apart_where_there_are_several():
    assert columns_of(row(field_torque={"dipoles": 2.0}))["torque_field"] == -2.0
    found = columns_of(row(field_torque={"dipoles": 2.0, "images": 0.5}, other_torque={"fluid_drag": -1.0}))
    assert (found["torque_field"], found["torque_field_images"], found["torque_fluid_drag"]) == (-2.5, -0.5, 1.0)


def test_energies_balance_with_the_terms_that_there_are():
    energy = EnergyRow(1.0, 0.5, -0.1, 3.0, 0.25, None, {"sliding": 1.0}, 1.0, 2.0)
    found = columns_of(row(energy=energy))
    assert (found["work_magnetic"], found["energy_residual"], found["dissipated_sliding"]) == (0.25, 0.25, 1.0)
    assert found["magnetic_energy"] == -0.1
    assert "magnetic_energy" not in columns_of(row(energy=replace(energy, magnetic_energy=None)))
    assert "work_lagged" in columns_of(row(energy=energy, lagged_is_magnetic=False)) and "work_gravity" not in found


def test_a_column_names_its_column_of_a_table_and_survives_a_copy():
    table = pandas.DataFrame({"torque_disc": [1.0]})
    assert table[TORQUE_DISC].tolist() == [1.0] and TORQUE_DISC in table
    copy = pickle.loads(pickle.dumps(TORQUE_DISC))
    assert copy == TORQUE_DISC and copy.unit == "N m"
