"""A hash of what a compiled kernel is made of: its syntax, the globals that it reads, and all that it calls."""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.typing.templates import builtin_registry

PACKAGES = ("geometry", "field", "particles", "coupling", "emclutch")


def is_own(function: Callable) -> bool:
    """True if a function belongs to one of the five packages."""
    return function.__module__.partition(".")[0] in PACKAGES


def kernel_stamp(function: Callable) -> str:
    """Hash of all that the machine code of a kernel is made of.

    Parameters
    ----------
    function : callable
        The Python function of a kernel.

    Returns
    -------
    str
        Hexadecimal digest. It stays when comments, docstrings, line breaks and anything that the kernel does not use
        are changed, and differs when an instruction, a constant, a compiler option or one of these of a callee does.

    Raises
    ------
    TypeError
        If the kernel reads a value whose text holds a memory address: every process would compile the kernel again.
    """
    digest = hashlib.sha256()
    own = function.__globals__.get(function.__name__)  # its compiler options
    _add_value("", own if getattr(own, "py_func", None) is function else function, digest, set())
    return digest.hexdigest()


def _add_function(function: Any, digest: Any, seen: set[int]) -> None:
    if id(function) in seen:
        return
    seen.add(id(function))
    digest.update(f"def {function.__module__}.{function.__qualname__}".encode())
    digest.update(_constant_text(function.__defaults__).encode())
    _add_code(function.__code__, function.__doc__, digest)
    for name, value in _globals_read(function, _names(function.__code__)):
        _add_value(name, value, digest, seen)
    for name, value in sorted(function.__globals__.items()):  # may be an argument: numba knows its name only
        if isinstance(value, type) and hasattr(value, "_fields") and is_own(value):
            _add_value(name, value, digest, seen)


def _names(code: CodeType) -> set[str]:
    """Names that the instructions of a function and of those inside it look up."""
    return set(code.co_names).union(*(_names(inside) for inside in code.co_consts if isinstance(inside, CodeType)))


def _globals_read(function: Any, names: set[str]) -> Iterator[tuple[str, Any]]:
    """Names and values from outside that a function reads, in the order of the names."""
    module = function.__globals__
    values = {name: module[name] for name in names if name in module}
    for cell, name in zip(function.__closure__ or (), function.__code__.co_freevars, strict=True):
        values[name] = cell.cell_contents
    for name in sorted(values):
        value = values[name]
        if isinstance(value, ModuleType) and value.__name__.partition(".")[0] in PACKAGES:
            for attribute in sorted(names & vars(value).keys()):  # more than is read of it, never less
                yield f"{name}.{attribute}", vars(value)[attribute]
        else:
            yield name, value


def _add_code(code: CodeType, doc: str | None, digest: Any) -> None:
    """Instructions and constants of a function and of those inside it."""
    digest.update(code.co_code)
    digest.update(repr((code.co_varnames, code.co_names, code.co_freevars, code.co_argcount)).encode())
    for number, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            _add_code(constant, None, digest)
        elif not (number == 0 and doc is not None and constant == doc):
            digest.update(_constant_text(constant).encode())


def _add_value(name: str, value: Any, digest: Any, seen: set[int]) -> None:
    if isinstance(value, Dispatcher):
        options = tuple((key, _constant_text(value.targetoptions[key])) for key in sorted(value.targetoptions))
        digest.update(f"{name}: kernel {options!r}".encode())
        if is_own(value.py_func):
            _add_function(value.py_func, digest, seen)
    elif isinstance(value, FunctionType) and is_own(value):
        _add_function(value, digest, seen)
        for chosen in _overloads(value):
            _add_function(chosen, digest, seen)
    elif isinstance(value, _Intrinsic) and is_own(value):  # instructions for LLVM, and the types that they work on
        digest.update(inspect.getsource(sys.modules[value.__module__]).encode())
    elif isinstance(value, dict) or (isinstance(value, tuple) and any(map(_is_compiled, value))):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, one in pairs:
            _add_value(f"{name}[{_constant_text(key)}]", one, digest, seen)
    elif isinstance(value, bool | int | float | complex | str | tuple | frozenset | type(None)):
        digest.update(f"{name} = {_constant_text(value)}".encode())
    elif isinstance(value, np.generic | np.ndarray):  # an array that is read as a global is part of the code
        if value.dtype.hasobject:
            raise TypeError(f"the kernel reads {name}, an array of objects: its bytes are memory addresses")
        digest.update(f"{name}: {value.dtype} {value.shape}".encode() + value.tobytes())
    elif isinstance(value, type):
        digest.update(f"{name}: {value.__qualname__}{getattr(value, '_fields', ())!r}".encode())
    else:  # numpy, math and what they hold come with numba's version
        digest.update(f"{name}: {type(value).__name__} {getattr(value, '__name__', '')}".encode())


def _is_compiled(value: Any) -> bool:
    return isinstance(value, Dispatcher)


def _overloads(function: Callable) -> list[Callable]:
    """Functions that choose the code of a plain function, by types, where kernels call it (`numba.extending.overload`).

    They hold that code, or the names under which it stands.
    """
    kinds = (kind for value, kind in builtin_registry.globals if value is function)
    templates = (template for kind in kinds for template in kind.templates)
    return [template._overload_func for template in templates if hasattr(template, "_overload_func")]


def _constant_text(value: Any) -> str:
    """Text of a constant that depends neither on the order of a set nor on the process.

    Raises
    ------
    TypeError
        If it holds a memory address.
    """
    if isinstance(value, set | frozenset):
        return f"set {sorted(map(_constant_text, value))!r}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_constant_text, value))})"
    text = f"{type(value).__name__} {value!r}"
    if not isinstance(value, str) and re.search(r" at 0x[0-9a-fA-F]+", text):
        raise TypeError(f"the stamp of a kernel would hold a memory address: {text}; give the value a name of its own")
    return text
