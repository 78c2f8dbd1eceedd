"""The cache of kernels follows what a kernel is made of, and no process takes another's code."""

import errno
import gc
import importlib
import multiprocessing
import os
import pkgutil
import queue
import subprocess
import sys
import types
from typing import NamedTuple

import numpy as np
import pytest
from full_disk import full_disk
from numba import njit
from numba.core import event
from numba.core.caching import IndexDataCacheFile, NullCache
from numba.core.dispatcher import Dispatcher
from numba.extending import overload

from geometry.kernels import cache as kernel_cache
from geometry.kernels.cache import _Stamp, specialisations
from geometry.kernels.stamp import _globals_read, _names, is_own, kernel_stamp

CALLEE = """
FACTOR = 2.0
UNUSED = 3.0

class Arrays(NamedTuple):
    first: float
    second: float

@njit(error_model="numpy")
def scaled(x):
    '''Twice.'''
    return FACTOR * x

@njit
def fivefold(x):
    return 5.0 * x

TABLE = {"one": fivefold}

def by_type(x):
    raise NotImplementedError

@overload(by_type)
def _by_type(x):
    code = TABLE["one"]
    def threefold(x):
        return 3.0 * code(x)
    return threefold
"""
KERNEL = """
import constants

@njit(error_model="numpy")
def kernel(x):
    '''What it does.'''
    total = 0.0
    for i in range(10):  # ten
        total += later(x) + constants.SHIFT
    return total

@njit(error_model="numpy")
def later(x):
    return scaled(x) if x > 0.0 else by_type(x)
"""


def stamp(callee=CALLEE, kernel=KERNEL, shift=1.0):
    """The stamp of a kernel whose callee and constants stand in other modules."""
    constants = types.ModuleType("particles.constants")
    constants.SHIFT, constants.OTHER = shift, 5.0
    sys.modules["constants"] = constants
    try:
        below = {"njit": njit, "overload": overload, "NamedTuple": NamedTuple, "np": np,
                 "__name__": "particles.callee"}  # fmt: skip
        exec(callee, below)
        above = {"njit": njit, "__name__": "particles.kernel", "scaled": below["scaled"], "by_type": below["by_type"]}
        exec(kernel, above)
        return kernel_stamp(above["kernel"].py_func)
    finally:
        del sys.modules["constants"]


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("nothing", {}),
        ("a docstring", {"kernel": KERNEL.replace("What it does.", "What else\n    it does.")}),
        ("the docstring of a callee", {"callee": CALLEE.replace("'''Twice.'''", "'''Two times.'''")}),
        ("a comment and the lines", {"kernel": "\n\n# here\n" + KERNEL.replace("# ten", "# 10 times")}),
        ("a constant that it does not read", {"callee": CALLEE.replace("UNUSED = 3.0", "UNUSED = 4.0")}),
    ],
)
def test_the_stamp_stays(what, change):
    assert stamp(**change) == stamp()


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("an instruction", {"kernel": KERNEL.replace("total +=", "total -=")}),
        ("a number", {"kernel": KERNEL.replace("range(10)", "range(11)")}),
        ("an instruction of a callee", {"callee": CALLEE.replace("FACTOR * x", "FACTOR + x")}),
        ("a constant of a callee's module", {"callee": CALLEE.replace("FACTOR = 2.0", "FACTOR = 2.5")}),
        ("the fields of a class that may be an argument", {"callee": CALLEE.replace("first", "third")}),
        ("a callee that stands below", {"kernel": KERNEL.replace("x > 0.0", "x >= 0.0")}),
        ("a constant read through its module", {"shift": 1.5}),
        ("a compiler option", {"kernel": KERNEL.replace("numpy", "python", 1)}),
        ("an instruction chosen by type", {"callee": CALLEE.replace("return 3.0 *", "return 4.0 *")}),
        ("a callee found in a table", {"callee": CALLEE.replace("return 5.0 *", "return 6.0 *")}),
        ("a compiler option of a callee", {"callee": CALLEE.replace('error_model="numpy"', 'error_model="python"')}),
    ],
)
def test_the_stamp_changes(what, change):
    assert stamp(**change) != stamp()


@pytest.mark.parametrize(
    "value", ["((fivefold,), 2.0)", "(len, object())", "np.array([fivefold])", "{'one': (object(),)}"]
)
def test_a_stamp_with_a_memory_address_raises(value):
    """Each process would compile the kernel again: here a table of functions that the Python twin of a kernel reads."""
    callee = CALLEE.replace("raise NotImplementedError", "return ADDRESSES[0][0](x)")
    with pytest.raises(TypeError, match="memory address"):
        stamp(callee=callee.replace("def by_type", f"ADDRESSES = {value}\n\ndef by_type"))


def test_the_stamp_is_the_same_in_every_process():
    """Hash seeds order sets differently."""
    code = (
        "from geometry.kernels.stamp import kernel_stamp\n"
        "from particles.dem.step_kernel import run_steps\n"
        "from particles.dvi.step_kernel import run_steps as rigid\n"
        "print(kernel_stamp(run_steps.py_func), kernel_stamp(rigid.py_func))"
    )
    stamps = [
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, text=True,
            check=True,
        ).stdout.split()
        for seed in ("1", "2")
    ]  # fmt: skip
    assert stamps[0] == stamps[1]
    assert stamps[0][0] != stamps[0][1]


def test_kernels_of_ours_are_cached_by_syntax_and_those_of_others_are_not():
    from particles.dem.step_kernel import run_steps

    assert type(run_steps._cache._impl.locator).__module__ == "geometry.kernels.cache"

    @njit(cache=True)
    def foreign(x):
        return x

    assert type(foreign._cache._impl.locator).__module__ == "numba.core.caching"


def every_kernel():
    for package in ("field", "particles", "coupling"):
        for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, Dispatcher) and value.py_func.__module__ == module.name:
                    yield value


def has_a_cache(kernel):
    return not isinstance(kernel._cache, NullCache)


def test_no_kernel_with_a_cache_is_called_by_another_kernel():
    """Read from the cache it cannot be inlined any more, compiled beside its caller it is: the caller's last bits would
    depend on which of the two was there first."""
    kernels = list(every_kernel())
    assert sum(map(has_a_cache, kernels)) > 40
    for kernel in kernels:
        function = kernel.py_func
        for _, callee in _globals_read(function, _names(function.__code__)):
            if not (isinstance(callee, Dispatcher) and is_own(callee.py_func)):
                continue
            assert not has_a_cache(callee), f"{kernel.py_func.__qualname__} calls {callee.py_func.__qualname__}: @inner"


def write(folder, worker, count):
    """Save ``count`` entries under keys of this worker's."""
    file = IndexDataCacheFile(folder, "kernel-s.py311", "stamp")
    for k in range(count):
        file.save((worker, k), f"code {worker} {k}")


def test_processes_that_write_one_index_keep_every_entry(tmp_path):
    count, workers = 25, 3
    context = multiprocessing.get_context("fork")
    tasks = [context.Process(target=write, args=(str(tmp_path), w, count)) for w in range(workers)]
    for task in tasks:
        task.start()
    for task in tasks:
        task.join()
        assert task.exitcode == 0
    file = IndexDataCacheFile(str(tmp_path), "kernel-s.py311", "stamp")
    for w in range(workers):
        for k in range(count):
            assert file.load((w, k)) == f"code {w} {k}"


def test_specialisations_are_counted_by_kernel_and_types():
    from particles.walls.device_walls import _merge

    start, other = np.array([0, 1], dtype=np.int64), np.array([3], dtype=np.int32)
    merged = np.empty(2, dtype=np.int32)
    _merge(start, other, start, other + np.int32(1), 2 * start, merged)
    assert merged.tolist() == [3, 4]
    mine = {one for one in specialisations() if one.startswith("particles.walls.device_walls._merge(")}
    assert len(mine) == len(_merge.overloads) >= 1
    assert not any("foreign" in one for one in specialisations())


def ask(folder, begun, answer):
    """Ask for a kernel that another process has begun to compile."""
    begun.wait(10.0)
    file = IndexDataCacheFile(folder, "kernel-s.py311", _Stamp(write))
    answer.put((file.load("key"), len(kernel_cache._compiling)))


def test_who_finds_a_kernel_being_compiled_waits_for_its_code(tmp_path):
    context = multiprocessing.get_context("fork")
    begun, answer = context.Event(), context.Queue()
    other = context.Process(target=ask, args=(str(tmp_path), begun, answer))
    other.start()  # before there is a lock, or it would inherit it
    file = IndexDataCacheFile(str(tmp_path), "kernel-s.py311", _Stamp(write))
    assert file.load("key") is None  # it is not there: numba compiles it now
    begun.set()
    with pytest.raises(queue.Empty):
        answer.get(timeout=0.5)
    file.save("key", "code")
    assert answer.get(timeout=10.0) == ("code", 0)
    other.join()
    assert file.load("another") is None and len(kernel_cache._compiling) == 1
    kernel_cache._release_compile_locks()


def test_a_file_system_without_locks_is_no_reason_to_stop(tmp_path, monkeypatch):
    def refuse(file, how):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr("geometry.kernels.cache.fcntl.flock", refuse)
    file = IndexDataCacheFile(str(tmp_path), "kernel-s.py311", "stamp")
    file.save("key", "code")
    assert file.load("key") == "code"


def test_the_collector_runs_again_after_a_kernel_was_compiled():
    paused = []

    class Listener(event.Listener):
        def on_start(self, event):
            paused.append(not gc.isenabled())

        def on_end(self, event):
            pass

    @njit
    def inside(x):
        return x + 1.0

    @njit
    def outside(x):
        return inside(x) * 2.0

    assert gc.isenabled()
    with event.install_listener("numba:compile", Listener()):
        assert outside(1.0) == 4.0
    assert paused == [True, True] and gc.isenabled()


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_damaged_file_of_the_cache_is_compiled_anew(tmp_path, ending, share):
    """Cut off by a full disk or a power failure; numba's own cache ends in an EOFError."""
    file = IndexDataCacheFile(str(tmp_path), "kernel-s.py311", "stamp")
    file.save("key", "code" * 100)
    (path,) = tmp_path.glob(f"*.{ending}")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    assert file.load("key") is None
    file.save("key", "code again")
    assert file.load("key") == "code again"


def kernel_of(folder, monkeypatch):
    """A new kernel with a cache in a folder."""
    monkeypatch.setattr(kernel_cache, "_warned", set())

    @njit(cache=True)
    def twice(x):
        return 2.0 * x

    cache = twice._cache
    monkeypatch.setattr(cache._impl.locator, "get_cache_path", lambda: str(folder))
    monkeypatch.setattr(cache, "_cache_path", str(folder))
    cache._cache_file = IndexDataCacheFile(str(folder), "twice-s.py311", "stamp")
    return twice


def test_a_kernel_that_finds_no_room_in_the_cache_is_used_all_the_same(tmp_path, monkeypatch):
    twice = kernel_of(tmp_path, monkeypatch)
    with full_disk(100), pytest.warns(RuntimeWarning, match=r"cannot be kept in .*too large.*NUMBA_CACHE_DIR"):
        assert twice(2.0) == 4.0
    assert kernel_cache._compiling == [] and not list(tmp_path.glob("*.tmp.*"))


def test_a_kernel_whose_cache_is_gone_is_used_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    twice = kernel_of(tmp_path / "file" / "below", monkeypatch)
    with pytest.warns(RuntimeWarning, match=r"cannot be kept in .*file/below \(Not a directory\)"):
        assert twice(2.0) == 4.0


def test_where_nothing_can_be_written_kernels_are_kept_for_the_process_alone(tmp_path, monkeypatch):
    """As for a user without a home in a container that may only be read; numba's own cache ends in a RuntimeError."""
    from particles.dem.step_kernel import run_steps

    def refused(self):
        raise PermissionError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(kernel_cache, "_warned", set())
    monkeypatch.setattr(kernel_cache.ProcessFolder, "_folder", None)
    for locator in (kernel_cache.EnvironmentFolder, kernel_cache.SourceFolder, kernel_cache.UserFolder):
        monkeypatch.setattr(locator, "ensure_cache_path", refused)
    with pytest.warns(RuntimeWarning, match="no folder for compiled kernels can be written.*NUMBA_CACHE_DIR"):
        cache = type(run_steps._cache)(run_steps.py_func)
    assert os.listdir(kernel_cache.ProcessFolder._folder) == [os.path.basename(cache.cache_path)]
