"""A command of emclutch that may kill itself: `python mortal_command.py FOLDER EVENT DELAY COMMAND ...`.

An event is a file below FOLDER that is opened for writing, moved or removed. Before the one of that number (from 1 on),
or DELAY seconds later, the process gets SIGKILL: nothing of it can clean up. With the number 0 it lives, and says at
last on its standard error how many events there were. A checkpoint is written after every window, not every minute.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from time import sleep

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class Death:
    """Audit hook that counts events, and kills at one of them."""

    def __init__(self, folder: str, number: int, delay: float) -> None:
        self._folder, self._number, self._delay = folder, number, delay
        self.count = 0

    def __call__(self, event: str, arguments: tuple) -> None:
        if not self._is_one(event, arguments):
            return
        self.count += 1
        if self.count == self._number:
            if self._delay == 0.0:
                die(0.0)
            threading.Thread(target=die, args=(self._delay,), daemon=True).start()

    def _is_one(self, event: str, arguments: tuple) -> bool:
        if event == "open":
            path, _, flags = arguments
            return isinstance(path, str) and path.startswith(self._folder) and bool(flags & WRITES)
        return event in ("os.rename", "os.remove") and str(arguments[0]).startswith(self._folder)


def die(after: float) -> None:
    """As `kill -9`, `after` some seconds."""
    sleep(after)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Run the command."""
    folder, number, delay, *command = sys.argv[1:]
    death = Death(folder, int(number), float(delay))
    sys.addaudithook(death)
    from emclutch.cli import main as command_line
    from emclutch.simulation import checkpoints

    checkpoints.CHECKPOINT_SECONDS = 0.0
    sys.argv = ["emclutch", *command]
    try:
        command_line.main()
    finally:
        print(f"{death.count} events", file=sys.stderr)


if __name__ == "__main__":
    main()
