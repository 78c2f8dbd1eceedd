"""Progress of a run: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from emclutch.results.text import format_duration
from emclutch.results.time_left import TimeLeft

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINE_EVERY_SECONDS = 5.0
LINE_EVERY_FRACTION = 0.1
LINE_MIN_SECONDS = 1.0  # between two lines
SAME_LINE_SECONDS = 60.0  # between two equal lines
MIN_DONE, MIN_PASSED = 0.03, 0.5  # and seconds; below, no time left is shown


SHOWN = "shown"
"""Progress of a function in Python unless another is given: a bar on a terminal or in a notebook, else nothing."""


def someone_looks() -> bool:
    """True on a terminal, and in a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


class Progress:
    """Shows the progress of one piece of work; use it in a ``with`` block and call `update`.

    Parameters
    ----------
    text : what is being done.
    stream : where to; stderr by default, so that standard output stays readable by machines.
    """

    def __init__(self, text: str = "", *, stream: TextIO | None = None) -> None:
        self.stream = sys.stderr if stream is None else stream
        self.text = text
        self._bar: RichProgress | None = None
        self._started = time.monotonic()
        self._time_left: TimeLeft | None = None  # from the first update on
        self._latest = 0.0
        self._line, self._line_time, self._line_fraction = "", self._started, 0.0

    def __enter__(self) -> Progress:
        self._started = self._line_time = time.monotonic()
        if self.stream.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.percentage:>3.0f} %  {task.fields[left]}"),
                TimeElapsedColumn(),
                console=Console(file=self.stream),
            )
            self._bar.start()
            self._task = self._bar.add_task(self.text, total=1.0, left="")
        return self

    def update(self, fraction: float, text: str | None = None) -> None:
        """Report that `fraction` of the work is done; `text` says what is going on."""
        if text is not None:
            self.text = text
        if self._time_left is None:
            self._time_left, self._line_fraction = TimeLeft(fraction), fraction
        self._latest = fraction
        self._time_left.read(fraction)
        left = self._left(self._time_left)
        if self._bar is not None:
            self._bar.update(self._task, completed=fraction, description=self.text, left=left)
            return
        now = time.monotonic()
        passed = now - self._line_time
        # 1e-9: ten steps of 0.1 do not add up to 1
        advanced = fraction - self._line_fraction >= LINE_EVERY_FRACTION - 1e-9
        due = passed >= LINE_EVERY_SECONDS or (advanced and passed >= LINE_MIN_SECONDS)
        if due or (fraction >= 1.0 and self._line_fraction < 1.0):
            line = f"{100.0 * fraction:3.0f} %  {self.text}  {left}".rstrip()
            if line == self._line and passed < SAME_LINE_SECONDS:
                return
            print(line, file=self.stream, flush=True)
            self._line, self._line_time, self._line_fraction = line, now, fraction

    def status(self, text: str) -> None:
        """Show at once what is going on, until the next update."""
        self.text = text
        if self._bar is not None:
            self._bar.update(self._task, description=text)
            return
        done = "" if self._time_left is None else f"{100.0 * self._latest:3.0f} %  "  # unknown before the first update
        print(f"{done}{text}", file=self.stream, flush=True)
        self._line_time = time.monotonic()

    def log(self, text: str) -> None:
        """Print a line that stays."""
        if self._bar is not None:
            self._bar.console.print(text, highlight=False)
        else:
            print(text, file=self.stream, flush=True)

    def _left(self, reading: TimeLeft) -> str:
        if self._latest >= 1.0:
            return f"took {format_duration(time.monotonic() - self._started)}"
        found = reading.estimate()
        if found is None or reading.advanced < MIN_DONE or reading.passed < MIN_PASSED or found[0] < 1.0:
            return ""  # too early, or done within a second
        return f"{format_duration(found[0])} left"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
