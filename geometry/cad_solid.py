"""A device in space from CAD: named solids and the air around them as second-order tetrahedra.

Neighbouring solids share their faces after one fragmentation.  The element size of a part follows from its thickness
(the shortest side of its box) and grows in proportion to the distance from it; whoever needs more refines.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_import import imported_solids
from geometry.cad_parts import CadError, CadSolid, list_of
from geometry.meshing import GROWTH, MILLIMETRE
from geometry.solid_mesh import SolidMesh
from geometry.solid_meshing import (
    SOLID_OPTIONS,
    box_distance,
    faces_of,
    faces_where,
    finish,
    generate,
    region_ranges,
    set_sizes,
)

# Of a part's thickness; and of the whole device, coarsest and finest: a thin sheet must not rule the mesh.
_OF_THICKNESS, _COARSEST, _FINEST = 0.5, 1.0 / 12.0, 1.0 / 80.0
_OVERLAP = 1e-6
_ON_SPHERE = 1e-6  # of the radius: nodes of the outer boundary lie on it exactly


def read_cad_solids(path: str | Path, **options: Any) -> list[CadSolid]:
    """The solids of a file; options and errors as `geometry.cad_import.imported_solids`."""
    with imported_solids(path, SOLID_OPTIONS, **options) as (_, solids, _):
        return solids


def mesh_cad_solids(
    path: str | Path, *, size_factor: float = 1.0, air_factor: float = 2.0, order: int = 2, **options: Any
) -> SolidMesh:
    """Fill a file's solids, and a sphere of air around them, with tetrahedra.

    Parameters
    ----------
    path : str or Path
    size_factor : float
        Scales every element size, 0.2 to 4.
    air_factor : float
        Radius of the sphere of air over that of the sphere around the device, 1.2 to 10.
    order : int
        1: flat faces, 2: curved.
    **options
        `names`, `needed`, `known`, `scale` of `imported_solids`.

    Returns
    -------
    SolidMesh
        Regions by name, ``air`` among them; boundary ``outer``.

    Raises
    ------
    CadError, ValueError
    """
    for name, value, low, high in (("size_factor", size_factor, 0.2, 4.0), ("air_factor", air_factor, 1.2, 10.0)):
        if not low <= value <= high:
            raise ValueError(f"`{name}` = {value:g}: allowed are {low:g} to {high:g}")
    if order not in (1, 2):
        raise ValueError(f"`order` = {order}: allowed are 1 (flat faces) and 2 (curved)")
    with imported_solids(path, SOLID_OPTIONS, **options) as (gmsh, solids, tags):
        lower = np.min([solid.lower for solid in solids], axis=0)
        upper = np.max([solid.upper for solid in solids], axis=0)
        middle, device = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
        radius = 0.5 * air_factor * device
        volumes = _fragments(gmsh, Path(path), solids, tags, middle / MILLIMETRE, radius / MILLIMETRE)
        set_sizes(gmsh, _sizes(solids, device, size_factor), far=size_factor * radius / 4.0, growth=GROWTH)
        points, elements, sizes = generate(gmsh, volumes, order)
    regions = region_ranges(list(volumes), sizes)
    faces, sides = faces_of(elements[:, :4])
    outline = faces[sides[:, 1] < 0]
    outer = faces_where(
        points, outline, lambda at: np.abs(np.linalg.norm(at - middle, axis=1) - radius) < _ON_SPHERE * radius
    )
    return finish(points, elements, regions, {"outer": outer})


def _sizes(solids: list[CadSolid], device: float, size_factor: float) -> list[tuple[float, str]]:
    sizes = []
    for solid in solids:
        thickness = min(b - a for a, b in zip(solid.lower, solid.upper, strict=True))
        size = min(max(_OF_THICKNESS * thickness, _FINEST * device), _COARSEST * device)
        sizes.append((size_factor * size, box_distance(solid.lower, solid.upper)))
    return sizes


def _fragments(
    gmsh: Any, path: Path, solids: list[CadSolid], tags: list[int], middle: np.ndarray, radius: float
) -> dict[str, list[int]]:
    """Volumes by region, ``air`` among them, neighbours sharing their faces."""
    occ = gmsh.model.occ
    ball = occ.addSphere(*middle, radius)
    _, pieces = occ.fragment([(3, ball)], [(3, tag) for tag in tags])
    occ.synchronize()
    owner: dict[int, CadSolid] = {}
    for solid, mine in zip(solids, pieces[1:], strict=True):
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
