"""A device from CAD: the named parts of a STEP file as the regions of an axisymmetric section, or as solids.

What may be in the file (STEP, IGES, BREP, or gmsh's own .geo with the OpenCASCADE kernel):

- **faces** in one plane, the half section: x is the radius, and y or z the axis, whichever plane they lie in;
- **solids of revolution** about z (or the axis that is named): they are cut by the half-plane, and a part whose
  volume is not that of its section turned (Pappus) is refused, because a slot would be lost without a message, or
  reported to a caller who solves the field in 3D.

A part's region is its name in the file (`geometry.cad_parts`); one without a name is ``part3``, say, by its number in
the order of the file, as are all parts of a BREP file.  Air need not be drawn: what no part fills is air, out to a half
disc around all.  STEP carries its unit of length; a BREP or .geo file is read in millimetres; ``scale`` mends a wrong
unit.
A .geo file is a script, and refused unless the caller trusts it (`geometry.file_content`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from geometry.cad_parts import CadFile, CadPart, own_name, plain_name
from geometry.file_content import SCRIPT, SHAPE_FORMATS, CadError, check_file
from geometry.mesher import MILLIMETRE, SECTION_OPTIONS, gmsh_model

SUFFIXES = (*SHAPE_FORMATS, SCRIPT)
_FLAT = 1e-5  # mm; coordinates in a STEP file are rounded to 1e-6 or better
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
            flat = _flat_section(gmsh, file.path, shapes)
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
            gmsh.model.occ.dilate(list(shapes), 0.0, 0.0, 0.0, *3 * (file.scale,))
            gmsh.model.occ.synchronize()
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
    shapes = {
        (dim, tag): gmsh.model.getPhysicalName(dim, group)
        for dim, group in groups
        for tag in gmsh.model.getEntitiesForPhysicalGroup(dim, group)
        if dim >= 2
    }
    if not built.issuperset(shapes):
        raise CadError(f'{path} uses the built-in kernel; begin it with SetFactory("OpenCASCADE");')
    names = {gmsh.model.getPhysicalName(*group) for group in groups}
    gmsh.model.removePhysicalGroups()
    for name in names:  # or the groups that we make later cannot have them
        gmsh.model.removePhysicalName(name)
    highest = max((dim for dim, _ in shapes), default=2)
    return {shape: name for shape, name in shapes.items() if shape[0] == highest}


def _flat_section(gmsh: Any, path: Path, shapes: _Shapes) -> list[tuple[int, str]]:
    """Turn the faces of a drawn section into the plane x, y."""
    boxes = [gmsh.model.occ.getBoundingBox(*shape) for shape in shapes]
    y0, z0, y1, z1 = (f(box[k] for box in boxes) for f, k in ((min, 1), (min, 2), (max, 4), (max, 5)))
    if max(abs(y0), abs(y1)) < _FLAT:
        gmsh.model.occ.rotate(list(shapes), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5 * math.pi)
        gmsh.model.occ.synchronize()
    elif max(abs(z0), abs(z1)) >= _FLAT:
        raise CadError(
            f"{path}: its faces lie neither in the plane y = 0 nor in z = 0 (y {y0:.4g} to {y1:.4g} mm, "
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
        turned = sum(2.0 * math.pi * occ.getCenterOfMass(*piece)[0] * occ.getMass(*piece) for piece in pieces)
        ratio, aside = occ.getMass(*solid) / turned, math.hypot(*occ.getCenterOfMass(*solid)[:2])
        # 0.1 %: far above the error of the volume's quadrature, far below a slot
        if abs(ratio - 1.0) > 1e-3 or aside > 1e-3 * reach:
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


def _part(gmsh: Any, file: CadFile, shape: tuple[int, int], label: str) -> CadPart:
    occ, dim = gmsh.model.occ, shape[0]
    # the kernel widens a box by 1e-7 mm
    box = tuple(round(MILLIMETRE * x, 9) + 0.0 for x in occ.getBoundingBox(*shape))
    size, radius = MILLIMETRE**dim * occ.getMass(*shape), MILLIMETRE * occ.getCenterOfMass(*shape)[0]
    return CadPart(own_name(label), file.region_of(label), size, box[:dim], box[3 : 3 + dim], radius)
