"""A study: one case with many values. The points are every combination of the values, or a sample of their ranges.

An entry ``"none"`` takes its key out of the scene, for ``effects.NAME`` also ``"off"``, as in ``emclutch run --set``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationError

from emclutch.scene.case import Case, case_from, load_case, read_toml, removes
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.fault_report import faults_from, key_fault, quantity_at
from emclutch.scene.model import NO_GRAINS, Scene
from emclutch.scene.sampling import SampleSection, combinations, is_range, read_ranges
from emclutch.scene.section import Section

MAX_POINTS = 10_000
"""Of a study, each of them a run."""


def flat_keys(given: Any, prefix: str = "") -> Any:
    """Turn nested tables into dotted keys: TOML reads an unquoted ``coil.current = [...]`` as tables.

    ValueError where both spellings name one key.
    """
    if not isinstance(given, dict):
        return given
    flat: dict[str, Any] = {}
    for key, value in given.items():
        nested = isinstance(value, dict) and value and not is_range(value)
        below = flat_keys(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
        if twice := flat.keys() & below.keys():
            raise ValueError(f"names {min(twice)} twice, once in quotes and once as a table; keep one of them")
        flat |= below
    return flat


class StudySection(Section):
    """[study]: one scene with many values; every combination of them is a run, unless they are sampled."""

    case: str = Field(min_length=1, description="scene file, relative to the study's folder")
    title: str = Field(default="", description="a line of text")
    values: Annotated[dict[str, Any], BeforeValidator(flat_keys)] = Field(
        description='dotted key = list of its values ("none" removes the key), or a range of them: { from, to, count, '
        'spacing = "log", whole = true }; without count it is sampled, the last two may be left out'
    )
    set: Annotated[dict[str, Any], BeforeValidator(flat_keys)] = Field(
        default={}, description='dotted key = value, for every point; "none" removes the key'
    )
    warm_start: str | None = Field(
        default=None, description="one of the values: along it each point begins with the grains of the one before"
    )
    sample: SampleSection | None = None
    _path: Path = PrivateAttr(default=Path("study.toml"))
    _trust_scripts: bool = PrivateAttr(default=False)
    _checked: dict[str, Case] = PrivateAttr(default_factory=dict)
    """Cases that `read_study` has checked, by scene and changes: to check one takes longer than all else of a point."""

    @property
    def path(self) -> Path:
        """The study's file."""
        return self._path

    @property
    def case_path(self) -> Path:
        """The scene's file."""
        return self._path.parent / self.case

    def points(self) -> list[dict[str, Any]]:
        """Every combination of the values, the last key running fastest; where they are sampled, the sample."""
        return combinations(self.values) if self.sample is None else self.sample.points(self.values)

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

    def changes(self, point: dict[str, Any]) -> dict[str, Any]:
        """Changes of a point in the scene; None removes a key, as in `Case.with_values`."""
        given = {**self.set, **point}
        return {key: None if removes(key, value) else value for key, value in given.items()}

    def warnings(self, numbers: Sequence[int] | None = None) -> list[str]:
        """Return warnings of the scenes of all points, or of those of some numbers, each once.

        One that only some points have comes with the values of the first of them.
        """
        found: dict[str, list[str]] = {}
        cases = list(self.cases(numbers))
        for values, case in cases:
            for text in case.warnings:
                found.setdefault(text, []).append(_in_words(values))
        return [
            text if len(where) == len(cases) else f"{text} ({where[0]}{'' if len(where) == 1 else ', and others'})"
            for text, where in found.items()
        ]

    def cases(self, numbers: Sequence[int] | None = None) -> Iterator[tuple[dict[str, Any], Case]]:
        """Yield each point's values with its checked case; of points of some numbers alone where these are given."""
        base: Case | None = None
        points = self.points()
        for point in points if numbers is None else [points[number] for number in numbers]:
            changes = self.changes(point)
            if (case := self._checked.get(repr((self.case_path, changes)))) is None:
                base = base or load_case(self.case_path, trust_scripts=self._trust_scripts)
                case = base.with_values(changes)
            yield point, case


NO_CHECKPOINT = Fault("output.checkpoint", "false", "keeps no grains to start from; remove it, or study.warm_start")


class StudyFile(Section):
    """A study file."""

    study: StudySection


class _PartialStudySection(StudySection):
    """The valid part of a study with errors."""

    case: str | None = None  # type: ignore[assignment]
    values: Annotated[dict[str, Any], BeforeValidator(flat_keys)] = {}


def read_study(path: str | Path, *, trust_scripts: bool = False, numbers: Sequence[int] | None = None) -> StudySection:
    """Read a study file and check every point of it; `trust_scripts` as in `emclutch.scene.case.load_case`.

    With `numbers`, from 0, only these points are checked.

    Raises
    ------
    SceneError
        The file, its scene or one of its points has faults: all of them at once. Those of the points come with the
        point's values. There is no such point.
    """
    if not isinstance(path, (str, PathLike)):
        message = "is not the path of a study file; write one with a table [study], as cases/current_to_torque.toml"
        raise SceneError([Fault("study", shown(path), message)], "arguments")
    path = Path(path)
    data = read_toml(path)
    if "study" not in data and "scene" in data:
        raise SceneError(
            [Fault("study", "", f"is missing: this file is one scene; use: emclutch run {path}")], str(path)
        )
    study, faults = _read(data)
    if study is not None:
        is_unknown = any(fault.key.startswith("study.sample") for fault in faults)
        values, sample, wrong = read_ranges(study.values, study.sample, is_unknown)
        given, study, faults = study, study.model_copy(update={"values": values, "sample": sample}), faults + wrong
        study._path, study._trust_scripts = path, trust_scripts
        faults += [*_key_faults(study), *_repeated(given), *_warm_start_faults(study)]
        lists = {key: entries for key, entries in study.values.items() if _is_list(entries)}
        number = math.prod(map(len, lists.values())) if wrong or sample is None else sample.size(lists)
        if number > MAX_POINTS:
            message = f"makes {number:.4g} points; allowed: at most {MAX_POINTS}; take fewer values, or more studies"
            faults.append(Fault("study.values", "", message))
        elif study.case is not None:
            if wrong:  # the right values are checked each with each: the sample is unknown
                study = study.model_copy(update={"sample": None})
            missing = _no_such_points(study, numbers) if numbers and not faults else []
            faults += missing or _faults_of_points(study, None if faults else numbers)
    if study is None or faults:
        raise SceneError(faults, str(path))
    return study


def _read(data: dict[str, Any]) -> tuple[StudySection | None, list[Fault]]:
    """The study, what is right of it where it has faults, None where there is no table; and the faults."""
    try:
        return StudyFile.model_validate(data).study, []
    except ValidationError as error:
        faults = faults_from(error, StudyFile, data)
    given = data.get("study")
    if not isinstance(given, dict):
        return None, faults
    broken = {fault.key.removeprefix("study.").split(".")[0].split("[")[0] for fault in faults}
    return _PartialStudySection.model_validate(
        {key: entry for key, entry in given.items() if key.split(".")[0] not in broken}
    ), faults


_NO_LIST = "is not a list of values; write it in brackets, e.g. [1, 2]"
_NO_VALUES = "is an empty list: the study would have no points; give one value or more, or remove the key"


def _key_faults(study: StudySection) -> list[Fault]:
    """Keys that no scene has, and values that are no list."""
    return [
        Fault(f"study.{table}.{key}", "", reason)
        for table, entries in (("values", study.values), ("set", study.set))
        for key in entries
        if (reason := key_fault(key, Scene))
    ] + [
        Fault(f"study.values.{key}", shown(values), _NO_VALUES if values == [] else _NO_LIST)
        for key, values in study.values.items()
        if not _is_list(values) and not is_range(values)
    ]


def _repeated(study: StudySection) -> Iterator[Fault]:
    """Yield a fault for a key that is set and varied, and for a value that is listed twice: it would run twice."""
    for key in study.set.keys() & study.values.keys():
        message = "is in [study.values] too, whose values would be taken; remove it here or there"
        yield Fault(f"study.set.{key}", shown(study.set[key]), message)
    for key, entries in study.values.items():
        seen: dict[str, Any] = {}
        for entry in entries if _is_list(entries) else ():
            value = _as_read(key, entry)
            if value in seen:
                same = "" if shown(seen[value]) == shown(entry) else f", as {shown(seen[value])} is the same"
                message = f"is listed twice{same}; its points would run twice: list each value once"
                yield Fault(f"study.values.{key}", shown(entry), message)
            seen.setdefault(value, entry)


def _as_read(key: str, entry: Any) -> str:
    """Return what an entry of a key means, as text: '1 A' and '1000 mA' are the same."""
    quantity = None if key_fault(key, Scene) or removes(key, entry) else quantity_at(key, Scene, {})
    try:
        return f"{entry!r}" if quantity is None else f"{quantity.read(entry):.12g}"
    except ValueError:  # reported with the points
        return f"{entry!r}"


def _is_list(values: Any) -> bool:
    return isinstance(values, list) and bool(values)


def _warm_start_faults(study: StudySection) -> list[Fault]:
    """Fault of the axis along which grains are handed on; None where there is none."""
    key = study.warm_start
    if key is None:
        return []
    if study.sample is not None:
        return [Fault("study.warm_start", shown(key), "needs listed values; remove it, or study.sample")]
    several = [one for one, values in study.values.items() if _is_list(values) and len(values) > 1]
    allowed = [one for one in several if one.startswith(("coil.", "motion."))]
    if key not in allowed:
        options = f"one of {', '.join(allowed)}" if allowed else "none, as it varies no coil.* and no motion.*"
        return [
            Fault(
                "study.warm_start",
                shown(key),
                f"cannot be used; allowed in this study: {options}",
            )
        ]
    return []


def _no_such_points(study: StudySection, numbers: Sequence[int]) -> list[Fault]:
    total = len(study.points())
    message = f"is no point of this study, which has {total}; allowed: 0 to {total - 1}"
    return [Fault("--point", str(number), message) for number in numbers if not 0 <= number < total]


def _faults_of_points(study: StudySection, numbers: Sequence[int] | None) -> list[Fault]:
    """Faults of the scene and of every point, with the valid part of the study; a common one is reported once.

    `numbers` : of the points that are to be checked; None: all.
    """
    try:
        data = read_toml(study.case_path)
        if "study" in data:
            raise SceneError([Fault("study", "", "makes it a study; name the file of one scene")])
    except SceneError as error:
        path = study.case_path
        words = " ".join(fault.message if fault.key == str(path) else str(fault) for fault in error.faults)
        message = f"{words} ({path.absolute()}; relative paths start in the study's folder)"
        return [Fault("study.case", shown(study.case), message)]
    right = {key: values for key, values in study.values.items() if _is_list(values) and not key_fault(key, Scene)}
    fixed = {key: value for key, value in study.set.items() if not key_fault(key, Scene)}
    sample = study.sample if len(right) == len(study.values) else None
    valid = study.model_copy(update={"values": right, "set": fixed, "sample": sample})
    faults: dict[Fault, str] = {}
    points = valid.points()
    path, last = study.case_path, None
    for point in [None, *(points if numbers is None else (points[number] for number in numbers))]:
        changes = {} if point is None else valid.changes(point)
        try:
            case = case_from(data, changes, path, trust_scripts=study._trust_scripts)
        except SceneError as error:
            found = error.faults
        else:
            if point is not None:
                study._checked[repr((path, changes))] = last = case if last is None else case.sharing(last)
            found = () if point is None or case.scene.particles is not None else (NO_GRAINS,)
            if point is not None and study.warm_start is not None and not case.scene.output.checkpoint:
                found += (NO_CHECKPOINT,)
        where = f"in {study.case}" if point is None else _in_words(point or valid.set)
        for fault in found:
            faults.setdefault(fault, where)
    return [Fault(fault.key, fault.value, f"{fault.message} ({where})") for fault, where in faults.items()]


def _in_words(values: dict[str, Any]) -> str:
    return "at " + ", ".join(f"{key} = {shown(value)}" for key, value in values.items())
