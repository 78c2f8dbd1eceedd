"""Exported numbers read back equal, with their units; nothing is overwritten."""

from importlib.util import find_spec

import numpy as np
import pandas
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner
from written_run import written_run, written_study

from emclutch.cli.export import Format, export
from emclutch.cli.main import app
from emclutch.results import OutputError, load_result
from emclutch.results.vtk.series import PvdSeries, read_pvd


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of two replicas with profiles."""
    folder = written_run(tmp_path_factory.mktemp("runs") / "run")
    written_run(folder.replicas / "01", seed=1)
    table = "along,moments,low,high,velocity\nr,4,0.01,0.02,0.3333333333333333\nz,4,0.0,0.1,\n"
    (folder.path / "profiles.csv").write_text(table)
    return folder


@pytest.fixture(scope="module")
def histories(run):
    result = load_result(run.path)
    return [result.history, *result.other_histories]


def test_csv_is_the_same_to_the_last_bit(run, histories, tmp_path):
    out = export(run.path, Format.CSV, tmp_path / "out")
    read = pandas.read_csv(out / "history.csv")
    for number, history in enumerate(histories):
        own = read[read["replica"] == number].reset_index(drop=True).drop(columns="replica")
        pandas.testing.assert_frame_equal(own, history, check_exact=True)
    profiles = pandas.read_csv(out / "profiles.csv")
    assert list(profiles["along"]) == ["r", "z"]
    assert profiles["velocity"][0] == 1.0 / 3.0 and np.isnan(profiles["velocity"][1])
    units = pandas.read_csv(out / "units.csv").set_index(["table", "column"])["unit"]
    assert units["history", "torque_disc"] == "N m" and units["profiles", "velocity"] == "m/s"


def test_mat_has_the_same_numbers_and_names(tmp_path):
    study = written_study(tmp_path / "study", [1.0, 2.0])
    out = export(study, Format.MAT, tmp_path / "out")
    read = loadmat(out / "tables.mat", squeeze_me=True, simplify_cells=True)
    table = pandas.read_csv(study / "study.csv")
    assert np.array_equal(read["study"]["torque"], table["torque"])
    assert (
        list(read["study"]["coil_current"]) == ["1 A", "2 A"]
        and read["names"]["study"]["coil_current"] == "coil.current"
    )
    assert list(np.unique(read["history"]["point"])) == ["point-000", "point-001"]
    second = load_result(study / "point-001").history["torque_disc"]
    assert np.array_equal(read["history"]["torque_disc"][read["history"]["point"] == "point-001"], second)
    assert read["units"]["history"]["time"] == "s"


def test_parquet_has_the_same_numbers_or_says_what_it_needs(run, histories, tmp_path, monkeypatch):
    if find_spec("pyarrow") is not None:
        out = export(run.path, Format.PARQUET, tmp_path / "out")
        read = pandas.read_parquet(out / "history.parquet")
        assert np.array_equal(read["torque_disc"], np.concatenate([each["torque_disc"] for each in histories]))
    monkeypatch.setattr("emclutch.cli.export.find_spec", lambda name: None)
    with pytest.raises(OutputError, match=r"pip install 'emclutch\[parquet\]'"):
        export(run.path, Format.PARQUET, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_vtk_is_what_the_run_has(tmp_path):
    folder = written_run(tmp_path / "run").path
    with pytest.raises(OutputError, match=r"output\.formats"):
        export(folder, Format.VTK)
    series = PvdSeries(folder, "particles")
    for time in (0.0, 1e-3):
        series.write_particles(time, np.zeros((2, 3)), {"radius": np.ones(2)})
    out = export(folder, Format.VTK)
    copied = read_pvd(out / "particles.pvd")
    assert [time for time, _ in copied] == [0.0, 1e-3]
    for (_, copy), (_, original) in zip(copied, read_pvd(folder / "particles.pvd"), strict=True):
        assert copy != original and copy.read_bytes() == original.read_bytes()


def test_nothing_is_overwritten_and_folders_are_counted(run, tmp_path):
    names = [export(run.path, Format.CSV).name for _ in range(2)]
    assert names == ["export-csv-1", "export-csv-2"]
    with pytest.raises(OutputError, match="exists"):
        export(run.path, Format.CSV, run.path / "export-csv-1")
    reported = CliRunner().invoke(app, ["export", str(run.path), "--to", "xlsx"])
    assert reported.exit_code == 2 and "csv, parquet, mat, netcdf, vtk" in reported.output
    assert CliRunner().invoke(app, ["export", str(tmp_path), "--to", "csv"]).exit_code == 2
