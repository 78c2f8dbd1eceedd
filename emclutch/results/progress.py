"""Progress of a run: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from emclutch.results.text import format_duration

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINE_EVERY_SECONDS = 5.0
LINE_EVERY_FRACTION = 0.1
# The first windows compile kernels: they say nothing about the rest, and the time left is guessed without them.
FIRST_STEPS, FIRST_FRACTION = 2, 0.01
MIN_DONE = 0.03  # below, no time left is shown


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
        self._first = 0.0  # fraction that was done at the start, where a run resumes
        self._seen = False
        self._steps, self._latest = 0, 0.0  # updates that brought the work forward, and the last of them
        self._clock: tuple[float, float] | None = None  # time and fraction since which the rate is measured
        self._line_time, self._line_fraction = self._started, 0.0

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
        if not self._seen:
            self._first, self._seen = fraction, True
            self._line_fraction = self._latest = fraction
        if fraction > self._latest:
            self._steps, self._latest = self._steps + 1, fraction
        left = self._left(fraction)
        if self._bar is not None:
            self._bar.update(self._task, completed=fraction, description=self.text, left=left)
            return
        now = time.monotonic()
        due = now - self._line_time >= LINE_EVERY_SECONDS
        # 1e-9: ten steps of 0.1 do not add up to 1
        due = due or fraction - self._line_fraction >= LINE_EVERY_FRACTION - 1e-9
        if due or (fraction >= 1.0 and self._line_fraction < 1.0):
            print(f"{100.0 * fraction:3.0f} %  {self.text}  {left}".rstrip(), file=self.stream, flush=True)
            self._line_time, self._line_fraction = now, fraction

    def announce(self, text: str) -> None:
        """Show at once what is being waited for."""
        self.text = text
        if self._bar is not None:
            self._bar.update(self._task, description=text)
            return
        print(f"{100.0 * self._latest:3.0f} %  {text}", file=self.stream, flush=True)
        self._line_time = time.monotonic()

    def note(self, text: str) -> None:
        """Print a line that stays."""
        if self._bar is not None:
            self._bar.console.print(text, highlight=False)
        else:
            print(text, file=self.stream, flush=True)

    def _left(self, fraction: float) -> str:
        now = time.monotonic()
        if fraction >= 1.0:
            return f"took {format_duration(now - self._started)}"
        done = (fraction - self._first) / (1.0 - self._first)
        if self._clock is None:
            if self._steps >= FIRST_STEPS and done >= FIRST_FRACTION:
                self._clock = now, fraction
            return ""
        passed, advanced = now - self._clock[0], fraction - self._clock[1]
        if done < MIN_DONE or advanced <= 0.0 or passed < 0.5:  # too early for an honest guess
            return ""
        return f"{format_duration(passed * (1.0 - fraction) / advanced)} left"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
