"""Mesh of a clutch's cross-section by gmsh, with regions and boundaries by name.

The parts of the section are cut out of the air's half-disc by one fragmentation, so that neighbours share their edges.

Element sizes: inside the gaps that of a whole number of rows of equilateral triangles, a quarter of it at
the steel corners beside the gap (where the field strength is singular like d^(-1/3)), and from there h
grows in proportion to the distance: in iron and coil up to a fraction of the device, in the air up to an
eighth of its radius.
"""

from __future__ import annotations

from typing import Any

from geometry.clutch import Clutch
from geometry.fault import GeometryError
from geometry.mesher import (
    CORNER,
    MAX_TRIANGLES,
    MILLIMETRE,
    MINIMUM_LAYERS,
    ROW_HEIGHT,
    SECTION_OPTIONS,
    add_half_disc,
    add_polygon,
    add_size_field,
    check_mesh_options,
    expected_triangles,
    gmsh_model,
    read_section,
    refuse_too_many,
    use_least_size,
)
from geometry.refinement import without_tangles
from geometry.section import SectionMesh

Extent = tuple[float, float, float, float]
"""r0, r1, z0, z1 of a rectangle [m]."""


def mesh_clutch(clutch: Clutch, *, gap_layers: int = 4, size_factor: float = 1.0) -> SectionMesh:
    """Triangulate the cross-section of a clutch and the air around it.

    Parameters
    ----------
    clutch : Clutch
        Its faults are looked for first.
    gap_layers : int
        Elements across the rim gap and across the face gaps, at least 3.
    size_factor : float
        Scales every element size, 0.1 to 4; whatever it is, three layers across the gaps remain.

    Raises
    ------
    GeometryError
        With every fault of the clutch.
    ValueError
        For too few layers, or a size factor out of range.
    """
    faults = clutch.faults()
    if faults:
        raise GeometryError(faults)
    check_mesh_options(gap_layers, size_factor)
    layers = max(float(gap_layers), MINIMUM_LAYERS * size_factor)
    refuse_too_many(_expected(clutch, layers, size_factor), MAX_TRIANGLES, "triangles")
    with gmsh_model(SECTION_OPTIONS | {"Mesh.MeshSizeFactor": size_factor}) as gmsh:
        surfaces = _fragments(gmsh, clutch)
        for name, tags in surfaces.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        for name, tags in _named_curves(gmsh, clutch, surfaces).items():
            gmsh.model.addPhysicalGroup(1, tags, name=name)
        _set_sizes(gmsh, clutch, layers)
        gmsh.model.mesh.generate(2)
        return without_tangles(read_section(gmsh)).mesh


def _fragments(gmsh: Any, clutch: Clutch) -> dict[str, list[int]]:
    """Cut the parts out of the air; return the surfaces of every region, ``air`` among them."""
    occ = gmsh.model.occ
    air = add_half_disc(gmsh, 0.0, clutch.air_radius / MILLIMETRE)
    arcs = {"housing": clutch.fillet_arcs()}
    parts = [(name, add_polygon(occ, polygon, arcs.get(name, ())))
             for name, polygons in clutch.section_polygons().items() for polygon in polygons]  # fmt: skip
    _, pieces = occ.fragment([(2, air)], [(2, tag) for _, tag in parts])
    occ.synchronize()
    surfaces: dict[str, list[int]] = {}
    for (name, _), piece in zip(parts, pieces[1:], strict=True):
        surfaces.setdefault(name, []).extend(tag for _, tag in piece)
    used = {tag for tags in surfaces.values() for tag in tags}
    surfaces["air"] = [tag for _, tag in pieces[0] if tag not in used]
    return surfaces


def _named_curves(gmsh: Any, clutch: Clutch, surfaces: dict[str, list[int]]) -> dict[str, list[int]]:
    """Name axis, outer arc and the powder's faces by where the middle of each curve lies."""
    everything = [(2, tag) for tags in surfaces.values() for tag in tags]
    curves: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getBoundary(everything, combined=True, oriented=False):
        r = gmsh.model.occ.getCenterOfMass(1, tag)[0]
        curves.setdefault("axis" if r < 1e-6 else "outer", []).append(tag)
    for _, tag in gmsh.model.getBoundary([(2, tag) for tag in surfaces["powder"]], combined=True, oriented=False):
        r, z, _ = (MILLIMETRE * x for x in gmsh.model.occ.getCenterOfMass(1, tag))
        name = next((name for name, lies_on in powder_faces(clutch, r, z).items() if lies_on), "disc_faces")
        curves.setdefault(name, []).append(tag)
    return curves


def powder_faces(clutch: Clutch, r: Any, z: Any) -> dict[str, Any]:
    """Return, by the name of each face of the powder, which of the points (r, z) [m] of its outline lie on it."""
    close = 1e-4 * min(clutch.gap, clutch.face_gap)
    return {
        "rotor_bore": abs(r - clutch.bore_radius) < close,
        "rotor_faces": abs(abs(z) - 0.5 * clutch.cavity_length) < close,
        "disc_rim": abs(r - clutch.disc_radius) < close,
        "seal_rim": abs(r - clutch.seal_radius) < close,
        "disc_faces": abs(abs(z) - 0.5 * clutch.disc_thickness) < close,
    }


def _expected(clutch: Clutch, layers: float, factor: float) -> float:
    """Estimate how many triangles the mesh will have."""
    boxes, _ = _sizes(clutch, layers)
    return expected_triangles((size, r1 - r0, z1 - z0) for size, (r0, r1, z0, z1) in boxes) / factor**2


def _sizes(clutch: Clutch, layers: float) -> tuple[list[tuple[float, Extent]], list[tuple[float, float, float]]]:
    """Return element sizes before the size factor, of boxes and at corners, as `element_sizes`."""
    rim, face = (gap / (layers * ROW_HEIGHT) for gap in (clutch.gap, clutch.face_gap))
    # One layer of P2 spans the running clearance well; the floor keeps a hair-thin one from ruling the mesh.
    bore = max(3.0 * clutch.clearance, clutch.housing_length / 200.0)
    return element_sizes(clutch, rim, face, bore, min(clutch.outer_radius / 20.0, clutch.housing_length / 8.0))


def element_sizes(
    clutch: Clutch, rim: float, face: float, bore: float, device: float
) -> tuple[list[tuple[float, Extent]], list[tuple[float, float, float]]]:
    """Return the element size [m] in each box of the section, and at each steel corner.

    Parameters
    ----------
    rim, face, bore, device : float
        Sizes [m] in the rim gap, in the face gaps, in the running clearance and in the whole device.

    Returns
    -------
    boxes : list of (size, (r0, r1, z0, z1)) [m]
    corners : list of (size, r, z) [m]
    """
    half, disc_half, rotor_half = (0.5 * x for x in (clutch.cavity_length, clutch.disc_thickness, clutch.rotor_length))
    seal, disc = clutch.seal_radius, clutch.disc_radius
    boxes: list[tuple[float, Extent]] = [
        (rim, (disc, clutch.bore_radius, -half, half)),
        (face, (seal, disc, disc_half, half)),
        (face, (seal, disc, -half, -disc_half)),
        (bore, (clutch.rotor_radius, clutch.housing_bore, -rotor_half, rotor_half)),
        (device, (0.0, clutch.outer_radius, -0.5 * clutch.length, 0.5 * clutch.length)),
    ]
    ring = 0.5 * clutch.ring_width
    upper = [
        (min(rim, face), disc, disc_half),
        (rim, clutch.bore_radius, ring),
        (bore, clutch.rotor_radius, ring),
        (min(bore, clutch.pole_edge or bore), clutch.housing_bore, 0.5 * clutch.coil_width),
    ]
    if clutch.pole_edge > 0.0:
        upper.append((min(bore, clutch.pole_edge), clutch.housing_bore, 0.5 * clutch.housing_length))
    if clutch.cover_magnetic:
        upper.append((face, seal, half))
    return boxes, [(CORNER * size, r, side) for size, r, z in upper if z > 0.0 for side in (-z, z)]


def _set_sizes(gmsh: Any, clutch: Clutch, layers: float) -> None:
    """Set element sizes before the size factor, as the least of a few boxes and balls that grow outwards."""
    far = clutch.air_radius / 8.0
    boxes, corners = _sizes(clutch, layers)
    fields = []
    for size, (r0, r1, z0, z1) in boxes:
        extent = {"XMin": r0, "XMax": r1, "YMin": z0, "YMax": z1, "ZMin": -1.0, "ZMax": 1.0}
        fields.append(add_size_field(gmsh, "Box", size, far, extent))
    for size, r, z in corners:
        fields.append(add_size_field(gmsh, "Ball", size, far, {"XCenter": r, "YCenter": z, "Radius": 0.0}))
    use_least_size(gmsh, fields)
