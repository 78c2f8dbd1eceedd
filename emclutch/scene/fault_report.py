"""From pydantic's errors to the faults that a user reads: key, entry, what is allowed, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from emclutch.effects import PLANNED_EFFECTS
from emclutch.scene.errors import Fault, entry_at, shown
from emclutch.scene.schema_walk import all_keys, annotations_at, entry_of, keys_at, models_at, tags_of
from emclutch.scene.section import Section, did_you_mean, not_one_of
from emclutch.scene.units import Quantity

Path = tuple[str | int, ...]

_NO_TABLE = "is not a table; write [{path}] with its keys below"
_NO_LIST = "is not a list; write it in brackets, e.g. {example}"
_NO_SWITCH = "is not a truth value; write true or false, without quotes"
_PYDANTIC = {
    "model_type": _NO_TABLE,
    "model_attributes_type": _NO_TABLE,
    "dict_type": _NO_TABLE,
    "bool_type": _NO_SWITCH,
    "bool_parsing": _NO_SWITCH,
    "string_type": "is not a text; write it in quotes",
    "string_too_short": "is empty; write a line of text",
    "string_too_long": "is too long; at most {max_length} letters are allowed",
    "tuple_type": _NO_LIST,
    "list_type": _NO_LIST,
    "string_pattern_mismatch": "is not a name; use letters, digits and _, a letter first",
    "too_short": "has too few entries; at least {min_length} are needed",
    "too_long": "has too many entries; at most {max_length} are allowed",
}
"""Pydantic's own kinds of error in the user's words."""


def faults_from(error: ValidationError, root: type[Section], data: dict[str, Any]) -> list[Fault]:
    """Return every fault of a validation, in the order of the sections.

    Parameters
    ----------
    error : what pydantic found when it read `data` as a `root`
    data : the file's content as the user wrote it
    """
    # once each: a list of three that has one entry lacks two
    return list(dict.fromkeys(_fault(details, root, data) for details in error.errors(include_url=False)))


def dotted(path: Sequence[str | int]) -> str:
    """Return a path as a user writes it: ``geometry.size[1]``."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")


def _fault(details: ErrorDetails, root: type[Section], data: dict[str, Any]) -> Fault:
    context, kind = details.get("ctx", {}), details["type"]
    path = _path(details["loc"], data, keep_last=kind == "missing")
    if kind == "rule" and context["key"] and path[-1:] != (context["key"],):  # a union's member may have that name
        path = (*path, context["key"])
    if kind == "missing":
        entry = entry_at(data, path)
        if isinstance(entry, list):
            example = _list_example(path, root, data)
            return Fault(dotted(path), shown(entry), f"has too few entries; three are needed, e.g. {example}")
        return Fault(dotted(path), "", f"is missing; {_needed(path, root, data)}")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _wrong_tag(path, str(context["discriminator"]).strip("'"), details["input"], root, data)
    given = entry_at(data, path) if kind == "rule" else details["input"]
    # a table is not shown whole: its key says enough
    value = "" if isinstance(given, dict) or (kind == "rule" and given is None) else shown(given)
    if kind == "rule":
        return Fault(dotted(path), value, context["message"])
    if kind == "extra_forbidden":
        return Fault(dotted(path), value, _unknown_key(path, root, data))
    if kind in _PYDANTIC:
        example = _list_example(path, root, data)
        message = _PYDANTIC[kind].format(path=dotted(path), example=example, **context)
        if _PYDANTIC[kind] == _NO_TABLE and path[0] == "effects" and len(path) == 2:
            message += f", or set {dotted(path)} to 'on' or 'off' (--set)"
        return Fault(dotted(path), value, message)
    return Fault(dotted(path), value, f"is refused: {details['msg'][:1].lower()}{details['msg'][1:]}")


def _path(location: Path, data: Any, keep_last: bool) -> Path:
    """Drop pydantic's own steps (the member of a union) from a location: they are no keys of the file.

    `keep_last`: the last step is a key that the file lacks.
    """
    path: list[str | int] = []
    for index, step in enumerate(location):
        if isinstance(data, dict):
            # a member of a union may have the name of a key: then the next step is a key of this table, too
            is_member = isinstance(data.get(step), str) and any(below in data for below in location[index + 1 :][:1])
            if step in data and not is_member:
                path.append(step)
                data = data[step]
            elif keep_last and index == len(location) - 1:
                path.append(step)
        elif isinstance(data, (list, tuple)) and isinstance(step, int) and step < len(data):
            path.append(step)
            data = data[step]
    return tuple(path)


def _list_example(path: Path, root: type[Section], data: dict[str, Any]) -> str:
    """Return a list of three entries as they may stand in a key."""
    entries = (entry_of(annotation) for annotation in annotations_at((*path, 0), root, data))
    return next((shown(3 * [entry.sample]) for entry in entries if entry is not None), "[1, 2, 3]")


def _needed(path: Path, root: type[Section], data: dict[str, Any]) -> str:
    name = str(path[-1])
    if len(path) == 1:
        return f"add the section [{name}]"
    for annotation in annotations_at(path, root, data):
        if (entry := entry_of(annotation)) is not None:
            return entry.needed_for(name)
    files = _files(models_at(path[:-1], root, data))
    return f"add it to [{dotted(path[:-1])}]{files}"


def _files(models: Sequence[type[Section]]) -> str:
    """Return the keys of some models that name a file in place of lists, as an alternative."""
    keys = [key for model in models for key in model.file_keys]
    return f", or name a file with {' or '.join(keys)}" if keys else ""


def _unknown_key(path: Path, root: type[Section], data: dict[str, Any]) -> str:
    name, table = str(path[-1]), path[:-1]
    allowed = keys_at(table, root, data)
    listed = f"{f'[{dotted(table)}] may have' if table else 'a scene may have the sections'}: {', '.join(allowed)}"
    if table == ("effects",) and name in PLANNED_EFFECTS:
        return f"is planned but not in this version; remove its table; {listed}"
    elsewhere = list(dict.fromkeys(other for other in all_keys(root) if other.rsplit(".", 1)[-1] == name))
    if dotted(path) in elsewhere:  # a member of the section's union has it, but not the one that is named
        tag = next(key for model in models_at(table, root, data) for key in tags_of(model))
        hint = f"with {tag} = {shown(entry_at(data, (*table, tag)))}"
        hint += ", which has no coil" if name.startswith("coil_") else ""
        return f"is not a key {hint}; remove it, or change {tag}; {listed}"
    hint = did_you_mean(name, allowed) or (f"did you mean {elsewhere[0]}? " if elsewhere else "")
    return f"is not a known key; {hint}{listed}"


def _wrong_tag(path: Path, tag: str, given: Any, root: type[Section], data: dict[str, Any]) -> Fault:
    """Return the fault of a section whose model follows from one of its keys (kind, law, source)."""
    if not isinstance(given, dict):
        return Fault(dotted(path), shown(given), _NO_TABLE.format(path=dotted(path)))
    models = models_at(path, root, {})
    names = tuple(tags_of(model)[tag] for model in models)
    key = dotted((*path, tag))
    if tag not in given:
        return Fault(key, "", f"is missing; give one of {', '.join(names)}{_files(models)}")
    return Fault(key, shown(given[tag]), not_one_of(given[tag], names))


def key_fault(key: str, root: type[Section]) -> str:
    """Return what is wrong with a dotted key that no model has; empty where it is right or below a free name."""
    path = tuple(key.split("."))
    if path[0] == "materials" or annotations_at(path, root, {}):
        return ""
    close = get_close_matches(key, list(all_keys(root)), n=1, cutoff=0.6)
    return f"is not a key of a scene; did you mean {close[0]}?" if close else "is not a key of a scene"


def quantity_at(key: str, root: type[Section], data: dict[str, Any]) -> Quantity | None:
    """Return the quantity of a dotted key, where `data` settles its unions; None for a text or a whole number."""
    marks = (entry_of(annotation) for annotation in annotations_at(key.split("."), root, data))
    return next((mark for mark in marks if isinstance(mark, Quantity)), None)
