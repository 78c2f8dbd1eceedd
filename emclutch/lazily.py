"""Attributes of a module that are imported when they are first used (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from inspect import Parameter, isfunction, signature
from os import PathLike
from typing import Any


def lazy_attributes(module: str, places: dict[str, str], checks_names: bool = False):
    """Return __getattr__ and __dir__ of a module for names at "package.module:attribute" or "package".

    With `checks_names` its functions raise SceneError, with the nearest name, for an argument that they do not have,
    and for an `out` that is no path.
    """

    def __getattr__(name: str):
        if name not in places:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        place, _, attribute = places[name].partition(":")
        found = import_module(place)
        value = getattr(found, attribute) if attribute else found
        if checks_names and isfunction(value):
            value = _with_checked_names(value, module)
        setattr(sys.modules[module], name, value)
        return value

    def __dir__() -> list[str]:
        return sorted(getattr(sys.modules[module], "__all__", places))

    return __getattr__, __dir__


def _with_checked_names(function: Callable[..., Any], module: str) -> Callable[..., Any]:
    parameters = signature(function).parameters
    takes_any = any(one.kind is Parameter.VAR_KEYWORD for one in parameters.values())

    @wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        from emclutch.scene.errors import Fault, SceneError, no_argument, shown  # local: the module is imported quickly

        for name in () if takes_any else named:
            if name not in parameters:
                raise no_argument(name, function.__name__, list(parameters))
        if not isinstance(out := named.get("out"), str | PathLike | None):
            raise SceneError([Fault("out", shown(out), "is not the path of a folder; give a text")], "arguments")
        return function(*given, **named)

    call.__module__ = module  # where pickle finds it
    return call
