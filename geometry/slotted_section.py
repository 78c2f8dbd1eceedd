"""The cross-section of a slotted clutch as triangles: faces with names, sizes of the mesh, slots cut into it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geometry.clutch import Clutch
from geometry.mesher import (
    MAX_TETRAHEDRA,
    MILLIMETRE,
    ROW_HEIGHT,
    add_half_disc,
    add_polygon,
    expected_triangles,
    gmsh_model,
    refuse_too_many,
)
from geometry.meshing import Extent, element_sizes
from geometry.meshing_3d import SOLID_OPTIONS, box_distance, set_sizes


def meshed_section(clutch: Clutch, layers: int, factor: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Triangulate the section.

    Returns
    -------
    points : ndarray (n, 2)
        (r, z) [m], r exactly 0 on the axis.
    triangles : ndarray (m, 3)
    owners : list of str
        What each triangle is; a name with a bar, ``"disc|disc_slots"``, is steel between the slots and `slots`
        in them.
    """
    with gmsh_model(SOLID_OPTIONS) as gmsh:
        names, tags = _section_faces(gmsh, clutch)
        gmsh.model.occ.synchronize()
        # the section's z is the model's y
        formulas = [
            (size, box_distance((r0, z0, 0.0), (r1, z1, 0.0)))
            for size, (r0, r1, z0, z1) in section_sizes(clutch, layers, factor)
        ]
        set_sizes(gmsh, formulas, factor * clutch.air_radius / 4.0)
        gmsh.model.mesh.generate(2)
        blocks = [gmsh.model.mesh.getElementsByType(2, tag)[1].reshape(-1, 3).astype(np.int64) for tag in tags]
        node, coordinates, _ = gmsh.model.mesh.getNodes()
    position = np.empty((int(node.max()) + 1, 3))
    position[node] = coordinates.reshape(-1, 3)
    used, flat = np.unique(np.concatenate(blocks), return_inverse=True)
    points = position[used, :2] * MILLIMETRE
    points[points[:, 0] < 1e-9 * clutch.air_radius, 0] = 0.0
    owners = [name for name, block in zip(names, blocks, strict=True) for _ in block]
    return points, flat.reshape(-1, 3), owners


def _section_faces(gmsh: Any, clutch: Clutch) -> tuple[list[str], list[int]]:
    """The faces of the section in the plane z = 0 of the model, and what each is.

    A name with a bar, ``"disc|disc_slots"``, is steel between the slots and `slots` in them.
    """
    occ = gmsh.model.occ
    tools = [add_half_disc(gmsh, 0.0, clutch.air_radius / MILLIMETRE)]
    names: list[str] = ["air"]
    polygons = [(name, polygon) for name, parts in clutch.section_polygons().items() for polygon in parts]
    half = 0.5 * clutch.coil_width
    polygons += _slot_polygons(clutch)
    polygons.append(("source", _rectangle(0.0, clutch.coil_outer_radius, -half, half)))
    for name, polygon in polygons:
        tools.append(add_polygon(occ, polygon))
        names.append(name)
    _, pieces = occ.fragment([(2, tools[0])], [(2, tag) for tag in tools[1:]])
    owner: dict[int, str] = {}
    for name, piece in zip(names, pieces, strict=True):
        for _, tag in piece:
            if name.endswith("_slots"):
                owner[tag] = f"{owner[tag]}|{name}"
            elif name != "source" and (name != "air" or tag not in owner):
                owner[tag] = name
    tags = sorted(owner)
    return [owner[tag] for tag in tags], tags


def _slot_polygons(clutch: Clutch) -> list[tuple[str, np.ndarray]]:
    """Position of the slots in the section, (r, z) [m]."""
    polygons = []
    if clutch.disc_slots is not None:
        rim, half = clutch.disc_radius, 0.5 * clutch.disc_thickness
        polygons.append(("disc_slots", _rectangle(rim - clutch.disc_slots.depth, rim, -half, half)))
    if clutch.rotor_slots is not None:
        bore, half, ring = clutch.bore_radius, 0.5 * clutch.rotor_length, 0.5 * clutch.ring_width
        bottom = bore + clutch.rotor_slots.depth
        polygons += [("rotor_slots", _rectangle(bore, bottom, *z)) for z in ((-half, -ring), (ring, half))]
    return polygons


def _rectangle(r0: float, r1: float, z0: float, z1: float) -> np.ndarray:
    return np.array([(r0, z0), (r1, z0), (r1, z1), (r0, z1)])


def gap_size(gap: float, layers: int, factor: float) -> float:
    """Side of the triangles across a gap [m]: by layers, of which a few always remain."""
    return gap * min(factor / layers, 1.0 / min(layers, 2)) / ROW_HEIGHT


def refuse_too_many_layers(sizes: Sequence[tuple[float, Extent]], layers: int) -> None:
    """Refuse a section of these sizes that is swept through so many layers, three tetrahedra a prism."""
    triangles = expected_triangles((size, r1 - r0, z1 - z0) for size, (r0, r1, z0, z1) in sizes)
    refuse_too_many(3.0 * triangles * layers, MAX_TETRAHEDRA, "tetrahedra")


def section_sizes(clutch: Clutch, layers: int, factor: float) -> list[tuple[float, Extent]]:
    """Return sizes of the triangles: gaps by layers, steel corners, the running clearance, the device by its size."""
    rim, face = (gap_size(gap, layers, factor) for gap in (clutch.gap, clutch.face_gap))
    # One P2 element spans the clearance; the floor keeps a hair-thin one from ruling the mesh.
    bore = factor * max(4.0 * clutch.clearance, clutch.housing_length / 100.0)
    device = factor * min(clutch.outer_radius / 10.0, clutch.housing_length / 5.0)
    sizes, corners = element_sizes(clutch, rim, face, bore, device)
    for slots, surface, inwards, reach in (
        (clutch.disc_slots, clutch.disc_radius, -1.0, 0.5 * clutch.disc_thickness),
        (clutch.rotor_slots, clutch.bore_radius, 1.0, 0.5 * clutch.rotor_length),
    ):
        if slots is not None:
            width = slots.pitch * min(slots.fraction, 1.0 - slots.fraction) * surface
            low, high = sorted((surface, surface + inwards * slots.depth))
            # of a slot shallower than the gap no more is seen in the gap than its own triangles resolve
            sizes.append((max(factor * min(width, slots.depth) / 3.0, rim), (low, high, -reach, reach)))
    return sizes + [(size, (r, r, z, z)) for size, r, z in corners]
