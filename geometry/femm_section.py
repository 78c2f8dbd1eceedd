"""The faces of a model of FEMM: what its segments and arcs enclose, and which label lies in each.

The half-plane r > 0 is cut along all segments and arcs, arcs being true circles. The face of a label is the piece that
its point lies in; what reaches the end of the half-plane lies outside of the model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.femm_file import FemmEdge, FemmLabel, FemmModel
from geometry.mesher import MILLIMETRE, gmsh_model
from geometry.table_file import FileFault


@dataclass(frozen=True, slots=True)
class FemmSection:
    """Area [m^2] and mean radius [m] by label; edges between a label and the outside; all others but on the axis."""

    areas: dict[FemmLabel, float]
    radii: dict[FemmLabel, float]
    outline: dict[FemmEdge, FemmLabel]
    inside: list[FemmEdge]


def femm_section(model: FemmModel) -> FemmSection:
    """Return the faces of a model.

    Raises
    ------
    FileFault
        Points with r < 0, an edge without length, a label in no closed region, a region without a label or with two.
    """
    with _cut(model) as (gmsh, faces, curves):
        areas = {label: MILLIMETRE**2 * gmsh.model.occ.getMass(2, tag) for tag, label in faces.items()}
        radii = {label: MILLIMETRE * gmsh.model.occ.getCenterOfMass(2, tag)[0] for tag, label in faces.items()}
        outline, inside = {}, []
        for edge, pieces in zip(model.edges, curves, strict=True):
            beside = [set(gmsh.model.getAdjacencies(1, piece)[0]) for piece in pieces]
            known = [[faces[tag] for tag in sides if tag in faces] for sides in beside]
            outer = [labels[0] for sides, labels in zip(beside, known, strict=True) if len(labels) < len(sides) == 2]
            if outer:
                outline[edge] = outer[0]
            elif np.any(model.points[[edge.start, edge.end], 0] > 0.0):
                inside.append(edge)
    return FemmSection(areas, radii, outline, inside)


def faces_as_brep(model: FemmModel, labels: Sequence[FemmLabel]) -> tuple[str, list[FemmLabel]]:
    """Return the faces of some labels as the text of a BREP file in millimetres, and the labels in the file's order.

    Raises
    ------
    FileFault
        As `femm_section` does.
    """
    with _cut(model) as (gmsh, faces, _), tempfile.TemporaryDirectory(prefix="emclutch-") as folder:
        occ, kept = gmsh.model.occ, {tag: label for tag, label in faces.items() if label in labels}
        occ.remove([face for face in occ.getEntities(2) if face[1] not in kept], recursive=True)
        occ.remove(occ.getEntities(1), recursive=True)  # those that bound no face
        occ.synchronize()
        path = Path(folder) / "section.brep"
        gmsh.write(str(path))
        return path.read_text(encoding="utf-8"), [kept[tag] for tag in sorted(kept)]


@contextmanager
def _cut(model: FemmModel) -> Iterator[tuple[Any, dict[int, FemmLabel], list[list[int]]]]:
    """The label of each face by its tag, and the curves of each edge, in millimetres."""
    points = model.points / MILLIMETRE
    if len(points) < 2 or (low := float(points[:, 0].min())) < 0.0:
        raise FileFault(model.path, f"has {len(points)} points, the least r is {low:.4g} mm; allowed: r of 0 or more"
                        if len(points) > 1 else "has no points; draw the model in FEMM")  # fmt: skip
    size = float(np.ptp(points, axis=0).max())
    bottom, height = float(points[:, 1].min()) - size, float(np.ptp(points[:, 1])) + 2.0 * size
    with gmsh_model({"General.Terminal": 0}) as gmsh:
        occ = gmsh.model.occ
        tags = [occ.addPoint(r, z, 0.0) for r, z in points]
        plane = occ.addRectangle(0.0, bottom, 0.0, float(points[:, 0].max()) + size, height)
        drawn = [(1, _curve(occ, edge, tags, points, model.path)) for edge in model.edges]
        _, pieces = occ.fragment([(2, plane)], drawn)
        occ.synchronize()
        cut, *curves = ([tag for _, tag in piece] for piece in pieces)
        yield gmsh, _labelled(gmsh, model, cut, bottom), curves


def _curve(occ: Any, edge: FemmEdge, tags: Sequence[int], points: np.ndarray, path: Path) -> int:
    start, end = tags[edge.start], tags[edge.end]
    try:
        if edge.angle == 0.0:
            return occ.addLine(start, end)
        middle = occ.addPoint(*edge.middle(points), 0.0)
        curve = occ.addCircleArc(start, middle, end, center=False)
    except Exception as error:  # gmsh raises plain Exception, with its own last message
        where = f"line {edge.line}: {edge.ends(MILLIMETRE * points)}"
        raise FileFault(path, f"{where} has no length ({error}); delete it in FEMM") from None
    occ.remove([(0, middle)])
    return curve


def _labelled(gmsh: Any, model: FemmModel, cut: list[int], bottom: float) -> dict[int, FemmLabel]:
    """Label of each face but that outside, which reaches down to `bottom` [mm]."""
    faces: dict[int, FemmLabel] = {}
    inner = [tag for tag in cut if gmsh.model.occ.getBoundingBox(2, tag)[1] > bottom + 1e-3]
    for label in model.labels:
        r, z = (x / MILLIMETRE for x in label.place)
        found = next((tag for tag in inner if gmsh.model.isInside(2, tag, (r, z, 0.0))), None)
        if found is None or found in faces:
            reason = "lies in no closed region; close its outline" if found is None else (
                f"shares its region with the label at {faces[found].at()}; delete one, or close the outline between "
                "them")  # fmt: skip
            raise FileFault(model.path, f"line {label.line}: the label at {label.at()} {reason}")
        faces[found] = label
    if bare := [tag for tag in inner if tag not in faces]:
        r, z, _ = gmsh.model.occ.getCenterOfMass(2, bare[0])
        raise FileFault(model.path, f"the region around r = {r:.4g} mm, z = {z:.4g} mm has no label; give it one")
    return faces
