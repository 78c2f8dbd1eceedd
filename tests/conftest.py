"""One thread a test worker, one cache of kernels for all of them, and a count of what was compiled.

The machine code of a kernel is rebuilt for every combination of its arguments' types. That is what made the test run
slow once, so the number of combinations is printed after it, and a run with more of them than `MAX_SPECIALISATIONS`
fails: whoever needs one more raises the number, and says in the commit what for.
"""

import gc
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy and numba are loaded; two workers share two cores
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # tests of threads: the other worker has the other core
os.environ["EMCLUTCH_LADDERS"] = os.path.join(__file__, "none")  # a test that needs a ladder names a folder of its own

import numba
import pytest

from geometry.kernels.cache import specialisations

# Specialisations that the whole run may use, of all kernels and of the two that take longest to compile
MAX_SPECIALISATIONS = {"": 98, "particles.dem.step_kernel.run_steps": 21, "particles.dvi.step_kernel.run_steps": 5}
found: set[str] = set()  # in the process that prints: those of all workers


gc.disable()  # while tests are collected: all modules stay, and going through them took a third of the time


def pytest_collection_finish():
    """From here on the collector leaves out what is there already, half a million objects."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def one_thread():
    """Every test begins with one thread, whatever the one before it has set; tests of threads take more."""
    numba.set_num_threads(1)


@pytest.fixture(autouse=True)
def one_replica(monkeypatch):
    """A scene that does not say how many replicas it wants has one; tests of replicas say how many."""
    monkeypatch.setattr("emclutch.scene.replica_count.automatic_count", lambda scene: 1)


def pytest_sessionfinish(session):
    """A worker sends what it has; the process that collects compares the whole with what is allowed."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["specialisations"] = sorted(specialisations())
        return
    found.update(specialisations())
    if too_many():
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """pytest-xdist: a worker has ended."""
    found.update(getattr(node, "workeroutput", {}).get("specialisations", ()))


def counts() -> dict[str, int]:
    """How many of each that `MAX_SPECIALISATIONS` bounds."""
    return {name: sum(one.startswith(f"{name}(" if name else "") for one in found) for name in MAX_SPECIALISATIONS}


def too_many() -> list[str]:
    return [name for name, number in counts().items() if number > MAX_SPECIALISATIONS[name]]


def pytest_terminal_summary(terminalreporter):
    number = counts()
    terminalreporter.write_sep("-", "compiled specialisations")
    for name in MAX_SPECIALISATIONS:
        terminalreporter.write_line(f"{name or 'all kernels'}: {number[name]} (at most {MAX_SPECIALISATIONS[name]})")
    for name in too_many():
        terminalreporter.write_line(
            f"FAILED: more specialisations of {name or 'all kernels'} than tests/conftest.py allows", red=True
        )
