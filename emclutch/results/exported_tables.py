"""The tables of a run or a study for other programs: histories, profiles, and a row a point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from emclutch.results.column_table import units_of
from emclutch.results.grain_profiles import profile_column, read_profiles
from emclutch.results.result import Result, load_result
from emclutch.results.study_folder import UNITS, is_study
from emclutch.results.study_result import load_study
from emclutch.results.wall_loads import read_wall_pressure

if TYPE_CHECKING:
    import pandas

POINT, REPLICA, ALONG = "point", "replica", "along"
"""Columns that distinguish what one table holds: a study's points, a run's replicas, the profiles' coordinates."""


def tables_of(folder: Path) -> dict[str, pandas.DataFrame]:
    """Return `history`, where there are any `profiles`, `wall_pressure`, `study`; ``attrs["units"]`` has the units.

    A column that only some of a study's points have is nan (empty) in the others' rows.

    Raises
    ------
    OutputError
        The folder holds neither a run nor a study.
    """
    if not is_study(folder):
        return _tables_of_run(load_result(folder))
    study = load_study(folder)
    found: dict[str, list[pandas.DataFrame]] = {}
    for name, result in zip(study.table["folder"].astype(str), study.results().values(), strict=True):
        for kind, table in _tables_of_run(result).items():
            table.insert(0, POINT, name)
            found.setdefault(kind, []).append(table)
    table = study.table.copy()
    table.attrs["units"] = {name: unit for name, unit in UNITS.items() if name in table}
    return {"study": table} | {kind: _joined(tables) for kind, tables in found.items()}


def _tables_of_run(result: Result) -> dict[str, pandas.DataFrame]:
    histories = [result.history.copy(), *result.other_histories]
    if len(histories) > 1:
        for number, history in enumerate(histories):
            history.insert(0, REPLICA, number)
    tables = {"history": _joined(histories)}
    tables["history"].attrs["units"] = units_of(tables["history"])
    path = result.folder.path / "profiles.csv"
    if path.is_file():
        profiles = []
        for along, profile in read_profiles(path).items():
            profile.insert(0, ALONG, along)
            profiles.append(profile)
        tables["profiles"] = _joined(profiles)
        names = [name for name in tables["profiles"] if name != ALONG]
        tables["profiles"].attrs["units"] = {name: profile_column(name)[0] for name in names}
    path = result.folder.path / "wall_pressure.csv"
    if path.is_file():
        tables["wall_pressure"] = read_wall_pressure(path)
    return tables


def _joined(tables: list[pandas.DataFrame]) -> pandas.DataFrame:
    """Return the rows of all tables under one another, with the units of all."""
    import pandas

    units = {name: unit for table in tables for name, unit in table.attrs.get("units", {}).items()}
    for table in tables:
        table.attrs = {}  # pandas compares them when it joins
    joined = pandas.concat(tables, ignore_index=True)
    joined.attrs["units"] = units
    return joined
