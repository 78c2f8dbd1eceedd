"""A study as one object has each point at its values, whatever is done, and reads back equal from NetCDF."""

import numpy as np
import pandas
import pytest
from written_run import written_study

import emclutch
from emclutch.cli.export import Format, export
from emclutch.results.atomic_file import replace_json
from emclutch.results.study_dataset import dataset_of
from emclutch.results.study_result import load_study

xarray = pytest.importorskip("xarray")
CURRENT, FRICTION, SEED = "coil.current", "contact.friction", "scene.seed"


def torque_of(row):
    """One that tells each point from all others."""
    return float(str(row[CURRENT]).split()[0]) * 100.0 + row[FRICTION] * 10.0 + row[SEED]


def write(folder, values, rows, points=None):
    folder.mkdir()
    whole = [
        {**row, "end_time": 0.2, "torque": torque_of(row), "low": 1.0, "high": None, "converged": True, "reason": "±",
         "shear_stress": 5.0, "seconds": 2.0, "folder": f"point-{number:03d}"}
        for number, row in enumerate(rows)
    ]  # fmt: skip
    pandas.DataFrame(whole).to_csv(folder / "study.csv", index=False)
    replace_json(folder / "study.json", {"title": "a study", "values": values, "points": points or len(rows)})
    return load_study(folder)


@pytest.fixture
def grid(tmp_path):
    """3 x 2 x 2 points, the last of which is not done; given in no order."""
    values = {CURRENT: ["1 A", "0.5 A", "2 A"], FRICTION: [0.1, 0.3], "coil.turns": [100], SEED: [1, 2]}
    rows = [
        {CURRENT: i, FRICTION: f, "coil.turns": 100, SEED: s}
        for i in values[CURRENT] for f in values[FRICTION] for s in values[SEED]
    ][:-1]  # fmt: skip
    return write(tmp_path / "grid", values, rows[::-1], points=12)


def test_each_point_of_a_grid_stands_at_its_values(grid):
    found = dataset_of(grid)
    assert dict(found.sizes) == {CURRENT: 3, FRICTION: 2, "replica": 2}
    assert found[CURRENT].attrs == {"units": "A"} and found[CURRENT].to_numpy().tolist() == [1.0, 0.5, 2.0]
    assert found["coil.turns"].ndim == 0 and float(found["coil.turns"]) == 100.0
    for _, row in grid.table.iterrows():
        current = float(row[CURRENT].split()[0])
        point = found.sel({CURRENT: current, FRICTION: row[FRICTION], "replica": row[SEED]})
        assert float(point["torque"]) == row["torque"] and bool(point["done"]) and bool(point["converged"])
    missing = found.sel({CURRENT: 2.0, FRICTION: 0.3, "replica": 2})
    assert np.isnan(missing["torque"]) and not missing["done"] and not missing["converged"] and missing["reason"] == ""
    assert int(found["done"].sum()) == 11
    units = {name: found[name].attrs.get("units") for name in ("torque", "low", "seconds", "shear_stress")}
    assert units == {"torque": "N m", "low": "N m", "seconds": "s", "shear_stress": "Pa"}


def test_a_sample_lies_along_points_and_its_seeds_are_replicas(tmp_path):
    currents, frictions = ["0.31 A", "0.62 A", "0.95 A"], [0.3, 0.1, 0.2]
    rows = [
        {CURRENT: i, FRICTION: f, SEED: s} for i, f in zip(currents, frictions, strict=True) for s in (7, 8)
    ]  # fmt: skip
    found = dataset_of(write(tmp_path / "s", {CURRENT: currents, FRICTION: frictions, SEED: [7, 8]}, rows))
    assert dict(found.sizes) == {"point": 3, "replica": 2}
    assert found[CURRENT].dims == ("point",) and found[FRICTION].to_numpy().tolist() == frictions
    wanted = [[100.0 * i + 10.0 * f + s for s in (7, 8)] for i, f in zip((0.31, 0.62, 0.95), frictions, strict=True)]
    assert found["torque"].to_numpy() == pytest.approx(np.array(wanted))


def test_entries_that_are_no_numbers_of_one_unit_stay_text(tmp_path):
    values = {CURRENT: ["500 mA", "1 A"], FRICTION: [0.1], SEED: [1]}
    rows = [{CURRENT: i, FRICTION: 0.1, SEED: 1} for i in values[CURRENT]]
    found = dataset_of(write(tmp_path / "s", values, rows))
    assert found[CURRENT].to_numpy().tolist() == ["500 mA", "1 A"] and found[CURRENT].attrs == {}
    one = dataset_of(write(tmp_path / "one", {**values, CURRENT: ["1 A"]}, rows[1:]))
    assert one["torque"].size == 1 and float(one["torque"].squeeze()) == torque_of(rows[1])


def test_netcdf_reads_back_equal(grid, tmp_path):
    out = export(grid.folder, Format.NETCDF, tmp_path / "out")
    read = xarray.load_dataset(out / "study.nc", engine="scipy")
    xarray.testing.assert_identical(read, dataset_of(grid))


def test_a_loaded_study_is_one_object_and_a_run_is_none(tmp_path):
    folder = written_study(tmp_path / "study", [1.0, 2.0])
    found = emclutch.load_study(folder).to_xarray()
    assert found["torque"].to_numpy() == pytest.approx(emclutch.load_study(folder).table["torque"].to_numpy())
    with pytest.raises(emclutch.OutputError, match="is not a study"):
        export(folder / "point-000", Format.NETCDF)


def test_without_xarray_the_line_that_installs_it_is_told(tmp_path, monkeypatch):
    folder = written_study(tmp_path / "study", [1.0, 2.0])
    monkeypatch.setattr("emclutch.results.study_dataset.find_spec", lambda name: None)
    with pytest.raises(emclutch.OutputError, match=r"pip install 'emclutch\[xarray\]'"):
        emclutch.load_study(folder).to_xarray()
    with pytest.raises(emclutch.OutputError, match=r"pip install 'emclutch\[xarray\]'"):
        export(folder, Format.NETCDF, tmp_path / "none")
    assert not (tmp_path / "none").exists()
