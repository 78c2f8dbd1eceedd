"""`emclutch view`: a run in 3D, in a window of pyvista, as picture, as movie, or as a script for ParaView."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from emclutch.results.new_path import new_picture
from emclutch.results.text import format_time
from emclutch.results.view.look import FIELDS, LOOKS
from emclutch.results.view.run_files import RunFiles, read_run_files
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_all

PICTURES, MOVIES = (".png", ".jpg", ".tif"), (".gif", ".mp4")


def view_run(
    folder: Path,
    *,
    look: str | None = None,
    colour: str | None = None,
    field: str | None = None,
    ring: bool = False,
    time: str | None = None,
    screenshot: Path | None = None,
    movie: Path | None = None,
) -> list[Path]:
    """Show a run in a window, or write the picture and the movie that were asked for; what was written.

    Raises
    ------
    SceneError
        What was asked for does not exist, or there is no screen for a window.
    OutputError
        There is nothing to look at, or a file exists.
    """
    files = read_run_files(folder)
    shown = _one_of("--look", look, list(LOOKS), "gap" if files.colours else "device")
    shade = _one_of("--colour", colour, list(files.colours), next(iter(files.colours), "")) or None
    drawn: dict[str, Any] = {"field": field and _one_of("--field", field, list(FIELDS), "B"), "ring": ring}
    moment = None if time is None else files.nearest_time(_moment(time, files.times))
    for option, path, endings in (("--screenshot", screenshot, PICTURES), ("--movie", movie, MOVIES)):
        if path is not None:
            new_picture(path, option, endings)
    if moment is not None:
        print(f"nearest stored moment: {format_time(moment)}", file=sys.stderr)
    from emclutch.results.view import pyvista_view as pictures

    if screenshot is None and movie is None:
        if not has_screen():
            message = "there is no screen for a window; add --screenshot FILE.png or --movie FILE.gif, or --paraview"
            raise SceneError([Fault(f"view {folder}:", "", message)], "command line")
        pictures.window(pictures.RunView(files, shown, shade, window=True, **drawn), moment)
        return []
    written = []
    if screenshot is not None:
        written.append(
            pictures.screenshot(pictures.RunView(files, shown, shade, window=False, **drawn), screenshot, moment)
        )
    if movie is not None:
        written.append(pictures.movie(pictures.RunView(files, shown, shade, window=False, **drawn), movie))
    return written


def open_in_paraview(folder: Path) -> str:
    """Start ParaView, where it is installed, with a script made for the run's files; returns what was done.

    The script is a new file outside the run's folder: a `paraview.py` that lies in there is not executed.
    """
    from emclutch.results.view.paraview_script import private_script

    files: RunFiles = read_run_files(folder)
    script = private_script(files)
    program, batch = shutil.which("paraview"), f"without a window: pvbatch {script} --screenshot picture.png"
    if program is None or not has_screen():
        missing = "ParaView is not installed here" if program is None else "there is no screen for ParaView's window"
        return f"{script}\n{missing}; where it is: paraview --script={script}; {batch}"
    subprocess.Popen([program, f"--script={script}"], start_new_session=True)
    return f"{script}\nParaView is starting; {batch}"


def has_screen() -> bool:
    """True if a window can open."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _one_of(option: str, value: str | None, allowed: list[str], default: str) -> str:
    if value is not None and value not in allowed:
        message = f"is none of {', '.join(allowed)}" if allowed else "the run has no grains that could be coloured"
        raise SceneError([Fault(option, value, message)], "command line")
    return default if value is None else value


def _moment(text: str, times: list[float]) -> float:
    """The time [s] that was asked for, within those that were written."""
    (time,) = read_all([text], Quantity("a time", "s", "5 ms"), "--time")
    if not times[0] * (1.0 - 1e-9) <= time <= times[-1] * (1.0 + 1e-9):
        first, last = (format_time(end) for end in (times[0], times[-1]))
        message = f"is not in the run, whose moments go from {first} to {last}; leave it out for the last"
        raise SceneError([Fault("--time", text, message)], "command line")
    return time
