"""One thread a test worker, one cache of kernels for all of them, and counts of what was compiled.

The machine code of a kernel is built for every combination of its arguments' types, which takes most of the time of a
first run; a child process compiles it, and the worker reads it from the cache. After the tests the number of
combinations is printed, what the two steps consist of, and the memory of the largest process; a run with more than
`MAX_SPECIALISATIONS`, `MAX_COUNTS` or `MAX_MEMORY` allow fails. Whoever needs more raises the number and gives the
reason in the commit.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy and numba are loaded; two workers share two cores
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # tests of threads: the other worker has the other core
os.environ["EMCLUTCH_ACCURACY_STUDIES"] = os.path.join(__file__, "none")  # tests of them name a folder of their own

import compile_counts
import compile_in_child
import numba
import pytest
from hypothesis import settings

from geometry.kernels.cache import specialisations

STEPS = ("particles.dem.step_kernel.run_steps", "particles.dvi.step_kernel.run_steps")
# Specialisations that the whole run may use, of all kernels and of the two that take longest to compile
# (17 of DEM: two are those of the gap between faces, with dipoles alone and with necks)
MAX_SPECIALISATIONS = {"": 96, STEPS[0]: 17, STEPS[1]: 5}
# What a variant of these may consist of (`compile_counts`): a tenth above the largest of today
MAX_COUNTS = {
    STEPS[0]: {"functions": 187, "scalars": 15_300, "lines": 125_500},
    STEPS[1]: {"functions": 314, "scalars": 40_300, "lines": 399_000},
}
MAX_MEMORY = 1650  # MB, of a test process or of one that it starts: a tenth above 1.5 GB, for other machines
compile_counts.install()
settings.register_profile("gate", derandomize=True)  # the same examples in every run; `make stability` draws others
settings.load_profile("gate")
found: set[str] = set()  # in the process that prints: specialisations of all workers
largest: dict[str, dict[str, int]] = {}  # and the largest counts of a variant of each step
memory = [0]  # MB, the largest of each worker


gc.disable()  # while tests are collected: all modules stay, and going through them took a third of the time


def pytest_collection_finish():
    """From here on the collector leaves out what is there already, half a million objects."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True, scope="module")
def freed_memory():
    """After each file memory that is not in use goes back to the system: garbage, and free blocks of malloc."""
    yield
    gc.collect()
    with suppress(OSError, AttributeError):  # only glibc has it
        ctypes.CDLL("libc.so.6").malloc_trim(0)


@pytest.fixture(autouse=True)
def threads():
    """Every test begins with one thread, or EMCLUTCH_TEST_THREADS; tests of threads take what they need."""
    numba.set_num_threads(int(os.environ.get("EMCLUTCH_TEST_THREADS", "1")))


@pytest.fixture(autouse=True)
def one_replica(monkeypatch):
    """A scene that does not say how many replicas it wants has one; tests of replicas say how many."""
    monkeypatch.setattr("emclutch.scene.replica_count.automatic_count", lambda scene: 1)


def counts_here() -> dict[str, dict[str, int]]:
    """The largest counts of the variants of each step that this process has compiled; nothing of those in the cache."""
    return {
        name: compile_counts.largest(sys.modules[module].run_steps)
        for name in STEPS
        if (module := name.rpartition(".")[0]) in sys.modules
    }


def merge(specialisations: Iterable[str], counts: dict[str, dict[str, int]]) -> None:
    """Add what a process has compiled or read."""
    found.update(specialisations)
    for name, own in counts.items():
        before = largest.setdefault(name, {})
        before.update({key: max(number, before.get(key, 0)) for key, number in own.items()})


compile_in_child.install(counts_here, lambda counts: merge((), counts))


def pytest_sessionfinish(session):
    """A worker sends what it has; the process that collects compares the whole with what is allowed."""
    merge(specialisations(), counts_here())
    memory.append(max(getrusage(who).ru_maxrss for who in (RUSAGE_SELF, RUSAGE_CHILDREN)) // 1024)
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["compiled"] = [sorted(found), largest, max(memory)]
        return
    if faults():
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """pytest-xdist: a worker has ended."""
    specialised, counts, size = getattr(node, "workeroutput", {}).get("compiled", ((), {}, 0))
    merge(specialised, counts)
    memory.append(size)


def numbers() -> Iterator[tuple[str, int, int]]:
    """(what, its number, the number allowed) of all that is bounded and known."""
    for name, allowed in MAX_SPECIALISATIONS.items():
        number = sum(one.startswith(f"{name}(" if name else "") for one in found)
        yield f"variants of {name or 'all kernels'}", number, allowed
    for name, bounds in MAX_COUNTS.items():
        for key, number in largest.get(name, {}).items():
            yield f"{key} of a variant of {name}", number, bounds[key]
    yield "MB of the largest process", max(memory), MAX_MEMORY


def faults() -> list[str]:
    return [what for what, number, allowed in numbers() if number > allowed]


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_sep("-", "what compilation consists of, and memory")
    for what, number, allowed in numbers():
        terminalreporter.write_line(f"{what}: {number} (at most {allowed})")
    for what in faults():
        terminalreporter.write_line(f"FAILED: more {what} than tests/conftest.py allows", red=True)
