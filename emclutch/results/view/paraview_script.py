"""``paraview.py`` of a run: `paraview_scene.py` and `look.py`, with what this run's files hold in its head."""

from __future__ import annotations

import math
import re
import tempfile
from pathlib import Path
from typing import Any

from emclutch.results.atomic_file import replace_text
from emclutch.results.text import in_words
from emclutch.results.view.run_files import RunFiles

NAME = "paraview.py"
SCENE, LOOK = (Path(__file__).with_name(name) for name in ("paraview_scene.py", "look.py"))


def script_text(files: RunFiles) -> str:
    """The script for a run."""
    known: dict[str, Any] = {
        "COLOUR": next(iter(files.colours), ""),
        "LOOK": "gap" if files.colours else "device",
        "RUN": str(files.folder.resolve()),
        "TITLE": files.title,
        "SECTOR": None if files.sector is None else round(math.degrees(files.sector), 9),
        "AIR": files.air,
        "FIELD": files.field,
        "WHERE": "POINTS" if files.field_at_points else "CELLS",
        "BODIES": tuple(files.bodies),
        "REGIONS": tuple(
            (in_words(name), tuple(round(part, 3) for part in shade))
            for name, shade in zip(files.regions, files.shades, strict=True)
        ),
        "QUANTITIES": files.colours,
    }
    scene = SCENE.read_text(encoding="utf-8")
    look = "".join(LOOK.read_text(encoding="utf-8").partition("import math\n")[1:])
    text = re.sub(r"^# (ruff|mypy): .*\n", "", scene, flags=re.MULTILINE)
    text = re.sub(r"^from emclutch.*? import \(.*?^\).*?\n", lambda _: look, text, flags=re.MULTILINE | re.DOTALL)
    for name, value in known.items():
        line = re.search(rf"^{name} = (.*?)(?=  # |$)", text, flags=re.MULTILINE)
        assert line is not None, f"{SCENE} has no line {name} = ..."
        text = text[: line.start(1)] + _written(value) + text[line.end(1) :]
    return text


def _written(value: Any) -> str:
    """A value as Python, a dictionary with a line an entry."""
    if not isinstance(value, dict):
        return repr(value)
    return "{\n" + "".join(f"    {key!r}: {entry!r},\n" for key, entry in value.items()) + "}"


def private_script(files: RunFiles) -> Path:
    """Write the script for a run into a new folder that only this user may read, and return its path.

    What lies in the run's folder is not executed: the folder may come from somebody else.
    """
    path = Path(tempfile.mkdtemp(prefix="emclutch-view-")) / NAME
    path.write_text(script_text(files), encoding="utf-8")
    return path


def write_script(files: RunFiles) -> Path:
    """Write a run's script where it has none: one that is there may have been edited."""
    path = files.folder / NAME
    if not path.exists():
        replace_text(path, script_text(files))
    return path
