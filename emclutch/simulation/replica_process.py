"""A replica's process: one run of the task on standard input, until it is done or the input ends.

Not for the command line: `emclutch run` starts it (`emclutch.simulation.replicas`).
"""

from __future__ import annotations

import json
import sys
import threading
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from emclutch.results.errors import OutputError
from emclutch.scene.case import case_from

FAILED, STOPPED = 1, 130


def run_task(task: dict[str, Any], control: Any) -> int:
    """Run a task of `emclutch.simulation.replicas` under a `ReplicaControl`; returns the process's exit code."""
    from emclutch.results.errors import Interrupted, RunError
    from emclutch.simulation.run import run_replica

    if not Path(task["folder"]).parent.is_dir():  # of the run, which another process has taken over
        print(f"the folder of {task['folder']} is gone", file=sys.stderr)
        return FAILED
    case = case_from(tomllib.loads(task["case"]), trust_scripts=task["trust_scripts"])
    try:
        settings = {name: task[name] for name in ("threads", "tune_threads", "resume", "start")}
        run_replica(case, task["folder"], task["number"], control, **settings)
    except Interrupted:
        return STOPPED
    except (RunError, OutputError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return FAILED
    return 0


def main() -> int:
    """Entry point of the process."""
    from emclutch.simulation.replicas import ReplicaControl

    task = json.loads(sys.stdin.readline())
    control = ReplicaControl(task["limit"], task["tolerance"])

    def watch(lines: Iterable[str] = sys.stdin) -> None:
        for line in lines:
            control.receive(line)
        control.stop()  # the run lets go of it, or does not live any more

    threading.Thread(target=watch, name="watch", daemon=True).start()
    return run_task(task, control)


if __name__ == "__main__":
    sys.exit(main())
