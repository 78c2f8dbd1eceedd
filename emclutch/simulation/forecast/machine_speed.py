"""Speed of this machine relative to the reference one, and the share of its cores that is free.

Two probes of a few tens of milliseconds stand for what a run spends its time in: a gather, a square root and a scatter
over a list of pairs (contacts, moments, forces), and sparse factorisations of a Laplacian (the field). They are made of
numpy and scipy, so that nothing is compiled for them, and measured in processor time, so that another program's share
of a core does not count; that is told apart, as the cores that are taken. Speeds are kept for a day in the cache.
"""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from emclutch.results.atomic_file import replace_json
from field.spheres.table_files import cache_folder
from geometry.kernels.threads import default_threads

# Processor time of the probes on the reference machine [s]: one core of a Xeon at 2.8 GHz (x86-64, 2 cores, 2026).
LOOPS_S, SOLVES_S = 0.0125, 0.026
LASTS = 86400.0  # s, that a measured speed is believed
PAIRS, GRAINS, SIDE, REPEATS = 20_000, 2_500, 90, 5
SERIAL = 0.43  # of a parallel step: two threads make it 1.4 times as fast (docs: 1.3 in a step, 1.0 to 1.8 in runs)
BELIEVED_S = 20.0  # s, that cores found busy or idle are taken to stay so
_SINCE = time.perf_counter(), time.process_time()
TELL = 0.5  # cores taken by others, from which on it is said


@dataclass(frozen=True, slots=True)
class MachineSpeed:
    """Speed of the machine at hand relative to the reference machine.

    Attributes
    ----------
    loops, solves : float
        Seconds here over seconds there, of loops over grains and of field solves.
    cores : int
        That this process may use.
    taken : float
        Cores that other programs ask for at the moment; it may be more than there are.
    """

    loops: float
    solves: float
    cores: int
    taken: float

    def gain(self, threads: int) -> float:
        """Speed-up of the parallel loops by `threads` threads; Amdahl's law with a measured share."""
        return 1.0 / (SERIAL + (1.0 - SERIAL) / max(1, min(threads, self.cores)))

    def delay(self, threads: int) -> float:
        """Wall-clock over processor time of `threads` threads that share the cores with what takes them now."""
        return max(1.0, (threads + self.taken) / self.cores)

    def in_words(self) -> str:
        """Return how fast, and how many cores are busy."""
        text = (
            f"this machine takes {self.loops:.2g} times the reference's time for grains, {self.solves:.2g} for fields"
        )
        busy = min(round(self.taken), self.cores)
        if self.taken < TELL or busy == 0:
            return text
        return f"{text}; {busy} of {self.cores} cores {'is' if busy == 1 else 'are'} busy with other programs"


def machine_speed() -> MachineSpeed:
    """The machine at hand: its speed of today, and what of it is taken now."""
    loops, solves = _speed_of_today()
    return MachineSpeed(loops, solves, cores_at_hand(), _taken())


def cores_at_hand() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads_at_hand() -> int:
    """Threads that a run takes where none are asked for."""
    return default_threads(cores_at_hand())


def speed_file() -> Path:
    """Return where the measured speed is kept."""
    return cache_folder() / "machine_speed.json"


@lru_cache(maxsize=1)
def _speed_of_today() -> tuple[float, float]:
    """(loops, solves) of `MachineSpeed`: of the cache, or measured and put there, if it can be written."""
    name = cpu_name()
    with suppress(OSError, ValueError, KeyError, TypeError):
        kept = json.loads(speed_file().read_text(encoding="utf-8"))
        loops, solves = float(kept["loops"]), float(kept["solves"])
        fresh = 0.0 <= time.time() - float(kept["measured"]) < LASTS
        if kept["cpu"] == name and fresh and 0.0 < loops < np.inf and 0.0 < solves < np.inf:
            return loops, solves
    loops, solves = least_seconds(_pairs_probe()) / LOOPS_S, least_seconds(_laplacian_probe()) / SOLVES_S
    with suppress(OSError):  # the next call measures again
        speed_file().parent.mkdir(parents=True, exist_ok=True)
        replace_json(speed_file(), {"cpu": name, "measured": time.time(), "loops": loops, "solves": solves})
    return loops, solves


def cpu_name() -> str:
    """Model of the processor, as the system names it."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def least_seconds(probe: Callable[[], object], repeats: int = REPEATS) -> float:
    """Least processor time [s] of some calls: what disturbs one of them is not the machine."""
    least = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        probe()
        least = min(least, time.process_time() - begin)
    return max(least, 1e-6)


def _pairs_probe() -> Callable[[], object]:
    """Distances and forces of a list of pairs, added up on the grains."""
    rng = np.random.default_rng(0)
    x = rng.random((GRAINS, 3))
    i, j = rng.integers(0, GRAINS, (2, PAIRS))

    def probe() -> np.ndarray:
        total = np.zeros(GRAINS)
        for _ in range(10):
            along = x[i] - x[j]
            r = np.sqrt(np.einsum("ij,ij->i", along, along)) + 1e-3
            total += np.bincount(i, 1.0 / (r * r * r), GRAINS)
        return total

    return probe


def _laplacian_probe() -> Callable[[], object]:
    """A factorisation and a solve with the five-point Laplacian of a square."""
    one = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(SIDE, SIDE))
    same = sp.eye_array(SIDE)
    matrix = (sp.kron(one, same) + sp.kron(same, one)).tocsc()
    right = np.ones(SIDE * SIDE)
    return lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A").solve(right)


def _taken() -> float:
    """Cores that other programs want: of the last minute by the system's load, or at this moment, whichever is less.

    What ended a short while ago is still in the load, and what runs for a blink only in the moment. 0 where the system
    tells neither.
    """
    if not hasattr(os, "getloadavg"):
        return 0.0
    asked = max(0.0, os.getloadavg()[0] - _own_load())
    return asked if asked < TELL else min(asked, _taken_now(int(time.monotonic() // BELIEVED_S)))


@lru_cache(maxsize=1)
def _taken_now(moment: int) -> float:
    """Cores that other programs have at work during a fifth of a second; infinite where the system does not tell.

    Where they have all that this process leaves them, more may be waiting: infinite as well. ``moment`` names the span
    of `BELIEVED_S` for which the answer is kept.
    """
    begin, own, wall = _busy_seconds(), time.process_time(), time.perf_counter()
    if begin is None:
        return math.inf
    time.sleep(0.2)
    busy, own, wall = (_busy_seconds() or begin) - begin, time.process_time() - own, time.perf_counter() - wall
    taken = (busy - own) / wall
    return math.inf if taken > cores_at_hand() - 0.25 else max(0.0, taken)


def _busy_seconds() -> float | None:
    """Seconds that the cores of the whole machine were at work so far (Linux' /proc/stat); None where there is none."""
    with suppress(OSError, ValueError):
        first = Path("/proc/stat").read_text(encoding="utf-8").partition("\n")[0].split()
        user, nice, system, _idle, _waiting, interrupts, soft = (int(word) for word in first[1:8])
        return (user + nice + system + interrupts + soft) / os.sysconf("SC_CLK_TCK")
    return None


def _own_load() -> float:
    """Return the load of this process: its cores at work since this module was read, of the last minute."""
    wall, processor = time.perf_counter() - _SINCE[0], time.process_time() - _SINCE[1]
    return processor / max(wall, 1e-3) * (1.0 - math.exp(-wall / 60.0))
