"""A design file: one key of a scene is searched for the value that gives a wanted torque."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from emclutch.scene.case import Case, load_case, read_toml, removes
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.fault_report import faults_from, key_fault, quantity_at
from emclutch.scene.model import Scene
from emclutch.scene.section import Section
from emclutch.scene.study import flat_keys
from emclutch.scene.units import Quantity, in_unit_of

WANTED = Quantity("a torque", "N*m", "12 N m", 0.0, 1e7, open_minimum=True)
_EXAMPLE = "write it as in 'torque 12 N m'"


class DesignSection(Section):
    """[design]: which value of one key gives a torque, over the law that `emclutch check` expects it by."""

    case: str = Field(min_length=1, description="scene file, relative to the design file's folder")
    vary: str = Field(min_length=1, description="dotted key of the quantity that is searched, e.g. `geometry.gap`")
    between: tuple[Any, Any] = Field(description='its least and largest value, e.g. `["0.5 mm", "2 mm"]`')
    target: str = Field(min_length=1, description="`torque 12 N m`: of the disc, at the largest current")
    like: str | None = Field(
        default=None,
        min_length=1,
        description="folder of a finished run, from the design file's; its torque over the expected corrects the law",
    )
    set: Annotated[dict[str, Any], BeforeValidator(flat_keys)] = Field(
        default={}, description='dotted key = value, changed in the scene beforehand; "none" removes the key'
    )


class DesignFile(Section):
    """A design file."""

    design: DesignSection


@dataclass(frozen=True, slots=True)
class Search:
    """Design search: a key of a case between two values, and the torque that is wanted.

    Attributes
    ----------
    case : Case
    key : str
    quantity : Quantity
        Of the key.
    between : tuple of float
        Ends of the range, ascending [SI].
    entries : tuple
        The same as they were given.
    torque : float
        Wanted [N m].
    source : str
        Name of the file, for messages.
    like : Path or None
        Folder of the run that corrects the law.
    """

    case: Case
    key: str
    quantity: Quantity
    between: tuple[float, float]
    entries: tuple[Any, Any]
    torque: float
    source: str
    like: Path | None = None

    def shown(self, value: float) -> str:
        """Return a value [SI] in the unit in which the range was given."""
        return in_unit_of(self.entries[0], value, self.quantity)


def read_design(path: str | Path, *, trust_scripts: bool = False) -> Search:
    """Read a design file; `trust_scripts` as in `emclutch.scene.case.load_case`.

    Raises
    ------
    SceneError
        The file or its scene has faults: all of them at once.
    """
    path = Path(path)
    data = read_toml(path)
    try:
        design = DesignFile.model_validate(data).design
    except ValidationError as error:
        raise SceneError(faults_from(error, DesignFile, data), str(path)) from None
    faults = [Fault(f"design.set.{key}", "", reason) for key in design.set if (reason := key_fault(key, Scene))]
    if design.vary in design.set:
        message = "is the key of design.vary, whose values would be taken; remove it"
        faults.append(Fault(f"design.set.{design.vary}", shown(design.set[design.vary]), message))
    case = None
    try:
        changes = {key: None if removes(key, value) else value for key, value in design.set.items()}
        case = load_case(path.parent / design.case, {} if faults else changes, trust_scripts=trust_scripts)
    except SceneError as error:
        faults += [Fault(one.key, one.value, f"{one.message} (in {design.case})") for one in error.faults]
    search = _search(case, design.vary, design.between, design.target, "design.", faults, str(path))
    return search if design.like is None else replace(search, like=path.parent / design.like)


def search_of(case: Case, vary: str, between: Sequence[Any], target: str | float, prefix: str = "") -> Search:
    """Check what is searched; SceneError with all faults, their keys after a `prefix`."""
    if not isinstance(vary, str):
        message = "is not a dotted key; write vary = 'coil.current', between = ('0.1 A', '1 A')"
        raise SceneError([Fault(f"{prefix}vary", shown(vary), message)], "design search")
    if isinstance(between, str) or len(between) != 2:
        message = "is not a pair of values; write it as in ('0.1 A', '1 A')"
        raise SceneError([Fault(f"{prefix}between", shown(between), message)], "design search")
    return _search(case, vary, between, target, prefix, [], "design search")


def _search(
    case: Case | None,
    vary: str,
    between: Sequence[Any],
    target: str | float,
    prefix: str,
    faults: list[Fault],
    source: str,
) -> Search:
    quantity = None
    if reason := key_fault(vary, Scene):
        faults.append(Fault(f"{prefix}vary", shown(vary), reason))
    elif (quantity := quantity_at(vary, Scene, {} if case is None else case.data)) is None:
        message = "is not a continuous quantity; search a length, a current, a fraction"
        faults.append(Fault(f"{prefix}vary", shown(vary), message))
    ends, torque, ends_key = [], 0.0, "--vary" if prefix == "--" else f"{prefix}between"
    for entry in between:
        try:
            ends += [] if quantity is None else [quantity.read(entry)]
        except ValueError as error:
            faults.append(Fault(ends_key, shown(entry), str(error)))
    if len(ends) == 2 and not ends[0] < ends[1]:
        faults.append(Fault(ends_key, shown(list(between)), "does not ascend; give the smaller value first"))
    try:
        torque = WANTED.read(_aim(target))
    except ValueError as error:
        faults.append(Fault(f"{prefix}target", shown(target), f"{error}; {_EXAMPLE}"))
    if faults:
        raise SceneError(faults, source)
    assert case is not None and quantity is not None  # else there were faults
    return Search(case, vary, quantity, (ends[0], ends[1]), (between[0], between[1]), torque, source)


def _aim(target: str | float) -> str | float:
    if not isinstance(target, str):
        return target
    return re.sub(r"^\s*torque\s+", "", target)
