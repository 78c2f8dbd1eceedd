"""The reference of the keys of all files as a page of Markdown, made from the models: `emclutch schema --markdown`."""

from __future__ import annotations

import inspect
import json
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import MinLen
from pydantic.fields import FieldInfo

from emclutch.scene.design import DesignFile
from emclutch.scene.model import Scene
from emclutch.scene.section import Automatic, Choice, Section, Whole
from emclutch.scene.study import StudyFile
from emclutch.scene.time_table import TimeTable
from emclutch.scene.torque_target import TorqueTarget
from emclutch.scene.units import Quantity

HEAD = """# The scene file: all sections and keys

<!-- Made by `emclutch schema --markdown`; change the models in emclutch/scene, not this page. -->

A scene is a TOML file. A quantity is a text with its unit (`"1.2 mm"`, `"1500 rpm"`) or a bare number in the SI unit
that stands in brackets; a pure number has no unit. A key whose default is "required" must be given where its section
is. Where an entry may be a table in time, write `{ times = ["0 s", "20 ms"], values = ["0 A", "0.94 A"] }`: linear
between the instants, held before and after.
"""


OTHER_FILES = """# Study files and design files

A study ([studies.md](studies.md)) and a design search ([design_search.md](design_search.md)) have a TOML file of one
section each. A dotted key is one of the scene's above, with or without quotes: `"coil.current"`; the entry `"none"`
leaves it away, for `effects.NAME` also `"off"`.
"""


def scene_reference() -> str:
    """Markdown of every section and key of all files: entry, default, range, description."""
    lines = [HEAD]
    for name, field in Scene.model_fields.items():
        lines += _sections(name, field)
    lines.append(OTHER_FILES)
    for file in (StudyFile, DesignFile):
        for name, field in file.model_fields.items():
            lines += _sections(name, field)
    return "\n".join(lines).rstrip("\n") + "\n"


def _sections(path: str, field: FieldInfo) -> Iterator[str]:
    """The sections of a field: one for each member of a union, each followed by those below it."""
    path = f"{path}.NAME" if get_origin(field.annotation) is dict else path
    models = [member for member in members_of(field.annotation) if is_section(member)]
    for model in models:
        tags = [(key, tag_of(entry)) for key, entry in model.model_fields.items() if tag_of(entry)]
        choice = "".join(f", {key} = {json.dumps(tag)}" for key, tag in tags)
        yield f"## `[{path}]`{choice}\n"
        words = inspect.cleandoc(model.__doc__ or "").removeprefix(f"[{path}]: ")
        yield f"{words[:1].upper()}{words[1:]}{_presence(path, field)}\n"
        parent = next((other for other in models if other in model.__mro__[1:]), None)
        own = inspect.get_annotations(model) if parent is not None else model.model_fields
        if parent is not None:
            yield "Its keys are those of the section above; these differ:\n"
        below = {key: entry for key, entry in model.model_fields.items() if key in own and holds_sections(entry)}
        rows = [_row(key, entry) for key, entry in model.model_fields.items() if key in own and key not in below]
        if rows:
            yield "| key | entry | default | range | |\n|---|---|---|---|---|"
            yield "\n".join(rows) + "\n"
        for key, entry in below.items():
            yield from _sections(f"{path}.{key}", entry)


def _presence(path: str, field: FieldInfo) -> str:
    if field.is_required():
        return " Required."
    if path.startswith("effects."):
        return " The effect is on where its table stands."
    return ""


def _row(key: str, field: FieldInfo) -> str:
    marks = tuple(field.metadata)
    entry = entry_in_words(field.annotation, marks)
    cells = [f"`{key}`", entry, _default(field), range_in_words(field.annotation, marks), field.description or ""]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def entry_in_words(annotation: Any, marks: tuple[Any, ...] = ()) -> str:
    """Return what may stand after the key, in words."""
    marks, annotation = unwrapped(annotation, marks)
    automatic = ', or `"auto"`' if any(isinstance(mark, Automatic) for mark in marks) else ""
    for mark in marks:
        if isinstance(mark, Quantity):
            name = mark.name.removeprefix("an ").removeprefix("a ")
            return (f"{name} [{mark.unit}]" if mark.unit else name) + automatic
        if isinstance(mark, Choice):
            return "one of " + ", ".join(f'`"{name}"`' for name in mark.available)
        if isinstance(mark, Whole):
            return "whole number" + automatic
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return ", or ".join(entry_in_words(part) for part in parts if part is not type(None)) + automatic
    if origin is Literal:
        return ", ".join(f"`{json.dumps(part)}`" for part in parts)
    if origin is dict:
        return "table" if parts[1] is Any else f"table of {entry_in_words(parts[1])}"
    if origin is tuple:
        return (
            f"list of {entry_in_words(parts[0])}"
            if parts[-1] is ...
            else f"list of {len(parts)}: {entry_in_words(parts[0])}"
        )
    if is_section(annotation) and issubclass(annotation, TimeTable):
        return "a table in time"
    return {bool: "true or false", str: "text", TorqueTarget: "text", Any: "as of its key"}.get(
        annotation, getattr(annotation, "__name__", str(annotation))
    )


def range_in_words(annotation: Any, marks: tuple[Any, ...] = ()) -> str:
    """The allowed range; of a list that of its entries, with their least number."""
    marks, annotation = unwrapped(annotation, marks)
    texts = [
        f"at least {mark.min_length} entries" for mark in marks if isinstance(mark, MinLen) and mark.min_length > 1
    ]
    for mark in marks:
        if isinstance(mark, Quantity):
            texts.append(mark.range_text)
        elif isinstance(mark, Whole):
            texts.append(f"{mark.minimum} to {mark.maximum}")
    if get_origin(annotation) in (Union, types.UnionType, tuple):
        inner = dict.fromkeys(range_in_words(part) for part in get_args(annotation) if part not in (type(None), ...))
        texts += [text for text in inner if text]
    return "; ".join(texts)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return f"`{json.dumps(tag_of(field))}`" if tag_of(field) else "required"
    if field.default is None:
        automatic = any(isinstance(mark, Automatic) for mark in field.metadata)
        return '`"auto"`' if automatic else "none"
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return f"`{json.dumps(default)}`"


def unwrapped(annotation: Any, marks: tuple[Any, ...]) -> tuple[tuple[Any, ...], Any]:
    """Take an Annotated apart: all marks that stand on it, and the type within."""
    while get_origin(annotation) is Annotated:
        marks, annotation = (*marks, *annotation.__metadata__), get_args(annotation)[0]
    return marks, annotation


def members_of(annotation: Any) -> Iterator[Any]:
    """Walk the members of unions and the values of dictionaries."""
    _, annotation = unwrapped(annotation, ())
    if get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from members_of(member)
    elif get_origin(annotation) is dict:
        yield from members_of(get_args(annotation)[1])
    else:
        yield annotation


def is_section(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Section)


def holds_sections(field: FieldInfo) -> bool:
    """Tell whether a key is a table of its own; a course in time is written in line."""
    return any(is_section(member) and not issubclass(member, TimeTable) for member in members_of(field.annotation))


def tag_of(field: FieldInfo) -> str:
    """The name that chooses a member of a union (kind, law, source); empty for any other key."""
    return str(get_args(field.annotation)[0]) if get_origin(field.annotation) is Literal else ""
