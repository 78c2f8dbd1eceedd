"""A scene as dotted keys, by which two are compared."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any

from emclutch.scene.case import Case, case_from, read_toml
from emclutch.scene.errors import SceneError, entry_at, shown
from emclutch.scene.section import Section


def flat_scene(text: str) -> dict[str, Any]:
    """Return the resolved scene of a TOML text as dotted keys; entries that it lacks have their defaults."""
    data = tomllib.loads(text)
    try:
        data = case_from(data).resolved()
    except SceneError:  # of another version, or its files are gone: what can be compared is the text
        pass
    return flat(data)


def differing_keys(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Return the keys of two flat scenes whose values differ, sorted."""
    return [key for key in sorted({*old, *new}) if old.get(key) != new.get(key)]


def settings_beside(case: Case) -> dict[str, str]:
    """Return what was set in a case beside its file, by dotted key, as ``--set`` takes it."""
    if case.path is None:
        return {}
    before, now = flat(read_toml(case.path)), flat(case.data)
    found = {key: _as_set(value) for key, value in now.items() if before.get(key) != value}
    for key in before.keys() - now.keys():
        steps = key.split(".")
        gone = next((n for n in range(1, len(steps) + 1) if entry_at(case.data, steps[:n]) is None), None)
        if gone is not None:  # of a table that has entries still, or is empty now
            found[".".join(steps[:gone])] = "none"
    return dict(sorted(found.items()))


def _as_set(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "on" if value == {} else shown(value, 1_000_000)


def keys_at_default(section: Section, prefix: str = "") -> Iterator[str]:
    """Dotted keys of a scene, or of a section of it, whose entry is their default."""
    for name, field in type(section).model_fields.items():
        entry = getattr(section, name)
        if isinstance(entry, Section):
            yield from keys_at_default(entry, f"{prefix}{name}.")
        elif not field.is_required() and entry == field.get_default(call_default_factory=True):
            yield prefix + name


def flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as dotted keys; an empty table, as of an effect without keys, is an entry itself."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict) and value
        found |= flat(value, f"{prefix}{key}.") if nested else {prefix + key: value}
    return found
