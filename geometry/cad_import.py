"""A device from CAD: the named parts of a STEP file as the regions of an axisymmetric section, or as solids.

What may be in the file (STEP, IGES, BREP, or gmsh's own .geo with the OpenCASCADE kernel):

- **faces** in one plane, the half section: x is the radius, and y or z the axis, whichever plane they lie in;
- **solids of revolution** about z (or the axis that is named): they are cut by the half-plane, and a part whose
  volume is not that of its section turned (Pappus) is refused, because a slot would be lost without a message, or
  reported to a caller who solves the field in 3D.

A part's region is its name in the file (`geometry.cad_parts`); one without a name is ``part3``, say, by its number in
the order of the file, as are all parts of a BREP file, and those of the physical group 3 of a .geo file, if it has no
name, are ``tag3``.  Air need not be drawn: what no part fills is air, out to a half
disc around all.  STEP carries its unit of length; a BREP or .geo file is read in millimetres; ``scale`` mends a wrong
unit.
A .geo file is a script, and refused unless the caller trusts it (`geometry.file_content`).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_parts import CadFile, CadPart, own_name, plain_name
from geometry.file_content import SCRIPT, SHAPE_FORMATS, CadError, check_file
from geometry.mesher import MILLIMETRE, SECTION_OPTIONS, gmsh_model

SUFFIXES = (*SHAPE_FORMATS, SCRIPT)
_FLAT = 1e-5  # of the file's unit; coordinates in a STEP file are rounded to 1e-6 or better
_ROUND = 1e-3  # of volume and radius: far above the error of the kernel's quadrature, far below a slot
_QUADRATURE = 0.02  # of the volume of a whole cylinder, torus or ball whose faces are NURBS
_SECTORS, _TILES = 8, 4
_TURNED = {"x": (0.0, 1.0, 0.0, -0.5 * math.pi), "y": (1.0, 0.0, 0.0, 0.5 * math.pi)}  # brings that axis onto z

_Shapes = dict[tuple[int, int], str]
"""Label (a path of the tree, or a physical group's name) of each solid or face."""


@contextmanager
def open_section(file: CadFile) -> Iterator[tuple[Any, list[CadPart], list[int], frozenset[str]]]:
    """Open a file in a gmsh model of its own: its section in the plane x = r, y = z, in millimetres.

    Yields
    ------
    gmsh, parts, tags, odd
        The module, the parts that the half-plane cuts, the tag of each part's face, and the regions that are no bodies
        of revolution.

    Raises
    ------
    CadError
        A file that is missing or no CAD file, a script without trust, parts without a name, unknown or missing regions,
        lengths that are none of a device, parts beyond the axis or that are no solids of revolution.
    """
    with _opened(file, SECTION_OPTIONS, solids=file.any_shape) as (gmsh, shapes):
        odd: list[str] = []
        if max(dim for dim, _ in shapes) == 3:
            flat, odd = _cut(gmsh, file, shapes)
        else:
            flat = _flat_section(gmsh, file, shapes)
        parts = [_part(gmsh, file, (2, tag), label) for tag, label in flat]
        unseen = [CadPart(own_name(label), file.region_of(label)) for label in odd]
        file.check_parts([*parts, *unseen])
        yield gmsh, parts, [tag for tag, _ in flat], frozenset(part.region for part in unseen)


@contextmanager
def open_solids(file: CadFile, options: Mapping[str, float]) -> Iterator[tuple[Any, list[CadPart], list[int]]]:
    """Open a file of solids in a gmsh model of its own, in millimetres; otherwise as `open_section`.

    `options` are gmsh's for the mesh.
    """
    with _opened(file, options, solids=True) as (gmsh, shapes):
        solids = [_part(gmsh, file, shape, label) for shape, label in shapes.items()]
        file.check_parts(solids)
        yield gmsh, solids, [tag for _, tag in shapes]


@contextmanager
def _opened(file: CadFile, options: Mapping[str, float], *, solids: bool) -> Iterator[tuple[Any, _Shapes]]:
    """The solids or faces of a file, in a model of its own in millimetres; `solids`: faces will not do."""
    check_file(file.path, "CAD file", SUFFIXES, file.scale, trusted=file.trust_scripts)
    if file.axis not in ("x", "y", "z"):
        raise CadError(f"`axis` = {file.axis!r}: allowed are x, y and z")
    with gmsh_model({**options, "Geometry.OCCImportLabels": 1}) as gmsh:
        unit = gmsh.option.getString("Geometry.OCCTargetUnit")
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        try:
            shapes = _read(gmsh, file.path)
        finally:
            gmsh.option.setString("Geometry.OCCTargetUnit", unit)
        if file.scale != 1.0:
            shapes = _scaled(gmsh, shapes, file.scale)
        boxes = [gmsh.model.occ.getBoundingBox(*shape) for shape in shapes]
        size = max(max(box[3 + k] for box in boxes) - min(box[k] for box in boxes) for k in range(3))
        file.check_size(MILLIMETRE * size, "export it in millimetres, or give `scale` = {factor}")
        if solids and max(dim for dim, _ in shapes) < 3:
            raise CadError(f"{file.path} holds faces but no solids; export solid bodies, or take it as a section")
        yield gmsh, shapes


def _read(gmsh: Any, path: Path) -> _Shapes:
    """Read the solids, or else the faces, of a file."""
    suffix = path.suffix.lower()
    try:
        if suffix == SCRIPT:
            gmsh.merge(str(path))
            shapes = _of_groups(gmsh, path)
        else:
            gmsh.model.occ.importShapes(str(path), highestDimOnly=False, format=SHAPE_FORMATS[suffix])
            gmsh.model.occ.synchronize()
            parts = gmsh.model.getEntities(3)
            loose = [face for face in gmsh.model.getEntities(2) if len(gmsh.model.getAdjacencies(*face)[0]) == 0]
            if parts and loose:
                raise CadError(
                    f"{path} holds {len(loose)} faces that belong to no solid, besides {len(parts)} solids: a part "
                    "that is not closed is no solid; close it in the CAD program, or export the solids alone"
                )
            parts = parts or loose
            shapes = _numbered(parts, [gmsh.model.getEntityName(*shape) for shape in parts], path)
    except CadError:
        raise
    except Exception as error:  # gmsh raises plain Exception, with its own last message
        raise CadError(f"{path} cannot be read ({error}); export it again, best as STEP AP214 or AP242") from None
    if not shapes:
        raise CadError(f"{path} holds neither solids nor faces; export parts or the faces of a section, not curves")
    return shapes


def _scaled(gmsh: Any, shapes: _Shapes, factor: float) -> _Shapes:
    """Scale the shapes by reading them once more: gmsh's `dilate` turns planes and cylinders into NURBS.

    The volume of these is wrong by a per cent, so that no cylinder would be a body of revolution.
    """
    dim = next(iter(shapes))[0]
    gmsh.model.occ.remove([shape for shape in gmsh.model.occ.getEntities(3) if dim < 3])
    gmsh.model.occ.synchronize()
    given = sorted(gmsh.model.getEntities(dim))  # the order in which gmsh writes
    before = gmsh.option.getNumber("Geometry.OCCScaling")
    with tempfile.TemporaryDirectory(prefix="emclutch-") as folder:
        copy = str(Path(folder) / "copy.brep")
        gmsh.write(copy)
        gmsh.model.occ.remove(gmsh.model.occ.getEntities(dim), recursive=True)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Geometry.OCCScaling", factor)
        try:
            found = gmsh.model.occ.importShapes(copy, format="brep")
        finally:
            gmsh.option.setNumber("Geometry.OCCScaling", before)
    gmsh.model.occ.synchronize()
    return {new: shapes[old] for old, new in zip(given, found, strict=True) if old in shapes}


def _numbered(parts: list[tuple[int, int]], labels: list[str], path: Path) -> _Shapes:
    """Label each part that has no name by its number, from 1."""
    numbers = [f"part{number}" for number in range(1, len(parts) + 1)]
    named = {plain_name(own_name(label)) for label in labels}
    twice = next((n for n, label in zip(numbers, labels, strict=True) if not own_name(label) and n in named), None)
    if twice:
        raise CadError(
            f"{path}: {twice!r} is the name of one part and the number of another, which has no name; rename it in the "
            "CAD program"
        )
    return {shape: label if own_name(label) else n for shape, label, n in zip(parts, labels, numbers, strict=True)}


def _of_groups(gmsh: Any, path: Path) -> _Shapes:
    """Take the entities of the physical groups of a .geo file, which are the regions there."""
    gmsh.model.occ.synchronize()
    built = set(gmsh.model.occ.getEntities())
    groups = gmsh.model.getPhysicalGroups()
    labels: dict[tuple[int, int], list[str]] = {}
    for dim, group in groups:
        for tag in gmsh.model.getEntitiesForPhysicalGroup(dim, group) if dim >= 2 else ():
            labels.setdefault((dim, int(tag)), []).append(gmsh.model.getPhysicalName(dim, group) or f"tag{group}")
    highest = max((dim for dim, _ in labels), default=2)
    shapes = {shape: names[0] for shape, names in labels.items() if shape[0] == highest}
    if several := [names for shape, names in labels.items() if shape in shapes and len(names) > 1]:
        raise CadError(
            f"{path}: one part is in the physical groups {' and '.join(several[0])}; leave it in the one of its region"
        )
    if not built.issuperset(shapes):
        raise CadError(f'{path} uses the built-in kernel; begin it with SetFactory("OpenCASCADE");')
    names = {gmsh.model.getPhysicalName(*group) for group in groups}
    gmsh.model.removePhysicalGroups()
    for name in names:  # or the groups that we make later cannot have them
        gmsh.model.removePhysicalName(name)
    return shapes


def _flat_section(gmsh: Any, file: CadFile, shapes: _Shapes) -> list[tuple[int, str]]:
    """Turn the faces of a drawn section into the plane x, y."""
    flat = _FLAT * max(1.0, file.scale)
    boxes = [gmsh.model.occ.getBoundingBox(*shape) for shape in shapes]
    y0, z0, y1, z1 = (f(box[k] for box in boxes) for f, k in ((min, 1), (min, 2), (max, 4), (max, 5)))
    if max(abs(y0), abs(y1)) < flat:
        gmsh.model.occ.rotate(list(shapes), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5 * math.pi)
        gmsh.model.occ.synchronize()
    elif max(abs(z0), abs(z1)) >= flat:
        raise CadError(
            f"{file.path}: its faces lie neither in the plane y = 0 nor in z = 0 (y {y0:.4g} to {y1:.4g} mm, "
            f"z {z0:.4g} to {z1:.4g} mm); draw the half section there, x as the radius, or export solids"
        )
    return [(tag, label) for (_, tag), label in shapes.items()]


def _cut(gmsh: Any, file: CadFile, shapes: _Shapes) -> tuple[list[tuple[int, str]], list[str]]:
    """Cut solids by the half-plane, turned into the plane x, y; return also what is no body of revolution."""
    occ, solids = gmsh.model.occ, list(shapes)
    if file.axis in _TURNED:
        occ.rotate(solids, 0.0, 0.0, 0.0, *_TURNED[file.axis])
    occ.synchronize()
    boxes = [occ.getBoundingBox(*solid) for solid in solids]
    low, high = min(box[2] for box in boxes), max(box[5] for box in boxes)
    reach = max(max(abs(x) for x in box[:2] + box[3:5]) for box in boxes)
    faces: list[tuple[int, str]] = []
    odd: dict[str, float] = {}
    for solid, label in shapes.items():
        plane = occ.addRectangle(0.0, low - reach, 0.0, 2.0 * reach, high - low + 2.0 * reach)
        occ.rotate([(2, plane)], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5 * math.pi)
        pieces, _ = occ.intersect([solid], [(2, plane)], removeObject=False, removeTool=True)
        pieces = [piece for piece in pieces if piece[0] == 2]
        if not pieces and file.any_shape:
            odd[label] = math.inf
            continue
        if not pieces:
            raise CadError(
                f"{file.path}: part {own_name(label)!r} does not meet the half-plane y = 0, x > 0; the axis of "
                f"revolution must be {file.axis} through the origin: give `axis`, or move the parts in the CAD program"
            )
        occ.rotate(pieces, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5 * math.pi)
        ratio, is_round = _compared(occ, [solid], pieces, reach)
        if not is_round and abs(ratio - 1.0) < _QUADRATURE:
            sectors, tiles = _sectors(occ, solid), _tiles(occ, pieces)
            ratio, is_round = _compared(occ, sectors, tiles, reach)
            occ.remove([*sectors, *tiles], recursive=True)
        if not is_round:
            odd[label] = ratio
        faces += [(tag, label) for _, tag in pieces]
    occ.remove(solids, recursive=True)
    occ.synchronize()
    if odd and not file.any_shape:
        wrong = ", ".join(f"{own_name(label)!r} ({100.0 * ratio:.2f} %)" for label, ratio in odd.items())
        raise CadError(
            f"{file.path}: no solids of revolution about {file.axis}: {wrong} of the volume of the section turned; "
            "give the right `axis`, fill slots and holes, or solve the field in 3D (`three_dimensional`)"
        )
    return faces, list(odd)


def _compared(
    occ: Any, solids: list[tuple[int, int]], faces: list[tuple[int, int]], reach: float
) -> tuple[float, bool]:
    """Volume of the pieces of a solid over that of its section's faces turned (Pappus), and whether it is round."""
    turned = sum(2.0 * math.pi * occ.getCenterOfMass(*face)[0] * occ.getMass(*face) for face in faces)
    volumes = np.array([occ.getMass(*solid) for solid in solids])
    centre = volumes @ np.array([occ.getCenterOfMass(*solid)[:2] for solid in solids]) / volumes.sum()
    ratio = float(volumes.sum() / turned)
    return ratio, abs(ratio - 1.0) <= _ROUND and bool(np.hypot(*centre) <= _ROUND * reach)


def _sectors(occ: Any, solid: tuple[int, int]) -> list[tuple[int, int]]:
    """Cut a solid into sectors about z, on which the kernel's quadrature holds for NURBS too."""
    x0, y0, z0, x1, y1, z1 = occ.getBoundingBox(*solid)
    radius = 2.0 * max(map(abs, (x0, y0, x1, y1)))
    pieces: list[tuple[int, int]] = []
    for angle in np.arange(_SECTORS) * (sector := 2.0 * math.pi / _SECTORS):
        wedge = occ.addCylinder(0.0, 0.0, z0 - radius, 0.0, 0.0, z1 - z0 + 2.0 * radius, radius, angle=sector)
        occ.rotate([(3, wedge)], 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, angle)
        pieces += occ.intersect([solid], [(3, wedge)], removeObject=False)[0]
    return pieces


def _tiles(occ: Any, faces: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Cut faces of the plane x, y into tiles, for the same reason as `_sectors`."""
    tiles: list[tuple[int, int]] = []
    for face in faces:
        x0, y0, _, x1, y1, _ = occ.getBoundingBox(*face)
        (dx, dy), cells = ((x1 - x0) / _TILES, (y1 - y0) / _TILES), np.ndindex(_TILES, _TILES)
        squares = [(2, occ.addRectangle(x0 + i * dx, y0 + j * dy, 0.0, dx, dy)) for i, j in cells]
        tiles += occ.intersect([face], squares, removeObject=False)[0]
    return tiles


def _part(gmsh: Any, file: CadFile, shape: tuple[int, int], label: str) -> CadPart:
    occ, dim = gmsh.model.occ, shape[0]
    corners = np.reshape(occ.getBoundingBox(*shape), (2, 3))
    # the kernel widens a box by its tolerance, 1e-7 of the file's unit, and so a face that has no thickness
    tolerance = 0.5 * (corners[1, 2] - corners[0, 2]) if dim == 2 else 0.0
    corners += np.array([[tolerance], [-tolerance]])
    box = tuple(round(MILLIMETRE * x, 9) + 0.0 for x in corners.ravel().tolist())
    size, radius = MILLIMETRE**dim * occ.getMass(*shape), MILLIMETRE * occ.getCenterOfMass(*shape)[0]
    return CadPart(own_name(label), file.region_of(label), size, box[:dim], box[3 : 3 + dim], radius)
