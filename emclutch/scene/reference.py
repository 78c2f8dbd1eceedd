"""The reference of the keys of all files as a page of Markdown, made from the models: `emclutch schema --markdown`."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Iterator
from typing import Any, Literal, get_args, get_origin

from annotated_types import MinLen
from pydantic.fields import FieldInfo

from emclutch.scene.design import DesignFile
from emclutch.scene.model import Scene
from emclutch.scene.schema_walk import (
    annotation_of,
    is_named,
    is_table,
    is_union,
    sections_of,
    tag_of,
    tags_of,
    unwrap,
)
from emclutch.scene.section import Automatic, Entry
from emclutch.scene.study import StudyFile
from emclutch.scene.time_table import TimeTable

HEAD = """# The scene file: all sections and keys

<!-- Made by `emclutch schema --markdown`; change the models in emclutch/scene, not this page. -->

A scene is a TOML file. A quantity is a text with its unit (`"1.2 mm"`, `"1500 rpm"`) or a bare number in the SI unit
that stands in brackets; a pure number has no unit. A key whose default is "required" must be given where its section
is. Where an entry may be a table in time, write `{ times = ["0 s", "20 ms"], values = ["0 A", "0.94 A"] }`: linear
between the instants, constant before and after.
"""


OTHER_FILES = """# Study files and design files

A study ([studies](how_to/studies.md)) and a design search ([design search](how_to/design_search.md)) have a TOML
file of one section each. A dotted key is one of the scene's above, with or without quotes: `"coil.current"`; the
entry `"none"` removes it, for `effects.NAME` also `"off"`.
"""


def scene_reference() -> str:
    """Markdown of every section and key of all files: entry, default, range, description."""
    lines = []
    for head, files in ((HEAD, (Scene,)), (OTHER_FILES, (StudyFile, DesignFile))):
        lines.append(head)
        for file in files:
            for name, field in file.model_fields.items():
                lines += _sections(name, field)
    return "\n".join(lines).rstrip("\n") + "\n"


def _sections(path: str, field: FieldInfo) -> Iterator[str]:
    """Walk the sections of a field: one for each member of a union, each followed by those below it."""
    path = f"{path}.NAME" if is_named(field.annotation) else path
    models = sections_of(field.annotation)
    for model in models:
        choice = "".join(f", {key} = {json.dumps(tag)}" for key, tag in tags_of(model).items())
        yield f"## `[{path}]`{choice}\n"
        words = inspect.cleandoc(model.__doc__ or "").removeprefix(f"[{path}]: ")
        yield f"{words[:1].upper()}{words[1:]}{_presence(path, field)}\n"
        keys = model.model_fields
        if any(other in model.__mro__[1:] for other in models):
            own = inspect.get_annotations(model)
            keys = {key: entry for key, entry in keys.items() if key in own}
            yield "Its keys are those of the section above; these differ:\n"
        rows = [_row(key, entry) for key, entry in keys.items() if not is_table(entry)]
        if rows:
            yield "| key | entry | default | range | |\n|---|---|---|---|---|"
            yield "\n".join(rows) + "\n"
        for key, entry in keys.items():
            if is_table(entry):
                yield from _sections(f"{path}.{key}", entry)


def _presence(path: str, field: FieldInfo) -> str:
    if field.is_required():
        return " Required."
    return " The effect is on where its table stands." if path.startswith("effects.") else ""


def _row(key: str, field: FieldInfo) -> str:
    annotation = annotation_of(field)
    cells = [f"`{key}`", kind_of(annotation), _default(field), range_of(annotation), field.description or ""]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def kind_of(annotation: Any) -> str:
    """Return what may stand after a key: ``length [m]``."""
    marks, plain = unwrap(annotation)
    automatic = ', or `"auto"`' if _is_automatic(marks) else ""
    for mark in marks:
        if isinstance(mark, Entry):
            return mark.kind_text + automatic
    origin, parts = get_origin(plain), get_args(plain)
    if is_union(plain):
        return ", or ".join(kind_of(part) for part in parts if part is not type(None)) + automatic
    if origin is Literal:
        return ", ".join(f"`{json.dumps(part)}`" for part in parts)
    if origin is dict:
        return "table" if parts[1] is Any else f"table of {kind_of(parts[1])}"
    if origin is tuple:
        return f"list of {'' if parts[-1] is ... else f'{len(parts)}: '}{kind_of(parts[0])}"
    for model in sections_of(plain):
        needed = ", ".join(name for name, field in model.model_fields.items() if field.is_required())
        return "a table in time" if issubclass(model, TimeTable) else f"a table {{ {needed} }}"
    return {bool: "true or false", str: "text", Any: "as of its key"}[plain]


def range_of(annotation: Any) -> str:
    """Return the allowed range; of a list that of its entries, with their least number."""
    marks, plain = unwrap(annotation)
    least = [mark.min_length for mark in marks if isinstance(mark, MinLen) and mark.min_length > 1]
    texts = [f"at least {count} entries" for count in least]
    texts += [mark.range_text for mark in marks if isinstance(mark, Entry)]
    if is_union(plain) or get_origin(plain) is tuple:
        texts += dict.fromkeys(range_of(part) for part in get_args(plain) if part not in (type(None), ...))
    return "; ".join(filter(None, texts))


def _is_automatic(marks: Iterable[Any]) -> bool:
    return any(isinstance(mark, Automatic) for mark in marks)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return f"`{json.dumps(tag_of(field))}`" if tag_of(field) else "required"
    if field.default is None:
        return '`"auto"`' if _is_automatic(field.metadata) else "none"
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return f"`{json.dumps(default)}`"
