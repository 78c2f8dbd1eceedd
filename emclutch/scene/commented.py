"""A scene as text with a comment for every key: what is given, and in comments what is not."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator
from typing import Any, get_args, get_origin

import tomli_w
from pydantic.fields import FieldInfo

from emclutch.scene.model import Scene
from emclutch.scene.reference import (
    entry_in_words,
    holds_sections,
    is_section,
    members_of,
    tag_of,
    unwrapped,
)
from emclutch.scene.section import Choice, Section, Whole
from emclutch.scene.units import Quantity

WIDTH = 110

HEAD = """# {title}: a scene to begin with
#
# Check:  emclutch check {name}
# Run:    emclutch run {name}
# Note:   a key in a comment is not given: it has the default that stands there, or the entry is an example.
#         A quantity is a text with its unit, or a number in the SI unit in brackets. Ranges: docs/scene.md
"""


def commented_scene(data: dict[str, Any], name: str) -> str:
    """Text of the scene `data` for a file of a `name`: every key of its sections, with unit and description."""
    lines = [HEAD.format(title=data["scene"]["title"], name=name)]
    for section, field in Scene.model_fields.items():
        lines += _table(section, field, data.get(section))
    return "\n".join(lines).rstrip() + "\n"


def _table(path: str, field: FieldInfo, data: dict[str, Any] | None) -> Iterator[str]:
    """A table with its keys and the tables below it; one that is not given is a comment."""
    models = [one for one in members_of(field.annotation) if is_section(one)]
    path = f"{path}.NAME" if get_origin(unwrapped(field.annotation, ())[1]) is dict and data is None else path
    if data is None:
        words = field.description or _first_line(models[0])
        yield from textwrap.wrap(f"[{path}]: {words}", WIDTH, initial_indent="# ", subsequent_indent="#   ")
        yield ""
        return
    model = next(one for one in models if _is_the_one(one, data))
    keys = {key: entry for key, entry in model.model_fields.items() if not holds_sections(entry)}
    below = {key: entry for key, entry in model.model_fields.items() if key not in keys}
    if keys or not below:
        yield from textwrap.wrap(_first_line(model), WIDTH, initial_indent="# ", subsequent_indent="# ")
        yield f"[{path}]"
    for key, entry in keys.items():
        yield from _line(key, entry, data)
    if keys or not below:
        yield ""
    for key, entry in below.items():
        yield from _table(f"{path}.{key}", entry, data.get(key))


def _is_the_one(model: type[Section], data: dict[str, Any]) -> bool:
    """Return whether a member of a tagged union is the one that an entry names."""
    return all(
        data.get(key) in get_args(field.annotation) for key, field in model.model_fields.items() if tag_of(field)
    )


def _first_line(model: type[Section]) -> str:
    words = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    words = words.partition("]: ")[2] or words
    return words[:1].upper() + words[1:]


def _line(key: str, field: FieldInfo, data: dict[str, Any]) -> Iterator[str]:
    """One key: given, or in a comment with its default or an example; its words at the end, or above where long."""
    said = _said(field)
    if key in data:
        text = _toml(key, data[key])
    elif field.default is None:
        text = f"# {_toml(key, _example(field))}"
        said += "" if "default" in said else " (not given)"
    else:
        default = field.get_default()
        text = f"# {_toml(key, default)}"
        said += " (default)"
    if len(text) < 32 and len(said) < WIDTH - 36:
        yield f"{text:<34}# {said}"
        return
    yield from textwrap.wrap(said, WIDTH, initial_indent="# ", subsequent_indent="# ")
    yield text


def _said(field: FieldInfo) -> str:
    """Return what a key is for, with its unit, or what may be chosen."""
    if tag_of(field):
        return "the keys below are those of this kind"
    entry = entry_in_words(field.annotation, tuple(field.metadata)).replace("`", "")
    unit = f" [{entry.partition('[')[2].partition(']')[0]}]" if "[" in entry else ""
    choice = entry if entry.startswith("one of") else ""
    words = f"{field.description or ''}{unit}".strip()
    if all(f"{name}:" in words for name in choice.removeprefix("one of ").replace('"', "").split(", ")):
        choice = ""  # the description says what each of them is
    return "; ".join(part for part in (words, choice) if part) or entry


def _example(field: FieldInfo) -> Any:
    """An entry of a key that has no default."""
    marks, annotation = unwrapped(field.annotation, tuple(field.metadata))
    for mark in marks:
        if isinstance(mark, Quantity):
            return mark.example if mark.unit else float(mark.example)
        if isinstance(mark, Choice):
            return mark.available[0]
        if isinstance(mark, Whole):
            return int(mark.example)
    for part in get_args(annotation):
        if part is not type(None) and (found := _example(FieldInfo(annotation=part))) is not ...:
            return found
    return ... if annotation is not str else "..."


def _toml(key: str, value: Any) -> str:
    return f"{key} = {_inline(value)}"


def _inline(value: Any) -> str:
    """A value in one line: a comment has one, and a table of its own would end the keys of the section."""
    if value is ...:
        return "..."
    if isinstance(value, dict):
        return f"{{ {', '.join(_toml(name, entry) for name, entry in value.items())} }}" if value else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_inline, value))}]"
    return tomli_w.dumps({"x": value}).strip().removeprefix("x = ")
