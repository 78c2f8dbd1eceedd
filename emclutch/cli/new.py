"""`emclutch new`: a scene of a kind to begin with, with every key, its unit and what it is for.

The values are those of a file in `emclutch/devices/starters`; everything that is said of them comes from the schema.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from emclutch.scene.commented import commented_scene
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.section import not_one_of

STARTERS = Path(__file__).parents[1] / "devices" / "starters"


def starter_kinds() -> tuple[str, ...]:
    """The kinds of scenes that there are to begin with."""
    return tuple(sorted(path.stem for path in STARTERS.glob("*.toml")))


def new_scene(path: str | Path, kind: str) -> list[Path]:
    """Write a commented scene of a kind (`starter_kinds`), with the CAD file that it names in the same folder.

    Returns
    -------
    list of Path
        What was written, the scene first.

    Raises
    ------
    SceneError
        There is no such kind, or a file is there already: nothing is overwritten.
    """
    path, kinds = Path(path), starter_kinds()
    if kind not in kinds:
        raise SceneError([Fault("--kind", shown(kind), not_one_of(kind, kinds))], "command line")
    data = _starter(kind)
    drawing, files = STARTERS / data["geometry"].get("file", ""), {}
    if drawing.is_file():
        data["geometry"]["file"] = path.with_suffix(drawing.suffix).name
        files = {data["geometry"]["file"]: drawing.read_text(encoding="utf-8")}
    return _write(path, data, files)


def new_scene_from(path: str | Path, model: str | Path, powder: str | None = None) -> list[Path]:
    """Write a commented scene from a model of FEMM (.fem), with its drawing and magnetisation curves beside it.

    Without `powder` it is a scene of the field alone; with it, a material of the model, the grains and their motion are
    those of the starter of kind cad.

    Returns
    -------
    list of Path
        What was written, the scene first.

    Raises
    ------
    SceneError
        The model cannot be read or has no counterpart, or a file is there already: nothing is overwritten.
    """
    from emclutch.scene.femm_scene import femm_scene  # local: the mesher

    path = Path(path)
    data, files = femm_scene(Path(model), path.stem, powder)
    return _write(path, data if powder is None else _starter("cad") | data, files)


def _starter(kind: str) -> dict[str, Any]:
    return tomllib.loads((STARTERS / f"{kind}.toml").read_text(encoding="utf-8"))


def _write(path: Path, data: dict[str, Any], beside: Mapping[str, str]) -> list[Path]:
    """Write a scene and the files that it names."""
    files = {path: commented_scene(data, path.name), **{path.with_name(name): text for name, text in beside.items()}}
    if faults := [Fault(str(file), "", "exists; name another file") for file in files if file.exists()]:
        raise SceneError(faults, "command line")
    for file, text in files.items():
        with open(file, "x", encoding="utf-8") as stream:
            stream.write(text)
    return list(files)
