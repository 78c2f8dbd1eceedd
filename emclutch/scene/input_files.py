"""The files that a scene names and whose content no resolved scene holds: what they are, and their sha256.

Curves of materials are not among them: their points are copied into the resolved scene, and compared with it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from emclutch.scene.materials import CURVE_FILES
from emclutch.scene.model import Scene
from emclutch.scene.sizes import DiametersOfFile


def input_files(scene: Scene) -> dict[str, Path]:
    """Files by the keys that name them."""
    files = {f"surfaces.{name}.file": Path(surface.file) for name, surface in scene.surfaces.items()}
    files |= scene.geometry.files
    particles = scene.particles
    if particles is not None and particles.packing_file is not None:
        files["particles.packing_file"] = Path(particles.packing_file)
    if particles is not None and isinstance(particles.sizes, DiametersOfFile):
        files["particles.sizes.file"] = Path(particles.sizes.file)
    return dict(sorted(files.items()))


def materials_in_words(scene: Scene, data: Mapping[str, Any]) -> dict[str, str]:
    """Material of each region of [geometry.materials], with the file of its curve; `data` as of `paths_elsewhere`."""
    own = data.get("materials", {})
    files = {name: entry[key] for name, entry in own.items() for key in CURVE_FILES if key in entry}
    materials = dict(getattr(scene.geometry, "materials", {}))
    return {region: f"{name} ({files[name]})" if name in files else name for region, name in materials.items()}


def paths_elsewhere(scene: Scene, data: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """Paths that lead out of the scene's folder, links followed, by the keys that name them: read, or written to.

    `data` is the scene as its author wrote it: of a material's curve the resolved scene has the points, not the file.
    The folder of the results counts from where the program is started.
    """
    named = input_files(scene)
    if scene.particles is not None and scene.particles.powder_law is not None:  # of expected torques, not of a run
        named["particles.powder_law"] = Path(scene.particles.powder_law)
    for name, entry in data.get("materials", {}).items():
        named |= {f"materials.{name}.{key}": folder / str(entry[key]) for key in CURVE_FILES if key in entry}
    home = folder.resolve()
    found = {key: path.resolve() for key, path in named.items() if not path.resolve().is_relative_to(home)}
    if scene.output.folder is not None and not Path(scene.output.folder).resolve().is_relative_to(Path.cwd().resolve()):
        found["output.folder"] = Path(scene.output.folder).resolve()
    return dict(sorted(found.items()))


def hashed_input_files(scene: Scene) -> dict[str, dict[str, str]]:
    """Path and sha256 of each file by its key, as ``provenance.json`` keeps them."""
    found = {}
    for key, path in input_files(scene).items():
        with open(path, "rb") as stream:
            found[key] = {"path": str(path), "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
    return found


def file_contents(scene: Scene) -> dict[str, str]:
    """SHA-256 of each file by the key that names it."""
    return {key: file["sha256"] for key, file in hashed_input_files(scene).items()}
