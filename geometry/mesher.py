"""The mesher, gmsh with its OpenCASCADE kernel: sessions, shapes, element sizes, limits, and reading a section back.

Lengths in a model are millimetres, those of a mesh metres. Every surface goes into a physical group of its region's
name, every curve that is a boundary into one of the boundary's name, and the named groups are read back.

gmsh keeps one global state and is not safe to call from several threads at once.
"""

from __future__ import annotations

import ctypes
import math
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from geometry.curved_edges import CurvedEdges
from geometry.section import SectionMesh

# The CAD kernel's tolerance is 1e-7 of its own unit: in metres, a clearance of 0.3 mm would be close to it.
MILLIMETRE = 1e-3

MINIMUM_LAYERS = 3
GROWTH = 0.45  # of the element size with distance: neighbours differ by less than a half
ROW_HEIGHT = 0.5 * 3.0**0.5  # of an equilateral triangle over its side
CORNER = 0.25  # element size at a steel corner over that of the gap

MAX_TRIANGLES = 3e5
"""Of a section; of order 2 their field takes 2.4 GB."""
MAX_TETRAHEDRA = 1e6
"""Of a sector in 3D; of order 2 their field takes some 7 GB."""

_SAMPLES = 256  # of a curve
_STRAIGHT = 1e-9  # width over length of a curve that is a line

SECTION_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,  # frontal Delaunay: nearly equilateral triangles, which gradient recovery likes
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.ScalingFactor": MILLIMETRE,
}


@contextmanager
def gmsh_model(options: Mapping[str, float]) -> Iterator[Any]:
    """Open a model of our own in gmsh, which is left as it was before, after an error as well."""
    import gmsh

    name = "emclutch cross-section"
    foreign = bool(gmsh.isInitialized())
    if not foreign:
        initialize_gmsh()
    try:
        before = gmsh.model.getCurrent()
        saved = {option: gmsh.option.getNumber(option) for option in options}
        gmsh.model.add(name)
        try:
            for option, value in options.items():
                gmsh.option.setNumber(option, value)
            yield gmsh
        finally:
            gmsh.model.setCurrent(name)
            gmsh.model.remove()
            for option, value in saved.items():
                gmsh.option.setNumber(option, value)
            if foreign:
                gmsh.model.setCurrent(before)
    finally:
        if not foreign:
            gmsh.finalize()


def initialize_gmsh() -> None:
    """Initialize gmsh in any thread, and leave the process's handling of SIGINT and SIGPIPE as it is.

    Python ignores SIGPIPE and raises BrokenPipeError. ``gmsh.initialize`` sets the default action, which ends the
    process without a message; with ``interruptible`` it does the same with SIGINT.
    """
    import gmsh

    pipe = getattr(signal, "SIGPIPE", None)  # none on Windows
    read, write = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig  # signal.signal: the main thread alone
    read.restype, read.argtypes = ctypes.c_void_p, [ctypes.c_int]
    write.restype, write.argtypes = ctypes.c_void_p, [ctypes.c_int, ctypes.c_void_p]
    before = None if pipe is None else read(pipe)
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    if pipe is not None:
        write(pipe, before)


def check_mesh_options(gap_layers: int, size_factor: float) -> None:
    """Refuse too few layers of elements across a gap, and a factor on the element sizes out of range.

    Raises
    ------
    ValueError
    """
    if gap_layers < MINIMUM_LAYERS:
        raise ValueError(f"`gap_layers` = {gap_layers}: allowed are {MINIMUM_LAYERS} or more; raise `gap_layers`")
    if not 0.1 <= size_factor <= 4.0:
        raise ValueError(f"`size_factor` = {size_factor:g}: allowed are 0.1 to 4; the default is 1")


def add_half_disc(gmsh: Any, centre: float, radius: float) -> int:
    """Add the air of a section: the half disc x > 0 about a point of the axis [mm]; return its tag."""
    occ = gmsh.model.occ
    arc = occ.addCircle(0.0, centre, 0.0, radius, angle1=-0.5 * np.pi, angle2=0.5 * np.pi)
    occ.synchronize()
    (_, south), (_, north) = gmsh.model.getBoundary([(1, arc)], combined=False)
    return occ.addPlaneSurface([occ.addCurveLoop([arc, occ.addLine(north, south)])])


def add_polygon(occ: Any, corners: np.ndarray, arcs: Sequence[tuple[int, int, np.ndarray]] = ()) -> int:
    """Add a polygon of the section with corners (r, z) [m], shape (n, 2); return its tag.

    `arcs` (first corner, last corner, centre) stand for the chords between their corners.
    """
    skipped = {i for first, last, _ in arcs for i in range(first + 1, last)}
    centres = {first: centre for first, _, centre in arcs}
    kept = [i for i in range(len(corners)) if i not in skipped]
    points = [occ.addPoint(*corners[i] / MILLIMETRE, 0.0) for i in kept]
    sides = []
    for i, start, end in zip(kept, points, points[1:] + points[:1], strict=True):
        if i in centres:
            centre = occ.addPoint(*centres[i] / MILLIMETRE, 0.0)
            sides.append(occ.addCircleArc(start, centre, end))
            occ.remove([(0, centre)])
        else:
            sides.append(occ.addLine(start, end))
    return occ.addPlaneSurface([occ.addCurveLoop(sides)])


def expected_triangles(shapes: Iterable[tuple[float, float, float]]) -> float:
    """Estimate the triangles of a mesh whose element size is the least of those of some shapes.

    The size is s inside a shape and s + g d at a distance d from it, g = `GROWTH`. An equilateral triangle of side h
    has the area sqrt(3)/4 h^2, so that a shape of area A and perimeter P asks for

        A/(sqrt(3)/4 s^2) + integral of P dd/(sqrt(3)/4 (s + g d)^2) = (A/s^2 + P/(g s))/(sqrt(3)/4)

    triangles. The sum over the shapes counts some places twice; corners and the air around the device are left out. It
    is the number within a factor of two.

    Parameters
    ----------
    shapes : iterable of (float, float, float)
        Size inside [m], width and height [m] of a rectangle; a line or a point has no height, or neither.
    """
    return sum((w * h / s**2 + 2.0 * (w + h) / (GROWTH * s)) / (0.25 * math.sqrt(3.0)) for s, w, h in shapes)


def refuse_too_many(count: float, most: float, kind: str) -> None:
    """Refuse a mesh of more than `most` elements of a `kind`, such as "triangles", before it is made.

    Raises
    ------
    ValueError
    """
    if count > most:
        raise ValueError(
            f"the mesh would have about {count:.2g} {kind}; allowed: at most {most:.2g}; raise field.size_factor, "
            "lower field.gap_layers, or check the units of the gaps and of all other lengths"
        )


def add_size_field(gmsh: Any, kind: str, size: float, far: float, numbers: Mapping[str, float]) -> int:
    """Add a size field (lengths in metres): ``size`` inside, growing with the distance outside up to ``far``."""
    tag = gmsh.model.mesh.field.add(kind)
    lengths = {"VIn": size, "VOut": far, "Thickness": (far - size) / GROWTH, **numbers}
    for name, value in lengths.items():
        gmsh.model.mesh.field.setNumber(tag, name, value / MILLIMETRE)
    return tag


def use_least_size(gmsh: Any, fields: Sequence[int]) -> None:
    """Make the least of some size fields the one that the mesh follows."""
    field = gmsh.model.mesh.field
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)


def read_section(gmsh: Any) -> SectionMesh:
    """Read a mesh back: nodes that triangles use, elements and edges by their physical group, and curved edges.

    The edges of `outer` stay straight: the polygon is the border of the mesh, and an open boundary is exact for it.
    """
    mesh = gmsh.model.mesh
    tags, coordinates, _ = mesh.getNodes()
    groups = {dim: _elements_by_name(gmsh, dim) for dim in (1, 2)}
    corners = np.concatenate(list(groups[2].values()))
    used = np.unique(corners)
    position = np.empty((int(tags.max()) + 1, 3))
    position[tags] = coordinates.reshape(-1, 3)
    points = position[used, :2] * MILLIMETRE
    triangles = np.searchsorted(used, corners)
    axis = np.searchsorted(used, groups[1]["axis"])
    points[axis, 0] = 0.0
    # OCC orients every face as it likes.
    a, b, c = (points[triangles[:, i]] for i in range(3))
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[clockwise, 1:] = triangles[clockwise, :0:-1]
    boundaries = {name: np.searchsorted(used, edges).astype(np.int64) for name, edges in groups[1].items()}
    regions = region_ranges({name: len(elements) for name, elements in groups[2].items()})
    curved = _curved_edges(gmsh, used, points, triangles)
    return SectionMesh(np.ascontiguousarray(points), triangles.astype(np.int64), regions, boundaries, curved)


def _curved_edges(gmsh: Any, used: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> CurvedEdges | None:
    """Edges of triangles on curves that are no lines, but for the group `outer`; `used` has the tags of the points."""
    outer = {
        entity
        for _, group in gmsh.model.getPhysicalGroups(1)
        if gmsh.model.getPhysicalName(1, group) == "outer"
        for entity in gmsh.model.getEntitiesForPhysicalGroup(1, group)
    }
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2) @ (len(points), 1)
    nodes, ends, curves = [], [], []
    for _, tag in gmsh.model.getEntities(1):
        if tag in outer or gmsh.model.getType(1, tag) == "Line":
            continue
        edges = gmsh.model.mesh.getElementsByType(1, tag)[1].reshape(-1, 2)
        edges = np.searchsorted(used, edges[np.isin(edges, used).all(axis=1)]).astype(np.int64)
        edges = edges[np.isin(np.sort(edges, axis=1) @ (len(points), 1), sides)]
        curve = _curve(gmsh, tag, len(edges))
        if len(edges) == 0 or _is_straight(curve(curve.x)):
            continue
        inner, _, parameter = gmsh.model.mesh.getNodes(1, tag, returnParametricCoord=True)
        of_point = np.full(len(points), np.nan)
        of_point[np.searchsorted(used, inner)] = parameter
        nodes.append(edges)
        ends.append(_ends(edges, of_point, points, curve))
        curves.append(curve)
    if not curves:
        return None
    number = np.repeat(np.arange(len(curves)), [len(edges) for edges in nodes])
    return CurvedEdges(np.concatenate(nodes), number, np.concatenate(ends), tuple(curves))


def _is_straight(points: np.ndarray) -> bool:
    """True if points (n, 2) of a curve lie in one line."""
    along, across = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(across < _STRAIGHT * along)


def _curve(gmsh: Any, tag: int, n_edges: int) -> CubicHermiteSpline:
    """(r, z) [m] of a curve's parameter; a circle is met to 1e-9 of its radius."""
    low, high = gmsh.model.getParametrizationBounds(1, tag)
    knots = np.linspace(low[0], high[0], max(_SAMPLES, 8 * n_edges) + 1)
    point, slope = (
        MILLIMETRE * np.reshape(values, (-1, 3))[:, :2]
        for values in (gmsh.model.getValue(1, tag, knots), gmsh.model.getDerivative(1, tag, knots))
    )
    return CubicHermiteSpline(knots, point, slope)


def _ends(edges: np.ndarray, of_point: np.ndarray, points: np.ndarray, curve: CubicHermiteSpline) -> np.ndarray:
    """Parameters (k, 2) of the ends of a curve's edges, from those of points inside the curve; others are nan."""
    ends = of_point[edges]
    low, high = curve.x[0], curve.x[-1]
    to_low, to_high = (np.linalg.norm(points[edges] - curve(bound), axis=2) for bound in (low, high))
    if np.linalg.norm(curve(low) - curve(high)) < _STRAIGHT * np.ptp(points):
        # of a closed curve, where both ends are one point, the end that is closer to the neighbour
        to_low, to_high = ends[:, ::-1] - low, high - ends[:, ::-1]
    return np.where(np.isnan(ends), np.where(to_low < to_high, low, high), ends)


def region_ranges(counts: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Indexes of the elements of each region, which are sorted by region, from their numbers."""
    ends = np.cumsum(list(counts.values()))
    return {
        name: np.arange(end - count, end, dtype=np.int64)
        for (name, count), end in zip(counts.items(), ends, strict=True)
    }


def _elements_by_name(gmsh: Any, dim: int) -> dict[str, np.ndarray]:
    """Node tags of the elements of every physical group, shape (k, dim + 1), sorted by the group's name."""
    groups = {}
    for _, group in gmsh.model.getPhysicalGroups(dim):
        nodes = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, group):
            _, _, tags = gmsh.model.mesh.getElements(dim, entity)
            nodes += [block.reshape(-1, dim + 1) for block in tags]
        groups[gmsh.model.getPhysicalName(dim, group)] = np.concatenate(nodes).astype(np.int64)
    return dict(sorted(groups.items()))
