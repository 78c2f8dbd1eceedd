"""A study: one case with many values. The points are every combination of the listed values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationError

from emclutch.case import Case, load_case, read_toml
from emclutch.faults import Fault, SceneError, shown
from emclutch.scene.fault_report import faults_from, key_fault
from emclutch.scene.model import Scene
from emclutch.scene.section import Section

MOST_POINTS = 10_000
"""Of a study, each of them a run."""


def _flat(given: Any, prefix: str = "") -> Any:
    """Turn nested tables into dotted keys: TOML reads an unquoted ``coil.current = [...]`` as tables."""
    if not isinstance(given, dict):
        return given
    flat: dict[str, Any] = {}
    for key, value in given.items():
        if isinstance(value, dict) and value:
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


class Study(Section):
    """[study] of a study file.

    Attributes
    ----------
    path : the file that it was read from
    """

    case: str = Field(min_length=1, description="scene file, relative to the study's folder")
    title: str = Field(default="", description="a line of text")
    values: Annotated[dict[str, Any], BeforeValidator(_flat)] = Field(
        description="dotted key = list of its values; every combination is a point"
    )
    set: Annotated[dict[str, Any], BeforeValidator(_flat)] = Field(
        default={}, description="dotted key = value, for every point"
    )
    warm_start: str | None = Field(
        default=None, description="one of the values: along it each point begins with the grains of the one before"
    )
    _path: Path = PrivateAttr(default=Path("study.toml"))
    _trust_scripts: bool = PrivateAttr(default=False)

    @property
    def path(self) -> Path:
        """The study's file."""
        return self._path

    @property
    def case_path(self) -> Path:
        """The scene's file."""
        return self._path.parent / self.case

    def points(self) -> list[dict[str, Any]]:
        """Every combination of the values, the last key running fastest."""
        combinations = itertools.product(*self.values.values())
        return [dict(zip(self.values, point, strict=True)) for point in combinations]

    def predecessors(self) -> list[int | None]:
        """The number of the point whose grains each point begins with, None where it packs its own."""
        if self.warm_start is None:
            return [None] * len(self.points())
        latest: dict[str, int] = {}
        found: list[int | None] = []
        for number, point in enumerate(self.points()):
            chain = repr([value for key, value in point.items() if key != self.warm_start])
            found.append(latest.get(chain))
            latest[chain] = number
        return found

    def cases(self) -> Iterator[tuple[dict[str, Any], Case]]:
        """Yield each point's values with its checked case."""
        base = load_case(self.case_path, trust_scripts=self._trust_scripts)
        for point in self.points():
            yield point, base.with_values({**self.set, **point})


NO_CHECKPOINT = Fault("output.checkpoint", "false", "keeps no grains to hand on; leave it out, or study.warm_start")


class _StudyFile(Section):
    study: Study


def read_study(path: str | Path, *, trust_scripts: bool = False) -> Study:
    """Read a study file and check every point of it; `trust_scripts` as in `emclutch.case.load_case`.

    Raises
    ------
    SceneError
        The file or one of its cases has faults. Those of the points come with the point's values.
    """
    path = Path(path)
    data = read_toml(path)
    if "study" not in data and "scene" in data:
        raise SceneError(
            [Fault("study", "", f"is missing: this file is one scene; use: emclutch run {path}")], str(path)
        )
    try:
        study = _StudyFile.model_validate(data).study
    except ValidationError as error:
        raise SceneError(faults_from(error, _StudyFile, data), str(path)) from None
    study._path, study._trust_scripts = path, trust_scripts
    faults = [
        Fault(f"study.{table}.{key}", "", reason)
        for table, entries in (("values", study.values), ("set", study.set))
        for key in entries
        if (reason := key_fault(key, Scene))
    ]
    faults += [
        Fault(f"study.values.{key}", shown(values), "is not a list of values; write it in brackets, e.g. [1, 2]")
        for key, values in study.values.items()
        if not isinstance(values, list) or not values
    ]
    faults += _warm_start_faults(study)
    number = math.prod(len(values) for values in study.values.values() if isinstance(values, list))
    if number > MOST_POINTS:
        message = f"makes {number:.4g} points; allowed: at most {MOST_POINTS}; take fewer values, or several studies"
        faults.append(Fault("study.values", "", message))
    if faults:
        raise SceneError(faults, str(path))
    _check_points(study)
    return study


def _warm_start_faults(study: Study) -> list[Fault]:
    """What is wrong with the axis along which grains are handed on."""
    key = study.warm_start
    if key is None:
        return []
    allowed = [one for one in study.values if one.startswith(("coil.", "motion.")) and len(study.values[one]) > 1]
    if key not in allowed:
        options = f"one of {', '.join(allowed)}" if allowed else "none, as it varies no coil.* and no motion.*"
        return [Fault("study.warm_start", shown(key), f"hands on no grains; allowed in this study: {options}")]
    return []


def _check_points(study: Study) -> None:
    """Check every point; a fault that all of them share is told once."""
    base = load_case(study.case_path, trust_scripts=study._trust_scripts)
    faults: dict[Fault, str] = {}
    for point in study.points():
        try:
            case = base.with_values({**study.set, **point})
        except SceneError as error:
            found = error.faults
        else:
            found = () if study.warm_start is None or case.scene.output.checkpoint else (NO_CHECKPOINT,)
        where = ", ".join(f"{key} = {shown(value)}" for key, value in point.items())
        for fault in found:
            faults.setdefault(fault, where)
    if faults:
        raise SceneError(
            [Fault(fault.key, fault.value, f"{fault.message} (at {where})") for fault, where in faults.items()],
            str(study.path),
        )
