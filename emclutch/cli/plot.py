"""`emclutch plot`: a picture of finished runs in a new file: torque, speeds, torque against the motor's speed.

A study stands for its points. Pictures that a killed run still owes its folder are drawn as well.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from emclutch.results import OutputError, Result, load_result
from emclutch.results.study_folder import is_study, read_study, refresh_in_words
from emclutch.scene.errors import Fault, SceneError
from emclutch.simulation.missing_pictures import draw_missing

TORQUE, SPEEDS, TORQUE_SPEED = "torque", "speeds", "torque_speed"


def plot_runs(
    folders: Sequence[Path],
    kind: str = TORQUE,
    *,
    measured: Path | None = None,
    out: Path | None = None,
    trust_scripts: bool = False,
    log: Callable[[str], None] = lambda text: None,
) -> Path:
    """Draw runs and return the new picture.

    Parameters
    ----------
    folders : of runs, and of studies for all their points that are done. Several runs lie over one another.
    kind : TORQUE, SPEEDS or TORQUE_SPEED.
    measured : table of speeds to lay over SPEEDS, as `read_measured_speeds` takes it.
    out : new file; default: the next free <kind>-<n>.png in the first folder.
    trust_scripts : as for `load_case`, of runs whose own pictures are missing.
    log : takes a line for each run whose own pictures were missing.

    Raises
    ------
    SceneError
        What was asked for does not go together.
    OutputError
        A folder holds no run, a run has no shafts, the table is none, or the file exists.
    """
    if measured is not None and kind != SPEEDS:
        raise SceneError([Fault("--measured", str(measured), "lies over speeds only; add --speeds")], "command line")
    runs = runs_of(folders)
    if not runs:
        raise OutputError(f"no point of the study in {folders[0]} is done: there is nothing to draw")
    results = list(runs.values())
    for result in results:
        try:
            if draw_missing(result.folder, trust_scripts=trust_scripts):
                log(f"{result.folder.path} had no pictures: they are drawn")
        except OutputError as error:  # what was asked for needs them not
            log(f"{result.folder.path} has no pictures, and they cannot be drawn: {error}")
    for folder in folders:
        if is_study(folder) and (old := refresh_in_words(read_study(folder))):
            log(f"{folder}: {old}")
    points = None if measured is None else _measured(measured)
    if out is None:
        numbered = (folders[0] / f"{kind}-{number}.png" for number in itertools.count(1))
        out = next(path for path in numbered if not path.exists())
    if out.exists():
        raise OutputError(f"{out} exists; name another file with --out")
    title = _title(folders, results)
    if kind == TORQUE and len(results) == 1:
        from emclutch.results.pictures.torque import torque_picture

        return torque_picture(out, results[0].history, results[0].torque, results[0].other_histories, title=title)
    if kind == TORQUE:
        from emclutch.results.pictures.torque_overlay import torque_overlay_picture

        return torque_overlay_picture(out, runs, title=title)
    from emclutch.results.pictures.speeds import speed_picture, torque_speed_picture

    histories = {name: result.history for name, result in runs.items()}
    if kind == SPEEDS:
        return speed_picture(out, histories, measured=points, title=title)
    return torque_speed_picture(out, histories, title=title)


def runs_of(folders: Sequence[Path]) -> dict[str, Result]:
    """The results in folders by their names; a study's points by the study's name and their values."""
    runs: dict[str, Result] = {}
    for folder, name in zip(folders, _names(folders), strict=True):
        if is_study(folder):
            of = f"{name}: " if len(folders) > 1 else ""
            runs |= {f"{of}{label}": result for label, result in read_study(folder).results().items()}
        else:
            runs[name] = load_result(folder)
    return runs


def _measured(path: Path):
    from emclutch.results.pictures.speeds import read_measured_speeds

    return read_measured_speeds(path)


def _names(folders: Sequence[Path]) -> list[str]:
    """Name of each folder, with that of the folder around it where two have the same."""
    paths = [folder.resolve() for folder in folders]
    count = Counter(path.name for path in paths)
    return [path.name if count[path.name] == 1 else f"{path.parent.name}/{path.name}" for path in paths]


def _title(folders: Sequence[Path], results: Sequence[Result]) -> str | None:
    if len(folders) == 1 and is_study(folders[0]):
        return read_study(folders[0]).title
    return results[0].summary.get("title") if len(results) == 1 else None
