"""Walk over the models of a file: the keys at a path, the marks on their types, the sections below them.

Errors (`fault_report`), the reference of all keys (`reference`) and commented scenes (`commented`) are rendered from
it. An annotation is taken apart into its marks (`emclutch.scene.section.Entry`, lengths of lists, `Automatic`) and the
plain type.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from emclutch.scene.errors import entry_at
from emclutch.scene.section import Entry, Section


def annotation_of(field: FieldInfo) -> Any:
    """Return the whole annotation of a key, with the marks that pydantic keeps apart from its type."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


def unwrap(annotation: Any) -> tuple[tuple[Any, ...], Any]:
    """Take an Annotated apart: all marks that stand on it, and the type within."""
    marks: tuple[Any, ...] = ()
    while get_origin(annotation) is Annotated:
        marks, annotation = (*marks, *annotation.__metadata__), get_args(annotation)[0]
    return marks, annotation


def is_union(annotation: Any) -> bool:
    """True for ``A | B`` and ``Union[A, B]``."""
    return get_origin(annotation) in (Union, types.UnionType)


def members_of(annotation: Any) -> Iterator[Any]:
    """Walk the types of an annotation without their marks: the members of unions, without None."""
    _, plain = unwrap(annotation)
    if is_union(plain):
        for member in get_args(plain):
            yield from members_of(member)
    elif plain is not type(None):
        yield plain


def entry_of(annotation: Any) -> Entry | None:
    """Return the first mark of an annotation that reads an entry; None where there is none, as for a text."""
    marks, plain = unwrap(annotation)
    parts = get_args(plain) if is_union(plain) else ()
    found = (mark for mark in marks if isinstance(mark, Entry))
    return next(found, None) or next((one for part in parts if (one := entry_of(part)) is not None), None)


def sections_of(annotation: Any) -> list[type[Section]]:
    """Return the models of a key that is a table, or a table of named tables: of a union all of them."""
    found: list[type[Section]] = []
    for member in members_of(annotation):
        if get_origin(member) is dict:
            found += sections_of(get_args(member)[1])
        elif isinstance(member, type) and issubclass(member, Section):
            found.append(member)
    return found


def is_named(annotation: Any) -> bool:
    """True for a table of named entries, such as [materials.NAME]."""
    return any(get_origin(member) is dict for member in members_of(annotation))


def is_table(field: FieldInfo) -> bool:
    """True for a key that is a table of its own in the file; one that may be a single entry is written in line."""
    return bool(sections_of(field.annotation)) and entry_of(annotation_of(field)) is None


def tag_of(field: FieldInfo) -> str:
    """Return the name that chooses a member of a union (kind, law, source); empty for any other key."""
    return str(get_args(field.annotation)[0]) if get_origin(field.annotation) is Literal else ""


def tags_of(model: type[Section]) -> dict[str, str]:
    """Return the keys that choose this model from a union, with their names."""
    return {key: tag for key, field in model.model_fields.items() if (tag := tag_of(field))}


def fits(model: type[Section], table: Any) -> bool:
    """True if a member of a union is the one that a table names; also where the table names none."""
    return not isinstance(table, dict) or all(table.get(key, tag) == tag for key, tag in tags_of(model).items())


def annotations_at(path: Sequence[str | int], root: type[Section], data: Any) -> list[Any]:
    """Return the annotations of a path; several where `data`, the user's entries, do not settle a union."""
    found: list[Any] = [root]
    for step in path:
        below: list[Any] = []
        for member in (member for annotation in found for member in members_of(annotation)):
            if get_origin(member) is dict:
                below.append(get_args(member)[1])
            elif get_origin(member) is tuple and isinstance(step, int):
                below.append(get_args(member)[0])
            elif sections_of(member) and fits(member, data) and step in member.model_fields:
                below.append(annotation_of(member.model_fields[step]))
        found, data = below, entry_at(data, (step,))
    return found


def models_at(path: Sequence[str | int], root: type[Section], data: Any) -> list[type[Section]]:
    """Return the models of the table at a path; several where the table names no member of a union."""
    members = (member for annotation in annotations_at(path, root, data) for member in members_of(annotation))
    entry = entry_at(data, path)
    return [member for member in members if get_origin(member) is not dict and sections_of(member)
            and fits(member, entry)]  # fmt: skip


def keys_at(path: Sequence[str | int], root: type[Section], data: Any) -> list[str]:
    """Return the keys that the table at a path may have."""
    models, given = models_at(path, root, data), entry_at(data, path) or {}
    models = [one for one in models if any(key in given for key in one.file_keys)] or models
    return list(dict.fromkeys(key for model in models for key in (*model.file_keys, *model.model_fields)))


def all_keys(model: type[Section], prefix: str = "") -> Iterator[str]:
    """Walk the dotted keys of a model and of the sections below it; not those of named tables."""
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}"
        if not is_named(field.annotation):
            for below in sections_of(field.annotation):
                yield from all_keys(below, f"{prefix}{name}.")
