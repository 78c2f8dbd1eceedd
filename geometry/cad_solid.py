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

from geometry.cad_import import open_solids
from geometry.cad_meshing import CadSection, own_pieces
from geometry.cad_parts import CadFile, CadPart, list_of
from geometry.file_content import CadError
from geometry.mesh_3d import Mesh3D
from geometry.mesher import GROWTH, MAX_TETRAHEDRA, MILLIMETRE, ROW_HEIGHT, refuse_too_many
from geometry.meshing_3d import SOLID_OPTIONS, box_distance, faces_of, faces_where, finish, generate, set_sizes

# Of a part's thickness; and of the whole device, coarsest and finest: a thin sheet must not rule the mesh.
_OF_THICKNESS, _COARSEST, _FINEST = 0.5, 1.0 / 12.0, 1.0 / 80.0
_OF_CUBE = 2.0**0.5 / 12.0  # volume of a regular tetrahedron over its side to the third power
_RECTANGLE = 1e-4  # of its area: corners that a CAD program rounds
_ON_SPHERE = 1e-6  # of the radius: nodes of the outer boundary lie on it exactly


def check_device_3d(path: str | Path, section: CadSection) -> None:
    """Refuse what a 3D field cannot carry: a coil that is no ring of rectangular section, powder missing or not round.

    Raises
    ------
    CadError
    """
    for region in ("coil", "powder"):
        if region in section.odd:
            raise CadError(
                f"{path}: {region!r} is not a body of revolution about z; draw it as one, and the slots and teeth of "
                f"other bodies as parts of their own\n{list_of(section.parts)}"
            )
    if all(part.region != "powder" for part in section.parts):
        raise CadError(
            f"{path}: a field in 3D is reported in the powder's gap, and no part is named 'powder'; draw the gap as "
            f"one, or solve the section (`three_dimensional` = false)\n{list_of(section.parts)}"
        )
    coil = _coil_of(section)
    if len(coil) != 1 or coil[0].size < (1.0 - _RECTANGLE) * np.prod(np.subtract(coil[0].upper, coil[0].lower)):
        raise CadError(
            f"{path}: the coil of a field in 3D is one ring of rectangular section about z; found "
            f"{len(coil)} part(s) of other sections; draw it as one hollow cylinder\n{list_of(section.parts)}"
        )
    if section.odd and any(edge.region == "air" for edge in section.powder_outline):
        raise CadError(
            f"{path}: next to the powder is air in the half-plane y = 0, x > 0, and air is not a body that grains "
            "could touch; draw what fills the slots as a part, or turn the device so that a tooth lies there"
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
        Those of a `CadFile`.

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
    file = CadFile(Path(path), **options)
    with open_solids(file, SOLID_OPTIONS) as (gmsh, solids, tags):
        lower = np.min([solid.lower for solid in solids], axis=0)
        upper = np.max([solid.upper for solid in solids], axis=0)
        middle, device = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
        radius = 0.5 * air_factor * device
        sizes = _sizes(solids, device, size_factor, section, gap_layers)
        expected = sum(volume / (_OF_CUBE * size**3) for size, _, volume in sizes)
        refuse_too_many(expected, MAX_TETRAHEDRA, "tetrahedra")
        occ = gmsh.model.occ
        ball = occ.addSphere(*middle / MILLIMETRE, radius / MILLIMETRE)
        ends = [
            occ.addDisk(0.0, 0.0, z / MILLIMETRE, *2 * (part.upper[0] / MILLIMETRE,))
            for part in ([] if section is None else _coil_of(section))
            for z in (part.lower[1], part.upper[1])
        ]
        _, pieces = occ.fragment([(3, ball)], [*((3, tag) for tag in tags), *((2, tag) for tag in ends)])
        occ.synchronize()
        volumes = own_pieces(pieces[: 1 + len(solids)], solids, occ, file.path)
        formulas = [(size, distance) for size, distance, _ in sizes]
        set_sizes(gmsh, formulas, far=size_factor * radius / 4.0, growth=GROWTH)
        points, elements, regions = generate(gmsh, volumes, order)
    faces, sides = faces_of(elements[:, :4])
    outline = faces[sides[:, 1] < 0]
    outer = faces_where(
        points, outline, lambda at: np.abs(np.linalg.norm(at - middle, axis=1) - radius) < _ON_SPHERE * radius
    )
    return finish(points, elements, regions, {"outer": outer})


def _coil_of(section: CadSection) -> list[CadPart]:
    return [part for part in section.parts if part.region == "coil"]


def _sizes(
    solids: list[CadPart], device: float, size_factor: float, section: CadSection | None, layers: int
) -> list[tuple[float, str, float]]:
    """Size [m] of each solid, the distance to it, its volume [m^3]; of bodies of revolution of a section, its rings."""

    def size_of(part: CadPart) -> float:
        thickness = min(b - a for a, b in zip(part.lower, part.upper, strict=True))
        return size_factor * min(max(_OF_THICKNESS * thickness, _FINEST * device), _COARSEST * device)

    rings = [] if section is None else [part for part in section.parts if part.region not in section.odd]
    sizes = []
    for part in rings:
        size = size_of(part)
        if section is not None and part.region == "powder":
            size = min(size, section.gap * min(size_factor / layers, 1.0 / min(layers, 2)) / ROW_HEIGHT)
        sizes.append((size, _ring_distance(part), 2.0 * np.pi * part.radius * part.size))
    round_regions = {part.region for part in rings}
    for solid in solids:
        if solid.region not in round_regions:
            sizes.append((size_of(solid), box_distance(solid.lower, solid.upper), solid.size))
    return sizes


def _ring_distance(part: CadPart) -> str:
    """Return the distance to the ring of a rectangle of the section, a formula in millimetres."""
    r0, z0, r1, z1 = (x / MILLIMETRE for x in (*part.lower, *part.upper))
    r = "Sqrt(x^2+y^2)"
    return f"Sqrt(Max({r0:.12g}-{r},{r}-({r1:.12g}),0)^2+Max({z0:.12g}-z,z-({z1:.12g}),0)^2)"
