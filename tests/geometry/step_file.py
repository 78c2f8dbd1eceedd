"""Writes STEP files with named parts for tests, by the CAD kernel itself.

gmsh writes no names; the translator's made-up product names ("Open CASCADE STEP translator 7.8 1.3": the third part
of the first file) are replaced in the text, which gives what a CAD program writes.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geometry.mesher import initialize_gmsh

MM = 1e3


def write_step(path: Path, build: Callable[[Any], Sequence[str]]) -> Path:
    """Let ``build(occ)`` make shapes (in millimetres) and return a name for each of the highest dimension, in order."""
    import gmsh

    initialize_gmsh()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("written by a test")
        names = build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    if path.suffix == ".step":
        text = path.read_text()
        for number, name in enumerate(names, 1):
            # counted by the files of the process, and by the parts where there are several
            part = rf" \d+\.{number}" if len(names) > 1 else r" \d+"
            text, count = re.subn(rf"'Open CASCADE STEP translator [\d.]+{part}'", f"'{name}'", text)
            assert count, f"no product for part {number}"
        path.write_text(text)
    return path


def write_polygons(path: Path, polygons: dict[str, list[np.ndarray]], plane: str = "z") -> Path:
    """Faces with corners (r, z) [m] in the plane z = 0 (plane "z") or y = 0 (plane "y"), each named by its key."""

    def build(occ: Any) -> list[str]:
        names = []
        for name, corners in polygons.items():
            for polygon in corners:
                points = [occ.addPoint(r * MM, z * MM, 0.0) if plane == "z" else occ.addPoint(r * MM, 0.0, z * MM)
                          for r, z in polygon]  # fmt: skip
                lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
                occ.addPlaneSurface([occ.addCurveLoop(lines)])
                names.append(name)
        return names

    return write_step(path, build)


def rectangle(r0: float, r1: float, z0: float, z1: float) -> np.ndarray:
    """Corners of a rectangle, shape (4, 2)."""
    return np.array([(r0, z0), (r1, z0), (r1, z1), (r0, z1)])


def area_of(polygon):
    """Area [m^2] of a polygon (n, 2) [m]."""
    r, z = polygon.T
    return 0.5 * abs(np.dot(r, np.roll(z, -1)) - np.dot(z, np.roll(r, -1)))


def solids_of_revolution(occ):
    """A stepped core and a tube about z."""
    core = occ.addCylinder(0, 0, -10, 0, 0, 20, 20)
    tube = occ.cut([(3, occ.addCylinder(0, 0, -10, 0, 0, 20, 30))], [(3, core)], removeTool=False)[0][0][1]
    assert tube == 2
    return ["core", "coil"]
