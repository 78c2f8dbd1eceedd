"""Section of a device from CAD, and its mesh: parts made conforming, air around them, sizes from the gaps themselves.

Element sizes: between two curves of the powder's outline that face each other, a whole number of rows as in
`geometry.meshing`; in other narrow places (a running clearance) one layer three gaps long; on curves (fillets, round
poles) edges that turn by 30 degrees; from there h grows with the distance, up to a fraction of the device in the parts
and an eighth of the radius in the air. Edges on curves are curved (`geometry.curved_edges`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_import import open_section
from geometry.cad_parts import CadFile, CadPart, list_of
from geometry.file_content import CadError
from geometry.mesher import (
    CORNER,
    GROWTH,
    MAX_TRIANGLES,
    MILLIMETRE,
    MINIMUM_LAYERS,
    ROW_HEIGHT,
    add_half_disc,
    add_size_field,
    check_mesh_options,
    expected_triangles,
    read_section,
    refuse_too_many,
    use_least_size,
)
from geometry.refinement import without_tangles
from geometry.section import SectionMesh

OVERLAP = 1e-6
"""Of the smaller part's size, below which a common piece of two parts is a rounding of the CAD program."""

_SLIVER = 1e-6  # m; no gap of a device is as narrow, and a STEP file's coordinates are rounded more finely
_CHORDS = 24  # of a curved edge of the powder's outline, as grains see it
_MAX_SAMPLES = 2000
_TURN = math.pi / 6.0  # of an edge on a curve

_Surfaces = Mapping[str, Sequence[int]]
"""Tags of the surfaces of each region."""


@dataclass(frozen=True, slots=True)
class OutlineEdge:
    """A piece of the powder's outline: from start to end (r, z) [m], with the region that lies behind it.

    A curved edge is given as chords, all with the same `region`.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    region: str


@dataclass(frozen=True, slots=True)
class CadSection:
    """The parts of a file made conforming.

    Attributes
    ----------
    parts : tuple of CadPart
    powder_outline : tuple of OutlineEdge
        Unordered; empty where there is no powder. Pieces of the axis are not part of it.
    gap : float
        Smallest distance between two edges of the powder's outline that do not touch [m]; inf without powder.
    odd : frozenset of str
        Regions that are no bodies of revolution, where those are allowed.
    """

    parts: tuple[CadPart, ...]
    powder_outline: tuple[OutlineEdge, ...]
    gap: float
    odd: frozenset[str] = frozenset()


def cad_section(path: str | Path, *, powder: str = "powder", **options: Any) -> CadSection:
    """Read a section without meshing it; `options` are those of a `CadFile`.

    Raises
    ------
    CadError
        As `geometry.cad_import.open_section`; parts that overlap or nearly touch.
    """
    with _conforming(CadFile(Path(path), **options), 2.0) as (gmsh, parts, surfaces, odd):
        outline = tuple(_outline(gmsh, surfaces, powder))
        pairs = _facing(gmsh, surfaces.get(powder, []))
        return CadSection(tuple(parts), outline, MILLIMETRE * min((d for d, *_ in pairs), default=math.inf), odd)


def mesh_cad(
    path: str | Path,
    *,
    powder: str = "powder",
    gap_layers: int = 4,
    size_factor: float = 1.0,
    air_factor: float = 3.0,
    **options: Any,
) -> SectionMesh:
    """Triangulate the section of a CAD file and the air around it.

    Parameters
    ----------
    path : str or Path
        The file, see `geometry.cad_import`.
    powder : str
        Region that is refined by layers.
    gap_layers, size_factor : int, float
        As in `mesh_clutch`.
    air_factor : float
        Radius of the air's half disc over that of the circle around the device, about the middle of its length.
    **options
        Those of a `CadFile`.

    Returns
    -------
    SectionMesh
        With the parts' regions and ``air``; boundaries ``axis``, ``outer`` and ``powder_REGION`` for each neighbour
        of the powder.

    Raises
    ------
    CadError, ValueError
    """
    check_mesh_options(gap_layers, size_factor)
    if not 1.5 <= air_factor <= 20.0:
        raise ValueError(f"`air_factor` = {air_factor:g}: allowed are 1.5 to 20; the default is 3")
    with _conforming(CadFile(Path(path), **options), air_factor) as (gmsh, parts, surfaces, _):
        gmsh.option.setNumber("Mesh.MeshSizeFactor", size_factor)
        for dim, named in ((2, surfaces), (1, _named_curves(gmsh, surfaces, powder))):
            for name, tags in named.items():
                gmsh.model.addPhysicalGroup(dim, tags, name=name)
        layers = max(float(gap_layers), MINIMUM_LAYERS * size_factor)
        turn = _TURN / max(1.0, size_factor)  # before the size factor: edges on curves turn by 30 degrees at most
        expected = _set_sizes(gmsh, parts, surfaces, powder, layers, turn, air_factor) / size_factor**2
        refuse_too_many(expected, MAX_TRIANGLES, "triangles")
        gmsh.model.mesh.generate(2)
        return without_tangles(read_section(gmsh)).mesh


def own_pieces(
    pieces: Sequence[Sequence[tuple[int, int]]], parts: Sequence[CadPart], occ: Any, path: Path
) -> dict[str, list[int]]:
    """Return the tags of each region, ``air`` among them, after one fragmentation of the air and the parts.

    Parameters
    ----------
    pieces : sequence
        Pieces (dimension, tag) of the air, then of each part.
    parts : sequence of CadPart

    Raises
    ------
    CadError
        Two parts overlap by more than `OVERLAP` of the smaller one.
    """
    owner: dict[int, CadPart] = {}
    for part, mine in zip(parts, pieces[1:], strict=True):
        for dim, tag in mine:
            other = owner.get(tag, part)
            size = MILLIMETRE**dim * occ.getMass(dim, tag) if other is not part else 0.0
            if size > OVERLAP * min(part.size, other.size):
                centre = occ.getCenterOfMass(dim, tag)
                place = (f"({', '.join(f'{x:.4g}' for x in centre)}) mm" if dim == 3 else
                         f"r = {centre[0]:.4g} mm, z = {centre[1]:.4g} mm")  # fmt: skip
                raise CadError(
                    f"{path}: {other.region!r} and {part.region!r} overlap by {10.0 ** (3 * dim) * size:.3g} mm{dim} "
                    f"around {place}; cut one out of the other in the CAD program\n{list_of(parts)}"
                )
            owner[tag] = part
    regions: dict[str, list[int]] = {}
    for tag, part in owner.items():
        regions.setdefault(part.region, []).append(tag)
    regions["air"] = regions.get("air", []) + [tag for _, tag in pieces[0] if tag not in owner]
    return regions


@contextmanager
def _conforming(
    file: CadFile, air_factor: float
) -> Iterator[tuple[Any, list[CadPart], dict[str, list[int]], frozenset[str]]]:
    """The section cut out of its air: surfaces by region, ``air`` among them, neighbours sharing their edges."""
    with open_section(file) as (gmsh, parts, tags, odd):
        before = gmsh.option.getNumber("Mesh.MeshSizeFactor")
        try:
            middle, radius = _disc(parts, air_factor)
            air = add_half_disc(gmsh, middle, radius)
            _, pieces = gmsh.model.occ.fragment([(2, air)], [(2, tag) for tag in tags])
            gmsh.model.occ.synchronize()
            surfaces = own_pieces(pieces, parts, gmsh.model.occ, file.path)
            _refuse_slivers(gmsh, file.path, surfaces)
            yield gmsh, parts, surfaces, odd
        finally:
            gmsh.option.setNumber("Mesh.MeshSizeFactor", before)


def _extent(parts: Iterable[CadPart]) -> tuple[float, float, float]:
    """Largest radius, lowest and highest z [m] of the parts."""
    corners = [(part.upper[0], part.lower[1], part.upper[1]) for part in parts]
    return max(r for r, _, _ in corners), min(low for _, low, _ in corners), max(high for _, _, high in corners)


def _disc(parts: Iterable[CadPart], air_factor: float) -> tuple[float, float]:
    """Middle on the axis and radius of the air's half disc [mm]."""
    r1, low, high = _extent(parts)
    radius = air_factor * math.hypot(r1, 0.5 * (high - low))
    return 0.5 * (low + high) / MILLIMETRE, radius / MILLIMETRE


def _refuse_slivers(gmsh: Any, path: Path, surfaces: _Surfaces) -> None:
    """Refuse parts that nearly touch: neither closed, as the drawer meant it, nor wide enough for elements."""
    for tags in surfaces.values():
        for distance, one, other in _facing(gmsh, tags, _SLIVER / MILLIMETRE):
            behind = sorted({name for curve in (one, other) for name in _neighbours(gmsh, curve, surfaces)})
            r, z, _ = gmsh.model.occ.getCenterOfMass(1, one)
            raise CadError(
                f"{path}: {' and '.join(behind)} leave a slit of {1e3 * distance:.2g} um near r = {r:.4g} mm, "
                f"z = {z:.4g} mm; let the parts touch exactly, or leave at least {1e6 * _SLIVER:g} um"
            )


def _ends(gmsh: Any, curve: int) -> list[tuple[int, int]]:
    return gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)


def _curves_of(gmsh: Any, surfaces: Sequence[int]) -> list[int]:
    shapes = [(2, tag) for tag in surfaces]
    return [tag for _, tag in gmsh.model.getBoundary(shapes, combined=True, oriented=False)] if shapes else []


def _on_axis(gmsh: Any, curve: int) -> bool:
    return abs(gmsh.model.occ.getCenterOfMass(1, curve)[0]) < 1e-5


def _neighbours(gmsh: Any, curve: int, surfaces: _Surfaces, powder: str = "") -> list[str]:
    """Regions on the two sides of a curve, but for the powder."""
    faces, _ = gmsh.model.getAdjacencies(1, curve)
    return [name for face in faces for name, tags in surfaces.items() if face in tags and name != powder]


def _named_curves(gmsh: Any, surfaces: _Surfaces, powder: str) -> dict[str, list[int]]:
    curves: dict[str, list[int]] = {}
    for tag in _curves_of(gmsh, [tag for tags in surfaces.values() for tag in tags]):
        curves.setdefault("axis" if _on_axis(gmsh, tag) else "outer", []).append(tag)
    for tag in _curves_of(gmsh, surfaces.get(powder, [])):
        for behind in _neighbours(gmsh, tag, surfaces, powder)[:1]:
            curves.setdefault(f"powder_{behind}", []).append(tag)
    return curves


def _outline(gmsh: Any, surfaces: _Surfaces, powder: str) -> Iterator[OutlineEdge]:
    for curve in _curves_of(gmsh, surfaces.get(powder, [])):
        if _on_axis(gmsh, curve):
            continue
        behind = _neighbours(gmsh, curve, surfaces, powder) or ["air"]
        count = 1 if gmsh.model.getType(1, curve) == "Line" else _CHORDS
        low, high = gmsh.model.getParametrizationBounds(1, curve)
        points = gmsh.model.getValue(1, curve, np.linspace(low[0], high[0], count + 1)).reshape(-1, 3)[:, :2]
        corners = [(max(0.0, round(float(r), 12)), round(float(z), 12) + 0.0) for r, z in points * MILLIMETRE]
        for start, end in pairwise(corners):
            yield OutlineEdge(start, end, behind[0])


def _facing(gmsh: Any, surfaces: Sequence[int], below: float = math.inf) -> Iterator[tuple[float, int, int]]:
    """Yield the distance [mm] of every two curves of one face that do not touch, where it is less than ``below``."""
    for surface in surfaces:
        curves = [tag for tag in _curves_of(gmsh, [surface]) if not _on_axis(gmsh, tag)]
        ends = {curve: set(_ends(gmsh, curve)) for curve in curves}
        boxes = {curve: gmsh.model.occ.getBoundingBox(1, curve) for curve in curves}
        for k, one in enumerate(curves):
            for other in curves[:k]:
                if ends[one] & ends[other] or _box_distance(boxes[one], boxes[other]) >= below:
                    continue
                distance = gmsh.model.occ.getDistance(1, one, 1, other)[0]
                if 0.0 < distance < below:
                    yield distance, one, other


def _box_distance(a: Sequence[float], b: Sequence[float]) -> float:
    return math.hypot(*(max(a[k] - b[k + 3], b[k] - a[k + 3], 0.0) for k in range(2)))


def _set_sizes(
    gmsh: Any,
    parts: Sequence[CadPart],
    surfaces: _Surfaces,
    powder: str,
    layers: float,
    turn: float,
    air_factor: float,
) -> float:
    """Set sizes before the size factor: gaps, corners, curves, growing with the distance; return expected triangles."""
    r1, low, high = _extent(parts)
    far = _disc(parts, air_factor)[1] * MILLIMETRE / 8.0
    device = min(r1 / 20.0, (high - low) / 8.0)
    extent = {"XMin": 0.0, "XMax": r1, "YMin": low, "YMax": high, "ZMin": -1.0, "ZMax": 1.0}
    fields = [add_size_field(gmsh, "Box", device, far, extent)]
    shapes = [(device, r1, high - low)]
    at_corner: dict[int, float] = {}
    for name, tags in surfaces.items():
        for distance, *curves in _facing(gmsh, tags, device / MILLIMETRE):
            gap = distance * MILLIMETRE
            size = gap / (layers * ROW_HEIGHT) if name == powder else max(3.0 * gap, (high - low) / 200.0)
            if size >= device:
                continue
            fields.append(_along(gmsh, curves, size, 0.5 * gap, far))
            shapes.append((size, min(gmsh.model.occ.getMass(1, curve) for curve in curves) * MILLIMETRE, gap))
            if name == powder:
                for _, corner in (end for curve in curves for end in _ends(gmsh, curve)):
                    at_corner[corner] = min(size, at_corner.get(corner, math.inf))
    for corner, size in at_corner.items():
        r, z, _ = gmsh.model.getValue(0, corner, [])
        place = {"XCenter": r * MILLIMETRE, "YCenter": z * MILLIMETRE, "Radius": 0.0}
        fields.append(add_size_field(gmsh, "Ball", CORNER * size, far, place))
    for _, curve in gmsh.model.getEntities(1):
        length, turned = gmsh.model.occ.getMass(1, curve) * MILLIMETRE, _turn_of(gmsh, curve)
        if turned * device > turn * length:
            fields.append(_along(gmsh, [curve], turn * length / turned, 0.0, far))
            shapes.append((turn * length / turned, length, 0.0))
    use_least_size(gmsh, fields)
    return expected_triangles(shapes)


def _turn_of(gmsh: Any, curve: int) -> float:
    """Angle [rad] by which the tangent of a curve turns from end to end."""
    if gmsh.model.getType(1, curve) == "Line":
        return 0.0
    low, high = gmsh.model.getParametrizationBounds(1, curve)
    tangent = gmsh.model.getDerivative(1, curve, np.linspace(low[0], high[0], 65)).reshape(-1, 3)
    return float(np.abs(np.diff(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))).sum())


def _along(gmsh: Any, curves: Sequence[int], size: float, reach: float, far: float) -> int:
    """Add a size field: ``size`` [m] within ``reach`` [m] of the curves, growing with the distance beyond."""
    field = gmsh.model.mesh.field
    length = max(gmsh.model.occ.getMass(1, curve) for curve in curves) * MILLIMETRE
    near = field.add("Distance")
    field.setNumbers(near, "CurvesList", list(curves))
    field.setNumber(near, "Sampling", min(_MAX_SAMPLES, 2 + math.ceil(2.0 * length / size)))
    grown = field.add("Threshold")
    field.setNumber(grown, "InField", near)
    numbers = {"SizeMin": size, "SizeMax": far, "DistMin": reach, "DistMax": reach + (far - size) / GROWTH}
    for name, value in numbers.items():
        field.setNumber(grown, name, value / MILLIMETRE)
    return grown
