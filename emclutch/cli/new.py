"""`emclutch new`: a scene of a kind to begin with, with every key, its unit and what it is for.

The values are those of a file in `emclutch/devices/starters`; everything that is said of them comes from the schema.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.new_path import new_picture
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


def draw_dimensions_of(path: str | Path, kind: str, case: str | Path | None = None) -> Path:
    """Draw the dimensions of a scene, or of that to begin with of a kind (`starter_kind`), into a new picture (.png).

    Raises
    ------
    SceneError
        There is no such kind, the scene has faults or its dimensions in a file, or the picture is no .png.
    OutputError
        There is a file already; nothing is overwritten.
    """
    from geometry.dimension_drawing import draw_dimensions  # local: a scene needs nothing that draws
    from geometry.dimensioned_views import mark_defaults

    path = new_picture(Path(path), "--drawing")
    scene = load_case(STARTERS / f"{starter_kind(kind)}.toml" if case is None else case).scene
    geometry = scene.geometry
    views = geometry.dimension_views(geometry.shape_in(scene))
    if not views:
        message = "has its dimensions in a file: draw a scene's regions with emclutch mesh"
        raise SceneError([Fault("geometry.kind", shown(geometry.name()), message)], "command line")
    defaults = type(geometry).model_fields.keys() - geometry.model_fields_set
    views = [mark_defaults(view, defaults) for view in views]
    title = f'[geometry] kind = "{geometry.name()}"{"" if case is None else f" of {Path(case).name}"}'
    replace_bytes(path, draw_dimensions(views, title))
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
    path, data = Path(path), _starter(starter_kind(kind))
    if kind.lower() == "brake":  # its disc is held, as that of the clutch is unless it is changed
        data["scene"]["title"] = data["scene"]["title"].replace("clutch", "brake")
    drawing, files = STARTERS / data["geometry"].get("file", ""), {}
    if drawing.is_file():
        data["geometry"]["file"] = path.with_suffix(drawing.suffix).name
        files = {data["geometry"]["file"]: drawing.read_text(encoding="utf-8")}
    return _write(path, data, files)


def new_scene_from(path: str | Path, model: str | Path, powder: str | None = None) -> tuple[list[Path], list[str]]:
    """Write a commented scene from a model of FEMM (.fem), with its drawing and magnetisation curves beside it.

    Without `powder` it is a scene of the field alone; with it, a material of the model, the grains and their motion are
    those of the starter of kind cad.

    Returns
    -------
    list of Path
        What was written, the scene first.
    list of str
        Notes for the reader, see `femm_scene`.

    Raises
    ------
    SceneError
        The model cannot be read or has no counterpart, or a file is there already: nothing is overwritten.
    """
    from emclutch.scene.femm_scene import femm_scene  # local: the mesher

    path = Path(path)
    data, files, notes = femm_scene(Path(model), path.stem, powder)
    wire = [note for note in notes if note.startswith("The wire")]
    return _write(path, data if powder is None else _starter("cad") | data, files, wire), notes


def _starter(kind: str) -> dict[str, Any]:
    return tomllib.loads((STARTERS / f"{kind}.toml").read_text(encoding="utf-8"))


def _write(path: Path, data: dict[str, Any], beside: Mapping[str, str], notes: Sequence[str] = ()) -> list[Path]:
    """Write a scene with notes as comments, and the files that it names."""
    files = {path: commented_scene(data, path.name, notes)}
    files |= {path.with_name(name): text for name, text in beside.items()}
    faults = [Fault(str(file), "", "exists; name another file") for file in files if file.exists()]
    if path.suffix != ".toml":
        kind = f" --kind {path}" if OTHER_WORDS.get(str(path), (str(path), ""))[0] in starter_kinds() else ""
        faults.append(Fault(str(path), "", f"is not a .toml file; write {path.with_suffix('.toml')}{kind}"))
    if faults:
        raise SceneError(faults, "command line")
    for file, text in files.items():
        with open(file, "x", encoding="utf-8") as stream:
            stream.write(text)
    return list(files)
