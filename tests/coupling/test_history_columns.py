"""Each column of a history is of the instant, or of the part of the window, that its reference names."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sheared_annulus import CELL

import emclutch
from emclutch.results.column_table import COLUMNS, reference
from emclutch.results.columns import When
from emclutch.scene.case import case_from
from emclutch.simulation.plan import make_plan

pytestmark = pytest.mark.physics

ROOT = Path(__file__).resolve().parents[2]
CLOCKS = {"wall_field", "wall_magnetic", "wall_contact", "wall_total", "processor_time"}
STEP, UPDATE, SHORT, LONG = 1e-7, 5, 13, 39
ANNULUS = {
    "time.step": STEP, "time.end": 10 * LONG * STEP, "effects.dipoles.update_every": UPDATE, "effects.gravity": {},
    "effects.rolling_friction": {}, "effects.twisting_friction": {}, "accuracy.replicas": 1,
}  # fmt: skip
RIGID = ANNULUS | {
    "contact.method": "dvi", "time.step": None, "contact.dvi.step": 5e-7, "effects.rolling_friction": None,
    "effects.twisting_friction": None, "particles.sector": None, "particles.count": 60,
    "particles.solid_fraction": None, "time.end": 10 * LONG * 5e-7,
}  # fmt: skip
AIR = {
    **{f"geometry.materials.{name}": "air" for name in ("disc", "rotor", "housing")},
    **{f"effects.{name}": None for name in ("dipoles", "wall_images", "back_reaction", "rolling_friction")},
    "field.size_factor": 3.0, "field.order": 1, "particles.solid_fraction": 0.02, "accuracy.replicas": 1,
    "time.until": None, "output.pictures": False, "output.snapshots": 4, "output.formats": ["vtk", "hdf5"],
}  # fmt: skip
"""The quickstart's coil in air: a linear one."""


def run(case, folder):
    return emclutch.run(case, out=folder)


def gathered(history, of):
    """A history whose rows gather so many, each column as its reference says."""
    group = np.arange(len(history)) // of
    duration = np.diff(history["time"], prepend=0.0)
    rows = {}
    for name in history:
        column, by = history[name], history[name].groupby(group)
        match COLUMNS[name].when:
            case When.SUM:
                rows[name] = by.sum()
            case When.MEAN:
                rows[name] = (column * duration).groupby(group).sum() / pd.Series(duration).groupby(group).sum()
            case When.LARGEST:
                rows[name] = by.max()
            case _:
                rows[name] = by.last()
    return pd.DataFrame(rows)


@pytest.mark.parametrize("values", [ANNULUS, RIGID], ids=["dem", "dvi"])
def test_short_windows_add_up_to_long_ones_as_the_reference_says(tmp_path, values):
    """Windows of 13 and of 39 steps of the same motion, moments found every step: sums, means, extremes, instants."""
    step = values.get("contact.dvi.step", STEP)
    values = values | {"effects.dipoles.update_every": 1}
    short, long = (
        run(case_from(CELL, values | {"time.window": steps * step}), tmp_path / str(steps)).history
        for steps in (SHORT, LONG)
    )
    assert len(long) == 10 and len(short) == 30
    rows = gathered(short, LONG // SHORT)
    for name in set(long) - CLOCKS:
        alike = [name]
        if name.endswith("_residual"):  # what is left of a balance is round-off of its terms
            alike = [one for one in long if COLUMNS[one].unit == COLUMNS[name].unit]
        scale = max(float(long[alike].abs().max().max()), 1e-30)
        assert rows[name].to_numpy() == pytest.approx(long[name].to_numpy(), rel=1e-9, abs=1e-9 * scale), name


def linear_coil(folder, values):
    """Run of the coil in air; its inductance [H]."""
    case = emclutch.load_case(ROOT / "cases" / "quickstart.toml").with_values(AIR | values)
    _, plan = make_plan(case)
    inductance = 500.0 * plan.peak_field.flux_linkage_per_turn / (plan.peak_field.ampere_turns / 500.0)
    return run(case, folder), inductance


def belongs_together(history, inductance):
    """Linkage, energy and flux density of each row are those of its current."""
    current = history["current"].to_numpy()
    assert history["flux_linkage"].to_numpy() == pytest.approx(inductance * current, rel=1e-6, abs=1e-12)
    assert history["field_energy"].to_numpy() == pytest.approx(0.5 * inductance * current**2, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("windows", [4, 1000])
def test_a_row_of_a_ramp_has_the_current_of_its_field(tmp_path, windows):
    """1 A/ms for 10 us, then held: L i in each row, i(t) at the row's time, and in the frames of the field too."""
    ramp = {"times": [0.0, 10e-6], "values": [0.0, 0.01]}
    times = {"time.end": 16e-6, "time.step": 1e-8, "time.window": 16e-6 / windows if windows > 4 else 4e-6}
    result, inductance = linear_coil(tmp_path / "run", {"coil.current": ramp} | times)
    history = result.history
    belongs_together(history, inductance)
    exact = np.interp(history["time"], ramp["times"], ramp["values"])
    # between solves the current may change by 1 % of its largest value
    assert np.abs(history["current"] - exact).max() < (1e-12 if windows == 4 else 0.0101 * 0.01)
    assert history["current"].iloc[-1] == 0.01, "a current that rests is solved for exactly"
    assert history["field_solves"].sum() == result.summary["field_solves"] <= (1 + 4 if windows == 4 else 500)
    ratio = history["gap_flux_density"] / history["current"]
    assert ratio.to_numpy() == pytest.approx(ratio.iloc[-1], rel=1e-6)
    frames = flux_densities(result.folder.path)
    assert next(iter(frames)) == 0.0 and frames[0.0] == 0.0 and len(frames) == 5
    last = frames[list(frames)[-1]]
    for time, size in frames.items():
        at = 0.0 if time == 0.0 else float(history["current"][np.isclose(history["time"], time)].iloc[0])
        assert size == pytest.approx(last * at / 0.01, rel=1e-5, abs=1e-9 * last)
    with result.open_record() as record:
        for name in ("current", "flux_linkage"):
            at, values = record.observable(name)
            assert np.array_equal(at, history["time"]) and np.array_equal(values, history[name])


def flux_densities(folder):
    """Largest |B| of each frame of the field by its time."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    from emclutch.results.vtk.series import read_pvd

    largest = {}
    for time, file in read_pvd(folder / "field.pvd"):
        reader = vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(file))
        reader.Update()
        largest[time] = float(np.abs(vtk_to_numpy(reader.GetOutput().GetCellData().GetArray("flux_density"))).max())
    return largest


def test_a_row_of_a_circuit_is_the_circuit_at_its_time(tmp_path):
    """i = V/R (1 - exp(-R t/L)), linkage L i and energy L i^2/2 in each row; what the supply gave until then."""
    R, V = 50.0, 10.0
    circuit = {"coil.current": None, "coil.voltage": V, "coil.resistance": R, "effects.coil_circuit": {}}
    result, L = linear_coil(
        tmp_path / "run", circuit | {"time.end": "1 ms", "time.step": 5e-7, "time.window": 25e-6, "output.snapshots": 0}
    )
    history = result.history
    t, tau = history["time"].to_numpy(), L / R
    assert 0.02e-3 < tau < 1e-3
    current = V / R * (1.0 - np.exp(-t / tau))
    assert history["current"].to_numpy() == pytest.approx(current, rel=1e-6)
    belongs_together(history, L)
    supplied = V * V / R * (t - tau * (1.0 - np.exp(-t / tau)))
    assert history["coil_supplied"].cumsum().to_numpy() == pytest.approx(supplied, rel=1e-6)
    left = (history["coil_supplied"] - history["copper_loss"]).cumsum().to_numpy()
    assert left == pytest.approx(0.5 * L * current**2, rel=1e-3)
    assert result.summary["current_rise_time"] == pytest.approx(tau, rel=0.02)


def test_the_reference_is_that_of_the_columns():
    page = (ROOT / "docs" / "reference" / "columns.md").read_text(encoding="utf-8")
    assert page == reference(), "write emclutch.results.column_table.reference() to docs/reference/columns.md"
    assert all(isinstance(column.when, When) for column in COLUMNS.values())
