"""A device from CAD: the named parts of a STEP file as the regions of an axisymmetric section.

What may be in the file (STEP, IGES, BREP, or gmsh's own .geo with the OpenCASCADE kernel):

- **faces** in one plane, the half section: x is the radius, and y or z the axis, whichever plane they lie in;
- **solids of revolution** about z (or the axis that is named): they are cut by the half-plane, and a part whose
  volume is not that of its section turned (Pappus) is refused, because a slot would be lost without a word, or told to
  a caller who solves the field in 3D.

A part's region is its name in the file (`geometry.cad_parts`); a BREP file has none, and its parts are ``part1``,
``part2`` and so on in the order of the file.  Air need not be drawn: what no part fills is air, out to a half disc
around all.  STEP carries its unit of length; a BREP or .geo file is read in millimetres; ``scale`` mends a wrong unit.
A .geo file is a script, and refused unless the caller trusts it (`geometry.file_content`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from geometry.cad_parts import CadError, CadPart, CadSolid, check_names, check_side, check_size, own_name, region_of
from geometry.file_content import SCRIPT, SHAPE_FORMATS, content_fault, untrusted_script
from geometry.mesher import MILLIMETRE, SECTION_OPTIONS, gmsh_model

SUFFIXES = (*SHAPE_FORMATS, SCRIPT)
_FLAT = 1e-5  # mm; coordinates in a STEP file are rounded to 1e-6 or better
_TURNED = {"x": (0.0, 1.0, 0.0, -0.5 * math.pi), "y": (1.0, 0.0, 0.0, 0.5 * math.pi)}  # brings that axis onto z


@contextmanager
def imported_section(
    path: str | Path,
    *,
    names: Mapping[str, str] | None = None,
    needed: Sequence[str] = (),
    known: Sequence[str] | None = None,
    axis: str = "z",
    scale: float = 1.0,
    trust_scripts: bool = False,
    any_shape: bool = False,
) -> Iterator[tuple[Any, list[CadPart], list[int], frozenset[str]]]:
    """Open a file in a gmsh model of its own: its section in the plane x = r, y = z, in millimetres.

    Parameters
    ----------
    path : str or Path
    names : mapping
        Region of a name in the file, where they differ.
    needed : sequence of str
        Regions that must be there.
    known : sequence of str, optional
        All regions that may be there; None: any.
    axis : {"x", "y", "z"}
        Axis of revolution of solids; sections of faces say it by their plane.
    scale : float
        Factor on all lengths.
    trust_scripts : bool
        Whether a .geo file may be run; it can run any command.
    any_shape : bool
        Whether solids may be of any shape.

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
    path = _checked(Path(path), axis, scale, trust_scripts)
    with _opened(path, scale, SECTION_OPTIONS) as (gmsh, raw):
        if any_shape and max(dim for dim, _ in raw) < 3:
            raise CadError(f"{path} holds faces but no solids; export solid bodies, or take it as a section")
        names, expected = names or {}, [*needed, *(known or ())]
        if max(dim for dim, _ in raw) == 3:
            flat, odd = _cut(gmsh, path, raw, axis, any_shape)
        else:
            flat, odd = _flat_section(gmsh, path, raw), []
        parts = [_part(gmsh, tag, name, region_of(name, names, expected)) for tag, name in flat]
        unseen = [CadPart(own_name(name), region_of(name, names, expected), *6 * (0.0,)) for name in odd]
        check_names(path, [*parts, *unseen], needed, known)
        check_side(path, parts)
        yield gmsh, parts, [tag for tag, _ in flat], frozenset(part.region for part in unseen)


@contextmanager
def imported_solids(
    path: str | Path,
    options: Mapping[str, float],
    *,
    names: Mapping[str, str] | None = None,
    needed: Sequence[str] = (),
    known: Sequence[str] | None = None,
    scale: float = 1.0,
    trust_scripts: bool = False,
) -> Iterator[tuple[Any, list[CadSolid], list[int]]]:
    """Open a file of solids in a gmsh model of its own, in millimetres; otherwise as `imported_section`.

    `options` are gmsh's for the mesh.
    """
    path = _checked(Path(path), "z", scale, trust_scripts)
    with _opened(path, scale, options) as (gmsh, raw):
        if max(dim for dim, _ in raw) < 3:
            raise CadError(f"{path} holds faces but no solids; export solid bodies, or take it as a section")
        solids = []
        for shape, label in raw.items():
            box = tuple(round(MILLIMETRE * x, 9) + 0.0 for x in gmsh.model.occ.getBoundingBox(*shape))
            volume = MILLIMETRE**3 * gmsh.model.occ.getMass(*shape)
            region = region_of(label, names or {}, [*needed, *(known or ())])
            solids.append(CadSolid(own_name(label), region, volume, box[:3], box[3:]))
        check_names(path, solids, needed, known)
        yield gmsh, solids, [tag for _, tag in raw]


@contextmanager
def _opened(path: Path, scale: float, options: Mapping[str, float]) -> Iterator[tuple[Any, dict[tuple[int, int], str]]]:
    """The solids or faces of a file with their labels, in a model of its own in millimetres."""
    with gmsh_model({**options, "Geometry.OCCImportLabels": 1}) as gmsh:
        unit = gmsh.option.getString("Geometry.OCCTargetUnit")
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        try:
            raw = _read(gmsh, path)
        finally:
            gmsh.option.setString("Geometry.OCCTargetUnit", unit)
        if scale != 1.0:
            gmsh.model.occ.dilate(list(raw), 0.0, 0.0, 0.0, scale, scale, scale)
            gmsh.model.occ.synchronize()
        check_size(path, _extent(gmsh, list(raw)), "export it in millimetres, or give `scale` = {factor}")
        yield gmsh, raw


def read_cad(path: str | Path, **options: Any) -> list[CadPart]:
    """The parts of a file's section; the options and errors of `imported_section`."""
    with imported_section(path, **options) as (_, parts, _, _):
        return parts


def _checked(path: Path, axis: str, scale: float, trust_scripts: bool) -> Path:
    if path.suffix.lower() not in SUFFIXES:
        raise CadError(f"{path} is no CAD file that is read here; give one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise CadError(f"{path} does not exist; check the path, which is relative to the scene's folder")
    if path.suffix.lower() == SCRIPT:
        if not trust_scripts:
            raise CadError(untrusted_script(path))
    elif fault := content_fault(path):
        raise CadError(f"{path} {fault}")
    if axis not in ("x", "y", "z"):
        raise CadError(f"`axis` = {axis!r}: allowed are x, y and z")
    if not (math.isfinite(scale) and scale > 0.0):
        raise CadError(f"`scale` = {scale}: allowed is a factor above 0, e.g. 0.001")
    return path


def _read(gmsh: Any, path: Path) -> dict[tuple[int, int], str]:
    """Solids or faces of a file, each with its name (a path of the tree, or a physical group's)."""
    try:
        if path.suffix.lower() == SCRIPT:
            gmsh.merge(str(path))
            shapes = _of_groups(gmsh, path)
        else:
            found = gmsh.model.occ.importShapes(
                str(path), highestDimOnly=True, format=SHAPE_FORMATS[path.suffix.lower()]
            )
            gmsh.model.occ.synchronize()
            found = [shape for shape in found if shape[0] >= 2]
            if path.suffix.lower() == ".brep":
                shapes = {shape: f"part{number}" for number, shape in enumerate(found, 1)}
            else:
                shapes = {shape: gmsh.model.getEntityName(*shape) for shape in found}
    except CadError:
        raise
    except Exception as error:  # gmsh raises plain Exception, with its own last message
        raise CadError(f"{path} cannot be read ({error}); export it again, best as STEP AP214 or AP242") from None
    if not shapes:
        raise CadError(f"{path} holds neither solids nor faces; export parts or the faces of a section, not curves")
    return shapes


def _of_groups(gmsh: Any, path: Path) -> dict[tuple[int, int], str]:
    """Entities of the physical groups of a .geo file, which are the regions there."""
    gmsh.model.occ.synchronize()
    built = set(gmsh.model.occ.getEntities())
    shapes: dict[tuple[int, int], str] = {}
    for dim, group in gmsh.model.getPhysicalGroups():
        for tag in gmsh.model.getEntitiesForPhysicalGroup(dim, group):
            if dim < 2:
                continue
            if (dim, tag) not in built:
                raise CadError(f'{path} uses the built-in kernel; begin it with SetFactory("OpenCASCADE");')
            shapes[dim, tag] = gmsh.model.getPhysicalName(dim, group)
    names = {gmsh.model.getPhysicalName(dim, group) for dim, group in gmsh.model.getPhysicalGroups()}
    gmsh.model.removePhysicalGroups()
    for name in names:  # or the groups that we make later cannot have them
        gmsh.model.removePhysicalName(name)
    dim = max((dim for dim, _ in shapes), default=2)
    return {shape: name for shape, name in shapes.items() if shape[0] == dim}


def _extent(gmsh: Any, shapes: list[tuple[int, int]]) -> float:
    """Largest side of the box around the shapes [m]."""
    boxes = [gmsh.model.occ.getBoundingBox(*shape) for shape in shapes]
    return MILLIMETRE * max(max(box[3 + k] for box in boxes) - min(box[k] for box in boxes) for k in range(3))


def _flat_section(gmsh: Any, path: Path, raw: Mapping[tuple[int, int], str]) -> list[tuple[int, str]]:
    """Faces of a drawn section, turned into the plane x, y."""
    boxes = [gmsh.model.occ.getBoundingBox(*shape) for shape in raw]
    y0, z0, y1, z1 = (f(box[k] for box in boxes) for f, k in ((min, 1), (min, 2), (max, 4), (max, 5)))
    if max(abs(y0), abs(y1)) < _FLAT:
        gmsh.model.occ.rotate(list(raw), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5 * math.pi)
        gmsh.model.occ.synchronize()
    elif max(abs(z0), abs(z1)) >= _FLAT:
        raise CadError(
            f"{path}: its faces lie neither in the plane y = 0 nor in z = 0 (y {y0:.4g} to {y1:.4g} mm, "
            f"z {z0:.4g} to {z1:.4g} mm); draw the half section there, x as the radius, or export solids"
        )
    return [(tag, name) for (_, tag), name in raw.items()]


def _cut(
    gmsh: Any, path: Path, raw: Mapping[tuple[int, int], str], axis: str, any_shape: bool
) -> tuple[list[tuple[int, str]], list[str]]:
    """Faces in which the half-plane cuts the solids, turned into the plane x, y; and what is no body of revolution."""
    occ, solids = gmsh.model.occ, list(raw)
    if axis in _TURNED:
        occ.rotate(solids, 0.0, 0.0, 0.0, *_TURNED[axis])
    occ.synchronize()
    boxes = [occ.getBoundingBox(*solid) for solid in solids]
    low, high = min(box[2] for box in boxes), max(box[5] for box in boxes)
    reach = max(max(abs(x) for x in box[:2] + box[3:5]) for box in boxes)
    faces: list[tuple[int, str]] = []
    odd: dict[str, float] = {}
    for solid in solids:
        plane = occ.addRectangle(0.0, low - reach, 0.0, 2.0 * reach, high - low + 2.0 * reach)
        occ.rotate([(2, plane)], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5 * math.pi)
        pieces, _ = occ.intersect([solid], [(2, plane)], removeObject=False, removeTool=True)
        pieces = [piece for piece in pieces if piece[0] == 2]
        if not pieces and any_shape:
            odd[raw[solid]] = math.inf
            continue
        if not pieces:
            raise CadError(
                f"{path}: part {own_name(raw[solid])!r} does not meet the half-plane y = 0, x > 0; the axis of "
                f"revolution must be {axis} through the origin: give `axis`, or move the parts in the CAD program"
            )
        occ.rotate(pieces, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5 * math.pi)
        turned = sum(2.0 * math.pi * occ.getCenterOfMass(*piece)[0] * occ.getMass(*piece) for piece in pieces)
        ratio, aside = occ.getMass(*solid) / turned, math.hypot(*occ.getCenterOfMass(*solid)[:2])
        # 0.1 %: far above the error of the volume's quadrature, far below a slot
        if abs(ratio - 1.0) > 1e-3 or aside > 1e-3 * reach:
            odd[raw[solid]] = ratio
        faces += [(tag, raw[solid]) for _, tag in pieces]
    occ.remove(solids, recursive=True)
    occ.synchronize()
    if odd and not any_shape:
        wrong = ", ".join(f"{own_name(label)!r} ({100.0 * ratio:.2f} %)" for label, ratio in odd.items())
        raise CadError(
            f"{path}: no solids of revolution about {axis}: {wrong} of the volume of the section turned; give the "
            "right `axis`, fill slots and holes, or solve the field in 3D (`three_dimensional`)"
        )
    return faces, list(odd)


def _part(gmsh: Any, tag: int, label: str, region: str) -> CadPart:
    occ = gmsh.model.occ
    # the kernel widens a box by 1e-7 mm
    r0, z0, _, r1, z1, _ = (round(MILLIMETRE * x, 9) + 0.0 for x in occ.getBoundingBox(2, tag))
    area, radius = MILLIMETRE**2 * occ.getMass(2, tag), MILLIMETRE * occ.getCenterOfMass(2, tag)[0]
    return CadPart(own_name(label), region, area, radius, r0, r1, z0, z1)
