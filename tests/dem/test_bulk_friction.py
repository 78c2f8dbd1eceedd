"""Bulk friction of a dry powder at an imposed pressure: scales that do not count, pressure, extremes of friction."""

import dataclasses

import numpy as np
import pytest
from steady_shear import SteadyShear, measure_bulk_friction

from particles.bulk_friction.friction_table import measured_table, read_table

pytestmark = pytest.mark.physics

SHORT = SteadyShear(friction=0.5, rolling=0.2, count=120, spread=0.0, inertial_number=0.01, start=0.3, strain=0.5)


@pytest.mark.parametrize("changed", [{"pressure": 1e-6}, {"pressure": 1e10}, {"diameter": 1e-2, "density": 1000.0}])
def test_scales_do_not_count(changed):
    """Tiny and huge pressures, sand of a centimetre: the same numbers without a unit, until chaos has its say."""
    brief = dataclasses.replace(SHORT, start=0.0, strain=0.05)
    found = [measure_bulk_friction(one) for one in (brief, dataclasses.replace(brief, **changed))]
    for name in ("mean", "fill", "contacts", "overlap", "steps"):
        assert getattr(found[1], name) == pytest.approx(getattr(found[0], name), rel=1e-4)


@pytest.mark.parametrize(("friction", "rolling"), [(0.0, 0.0), (1.0, 0.0), (0.5, 0.2), (1.0, 2.0)])
def test_pressure_is_held_and_friction_is_in_its_range(friction, rolling):
    """From slippery to locked grains, all from the same dense start, which friction makes dilate.

    Means of short runs: pressure 1 +- 0.05, friction of locked grains 0.67 +- 0.06, by the path of the grains.
    """
    found = measure_bulk_friction(dataclasses.replace(SHORT, friction=friction, rolling=rolling))
    assert found.pressure == pytest.approx(1.0, abs=0.25)
    assert found.overlap < 0.1
    low, high = {0.0: (0.05, 0.25), 0.5: (0.25, 0.9), 1.0: (0.25, 1.0)}[friction]
    assert low < found.mean < high
    assert found.error > 0.0
    if friction == 0.0:
        assert found.fill > 0.60 and found.contacts > 4.5  # near random close packing, nearly isostatic: 6
    if rolling > 0.0:
        assert found.fill < 0.60


def test_what_cannot_be_sheared_is_refused():
    for wrong in ({"friction": -0.1}, {"pressure": 0.0}, {"inertial_number": np.inf}, {"spread": 1.0}, {"strain": 0.0}):
        with pytest.raises(ValueError, match="allowed"):
            dataclasses.replace(SHORT, **wrong)
    with pytest.raises(ValueError, match="blocks for its error bar"):
        measure_bulk_friction(dataclasses.replace(SHORT, strain=1e-3))
    with pytest.raises(ValueError, match="twice"):
        measure_bulk_friction(dataclasses.replace(SHORT, count=8))


def test_the_table_agrees_with_published_values():
    """Frictionless beads: 0.101 +- 0.004 as I -> 0, and + 0.03 at I = 0.003 (Peyneau & Roux, PRE 78 (2008) 011307).

    Glass beads: 0.38 = tan 20.9 deg (Forterre & Pouliquen, J. Fluid Mech. 486 (2003) 21), as spheres of friction 0.5
    that roll freely; from there on it no longer grows.
    """
    table = measured_table()
    assert 0.095 < table.mean[0, 0] < 0.145
    rolls = {float(mu_s): mean for mu_s, mean in zip(table.friction, table.mean[:, 0], strict=True)}
    assert 0.34 < rolls[0.5] < 0.39
    assert rolls[1.0] == pytest.approx(rolls[0.5], abs=0.03)
    assert rolls[0.0] < rolls[0.1] < rolls[0.3] < 0.4


def test_the_table_has_error_bars_and_grows_with_rolling_friction():
    table = measured_table()
    assert (table.error > 0.0).all() and (table.error < 0.05 * table.mean + 0.005).all()
    assert (np.diff(table.mean, axis=1) >= 0.0).all()


@pytest.mark.parametrize("bulk", [0.2, 0.3, 0.36, 0.45, 0.5])
def test_a_pair_has_the_bulk_friction_that_it_was_found_for(bulk):
    """The inverse of the interpolation, at both ends of the line and inside, with an interval about it."""
    table = measured_table()
    ends = table.range_of_friction(bulk)
    for friction in np.linspace(*ends, 5):
        pair = table.pair(bulk, float(friction), spread=0.01)
        assert table.bulk_friction(pair.friction, pair.rolling)[0] == pytest.approx(bulk, abs=2e-3)
        assert pair.lowest <= pair.rolling <= pair.highest
    assert table.rolling_for(bulk, 0.0) is None  # without sliding friction no rolling friction helps


def test_the_interval_holds_the_softness_of_the_tables_contacts():
    """With contacts four times as stiff a bulk friction b is had where the table has b/1.08 (0.537 to 0.581)."""
    table = measured_table()
    for bulk in (0.45, 0.5, 0.55):
        pair = table.pair(bulk, 0.6)
        assert pair.lowest <= table.rolling_for(bulk * 0.537 / 0.581, 0.6) < pair.rolling < pair.highest


def test_the_nearest_pair_exists_wherever_the_line_does():
    """Every bulk friction of the table, also those that noise has in pieces, and its very end."""
    table = measured_table()
    for bulk in [*np.linspace(float(table.mean[0, 0]), float(table.mean.max()), 60), 0.37]:
        friction = table.nearest_friction(float(bulk), 0.6)
        pair = table.pair(float(bulk), friction)
        assert table.bulk_friction(friction, pair.rolling)[0] == pytest.approx(bulk, abs=2e-3)
        ends = table.range_of_friction(float(bulk))
        assert ends is None or ends[0] <= friction <= ends[1]
    assert table.nearest_friction(0.3, 0.1) == 0.1
    assert table.nearest_friction(1.0, 0.6) is None


def test_what_the_table_does_not_hold():
    table = measured_table()
    assert table.range_of_friction(1.0) is None and table.range_of_friction(0.05) is None
    assert table.bulk_friction(0.5, 50.0) == table.bulk_friction(0.5, float(table.rolling[-1]))
    for friction, rolling in ((-0.1, 0.0), (5.0, 0.0), (0.5, -1.0)):
        with pytest.raises(ValueError, match="allowed"):
            table.bulk_friction(friction, rolling)


def test_a_table_with_a_hole_is_refused(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("friction,rolling,bulk_friction,error\n0,0,0.1,0.01\n0.5,0,0.3,0.01\n1,0.2,0.5,0.01\n")
    with pytest.raises(ValueError, match="no run at friction 0"):
        read_table(path)
