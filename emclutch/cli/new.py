"""`emclutch new`: a scene of a kind to begin with, with every key, its unit and what it is for.

The values are those of a file in `emclutch/devices/starters`; everything that is said of them comes from the schema.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from emclutch.scene.commented import commented_scene
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.section import OTHER_WORDS, not_one_of

STARTERS = Path(__file__).parents[1] / "devices" / "starters"


def starter_kinds() -> tuple[str, ...]:
    """The kinds of scenes that there are to begin with."""
    return tuple(sorted(path.stem for path in STARTERS.glob("*.toml")))


def starter_kind(word: str) -> str:
    """Return the kind of scene that a word of the user means; SceneError where it means none."""
    kinds, plain = starter_kinds(), word.lower()
    kind, _ = OTHER_WORDS.get(plain, (plain, ""))
    if kind not in kinds:
        raise SceneError([Fault("--kind", shown(word), not_one_of(word, kinds))], "command line")
    return kind


def new_scene(path: str | Path, kind: str) -> list[Path]:
    """Write a commented scene of a kind (`starter_kind`), with the CAD file that it names in the same folder.

    Returns
    -------
    list of Path
        What was written, the scene first.

    Raises
    ------
    SceneError
        There is no such kind, or a file is there already: nothing is overwritten.
    """
    path = Path(path)
    data = tomllib.loads((STARTERS / f"{starter_kind(kind)}.toml").read_text(encoding="utf-8"))
    if kind.lower() == "brake":  # its disc is held, as that of the clutch is unless it is changed
        data["scene"]["title"] = data["scene"]["title"].replace("clutch", "brake")
    drawing = STARTERS / data["geometry"].get("file", "")
    files = [path]
    if drawing.is_file():
        files.append(path.with_suffix(drawing.suffix))
        data["geometry"]["file"] = files[1].name
    if faults := [Fault(str(file), "", "exists; name another file") for file in files if file.exists()]:
        raise SceneError(faults, "command line")
    with open(path, "x", encoding="utf-8") as stream:
        stream.write(commented_scene(data, path.name))
    for copy in files[1:]:
        with open(copy, "x", encoding="utf-8") as stream:
            stream.write(drawing.read_text(encoding="utf-8"))
    return files
