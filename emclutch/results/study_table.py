"""Progress of a study: a live table with a row per point and the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from emclutch.results.progress import LINE_EVERY_FRACTION, LINE_EVERY_SECONDS
from emclutch.results.text import format_duration, format_mean

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table

WAITING, RUNNING, DONE, KEPT, FAILED, STOPPED = "waiting", "running", "done", "kept", "failed", "stopped"
MIN_DONE = 0.01  # of the work since the start; below, no time left is guessed
FRAME = 7  # lines of a terminal in addition to the points: title, head, rules, what is going on
STYLES = {RUNNING: "bold", FAILED: "red", STOPPED: "yellow", WAITING: "dim"}


@dataclass(slots=True)
class PointRow:
    """Row of the table for a point.

    Attributes
    ----------
    label : its values.
    state : WAITING, RUNNING, DONE, KEPT, FAILED or STOPPED.
    fraction : of it that is done.
    torque, interval, converged : of a point that is done: best estimate and ends of its 95 % interval [N m].
    seconds : wall-clock time of the whole run [s].
    began : reading of the clock when it began here [s].
    stress : of a point without a torque that is done: shear stress [Pa].
    marched, first : reading of the clock [s] when it was first seen to have done a part, and how much; what goes
        before, compiling and packing, says nothing about the rest.
    """

    label: str
    state: str = WAITING
    fraction: float = 0.0
    torque: float | None = None
    interval: tuple[float, float] | None = None
    converged: bool = True
    seconds: float | None = None
    began: float = 0.0
    marched: float | None = None
    first: float = 0.0
    stress: float | None = None


class StudyTable:
    """Shows the progress of a study; use it in a ``with`` block.

    Parameters
    ----------
    stream : where to; stderr by default.
    clock : seconds that pass.
    """

    def __init__(self, *, stream: TextIO | None = None, clock=time.monotonic) -> None:
        self.stream = sys.stderr if stream is None else stream
        self.rows: list[PointRow] = []
        self._clock = clock
        self._live: Live | None = None
        self._line_time, self._line_fraction = clock(), 0.0
        self._text = ""
        self._room: int | None = None
        self._running: dict[int, PointRow] = {}
        # Sums over rows, so that a point costs the same in a study of any size: how many are done or kept, what those
        # done have advanced here, what those ended otherwise had done, and when the first of those done began.
        self._finished, self._advanced, self._ended, self._since = 0, 0.0, 0.0, math.inf

    def __enter__(self) -> StudyTable:
        if self.stream.isatty():
            from rich.console import Console
            from rich.live import Live

            console = Console(file=self.stream)
            self._room = max(console.height - FRAME, 1)
            self._live = Live(console=console, get_renderable=self.table, refresh_per_second=2)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._room = None
            self._live.stop()

    def begin(self, labels: Sequence[str]) -> None:
        """Take the points of a study, all of them waiting."""
        self.rows = [PointRow(label) for label in labels]
        self._running = {}
        self._finished, self._advanced, self._ended, self._since = 0, 0.0, 0.0, math.inf

    def set_running(self, number: int) -> None:
        """Note that a point begins."""
        row = self.rows[number]
        row.state, row.began = RUNNING, self._clock()
        self._running[number] = row

    def set_fraction(self, number: int, fraction: float, text: str = "") -> None:
        """Note how far a running point is; `text` what is going on in it."""
        row = self.rows[number]
        if row.marched is None and fraction > 0.0:
            row.marched, row.first = self._clock(), fraction
        row.fraction = max(row.fraction, min(fraction, 1.0))
        self._text = f"{row.label}: {text}" if text else ""
        self._print_line()

    def set_status(self, number: int, text: str) -> None:
        """Show at once what a point waits for."""
        self._text = f"{self.rows[number].label}: {text}"
        self._print_line(at_once=True)

    def set_done(
        self,
        number: int,
        torque: float | None,
        interval: tuple[float, float] | None,
        seconds: float | None,
        *,
        kept: bool = False,
        converged: bool = True,
    ) -> None:
        """Note that a point is done, in this run or before: its torque with its 95 % interval [N m] and its seconds."""
        row = self.rows[number]
        if row.marched is None and not kept:  # it was too short to be seen running
            row.marched = self._clock() - (seconds or 0.0)
        row.state, row.fraction = KEPT if kept else DONE, 1.0
        self._running.pop(number, None)
        self._finished += 1
        if row.marched is not None and not kept:
            self._advanced += 1.0 - row.first
            self._since = min(self._since, row.marched)
        row.torque, row.interval, row.seconds = torque, interval, seconds
        row.converged = converged
        self._text = f"{row.label} is {row.state}: {torque_text(row)}"
        self._print_line(at_once=True)

    def set_ended(self, number: int, state: str) -> None:
        """Note that a point has failed or was stopped."""
        row = self.rows[number]
        row.seconds = None if row.state == WAITING else self._clock() - row.began
        row.state = state
        self._running.pop(number, None)
        self._ended += row.fraction
        self._text = f"{row.label} {'has failed' if state == FAILED else 'was stopped'}"
        self._print_line(at_once=True)

    @property
    def fraction(self) -> float:
        """Return the fraction of the whole study that is done."""
        begun = sum(row.fraction for row in self._running.values())
        return (self._finished + self._ended + begun) / max(len(self.rows), 1)

    def seconds_left(self) -> float | None:
        """Return the wall-clock time [s] that the study will still take; None too early for an honest guess.

        All points are taken to cost the same. What was done since the first of them began here gives the rate; but it
        lasts no shorter than the slowest of those that run.
        """
        now = self._clock()
        running = [(row, row.marched) for row in self._running.values() if row.marched is not None]
        advanced = self._advanced + sum(row.fraction - row.first for row, _ in running)
        left = len(self.rows) * (1.0 - self.fraction)
        since = min([self._since, *(marched for _, marched in running)])
        if math.isinf(since) or advanced <= MIN_DONE * (advanced + left):  # both 0: seen at its end
            return None
        guess = (now - since) * left / advanced
        for row, since in running:
            if row.fraction - row.first > MIN_DONE:
                guess = max(guess, (now - since) * (1.0 - row.fraction) / (row.fraction - row.first))
        return guess

    def table(self) -> Table:
        """Return the table; on a terminal with too few lines from the first point on that is not done."""
        from rich.table import Table

        left = self.seconds_left()
        counts = ", ".join(
            f"{number} {state}"
            for state in (DONE, KEPT, RUNNING, WAITING, FAILED, STOPPED)
            if (number := sum(row.state == state for row in self.rows))
        )
        ahead = "" if left is None or self.fraction >= 1.0 else f", {format_duration(left)} left"
        table = Table(title=f"{100.0 * self.fraction:.0f} % of {len(self.rows)} points: {counts}{ahead}")
        for name in ("point", "state", "done", "torque", "time"):
            table.add_column(name, justify="left" if name in ("point", "state") else "right")
        rows = self.rows
        if self._room is not None and len(rows) > self._room:
            undone = next((k for k, row in enumerate(rows) if row.state not in (DONE, KEPT)), len(rows))
            first = min(undone, len(rows) - self._room)
            rows = rows[first : first + self._room]
        for row in rows:
            seconds = self._clock() - row.began if row.state == RUNNING else row.seconds
            table.add_row(
                row.label,
                row.state,
                "" if row.state == WAITING else f"{100.0 * row.fraction:.0f} %",
                torque_text(row),
                "" if seconds is None else format_duration(seconds),
                style=STYLES.get(row.state),
            )
        table.caption = self._text or None
        return table

    def _print_line(self, at_once: bool = False) -> None:
        """Print a line where there is no terminal, when it is due."""
        if self._live is not None:
            return
        now, fraction = self._clock(), self.fraction
        due = now - self._line_time >= LINE_EVERY_SECONDS or fraction - self._line_fraction >= LINE_EVERY_FRACTION
        if not (at_once or due):
            return
        left = self.seconds_left()
        parts = [f"{100.0 * fraction:3.0f} %", f"{self._finished} of {len(self.rows)} points", self._text]
        if left is not None and fraction < 1.0:
            parts.append(f"{format_duration(left)} left")
        print("  ".join(part for part in parts if part), file=self.stream, flush=True)
        self._line_time, self._line_fraction = now, fraction


def torque_text(row: PointRow) -> str:
    """Return a point's torque with its 95 % interval, or nothing."""
    if row.torque is None and row.state in (WAITING, RUNNING, FAILED, STOPPED):
        return ""
    text = format_mean(row.torque, row.interval)
    return text if row.converged else f"{text}, not converged"
