"""Attributes of a module that are imported when they are first used (PEP 562)."""

from __future__ import annotations

import sys
from importlib import import_module


def lazy_attributes(module: str, places: dict[str, str]):
    """Return __getattr__ and __dir__ of a module for names at "package.module:attribute" or "package"."""

    def __getattr__(name: str):
        if name not in places:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        place, _, attribute = places[name].partition(":")
        found = import_module(place)
        value = getattr(found, attribute) if attribute else found
        setattr(sys.modules[module], name, value)
        return value

    def __dir__() -> list[str]:
        return sorted(getattr(sys.modules[module], "__all__", places))

    return __getattr__, __dir__
