"""The cache of compiled kernels: keyed by their content, safe for concurrent processes.

Numba's own cache has two defects that matter here. It is keyed by the modification time of a kernel's *file*: a comma
in a docstring recompiles everything in that file, while a change of a callee or of a constant in another file goes
unnoticed, and a stale kernel is loaded silently. And it numbers its files by the number of entries in its index: two
processes that compile one function for different arguments at the same time may load each other's code.

Here (1) a kernel's stamp is a hash of its content (`kernel_stamp`): its instructions and constants, without docstrings,
comments and line numbers, the values of the globals that it reads, and the same of every compiled function that it
calls, in any file, including those chosen by types or found in a table; (2) index and code are read and written under
a lock, and a process that finds another one compiling a kernel waits for its code; (3) where the disk is full, the
folder is not writable, or a file is damaged, kernels are compiled and a warning is given.

Every package with kernels imports this module before its first kernel is defined. Kernels of other packages keep
numba's own cache.
"""

from __future__ import annotations

import functools
import gc
import os
import shutil
import sys
import tempfile
import warnings
from atexit import register
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter, sleep
from typing import IO, Any

import numba
from numba.core import caching, event
from numba.core.dispatcher import Dispatcher
from numba.core.targetconfig import TargetConfig

from geometry.kernels.numba_version import require_tested_version
from geometry.kernels.stamp import PACKAGES, is_own, kernel_stamp

try:
    import fcntl
except ImportError:  # no such locks on Windows: there numba's own rule holds
    fcntl = None  # type: ignore[assignment]

ROOT = Path(__file__).resolve().parents[2]
MAX_WAIT, POLL = 180.0, 0.1  # s, for another process that compiles; between two looks


def specialisations() -> set[str]:
    """``module.kernel(types of its arguments)`` of all that this process has compiled or read from the cache.

    Of functions that are compiled into kernels, not those: they have no cache of their own.
    """
    return {
        f"{name}.{kernel}{signature}"
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in PACKAGES
        for kernel, value in list(vars(module).items())
        if isinstance(value, Dispatcher)
        and value.py_func.__module__ == name
        and not isinstance(getattr(value, "_cache"), caching.NullCache)  # noqa: B009 (numba's stubs hide it)
        for signature in value.overloads
    }


class _Stamp:
    """A kernel's stamp, computed when the cache is first used: callees may be defined below their caller.

    Pickled and compared as the text that it is.
    """

    def __init__(self, function: Callable) -> None:
        self._function = function
        self._text: str | None = None

    def __str__(self) -> str:
        if self._text is None:
            self._text = kernel_stamp(self._function)
        return self._text

    def __eq__(self, other: object) -> bool:
        return str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __reduce__(self) -> tuple:
        return str, (str(self),)


class _StampedLocator:
    """A place for the cache of a kernel of ours; none for others'."""

    def __init__(self, py_func: Callable, py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[call-arg]
        self._stamp = _Stamp(py_func)

    @classmethod
    def from_function(cls, py_func: Callable, py_file: str) -> Any:
        if not is_own(py_func) or not Path(py_file).resolve().is_relative_to(ROOT):
            return None
        return super().from_function(py_func, py_file)  # type: ignore[misc]

    def get_source_stamp(self) -> _Stamp:
        return self._stamp

    def get_disambiguator(self) -> str:
        return "s"  # numba's is the line's number; names are unique within a file of ours


class EnvironmentFolder(_StampedLocator, caching.UserProvidedCacheLocator):
    """In ``NUMBA_CACHE_DIR``."""


class SourceFolder(_StampedLocator, caching.InTreeCacheLocator):
    """In the ``__pycache__`` of the source folder."""


class UserFolder(_StampedLocator, caching.UserWideCacheLocator):
    """In the user's cache folder, where the source may not be written."""


class ProcessFolder(_StampedLocator, caching.UserWideCacheLocator):
    """In a folder of this process alone, where no other may be written: it is removed with the process."""

    _folder: str | None = None

    def get_cache_path(self) -> str:
        if ProcessFolder._folder is None:
            ProcessFolder._folder = tempfile.mkdtemp(prefix="emclutch-kernels-")
            register(shutil.rmtree, ProcessFolder._folder, ignore_errors=True)
            _warn("no folder for compiled kernels can be written")
        return os.path.join(ProcessFolder._folder, os.path.basename(self._cache_path))


_warned: set[str] = set()


def _warn(fault: str) -> None:
    """Warn once that kernels are not kept."""
    if fault not in _warned:
        _warned.add(fault)
        text = f"{fault}: they are recompiled by every run, which takes a minute; make room or permissions there, or"
        warnings.warn(f"{text} set NUMBA_CACHE_DIR to another folder", RuntimeWarning, stacklevel=2)


@contextmanager
def _tolerate_disk_errors(cache: caching.Cache) -> Iterator[None]:
    """Leave the block at an error of the disk: numba compiles what it cannot read, and keeps what it cannot write."""
    try:
        yield
    except OSError as error:
        _release_compile_locks()
        _warn(f"compiled kernels cannot be kept in {cache.cache_path} ({error.strerror or error})")


@contextmanager
def _lock(path: str, *, alone: bool) -> Iterator[None]:
    """Hold the lock of an index; without one where the file system has none."""
    if fcntl is None:
        yield
        return
    try:
        file = open(f"{path}.lock", "a")
    except OSError:  # a cache that may only be read, or is not there yet
        yield
        return
    with file:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)  # released when the file is closed
        yield


_compiling: list[IO] = []  # locks of kernels that this process compiles


def _acquire_compile_lock(path: str) -> None:
    """Become the only process that compiles a missing kernel; wait for another one for at most MAX_WAIT."""
    try:
        file = open(f"{path}.compiling", "a")
    except OSError:
        return
    for _ in range(round(MAX_WAIT / POLL)):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sleep(POLL)
        except OSError:  # a file system without locks
            break
        else:
            _compiling.append(file)
            return
    file.close()


def _release_compile_locks() -> None:
    """Let other processes continue."""
    while _compiling:
        _compiling.pop().close()


class _WithoutCollection(event.Listener):
    """No garbage collection while a kernel is compiled: it makes millions of objects and takes an eighth less time.

    `seconds` is the wall-clock time that compiling, or waiting for another process that compiles, has taken.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._was_on = False
        self._begin = 0.0
        self.seconds = 0.0

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._begin = perf_counter()
            self._was_on = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += perf_counter() - self._begin
            if sys.exc_info()[0] is not None:  # failed (`is_failed` is inverted in 0.68); else it is saved first
                _release_compile_locks()
            if self._was_on:
                gc.enable()


_listener = _WithoutCollection()


def compile_seconds() -> float:
    """Wall-clock time [s] that this process has spent on kernels that were not in the cache."""
    return _listener.seconds


@functools.cache
def _defaults(kind: type[TargetConfig]) -> dict[str, Any]:
    return {name: option.default for name, option in kind.options.items()}


def _option_values(self: TargetConfig) -> dict[str, Any]:
    """`TargetConfig.values`, which asks a property for each of twenty options, at every look-up of an overload."""
    return {**_defaults(type(self)), **self._values}


def _install() -> None:
    """Put locators, locks, the pause of the collector and quick options into numba; once a process."""
    event.register("numba:compile", _listener)
    TargetConfig.values = _option_values  # type: ignore[method-assign]
    numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # type: ignore[attr-defined]
    if not numba.config.CACHE_LOCATOR_CLASSES:  # type: ignore[attr-defined]
        locators = (EnvironmentFolder, SourceFolder, UserFolder, ProcessFolder)
        own = [f"{__name__}.{locator.__name__}" for locator in locators]
        usual = [locator.__name__ for locator in caching.CacheImpl._locator_classes]
        numba.config.CACHE_LOCATOR_CLASSES = ",".join(own + usual)  # type: ignore[attr-defined]
    caching.Cache._guard_against_spurious_io_errors = _tolerate_disk_errors  # type: ignore
    save, load = caching.IndexDataCacheFile.save, caching.IndexDataCacheFile.load
    load_index, load_data = caching.IndexDataCacheFile._load_index, caching.IndexDataCacheFile._load_data

    def index_or_none(self):
        try:
            return load_index(self)
        except OSError:
            raise
        except Exception:  # whatever pickle finds in half a file
            with suppress(OSError):
                os.unlink(self._index_path)
            return {}

    def data_or_none(self, name):
        try:
            return load_data(self, name)
        except OSError:
            raise
        except Exception as error:
            raise OSError(f"{name} is damaged") from error  # for numba it does not exist, and is rewritten

    caching.IndexDataCacheFile._load_index = index_or_none  # type: ignore[method-assign]
    caching.IndexDataCacheFile._load_data = data_or_none  # type: ignore[method-assign]

    def locked_save(self, key, data):
        with _lock(self._index_path, alone=True):
            save(self, key, data)
        _release_compile_locks()

    def locked_load(self, key):
        with _lock(self._index_path, alone=False):
            index_data = load(self, key)
        if index_data is None and fcntl is not None and isinstance(self._source_stamp, _Stamp):
            _release_compile_locks()
            _acquire_compile_lock(self._index_path)  # until the code that numba compiles now has been saved
            with _lock(self._index_path, alone=False):
                index_data = load(self, key)
            if index_data is not None:
                _release_compile_locks()
        return index_data

    caching.IndexDataCacheFile.save, caching.IndexDataCacheFile.load = locked_save, locked_load  # type: ignore


require_tested_version(numba.__version__)
_install()
