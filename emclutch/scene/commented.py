"""A scene as text with a comment for every key: what is given, and in comments what is not."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import tomli_w
from pydantic.fields import FieldInfo

from emclutch.scene.model import Scene
from emclutch.scene.reference import kind_of
from emclutch.scene.schema_walk import (
    annotation_of,
    entry_of,
    fits,
    is_named,
    is_table,
    members_of,
    sections_of,
    tag_of,
)
from emclutch.scene.section import Section

WIDTH = 110

HEAD = """# {title}: a scene to begin with
#
# Check:  emclutch check {name}
# {next}
# Note:   commented keys show their default or an example.
#         A quantity is a text with its unit, or a number in the SI unit in brackets. Ranges: docs/scene.md
"""


def commented_scene(data: dict[str, Any], name: str, notes: Sequence[str] = ()) -> str:
    """Return the scene `data` as the text of a file `name`: every key of its sections, with unit and description.

    `notes` stand as comments below the head.
    """
    command = f"Run:    emclutch run {name}" if "particles" in data else f"Solve:  emclutch field {name}"
    lines = [HEAD.format(title=data["scene"]["title"], name=name, next=command)]
    for note in notes:
        lines += [*textwrap.wrap(note, WIDTH, initial_indent="# ", subsequent_indent="#   "), ""]
    for section, field in Scene.model_fields.items():
        lines += _table(section, field, data.get(section))
    return "\n".join(lines).rstrip() + "\n"


def _table(path: str, field: FieldInfo, data: dict[str, Any] | None) -> Iterator[str]:
    """Write a table with its keys and the tables below it; one that is not given is a comment."""
    models = sections_of(field.annotation)
    if data is None:
        path = f"{path}.NAME" if is_named(field.annotation) else path
        words = field.description or _first_line(models[0])
        yield from textwrap.wrap(f"[{path}]: {words}", WIDTH, initial_indent="# ", subsequent_indent="#   ")
        yield ""
        return
    if is_named(field.annotation):
        for name, entries in data.items():
            yield from (f"[{path}.{name}]", *(_toml(key, value) for key, value in entries.items()), "")
        return
    model = next(one for one in models if fits(one, data))
    keys = {key: entry for key, entry in model.model_fields.items() if not is_table(entry)}
    below = {key: entry for key, entry in model.model_fields.items() if key not in keys}
    if keys or not below:
        yield from textwrap.wrap(_first_line(model), WIDTH, initial_indent="# ", subsequent_indent="# ")
        yield f"[{path}]"
        for key, entry in keys.items():
            yield from _line(key, entry, data)
        yield ""
    for key, entry in below.items():
        yield from _table(f"{path}.{key}", entry, data.get(key))


def _first_line(model: type[Section]) -> str:
    words = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    words = words.partition("]: ")[2] or words
    return words[:1].upper() + words[1:]


def _line(key: str, field: FieldInfo, data: dict[str, Any]) -> Iterator[str]:
    """Write a key: given, or in a comment with its default or an example; its meaning behind it, or above if long."""
    meaning = _meaning(field)
    if key in data:
        text = _toml(key, data[key])
    elif field.default is None:
        text = f"# {_toml(key, _example(field))}"
        meaning += "" if "default" in meaning else " (not given)"
    else:
        text = f"# {_toml(key, field.get_default())}"
        meaning += " (default)"
    if len(text) < 32 and len(meaning) < WIDTH - 36:
        yield f"{text:<34}# {meaning}"
        return
    yield from textwrap.wrap(meaning, WIDTH, initial_indent="# ", subsequent_indent="# ")
    yield text


def _meaning(field: FieldInfo) -> str:
    """Purpose of a key, with its unit, or its choices."""
    if tag_of(field):
        return "the keys below are those of this kind"
    kind = kind_of(annotation_of(field)).replace("`", "")
    unit = f" [{kind.partition('[')[2].partition(']')[0]}]" if "[" in kind else ""
    choice = kind if kind.startswith("one of") else ""
    words = f"{field.description or ''}{unit}".strip()
    if all(f"{name}:" in words for name in choice.removeprefix("one of ").replace('"', "").split(", ")):
        choice = ""  # the description explains each of them
    return "; ".join(part for part in (words, choice) if part) or kind


def _example(field: FieldInfo) -> Any:
    """Return an entry of a key that has no default, of a device's size; an ellipsis where it has no example."""
    if field.examples:
        return field.examples[0]
    if (entry := entry_of(annotation_of(field))) is not None:
        return entry.sample
    return "..." if str in members_of(field.annotation) else ...


def _toml(key: str, value: Any) -> str:
    return f"{key} = {_inline(value)}"


def _inline(value: Any) -> str:
    """Return a value in one line: a comment has one, and a table of its own would end the keys of the section."""
    if value is ...:
        return "..."
    if isinstance(value, dict):
        return f"{{ {', '.join(_toml(name, entry) for name, entry in value.items())} }}" if value else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_inline, value))}]"
    return tomli_w.dumps({"x": value}).strip().removeprefix("x = ")
