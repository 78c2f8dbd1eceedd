"""A task whose every step is written down, for workers that are killed in the middle of it."""

import os
import time
from pathlib import Path

from emclutch.results.lease import leased_in_turn


def count(folder, last):
    """Append lines "step process" to a file until step `last`, from where another process has left it.

    In the middle it waits for a file ``go``.
    """
    folder = Path(folder)
    with leased_in_turn(folder / "count", "the count"):
        for step in range(len(steps_in(folder)) + 1, last + 1):
            with (folder / "steps").open("a") as file:
                file.write(f"{step} {os.getpid()}\n")
            while step == last // 2 and not (folder / "go").exists():
                time.sleep(0.02)
    return last


def steps_in(folder):
    """Steps and processes that have done them."""
    try:
        return [tuple(map(int, line.split())) for line in (Path(folder) / "steps").read_text().splitlines()]
    except FileNotFoundError:
        return []
