"""Mesh of a clutch's cross-section by gmsh (OpenCASCADE kernel), with regions and boundaries by name.

The parts of the section are cut out of the air's half-disc by one fragmentation, so that neighbours share
their edges. Every surface goes into a physical group of its region's name, and the named groups are read
back.

Element sizes: inside the gaps that of a whole number of rows of equilateral triangles, a quarter of it at
the steel corners beside the gap (where the field strength is singular like d^(-1/3)), and from there h
grows in proportion to the distance: in iron and coil up to a fraction of the device, in the air up to an
eighth of its radius.

gmsh keeps one global state and is not safe to call from several threads at once.
"""

from __future__ import annotations

import ctypes
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from geometry.clutch import Clutch
from geometry.element_count import MAX_TRIANGLES, expected_triangles, refuse_too_many
from geometry.fault import GeometryError
from geometry.section import SectionMesh

MINIMUM_LAYERS = 3
GROWTH = 0.45  # of the element size with distance: neighbours differ by less than a half
ROW_HEIGHT = 0.5 * 3.0**0.5  # of an equilateral triangle over its side
CORNER = 0.25  # element size at a steel corner over that of the gap

# The CAD kernel's tolerance is 1e-7 of its own unit: in metres, a clearance of 0.3 mm would be close to it.
MILLIMETRE = 1e-3

Extent = tuple[float, float, float, float]
"""r0, r1, z0, z1 of a rectangle [m]."""

_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,  # frontal Delaunay: nearly equilateral triangles, which gradient recovery likes
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MshFileVersion": 4.1,
    "Mesh.SaveAll": 0,
    "Mesh.Binary": 0,
    "Mesh.ScalingFactor": MILLIMETRE,
}


def mesh_clutch(
    clutch: Clutch, *, gap_layers: int = 4, size_factor: float = 1.0, path: str | Path | None = None
) -> SectionMesh:
    """Triangulate the cross-section of a clutch and the air around it.

    Parameters
    ----------
    clutch : Clutch
        Its faults are looked for first.
    gap_layers : int
        Elements across the rim gap and across the face gaps, at least 3.
    size_factor : float
        Scales every element size, 0.1 to 4; whatever it is, three layers across the gaps remain.
    path : str or Path, optional
        Where to write the mesh as well (``.msh``, format 4.1, coordinates in metres, physical names).

    Raises
    ------
    GeometryError
        With every fault of the clutch.
    ValueError
        For too few layers, a size factor out of range, or a file name that does not end in ``.msh``.
    OSError
        If the file cannot be written.
    """
    faults = clutch.faults()
    if faults:
        raise GeometryError(faults)
    if gap_layers < MINIMUM_LAYERS:
        raise ValueError(f"`gap_layers` = {gap_layers}: allowed are {MINIMUM_LAYERS} or more; raise `gap_layers`")
    if not 0.1 <= size_factor <= 4.0:
        raise ValueError(f"`size_factor` = {size_factor:g}: allowed are 0.1 to 4; the default is 1")
    layers = max(float(gap_layers), MINIMUM_LAYERS * size_factor)
    refuse_too_many(_expected(clutch, layers, size_factor), MAX_TRIANGLES, "triangles")
    target = None if path is None else _writable(Path(path))
    options = _OPTIONS | {"Mesh.MeshSizeFactor": size_factor}
    with gmsh_model(options) as gmsh:
        surfaces = _fragments(gmsh, clutch)
        for name, tags in surfaces.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        for name, tags in _named_curves(gmsh, clutch, surfaces).items():
            gmsh.model.addPhysicalGroup(1, tags, name=name)
        _set_sizes(gmsh, clutch, layers)
        gmsh.model.mesh.generate(2)
        if target is not None:
            gmsh.write(str(target))
        return _section(gmsh)


@contextmanager
def gmsh_model(options: dict[str, float]) -> Iterator[Any]:
    """A model of our own in gmsh, which is left as it was found, after an error as well."""
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


def _writable(path: Path) -> Path:
    """The path, once it is known that gmsh will be able to write there: its own message names no reason."""
    if path.suffix != ".msh":
        raise ValueError(f"`path` = {path}: a mesh is written as .msh; change the file's ending")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no folder {path.parent}; create it first")
    with path.open("ab"):
        return path


def _fragments(gmsh: Any, clutch: Clutch) -> dict[str, list[int]]:
    """Cut the parts out of the air; the surfaces of every region, ``air`` among them."""
    occ = gmsh.model.occ
    radius = clutch.air_radius / MILLIMETRE
    arc = occ.addCircle(0.0, 0.0, 0.0, radius, angle1=-0.5 * np.pi, angle2=0.5 * np.pi)
    occ.synchronize()
    (_, south), (_, north) = gmsh.model.getBoundary([(1, arc)], combined=False)
    air = occ.addPlaneSurface([occ.addCurveLoop([arc, occ.addLine(north, south)])])
    parts: list[int] = []
    owners: list[str] = []
    for name, polygons in clutch.section_polygons().items():
        for polygon in polygons:
            corners = [occ.addPoint(r, z, 0.0) for r, z in polygon / MILLIMETRE]
            lines = [occ.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
            parts.append(occ.addPlaneSurface([occ.addCurveLoop(lines)]))
            owners.append(name)
    _, pieces = occ.fragment([(2, air)], [(2, tag) for tag in parts])
    occ.synchronize()
    surfaces: dict[str, list[int]] = {}
    for name, piece in zip(owners, pieces[1:], strict=True):
        surfaces.setdefault(name, []).extend(tag for _, tag in piece)
    taken = {tag for tags in surfaces.values() for tag in tags}
    surfaces["air"] = [tag for _, tag in pieces[0] if tag not in taken]
    return surfaces


def _named_curves(gmsh: Any, clutch: Clutch, surfaces: dict[str, list[int]]) -> dict[str, list[int]]:
    """Axis, outer arc and the powder's faces, told apart by where the middle of each curve lies."""
    everything = [(2, tag) for tags in surfaces.values() for tag in tags]
    curves: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getBoundary(everything, combined=True, oriented=False):
        r = gmsh.model.occ.getCenterOfMass(1, tag)[0]
        curves.setdefault("axis" if r < 1e-6 else "outer", []).append(tag)
    powder = [(2, tag) for tag in surfaces["powder"]]
    half = 0.5 * clutch.cavity_length / MILLIMETRE
    bore, disc, seal = (x / MILLIMETRE for x in (clutch.bore_radius, clutch.disc_radius, clutch.seal_radius))
    close = 1e-4 * min(clutch.gap, clutch.face_gap) / MILLIMETRE
    for _, tag in gmsh.model.getBoundary(powder, combined=True, oriented=False):
        r, z, _ = gmsh.model.occ.getCenterOfMass(1, tag)
        if abs(r - bore) < close:
            name = "rotor_bore"
        elif abs(abs(z) - half) < close:
            name = "rotor_faces"
        elif abs(r - disc) < close:
            name = "disc_rim"
        elif abs(r - seal) < close:
            name = "seal_rim"
        else:
            name = "disc_faces"
        curves.setdefault(name, []).append(tag)
    return curves


def _expected(clutch: Clutch, layers: float, factor: float) -> float:
    """About how many triangles the mesh will have."""
    boxes, _ = _sizes(clutch, layers)
    return expected_triangles(((factor * size, r1 - r0, z1 - z0) for size, (r0, r1, z0, z1) in boxes), factor * GROWTH)


def _sizes(clutch: Clutch, layers: float) -> tuple[list[tuple[float, Extent]], list[tuple[float, tuple[float, float]]]]:
    """Element sizes before the size factor, of boxes and at corners [m]."""
    device = min(clutch.outer_radius / 20.0, clutch.housing_length / 8.0)
    rim, face = (gap / (layers * ROW_HEIGHT) for gap in (clutch.gap, clutch.face_gap))
    half, disc_half = 0.5 * clutch.cavity_length, 0.5 * clutch.disc_thickness
    # One layer of P2 spans the running clearance well; the floor keeps a hair-thin one from ruling the mesh.
    bore = max(3.0 * clutch.clearance, clutch.housing_length / 200.0)
    ring, coil = 0.5 * clutch.ring_width, 0.5 * clutch.coil_width
    boxes = [
        (rim, (clutch.disc_radius, clutch.bore_radius, -half, half)),
        (face, (clutch.seal_radius, clutch.disc_radius, disc_half, half)),
        (face, (clutch.seal_radius, clutch.disc_radius, -half, -disc_half)),
        (
            bore,
            (clutch.rotor_radius, clutch.housing_bore, -0.5 * clutch.rotor_length, 0.5 * clutch.rotor_length),
        ),
        (device, (0.0, clutch.outer_radius, -0.5 * clutch.length, 0.5 * clutch.length)),
    ]
    corners = [
        (CORNER * min(rim, face), (clutch.disc_radius, disc_half)),
        (CORNER * rim, (clutch.bore_radius, ring)),
        (CORNER * bore, (clutch.rotor_radius, ring)),
        (CORNER * bore, (clutch.housing_bore, coil)),
    ]
    if clutch.cover_magnetic:
        corners.append((CORNER * face, (clutch.seal_radius, half)))
    return boxes, corners


def _set_sizes(gmsh: Any, clutch: Clutch, layers: float) -> None:
    """Element sizes before the size factor, as the least of a few boxes and balls that grow outwards."""
    field = gmsh.model.mesh.field
    far = clutch.air_radius / 8.0
    boxes, corners = _sizes(clutch, layers)
    fields = []
    for size, extent in boxes:
        numbers = dict(zip(("XMin", "XMax", "YMin", "YMax"), extent, strict=True)) | {
            "ZMin": -1.0,
            "ZMax": 1.0,
        }
        fields.append(_grown(gmsh, "Box", size, far, numbers))
    for size, (r, z) in corners:
        for side in (-z, z) if z > 0.0 else ():
            fields.append(_grown(gmsh, "Ball", size, far, {"XCenter": r, "YCenter": side, "Radius": 0.0}))
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)


def _grown(gmsh: Any, kind: str, size: float, far: float, numbers: dict[str, float]) -> int:
    """A size field (lengths in metres): ``size`` inside, growing with the distance outside up to ``far``."""
    tag = gmsh.model.mesh.field.add(kind)
    lengths = {"VIn": size, "VOut": far, "Thickness": (far - size) / GROWTH} | numbers
    for name, value in lengths.items():
        gmsh.model.mesh.field.setNumber(tag, name, value / MILLIMETRE)
    return tag


def _section(gmsh: Any) -> SectionMesh:
    """Read the mesh back: nodes that triangles use, and elements and edges by the name of their group."""
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
    ends = np.cumsum([len(elements) for elements in groups[2].values()])
    regions = {
        name: np.arange(end - len(elements), end, dtype=np.int64)
        for (name, elements), end in zip(groups[2].items(), ends, strict=True)
    }
    boundaries = {name: np.searchsorted(used, edges).astype(np.int64) for name, edges in groups[1].items()}
    return SectionMesh(np.ascontiguousarray(points), triangles.astype(np.int64), regions, boundaries)


def _elements_by_name(gmsh: Any, dim: int) -> dict[str, np.ndarray]:
    """Node tags of the elements of every physical group, shape (k, dim + 1), sorted by the group's name."""
    found = {}
    for _, group in gmsh.model.getPhysicalGroups(dim):
        nodes = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, group):
            _, _, tags = gmsh.model.mesh.getElements(dim, entity)
            nodes += [block.reshape(-1, dim + 1) for block in tags]
        found[gmsh.model.getPhysicalName(dim, group)] = np.concatenate(nodes).astype(np.int64)
    return dict(sorted(found.items()))
