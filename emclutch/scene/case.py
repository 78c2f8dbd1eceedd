"""A case: a validated scene, with the file that it came from."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import tomli_w
from pydantic import Field, ValidationError, create_model

from emclutch.scene.consistency import GEOMETRY_KIND, PartialScene, faults_between_sections
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.fault_report import faults_from, key_fault
from emclutch.scene.geometry_sketch import sketch_of
from emclutch.scene.likely_mistakes import warnings_of
from emclutch.scene.model import NO_GRAINS, Scene
from emclutch.scene.repeated_key import repeated_key
from emclutch.scene.repose import with_friction_of_repose
from emclutch.scene.section import Section
from emclutch.scene.sector_checks import with_sector_angle

MAX_FILE = 20_000_000
"""Bytes of a scene or study: half a million points of a table; a larger file is refused before it is parsed."""
DEEPEST = 20
"""Levels of nested tables and lists; a scene needs five."""


@dataclass(frozen=True, slots=True, repr=False)
class Case:
    """A scene that was read and checked. `load_case` makes it from a file.

    Attributes
    ----------
    scene : Scene
        All tables of the scene, values in SI.
    path : Path or None
        Its file; None for a scene made in Python.
    data : dict
        The scene as the user wrote it, with the values that were set since.
    trust_scripts : bool
        Whether scripts that the scene names (.geo) may be run. They can run any command.
    """

    scene: Scene
    path: Path | None = None
    data: dict[str, Any] = field(default_factory=dict)
    trust_scripts: bool = False

    def __reduce__(self):
        """Pickle what the scene was made from, with an absolute path; it is checked again where it is loaded."""
        path = None if self.path is None else self.path.resolve()
        return partial(case_from, trust_scripts=self.trust_scripts), (self.data, {}, path)

    def __repr__(self) -> str:
        from emclutch.scene.flat import settings_beside  # local: it imports this module

        whole = repr(self.scene.scene.title if self.path is None else str(self.path))
        with suppress(SceneError):  # the file is gone
            changes = [f"{key} = {value}" for key, value in settings_beside(self).items()]
            more = [f"and {len(changes) - 4} more"] if len(changes) > 5 else []
            return f"Case({', '.join([whole, *(changes[:4] + more if more else changes)])})"
        return f"Case({whole})"

    @property
    def name(self) -> str:
        """Name of the file without its ending; ``scene`` without a file."""
        return "scene" if self.path is None else self.path.stem

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of entries that are allowed but likely not meant, a text each."""
        return tuple(warnings_of(self.scene))

    def need_grains(self) -> None:
        """Raise SceneError, with the remedy, for a scene of the field alone."""
        if self.scene.particles is None:
            raise SceneError([NO_GRAINS], "scene" if self.path is None else str(self.path))

    def with_values(self, values: Mapping[str, Any]) -> Case:
        """Return a new case with other values.

        Parameters
        ----------
        values : mapping of str to value
            By dotted keys, as a scene file has them: ``{"coil.current": "0.8 A"}``, or a number in SI. None removes
            the key. ``"off"`` removes ``effects.NAME``, ``"on"`` adds its table where there is none. A dictionary
            replaces the whole table of its key.

        Raises
        ------
        SceneError
            The scene is not valid with these values.
        """
        return case_from(self.data, values, self.path, trust_scripts=self.trust_scripts)

    def sharing(self, other: Case) -> Case:
        """Return the same case with the sections of another one that are equal: of thousands one is kept."""
        mine, theirs, data = dict(self.scene), dict(other.scene), {**self.data}
        for name, section in mine.items():
            if data.get(name) == other.data.get(name) and section == theirs[name]:
                mine[name] = theirs[name]
                if name in data:
                    data[name] = other.data[name]
        given, same = self.scene.model_fields_set, other.scene.model_fields_set
        return replace(self, scene=Scene.model_construct(same if given == same else given, **mine), data=data)

    def resolved(self) -> dict[str, Any]:
        """Return the whole scene as nested dictionaries, values in SI, with all defaults."""
        whole = self.scene.model_dump(mode="json", exclude_none=True)
        return {name: section for name, section in whole.items() if section or name != "materials"}

    def toml(self) -> str:
        """Return the resolved scene as the text of a scene file."""
        return tomli_w.dumps(self.resolved())

    def write_toml(self, path: str | Path) -> None:
        """Write the resolved scene to a new file.

        Raises
        ------
        FileExistsError
            There is a file already; nothing is overwritten.
        """
        with open(path, "x", encoding="utf-8") as stream:
            stream.write(self.toml())


def load_case(
    path: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | None = None, *, trust_scripts: bool = False
) -> Case:
    """Read a scene file and check it.

    Parameters
    ----------
    path : of the TOML file, or its tables as nested dictionaries.
    overrides : values by dotted keys that replace those of the file, as of `Case.with_values`.
    trust_scripts : allow a script as the file of the geometry (.geo). It may run any command on this machine.

    Raises
    ------
    SceneError
        The file cannot be read, is no TOML, or the scene has faults. The error has all of them.
    """
    if isinstance(path, Mapping):
        return case_from(path, {} if overrides is None else overrides, trust_scripts=trust_scripts)
    if not isinstance(path, (str, PathLike)):
        message = "is neither the path of a scene file nor the tables of a scene; give 'my_scene.toml', or a dictionary"
        raise SceneError([Fault("case", shown(path), message)], "arguments")
    path = Path(path)
    data = read_toml(path)
    if "study" in data:
        raise SceneError(
            [Fault("study", "", f"makes this file a study of many scenes; use: emclutch sweep {path}")],
            str(path),
        )
    if "design" in data:
        raise SceneError(
            [Fault("design", "", f"makes this file the search of a value; use: emclutch design {path}")],
            str(path),
        )
    return case_from(data, {} if overrides is None else overrides, path, trust_scripts=trust_scripts)


def as_case(given: Case | str | Path) -> Case:
    """Return a case as it is, and the checked scene of a file's path; SceneError as of `load_case`."""
    return given if isinstance(given, Case) else load_case(given)


def case_from(
    data: Mapping[str, Any],
    values: Mapping[str, Any] = MappingProxyType({}),
    path: Path | None = None,
    *,
    trust_scripts: bool = False,
) -> Case:
    """Check a scene given as nested dictionaries, with dotted `values` set in a copy of it; else as `load_case`."""
    changed = copy.deepcopy(dict(data))
    source = "scene" if path is None else str(path)
    faults = []
    if not isinstance(values, Mapping):
        message = "is not a dictionary; write values as in {'coil.current': '0.8 A'}"
        raise SceneError([Fault("values", shown(values), message)], source)
    for key, value in values.items():
        faults += _set(changed, key, value)
    if faults:
        raise SceneError(faults, source)
    scene, faults = _validate(changed, Path() if path is None else path.parent, trust_scripts)
    if scene is None or faults:
        raise SceneError(faults, source)
    return Case(scene, path, changed, trust_scripts)


def removes(key: str, value: object) -> bool:
    """True if a value removes its key from a scene: ``none``, and for ``effects.NAME`` ``off`` too."""
    return value == "none" or (value == "off" and _is_an_effect(key))


def _is_an_effect(key: str) -> bool:
    return key.startswith("effects.") and key.count(".") == 1


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    SceneError
        It cannot be read, or it is not TOML; the fault has the line.
    """
    try:
        with open(path, "rb") as stream:
            content = stream.read(MAX_FILE + 1)
        if len(content) <= MAX_FILE:
            data = tomllib.loads(text := content.decode("utf-8-sig"))  # Notepad writes a byte order mark
            if not (faults := _not_of_a_scene(data, path)):
                return data
            raise SceneError(faults, str(path))
        reason = f"is larger than {MAX_FILE // 1_000_000} MB; put long tables into files of their own"
    except FileNotFoundError:
        reason = "does not exist; check the path"
    except IsADirectoryError:
        reason = "is a folder; name a scene's .toml file, or continue a run in it by --resume"
    except OSError as error:
        reason = f"cannot be read ({error.strerror}); check the path and its permissions"
    except UnicodeDecodeError:
        reason = "is not text in UTF-8; a scene is a TOML file"
    except RecursionError:
        reason = _TOO_DEEP
    except ValueError as error:  # of the parser, or of Python for a number of more digits than it reads
        remedy = "correct that line, texts and values with a unit need quotes"
        if any(mark in text for mark in "\u201c\u201d\u201e\u2018\u2019"):
            remedy += ', straight ones as in "1 A"'
        reason = repeated_key(text) or f"is not TOML: {error}; {remedy}"
    raise SceneError([Fault(str(path), "", reason)], str(path))


_TOO_DEEP = f"nests tables more than {DEEPEST} deep; a scene needs five levels: write them one after another"


def _not_of_a_scene(data: dict[str, Any], path: Path) -> list[Fault]:
    """Return faults that Python cannot handle: deep nesting, whole numbers of more than TOML's 64 bits."""
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST):
        below: list[tuple[str, Any]] = []
        for key, entry in level:
            if isinstance(entry, int) and not -(2**63) <= entry < 2**63:
                words = "holds a whole number of more than 64 bits; write it as 1e30, or check its digits"
                return [Fault(key, "", words)]
            if isinstance(entry, dict):
                below += ((f"{key}.{name}".lstrip("."), value) for name, value in entry.items())
            elif isinstance(entry, list):
                below += ((key, value) for value in entry)
        level = below
    return [Fault(str(path), "", _TOO_DEEP)] if level else []


def _set(data: dict[str, Any], key: str, value: Any) -> list[Fault]:
    """Set a dotted key in place; tables on its path are created. An effect that is on already keeps its table.

    A section is not replaced by a part of itself: who writes {"coil": {"current": 1}} wants to keep the turns.
    """
    if not isinstance(key, str):
        return [Fault(shown(key), "", "is not a dotted key; write it as in 'coil.current'")]
    if isinstance(value, dict) and value and key != "effects" and isinstance(present := data.get(key), dict):
        lost = [name for name in present if name not in value]
        if lost and all(name in present for name in value):
            dotted, inner = key, value
            while isinstance(inner, dict) and inner:
                name, inner = next(iter(inner.items()))
                dotted += f".{name}"
            message = f"would remove {', '.join(lost)} of [{key}]; write dotted keys: {{'{dotted}': {shown(inner)}}}"
            return [Fault(key, shown(value), message)]
    *tables, name = key.split(".")
    if _is_an_effect(key) and value == "off":
        value = None
    if not all((*tables, name)):
        return [Fault(key, "", "is not a dotted key; write it as in 'coil.current'")]
    for step in tables:
        table = data.setdefault(step, {}) if value is not None else data.get(step, {})
        if not isinstance(table, dict):
            return [Fault(key, "", f"cannot be set: {step} is a value in this scene, not a table; set {step} itself")]
        data = table
    if value is None:
        if name not in data and (reason := key_fault(key, Scene)):
            return [Fault(key, "", reason)]
        data.pop(name, None)
    elif value == "on" and _is_an_effect(key):
        data.setdefault(name, {})
    else:
        data[name] = copy.deepcopy(value)
    return []


def _validate(data: dict[str, Any], folder: Path, trust_scripts: bool) -> tuple[Scene | None, list[Fault]]:
    """Return the scene, or None, and every fault: within the sections and between those that are right."""
    context = {"folder": folder, "trust_scripts": trust_scripts}
    try:
        scene = Scene.model_validate(data, context=context)
    except ValidationError as error:
        faults = faults_from(error, Scene, data)
        broken = frozenset(fault.key.split(".")[0].split("[")[0] for fault in faults)
        right = {name: entry for name, entry in data.items() if name not in broken}
        valid = _optional_scene().model_validate(right, context=context)
        of_geometry = frozenset(fault.key for fault in faults if fault.key.split(".")[0] == "geometry")
        if of_geometry:
            sketch = sketch_of(data.get("geometry"), of_geometry, context)
            valid = valid.model_copy(update={"geometry": sketch})
            broken |= {"geometry"} if sketch is not None else {"geometry", GEOMETRY_KIND}
        valid = with_sector_angle(valid, shape_is_known="geometry" not in broken)
        return None, faults + faults_between_sections(PartialScene(valid, data, broken, of_geometry))
    scene = with_sector_angle(scene)
    faults = faults_between_sections(PartialScene(scene, data, frozenset()))
    return (None if faults else with_friction_of_repose(scene)), faults


@lru_cache(maxsize=1)
def _optional_scene() -> type[Section]:
    """Return the scene's model with every section optional, to check its valid parts even where others are broken."""
    sections: dict[str, Any] = {}
    for name, info in Scene.model_fields.items():
        if info.is_required():
            marked: Any = Annotated[info.annotation, Field(discriminator=info.discriminator)]  # type: ignore
            sections[name] = (marked | None, None)
    return create_model("OptionalScene", __base__=Scene, **sections)
