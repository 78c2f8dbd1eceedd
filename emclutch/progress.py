"""Progress of a run: a bar with its ETA on a terminal, plain lines elsewhere."""

from __future__ import annotations

from time import monotonic
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

LINE_SECONDS = 10.0  # between plain lines: a log of a night stays readable


class ProgressReport(Protocol):
    """What a working function tells how far it is."""

    def update(self, fraction: float, text: str) -> None:
        """Say that `fraction` (0 to 1) is done, and what is going on."""


class _Bar:
    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task = progress.add_task("", total=1.0)

    def update(self, fraction: float, text: str) -> None:
        self._progress.update(self._task, completed=fraction, description=text)


class _Lines:
    def __init__(self, console: Console) -> None:
        self._console = console
        self._last = -LINE_SECONDS
        self._fraction = -1.0

    def update(self, fraction: float, text: str) -> None:
        # A stage that starts (the fraction stands still) is always told.
        if fraction == self._fraction or fraction >= 1.0 or monotonic() - self._last >= LINE_SECONDS:
            self._console.print(f"{100.0 * fraction:3.0f} %  {text}", highlight=False)
            self._last = monotonic()
        self._fraction = fraction


class progress_report:
    """Context that shows progress on standard error; `quiet` shows nothing."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._progress: Progress | None = None

    def __enter__(self) -> ProgressReport | None:
        if self._quiet:
            return None
        console = Console(stderr=True)
        if not console.is_terminal:
            return _Lines(console)
        columns = (BarColumn(), TaskProgressColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
        self._progress = Progress(*columns, console=console)
        self._progress.start()
        return _Bar(self._progress)

    def __exit__(self, *error: object) -> None:
        if self._progress is not None:
            self._progress.stop()
