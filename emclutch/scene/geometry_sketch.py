"""Sketch of a geometry with errors: its kind, its materials, and its valid sizes.

Most of what the sections of a scene demand of the geometry concerns its kind alone. It is judged on a sketch, so that
one wrong size hides no fault of another section.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Any

from pydantic import ValidationError, create_model

from emclutch.devices import GEOMETRIES
from emclutch.scene.section import Section


def sketch_of(given: Any, keys: Iterable[str], context: dict[str, Any]) -> Section | None:
    """Return the geometry without its faulty entries; None where not even the kind is known.

    Parameters
    ----------
    given : the user's table [geometry]
    keys : dotted keys of its faults, ``geometry.gap``; the entry of a required one is None in the sketch
    context : as the scene's models take it
    """
    keys = set(keys)
    kind = given.get("kind") if isinstance(given, Mapping) else None
    model = next((one for one in GEOMETRIES if one.name() == kind), None)
    # without its file nothing of a device from CAD is known
    if model is None or keys & {"geometry", "geometry.kind", "geometry.file"}:
        return None
    right = copy.deepcopy(dict(given))
    for key in keys:
        _, name, *below = key.split("[")[0].split(".")
        table = right.get(name)
        if name == "materials" and below and isinstance(table, dict):
            table.pop(below[0], None)
        else:
            right.pop(name, None)
    try:
        return _with_optional_entries(model).model_validate(right, context=context)
    except ValidationError:
        return None  # a rule between entries is broken; which of them are right is not known


@cache
def _with_optional_entries(model: type[Section]) -> type[Section]:
    entries: dict[str, Any] = {}
    for name, info in model.model_fields.items():
        if info.is_required() and name != "kind":
            annotation: Any = info.annotation
            marked = Annotated[(annotation, *info.metadata)] if info.metadata else annotation
            entries[name] = (marked | None, None)
    return create_model(f"{model.__name__}Sketch", __base__=model, **entries)
