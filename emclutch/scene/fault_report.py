"""From pydantic's errors to the faults that a user reads: key, entry, what is allowed, what to do."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from emclutch.effects import PLANNED_EFFECTS
from emclutch.scene.errors import Fault, entry_at, shown
from emclutch.scene.section import Choice, Section, did_you_mean, not_one_of
from emclutch.scene.units import Quantity

Path = tuple[str | int, ...]
def faults_from(error: ValidationError, root: type[Section], data: dict[str, Any]) -> list[Fault]:
    """Return every fault of a validation, in the order of the sections.

    Parameters
    ----------
    error : what pydantic found when it read `data` as a `root`
    data : the file's content as the user wrote it
    """
    return [_fault(details, root, data) for details in error.errors(include_url=False)]


def dotted(path: Sequence[str | int]) -> str:
    """Return a path as a user writes it: ``geometry.size[1]``."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")


def _fault(details: ErrorDetails, root: type[Section], data: dict[str, Any]) -> Fault:
    context, kind = details.get("ctx", {}), details["type"]
    path = _path(details["loc"], data, keep_last=kind == "missing")
    given: Any = details["input"]
    value = "" if isinstance(given, dict) else shown(given)  # a table is not shown whole: its key says enough
    if kind == "missing":
        entry = entry_at(data, path)
        if isinstance(entry, list):
            return Fault(dotted(path), shown(entry), "has too few entries; three numbers are needed, e.g. [1, 2, 3]")
        return Fault(dotted(path), "", _missing(path, root, data))
    if kind == "extra_forbidden":
        return Fault(dotted(path), value, _unknown_key(path, root, data))
    if kind == "rule":
        if context["key"] and path[-1:] != (context["key"],):  # a member of a union may have the key's name
            path = (*path, context["key"])
        entry = entry_at(data, path)
        return Fault(dotted(path), "" if entry is None or isinstance(entry, dict) else shown(entry), context["message"])
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _wrong_tag(path, str(context["discriminator"]).strip("'"), given, root, data)
    if kind == "choice" and path == ("contact", "law") and str(given).lower() in ("jkr", "dmt"):
        model = str(given).lower()
        hint = f"is a cohesion, not a contact law; add [effects.cohesion] with model = '{model}' beside a law; "
        return Fault(dotted(path), value, hint + context["message"].partition("; ")[2])
    if kind in ("quantity", "choice", "whole"):
        return Fault(dotted(path), value, context["message"])
    return Fault(dotted(path), value, _plain(kind, details["msg"], context, path))


def _path(location: Path, data: Any, keep_last: bool) -> Path:
    """Drop pydantic's own steps (the member of a union) from a location: they are no keys of the file.

    `keep_last`: the last step is a key that the file lacks.
    """
    path: list[str | int] = []
    for index, step in enumerate(location):
        # a member of a union may have the name of a key: then the next step is not below that key but beside it
        beside = isinstance(data, dict) and isinstance(data.get(step), str) and location[index + 1 :][:1] != ()
        is_member = beside and location[index + 1] in data
        is_entry = isinstance(data, dict) and step in data and not is_member
        is_item = isinstance(data, (list, tuple)) and isinstance(step, int) and step < len(data)
        if is_entry or is_item:
            path.append(step)
            data = data[step]
        elif isinstance(data, dict) and keep_last and index == len(location) - 1:
            path.append(step)
    return tuple(path)


def _missing(path: Path, root: type[Section], data: dict[str, Any]) -> str:
    name = str(path[-1])
    if len(path) == 1:
        return f"is missing; add the section [{name}]"
    for annotation in _annotations_at(path, root, data):
        for mark in _marks(annotation):
            if isinstance(mark, Quantity):
                return f"is missing; {mark.name} is needed, e.g. {name} = {mark.given_example}"
            if isinstance(mark, Choice):
                return f"is missing; give one of {', '.join(mark.available)}"
    return f"is missing; add it to [{dotted(path[:-1])}]"


def _unknown_key(path: Path, root: type[Section], data: dict[str, Any]) -> str:
    name = str(path[-1])
    if path[:-1] == ("effects",) and name in PLANNED_EFFECTS:
        return f"is planned but not in this version; remove its table; {_listed(root, path[:-1], data)}"
    allowed = _keys_at(path[:-1], root, data)
    elsewhere = list(dict.fromkeys(other for other in _all_keys(root) if other.rsplit(".", 1)[-1] == name))
    if dotted(path) in elsewhere:  # a member of the section's union has it, but not the one that is named
        tag = next(key for key in ("kind", "law", "source") if key in allowed)
        hint = f"with {tag} = {shown(entry_at(data, (*path[:-1], tag)))}"
        hint += ", which has no coil; " if name.startswith("coil_") else "; "
        return f"is not a key {hint}remove it, or change {tag}; {_listed(root, path[:-1], data)}"
    hint = did_you_mean(name, allowed)
    if not hint:
        hint = f"did you mean {elsewhere[0]}? " if elsewhere else ""
    return f"is not a known key; {hint}{_listed(root, path[:-1], data)}"


def _listed(root: type[Section], path: Path, data: dict[str, Any]) -> str:
    where = f"[{dotted(path)}] may have" if path else "a scene may have the sections"
    return f"{where}: {', '.join(_keys_at(path, root, data))}"


def _wrong_tag(path: Path, tag: str, given: Any, root: type[Section], data: dict[str, Any]) -> Fault:
    """Answer for a section whose model follows from one of its keys (kind, law, source)."""
    if not isinstance(given, dict):
        return Fault(dotted(path), shown(given), f"is not a table; write [{dotted(path)}] with its keys below")
    names = tuple(_tags(path, tag, root))
    key = dotted((*path, tag))
    if tag not in given:
        return Fault(key, "", f"is missing; give one of {', '.join(names)}")
    return Fault(key, shown(given[tag]), not_one_of(given[tag], names))


def _plain(kind: str, message: str, context: dict[str, Any], path: Path) -> str:
    """Say one of pydantic's own errors in our words."""
    words = {
        "model_type": f"is not a table; write [{dotted(path)}] with its keys below",
        "model_attributes_type": f"is not a table; write [{dotted(path)}] with its keys below",
        "dict_type": f"is not a table; write [{dotted(path)}] with its keys below",
        "bool_type": "is not a truth value; write true or false, without quotes",
        "bool_parsing": "is not a truth value; write true or false, without quotes",
        "string_type": "is not a text; write it in quotes",
        "string_too_short": "is empty; write a line of text",
        "string_too_long": f"is too long; at most {context.get('max_length')} letters are allowed",
        "tuple_type": "is not a list; write it in brackets, e.g. [1, 2, 3]",
        "list_type": "is not a list; write it in brackets, e.g. [1, 2, 3]",
        "string_pattern_mismatch": "is not a name; use letters, digits and _, a letter first",
        "too_short": f"has too few entries; at least {context.get('min_length')} are needed",
        "too_long": f"has too many entries; at most {context.get('max_length')} are allowed",
    }
    return words.get(kind, f"is refused: {message[:1].lower()}{message[1:]}")


# --- the models, asked for their keys ------------------------------------------------------------


def _members(annotation: Any) -> Iterator[Any]:
    """Walk the members of unions and the wrapped types of Annotated."""
    if get_origin(annotation) is Annotated:
        yield from _members(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _members(member)
    else:
        yield annotation


def _marks(annotation: Any) -> Iterator[Any]:
    """Walk the marks (Quantity, Choice) that stand in an annotation."""
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
        yield from _marks(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _marks(member)


def _is_section(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Section)


def _matches(section: type[Section], data: Any) -> bool:
    """Tell whether a member of a tagged union is the one that the entry names; true where it names none."""
    if not isinstance(data, dict):
        return True
    for name, field in section.model_fields.items():
        if get_origin(field.annotation) is Literal and name in data:
            return data[name] in get_args(field.annotation)
    return True


def _annotations_at(path: Sequence[str | int], root: type[Section], data: Any) -> list[Any]:
    """Return the annotations of a path in the models; several where the entry does not settle a union."""
    found: list[Any] = [root]
    for step in path:
        members = [member for annotation in found for member in _members(annotation)]
        found = []
        for member in members:
            if _is_section(member) and _matches(member, data) and step in member.model_fields:
                field = member.model_fields[step]
                mark = field.metadata[0] if field.metadata else None
                found.append(Annotated[field.annotation, mark] if mark is not None else field.annotation)
            elif get_origin(member) is dict:
                found.append(get_args(member)[1])
            elif get_origin(member) is tuple and isinstance(step, int):
                found.append(get_args(member)[0])
        data = entry_at(data, (step,))
    return found


def _keys_at(path: Sequence[str | int], root: type[Section], data: Any) -> list[str]:
    entry = entry_at(data, path)
    keys: dict[str, None] = {}
    for annotation in _annotations_at(path, root, data):
        for member in _members(annotation):
            if _is_section(member) and _matches(member, entry):
                keys.update(dict.fromkeys(member.model_fields))
    return list(keys)


def _tags(path: Sequence[str | int], tag: str, root: type[Section]) -> Iterator[str]:
    for annotation in _annotations_at(path, root, {}):
        for member in _members(annotation):
            if _is_section(member) and tag in member.model_fields:
                yield from get_args(member.model_fields[tag].annotation)


def _all_keys(section: type[Section], prefix: str = "") -> Iterator[str]:
    for name, field in section.model_fields.items():
        key = f"{prefix}{name}"
        yield key
        for member in _members(field.annotation):
            if _is_section(member):
                yield from _all_keys(member, f"{key}.")


def key_fault(key: str, root: type[Section]) -> str:
    """Say what is wrong with a dotted key that no model has; empty where it is right or below a free name."""
    path = tuple(key.split("."))
    if path[0] == "materials" or _annotations_at(path, root, {}):
        return ""
    close = get_close_matches(key, list(_all_keys(root)), n=1, cutoff=0.6)
    return f"is not a key of a scene; did you mean {close[0]}?" if close else "is not a key of a scene"


def quantity_at(key: str, root: type[Section], data: dict[str, Any]) -> Quantity | None:
    """The quantity of a dotted key, where `data` settles its unions; None for what is none (a text, a whole number)."""
    for annotation in _annotations_at(key.split("."), root, data):
        for mark in _marks(annotation):
            if isinstance(mark, Quantity):
                return mark
    return None
