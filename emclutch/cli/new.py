"""`emclutch new`: a scene of a kind to begin with, with every key, its unit and what it is for.

The values are those of a file in `emclutch/devices/starters`; everything that is said of them comes from the schema.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.new_path import new_path
from emclutch.scene.case import load_case
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


def draw_kind(path: str | Path, kind: str) -> Path:
    """Draw the dimensions of a kind (`starter_kind`) with their keys into a new picture (.png).

    Raises
    ------
    SceneError
        There is no such kind, its dimensions are those of its file, or the file is no .png.
    OutputError
        There is a file already; nothing is overwritten.
    """
    from geometry.dimension_drawing import draw_dimensions  # local: a scene needs nothing that draws

    path, name = Path(path), starter_kind(kind)
    if path.suffix.lower() != ".png":
        raise SceneError([Fault("--drawing", str(path), "is no picture; change its ending to .png")], "command line")
    scene = load_case(STARTERS / f"{name}.toml").scene
    geometry = scene.geometry
    views = geometry.dimension_views(geometry.shape_in(scene))
    if not views:
        message = "has its dimensions in a file: draw a scene's regions with emclutch mesh"
        raise SceneError([Fault("--kind", shown(kind), message)], "command line")
    drawn = draw_dimensions(views, f'[geometry] kind = "{geometry.name()}"')
    replace_bytes(new_path(path), drawn)
    return path


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
