"""`emclutch export`: the tables of a run or a study as CSV, Parquet, MATLAB or NetCDF, its series for ParaView."""

from __future__ import annotations

import itertools
import shutil
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results import OutputError, RunFolder, load_result
from emclutch.results.exported_tables import tables_of
from emclutch.results.study_dataset import dataset_of, refuse_without_xarray
from emclutch.results.study_folder import is_study
from emclutch.results.study_result import load_study

if TYPE_CHECKING:
    import pandas


class Format(StrEnum):
    """Formats of exported tables."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"
    NETCDF = "netcdf"
    VTK = "vtk"


def export(folder: Path, to: Format, out: Path | None = None) -> Path:
    """Write a run or a study for another program into a new folder, and return that.

    Parameters
    ----------
    folder : of the run or the study.
    to : CSV and PARQUET: a file a table, and the units in `units.csv`. MAT: one file with a struct a table, and the
        structs `units` and `names`. NETCDF: of a study `study.nc`, its points over its values
        (`emclutch.results.study_dataset`), in NetCDF 3, which scipy writes. VTK: the .pvd series that the run wrote,
        with their files.
    out : new folder; default: the next free export-<format>-<n> in `folder`.

    Raises
    ------
    OutputError
        There is nothing to export, the new folder exists, or a package is missing; the message says which.
    """
    if to is Format.PARQUET and find_spec("pyarrow") is None:
        raise OutputError("Parquet needs the package pyarrow: pip install 'emclutch[parquet]', or take --to csv")
    if to is Format.NETCDF:
        refuse_without_xarray()
        if not is_study(folder):
            raise OutputError(f"{folder} is not a study, and NetCDF is written for studies only; take --to csv")
    series = _series(folder) if to is Format.VTK else {}
    tables = {} if to in (Format.VTK, Format.NETCDF) else tables_of(folder)
    if out is None:
        numbered = (folder / f"export-{to.value}-{number}" for number in itertools.count(1))
        out = next(path for path in numbered if not path.exists())
    try:
        out.mkdir(parents=True)
    except FileExistsError as error:
        raise OutputError(f"{out} exists; name another folder with --out") from error
    if to is Format.VTK:
        for place, runs in series.items():
            _copy_series(runs, out / place)
    elif to is Format.NETCDF:
        dataset_of(load_study(folder)).to_netcdf(out / "study.nc", engine="scipy")
    elif to is Format.MAT:
        _write_mat(out / "tables.mat", tables)
    else:
        _write_tables(out, tables, to)
    return out


def _write_tables(out: Path, tables: dict[str, pandas.DataFrame], to: Format) -> None:
    import pandas

    units = []
    for name, table in tables.items():
        units += [(name, column, unit) for column, unit in table.attrs["units"].items()]
        if to is Format.PARQUET:
            table.to_parquet(out / f"{name}.parquet", index=False, engine="pyarrow")
        else:
            table.to_csv(out / f"{name}.csv", index=False)
    pandas.DataFrame(units, columns=["table", "column", "unit"]).to_csv(out / "units.csv", index=False)


def _write_mat(path: Path, tables: dict[str, pandas.DataFrame]) -> None:
    """A struct a table; columns are fields, whose names MATLAB allows: what it does not becomes an underscore."""
    from scipy.io import savemat

    content: dict[str, Any] = {"units": {}, "names": {}}
    for name, table in tables.items():
        fields = {column: _identifier(column) for column in table.columns}
        content[name] = {fields[column]: _mat_values(table[column]) for column in table.columns}
        content["units"][name] = {fields[column]: unit for column, unit in table.attrs["units"].items()}
        content["names"][name] = {field: column for column, field in fields.items()}
    savemat(path, content, long_field_names=True, oned_as="column", do_compression=True)


def _mat_values(column: pandas.Series) -> np.ndarray:
    if column.dtype.kind in "iuf":
        return column.to_numpy()
    if column.dtype.kind == "b":
        return column.to_numpy(dtype=bool)
    return np.array([str(value) for value in column], dtype=object)


def _identifier(name: str) -> str:
    field = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
    return field if field[:1].isalpha() else f"x{field}"


def _series(folder: Path) -> dict[str, RunFolder]:
    """The runs in a folder that have series for ParaView, by the subfolder that each gets."""
    if is_study(folder):
        runs = {str(name): RunFolder(folder / str(name)) for name in load_study(folder).table["folder"]}
    else:
        runs = {"": load_result(folder).folder}
    found = {place: run for place, run in runs.items() if any(path.is_file() for path in run.series())}
    if not found:
        raise OutputError(
            f"{folder} has no series for ParaView, as the scene requests none; set output.formats = ['vtk'] and "
            "output.snapshots, and run it again"
        )
    return found


def _copy_series(run: RunFolder, place: Path) -> None:
    place.mkdir(parents=True, exist_ok=True)
    for path in run.series():
        if path.is_file():
            shutil.copy2(path, place / path.name)
            shutil.copytree(path.with_suffix(""), place / path.stem)
