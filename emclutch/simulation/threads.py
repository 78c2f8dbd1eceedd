"""Number of threads of the compiled kernels, the threading layer, and the trial of how many pay."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from emclutch.scene.errors import Fault, SceneError, shown
from geometry.kernels.threads import default_threads, requested_threads

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow


def check_threads(threads: int | None) -> None:
    """Raise SceneError for what is no number of threads from 1 to the machine's cores; None is left to the run."""
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (numba's stubs hide it)
    if threads is not None and (not isinstance(threads, int) or not 1 <= threads <= available):
        message = f"is not a whole number from 1 to {available}, the cores of this machine"
        raise SceneError([Fault("threads", shown(threads), message)], "arguments")


def use_threads(threads: int | None, replicas: int = 1) -> int:
    """Set the number of threads of the compiled kernels, and return it; None: all, shared out among the replicas."""
    import numba

    check_threads(threads)
    chosen = threads or threads_of_a_process(replicas)
    numba.set_num_threads(chosen)
    return chosen


def threads_of_a_process(processes: int) -> int:
    """Return the threads of each of so many processes: ``OMP_NUM_THREADS`` or all cores, shared out."""
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (as above)
    return max(1, default_threads(available) // processes)


def may_tune_threads(threads: int | None) -> bool:
    """True if neither the caller nor ``OMP_NUM_THREADS`` says how many, so that a run may find out what pays."""
    return threads is None and requested_threads() is None


def threads_in_use() -> int:
    import numba

    return numba.get_num_threads()


def threading_layer() -> str:
    """The layer that numba will use or uses, e.g. "omp"."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # no parallel kernel has run yet: the first choice that this machine can load
        return str(getattr(numba.config, "THREADING_LAYER_PRIORITY")[0])  # noqa: B009


ROUNDS = 3  # windows of each number in a trial; the fastest counts
REST = 20  # times as many windows pass between two trials as one takes
GAIN = 1.05  # more threads must be faster by this factor


class ThreadTrial:
    """Callback of the loop; it tries how many threads pay, and sets the number of those of the windows to come.

    No bit of a result depends on their number. Two threads gain up to a factor of two, or cost some of it: a thousand
    grains leave them some ten microseconds of work between two stages, and a thread that shares its core with another
    program is late at each. Which holds is a property of the machine, the scene and the hour, so it is measured in a
    few windows, and again in one of twenty.

    Parameters
    ----------
    most : int
        Threads that this process may use; powers of two below it, and it itself, are tried.
    use : callable
        Sets the number of threads of the compiled loops.
    report : callable
        Takes the text of the first choice, and of each that differs from the one before.
    """

    def __init__(self, most: int, use: Callable[[int], object], report: Callable[[str], None]) -> None:
        self.numbers = sorted({*(2**k for k in range(most.bit_length()) if 2**k < most), most})
        self._use, self._report, self._rested, self._chosen = use, report, 0, 0
        self._begin()

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        if not self._to_try:
            self._rested += 1
            if self._rested >= REST * ROUNDS * len(self.numbers):
                self._begin()
            return
        number = self._to_try.pop(0)
        seconds = row.seconds.contact + (row.seconds.magnetic or 0.0)
        self._seconds[number] = min(seconds, self._seconds.get(number, seconds))
        self._take(self._to_try[0] if self._to_try else self._choose())

    def _begin(self) -> None:
        self._seconds: dict[int, float] = {}  # of the fastest window
        self._to_try = ROUNDS * self.numbers  # one entry a window
        self._take(self._to_try[0])

    def _choose(self) -> int:
        self._rested, least = 0, min(self._seconds.values())
        chosen = next(n for n in self.numbers if self._seconds[n] <= GAIN * least)
        if chosen != self._chosen:
            own = self._seconds[chosen]
            used = "1 thread is used" if chosen == 1 else f"{chosen} threads are used"
            ratios = {n: self._seconds[n] / own for n in self.numbers if n != chosen}
            others = [f"with {n} the run would be {_slower(ratio)}" for n, ratio in ratios.items()]
            self._report(f"{used}; {', '.join(others)}")
        self._chosen = chosen
        return chosen

    def _take(self, number: int) -> None:
        self.threads = number
        self._use(number)


def _slower(ratio: float) -> str:
    """Return a ratio of times in words."""
    percent = round(100.0 * abs(ratio - 1.0))
    return "as fast" if not percent else f"{percent} % {'slower' if ratio > 1.0 else 'faster'}"
