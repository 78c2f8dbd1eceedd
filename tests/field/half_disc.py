"""Sections in a half-disc of air by gmsh, for the tests of the open boundary and of adaptivity."""

import numpy as np

from geometry import SectionMesh
from geometry.mesher import SECTION_OPTIONS, gmsh_model, read_section


def half_disc(parts, radius, size, *, air_size=None, z0=0.0, shell=None):
    """Rectangles {name: (r0, r1, z0, z1)} [m] that do not overlap, in air up to `radius` around (0, z0).

    Elements are `size` in and at the parts and grow to `air_size` (an eighth of the radius);
    with a `shell` no edge crosses the half-circle of that radius, and `within` can cut the mesh there.
    """
    shells = [radius] if shell is None else [radius, shell]
    air_size = min(air_size or radius / 8.0, radius / 3.0)
    with gmsh_model(SECTION_OPTIONS) as gmsh:
        occ, field, mm = gmsh.model.occ, gmsh.model.mesh.field, 1e3
        discs = []
        for distance in shells:
            arc = occ.addCircle(0.0, z0 * mm, 0.0, distance * mm, angle1=-0.5 * np.pi, angle2=0.5 * np.pi)
            occ.synchronize()
            (_, south), (_, north) = gmsh.model.getBoundary([(1, arc)], combined=False)
            discs.append(occ.addPlaneSurface([occ.addCurveLoop([arc, occ.addLine(north, south)])]))
        owners, tags = [], []
        for name, boxes in parts.items():
            for a, b, c, d in [boxes] if isinstance(boxes[0], float) else boxes:
                owners.append(name)
                tags.append(occ.addRectangle(a * mm, c * mm, 0.0, (b - a) * mm, (d - c) * mm))
        _, pieces = occ.fragment([(2, discs[0])], [(2, tag) for tag in tags + discs[1:]])
        occ.synchronize()
        surfaces = {}
        for name, piece in zip(owners, pieces[1 : 1 + len(tags)], strict=True):
            surfaces.setdefault(name, []).extend(tag for _, tag in piece)
        taken = {tag for group in surfaces.values() for tag in group}
        surfaces["air"] = [tag for _, tag in pieces[0] if tag not in taken]
        for name, group in surfaces.items():
            gmsh.model.addPhysicalGroup(2, group, name=name)
        curves = {}
        for _, tag in gmsh.model.getBoundary(
            [(2, t) for group in surfaces.values() for t in group], combined=True, oriented=False
        ):
            curves.setdefault("axis" if occ.getCenterOfMass(1, tag)[0] < 1e-6 else "outer", []).append(tag)
        for name, group in curves.items():
            gmsh.model.addPhysicalGroup(1, group, name=name)
        boxes = []
        for group in parts.values():
            for a, b, c, d in [group] if isinstance(group[0], float) else group:
                boxes.append(field.add("Box"))
                numbers = {"VIn": size, "VOut": air_size, "Thickness": (air_size - size) / 0.45}
                numbers |= {"XMin": a, "XMax": b, "YMin": c, "YMax": d}
                for key, value in numbers.items():
                    field.setNumber(boxes[-1], key, value * mm)
                field.setNumber(boxes[-1], "ZMin", -1.0)
                field.setNumber(boxes[-1], "ZMax", 1.0)
        least = field.add("Min")
        field.setNumbers(least, "FieldsList", boxes)
        field.setAsBackgroundMesh(least)
        gmsh.model.mesh.generate(2)
        return read_section(gmsh)


def within(mesh, radius):
    """The part of a mesh inside a `shell` around (0, 0), which becomes `outer`."""
    kept = np.flatnonzero(np.linalg.norm(mesh.centroid(), axis=1) < radius)
    nodes, triangles = np.unique(mesh.triangles[kept], return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    points = mesh.points[nodes]
    rim = edges[(uses == 1) & np.any(points[edges, 0] > 0.0, axis=1)]
    assert np.allclose(np.linalg.norm(points[np.unique(rim)], axis=1), radius), "the mesh has no such shell"
    regions = {name: np.flatnonzero(np.isin(kept, elements)) for name, elements in mesh.regions.items()}
    return SectionMesh(points, triangles, regions, {"outer": rim})
