"""`emclutch plot`: a picture of finished runs in a new file: torque, speeds, torque against the motor's speed."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from emclutch.faults import Fault, SceneError
from emclutch.results import OutputError, Result, load_result

TORQUE, SPEEDS, TORQUE_SPEED = "torque", "speeds", "torque_speed"


def plot_runs(
    folders: Sequence[Path], kind: str = TORQUE, *, measured: Path | None = None, out: Path | None = None
) -> Path:
    """Draw runs and return the new picture.

    Parameters
    ----------
    folders : of the runs; one for their torques against time, one or more for the other kinds.
    kind : TORQUE, SPEEDS or TORQUE_SPEED.
    measured : table of speeds to lay over SPEEDS, as `read_measured_speeds` takes it.
    out : new file; default: the next free <kind>-<n>.png in the first folder.

    Raises
    ------
    SceneError
        What was asked for does not go together.
    OutputError
        A folder holds no run, a run has no shafts, the table is none, or the file exists.
    """
    if kind == TORQUE and len(folders) > 1:
        message = "draws the torques of one run; name one folder, or add --speeds or --torque-speed to compare runs"
        raise SceneError([Fault("plot", "", message)], "command line")
    if measured is not None and kind != SPEEDS:
        raise SceneError([Fault("--measured", str(measured), "lies over speeds only; add --speeds")], "command line")
    results = [load_result(folder) for folder in folders]
    points = None if measured is None else _measured(measured)
    if out is None:
        numbered = (folders[0] / f"{kind}-{number}.png" for number in itertools.count(1))
        out = next(path for path in numbered if not path.exists())
    if out.exists():
        raise OutputError(f"{out} exists; name another file with --out")
    if kind == TORQUE:
        from emclutch.results.torque_picture import torque_picture

        return torque_picture(out, results[0].history, results[0].torque, results[0].other_histories)
    from emclutch.results.speed_picture import speed_picture, torque_speed_picture

    runs = dict(zip(_names(folders), (result.history for result in results), strict=True))
    title = _title(results)
    if kind == SPEEDS:
        return speed_picture(out, runs, measured=points, title=title)
    return torque_speed_picture(out, runs, title=title)


def _measured(path: Path):
    from emclutch.results.speed_picture import read_measured_speeds

    return read_measured_speeds(path)


def _names(folders: Sequence[Path]) -> list[str]:
    """Name of each folder, with that of the folder around it where two have the same."""
    paths = [folder.resolve() for folder in folders]
    count = Counter(path.name for path in paths)
    return [path.name if count[path.name] == 1 else f"{path.parent.name}/{path.name}" for path in paths]


def _title(results: Sequence[Result]) -> str | None:
    return results[0].summary.get("title") if len(results) == 1 else None
