"""A device in 3D from CAD: named solids and the air around them as second-order tetrahedra.

Neighbouring solids share their faces after one fragmentation.  The element size of a part follows from its thickness
and grows in proportion to the distance from it: of a body of revolution, whose section the caller knows, the shorter
side of that section, across the powder's gap a number of layers; of any other solid the shortest side of its box.
The planes of the coil's two ends within its outer radius are faces of the mesh: a source field that jumps there is
integrated exactly.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_import import imported_solids
from geometry.cad_meshing import CadSection
from geometry.cad_parts import CadError, CadPart, CadSolid, list_of
from geometry.mesh_3d import Mesh3D
from geometry.mesher import GROWTH, MAX_TETRAHEDRA, MILLIMETRE, ROW_HEIGHT, refuse_too_many
from geometry.meshing_3d import (
    SOLID_OPTIONS,
    box_distance,
    faces_of,
    faces_where,
    finish,
    generate,
    set_sizes,
)

# Of a part's thickness; and of the whole device, coarsest and finest: a thin sheet must not rule the mesh.
_OF_THICKNESS, _COARSEST, _FINEST = 0.5, 1.0 / 12.0, 1.0 / 80.0
_OF_CUBE = 2.0**0.5 / 12.0  # volume of a regular tetrahedron over its side to the third power
_OVERLAP = 1e-6
_RECTANGLE = 1e-4  # of its area: corners that a CAD program rounds
_ON_SPHERE = 1e-6  # of the radius: nodes of the outer boundary lie on it exactly


def read_cad_solids(path: str | Path, **options: Any) -> list[CadSolid]:
    """The solids of a file; options and errors as `geometry.cad_import.imported_solids`."""
    with imported_solids(path, SOLID_OPTIONS, **options) as (_, solids, _):
        return solids


def check_device_3d(path: str | Path, section: CadSection) -> None:
    """Refuse what a field in 3D cannot carry: a coil that is no ring of rectangular section, a powder not round.

    Raises
    ------
    CadError
    """
    for region in ("coil", "powder"):
        if region in section.odd:
            raise CadError(
                f"{path}: {region!r} is no body of revolution about z; draw it as one, and the slots and teeth beside "
                f"it as parts of their own\n{list_of(section.parts)}"
            )
    coil = [part for part in section.parts if part.region == "coil"]
    full = [(part.r1 - part.r0) * (part.z1 - part.z0) for part in coil]
    if len(coil) != 1 or coil[0].area < (1.0 - _RECTANGLE) * full[0]:
        raise CadError(
            f"{path}: the coil of a field in 3D is one ring of rectangular section about z; found "
            f"{len(coil)} part(s) of other sections; draw it as one hollow cylinder\n{list_of(section.parts)}"
        )
    if section.odd and any(edge.region == "air" for edge in section.powder_outline):
        raise CadError(
            f"{path}: beside the powder is air in the half-plane y = 0, x > 0, and air is no body that grains could "
            "touch; draw what fills the slots as a part, or turn the device so that a tooth lies in that half-plane"
        )


def mesh_cad_solids(
    path: str | Path,
    *,
    section: CadSection | None = None,
    gap_layers: int = 3,
    size_factor: float = 1.0,
    air_factor: float = 2.0,
    order: int = 2,
    **options: Any,
) -> Mesh3D:
    """Fill a file's solids, and a sphere of air around them, with tetrahedra.

    Parameters
    ----------
    path : str or Path
    section : CadSection, optional
        Of the same file about z, read with `any_shape`: sizes the bodies of revolution, and says where the coil is.
    gap_layers : int
        Elements across the powder's gap, of which two remain whatever the size factor; needs the section.
    size_factor : float
        Scales every element size, 0.2 to 4.
    air_factor : float
        Radius of the sphere of air over that of the sphere around the device, 1.2 to 20.
    order : int
        1: flat faces, 2: curved.
    **options
        `names`, `needed`, `known`, `scale` of `imported_solids`.

    Returns
    -------
    Mesh3D
        Regions by name, ``air`` among them; boundary ``outer``.

    Raises
    ------
    CadError, ValueError
    """
    for name, value, low, high in (("size_factor", size_factor, 0.2, 4.0), ("air_factor", air_factor, 1.2, 20.0)):
        if not low <= value <= high:
            raise ValueError(f"`{name}` = {value:g}: allowed are {low:g} to {high:g}")
    if order not in (1, 2):
        raise ValueError(f"`order` = {order}: allowed are 1 (flat faces) and 2 (curved)")
    with imported_solids(path, SOLID_OPTIONS, **options) as (gmsh, solids, tags):
        lower = np.min([solid.lower for solid in solids], axis=0)
        upper = np.max([solid.upper for solid in solids], axis=0)
        middle, device = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
        radius = 0.5 * air_factor * device
        sizes = _sizes(solids, device, size_factor, section, gap_layers)
        expected = sum(volume / (_OF_CUBE * size**3) for size, _, volume in sizes)
        refuse_too_many(expected, MAX_TETRAHEDRA, "tetrahedra")
        coil = [] if section is None else [part for part in section.parts if part.region == "coil"]
        volumes = _fragments(gmsh, Path(path), solids, tags, coil, middle / MILLIMETRE, radius / MILLIMETRE)
        formulas = [(size, distance) for size, distance, _ in sizes]
        set_sizes(gmsh, formulas, far=size_factor * radius / 4.0, growth=GROWTH)
        points, elements, regions = generate(gmsh, volumes, order)
    faces, sides = faces_of(elements[:, :4])
    outline = faces[sides[:, 1] < 0]
    outer = faces_where(
        points, outline, lambda at: np.abs(np.linalg.norm(at - middle, axis=1) - radius) < _ON_SPHERE * radius
    )
    return finish(points, elements, regions, {"outer": outer})


def _sizes(
    solids: list[CadSolid], device: float, size_factor: float, section: CadSection | None, layers: int
) -> list[tuple[float, str, float]]:
    """Size [m] of each solid, the distance to it, its volume [m^3]; of bodies of revolution of a section, its rings."""
    boxes = [] if section is None else [part for part in section.parts if part.region not in section.odd]
    round_regions = {part.region for part in boxes}
    sizes = []
    for part in boxes:
        size = _size(min(part.r1 - part.r0, part.z1 - part.z0), device, size_factor)
        if section is not None and part.region == "powder":
            size = min(size, section.gap * min(size_factor / layers, 1.0 / min(layers, 2)) / ROW_HEIGHT)
        sizes.append((size, _ring_distance(part), 2.0 * np.pi * part.radius * part.area))
    for solid in solids:
        if solid.region not in round_regions:
            thickness = min(b - a for a, b in zip(solid.lower, solid.upper, strict=True))
            sizes.append((_size(thickness, device, size_factor), box_distance(solid.lower, solid.upper), solid.volume))
    return sizes


def _size(thickness: float, device: float, size_factor: float) -> float:
    return size_factor * min(max(_OF_THICKNESS * thickness, _FINEST * device), _COARSEST * device)


def _ring_distance(part: CadPart) -> str:
    """Distance to the ring of a rectangle of the section, a formula in millimetres."""
    r0, r1, z0, z1 = (x / MILLIMETRE for x in (part.r0, part.r1, part.z0, part.z1))
    r = "Sqrt(x^2+y^2)"
    return f"Sqrt(Max({r0:.12g}-{r},{r}-({r1:.12g}),0)^2+Max({z0:.12g}-z,z-({z1:.12g}),0)^2)"


def _fragments(
    gmsh: Any,
    path: Path,
    solids: list[CadSolid],
    tags: list[int],
    coil: list[CadPart],
    middle: np.ndarray,
    radius: float,
) -> dict[str, list[int]]:
    """Volumes by region, ``air`` among them, neighbours sharing their faces; cut at the ends of the coil's parts."""
    occ = gmsh.model.occ
    ball = occ.addSphere(*middle, radius)
    ends = [occ.addDisk(0.0, 0.0, z / MILLIMETRE, *2 * (part.r1 / MILLIMETRE,))
            for part in coil for z in (part.z0, part.z1)]  # fmt: skip
    _, pieces = occ.fragment([(3, ball)], [*((3, tag) for tag in tags), *((2, tag) for tag in ends)])
    occ.synchronize()
    owner: dict[int, CadSolid] = {}
    for solid, mine in zip(solids, pieces[1 : 1 + len(solids)], strict=True):
        for _, tag in mine:
            if tag in owner:
                volume = MILLIMETRE**3 * occ.getMass(3, tag)
                if volume > _OVERLAP * min(solid.volume, owner[tag].volume):
                    place = ", ".join(f"{x:.4g}" for x in occ.getCenterOfMass(3, tag))
                    raise CadError(
                        f"{path}: {owner[tag].region!r} and {solid.region!r} overlap by {1e9 * volume:.3g} mm3 around "
                        f"({place}) mm; cut one out of the other in the CAD program\n{list_of(solids)}"
                    )
            owner[tag] = solid
    volumes: dict[str, list[int]] = {}
    for tag, solid in owner.items():
        volumes.setdefault(solid.region, []).append(tag)
    volumes["air"] = volumes.get("air", []) + [tag for _, tag in pieces[0] if tag not in owner]
    return volumes
