"""The files that a scene names and whose content no resolved scene holds: what they are, and their sha256.

Curves of materials are not among them: their points are copied into the resolved scene, and compared with it.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from emclutch.scene.geometry import CadGeometry
from emclutch.scene.model import Scene
from emclutch.scene.sizes import DiametersOfFile


def input_files(scene: Scene) -> dict[str, Path]:
    """Files by the keys that name them."""
    files = {f"surfaces.{name}.file": Path(surface.file) for name, surface in scene.surfaces.items()}
    if isinstance(scene.geometry, CadGeometry):
        files["geometry.file"] = Path(scene.geometry.file)
    if scene.particles.packing_file is not None:
        files["particles.packing_file"] = Path(scene.particles.packing_file)
    if isinstance(scene.particles.sizes, DiametersOfFile):
        files["particles.sizes.file"] = Path(scene.particles.sizes.file)
    return dict(sorted(files.items()))


def hashed_input_files(scene: Scene) -> dict[str, dict[str, str]]:
    """Path and sha256 of each file by its key, as ``provenance.json`` keeps them."""
    found = {}
    for key, path in input_files(scene).items():
        with open(path, "rb") as stream:
            found[key] = {"path": str(path), "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
    return found
