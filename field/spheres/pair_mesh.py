"""Mesh of two equal spheres on the axis: the upper one of them, over the plane of symmetry between them.

Lengths in radii, taken as metres.  The neck sets the sizes: the air between the spheres is gap + r^2 thick at the
radius r, and the elements there are a fraction of that; from the neck on they grow in proportion to the distance.
Triangles are straight, so the nodes of the sphere are put outside it by a twelfth of the square of their edges: the
polygon then has the sphere's outline on average, and what is left of its error is of the fourth order.
"""

from __future__ import annotations

import numpy as np

from geometry.mesher import MILLIMETRE, SECTION_OPTIONS, gmsh_model, read_section
from geometry.section import SectionMesh

# Element sizes at resolution 1 (in radii): across the neck as a fraction of its thickness, growth with distance, the
# most on the sphere, inside it and in the air around.
_NECK, _GROWTH = 0.45, 0.4
_SPHERE, _INSIDE, _AIR = 0.13, 0.25, 0.5
# Radius of the air over the reach of the spheres.
_ROOM = 1.3


def pair_mesh(gap: float, resolution: float = 1.0) -> SectionMesh:
    """Section of the upper of two spheres of radius 1 m.

    Parameters
    ----------
    gap : float
        Between the surfaces, in radii.
    resolution : float
        Divides every element size.

    Returns
    -------
    SectionMesh
        Regions `sphere` and `air`, boundaries `axis`, `mirror` (z = 0) and `outer`.
    """
    centre = 1.0 + 0.5 * gap
    reach = _ROOM * (centre + 1.0)

    def size(dim: int, tag: int, r: float, z: float, _: float, default_size: float) -> float:
        r, z = r * MILLIMETRE, z * MILLIMETRE
        thickness = gap + r * r
        neck = _NECK * thickness + _GROWTH * max(z - 0.5 * thickness, 0.0)
        depth = np.hypot(r, z - centre) - 1.0
        # inwards and outwards from the surface
        rest = min(_SPHERE + _GROWTH * max(-depth, 0.0), _INSIDE) if depth < 0.0 else _SPHERE + _GROWTH * depth
        return float(min(neck, rest, _AIR) / resolution / MILLIMETRE)

    with gmsh_model(SECTION_OPTIONS) as gmsh:
        geo = gmsh.model.geo
        origin, pole, equator, top, end, side, middle = (
            geo.addPoint(r / MILLIMETRE, z / MILLIMETRE, 0.0)
            for r, z in (
                (0.0, 0.0),
                (0.0, 0.5 * gap),
                (1.0, centre),
                (0.0, centre + 1.0),
                (0.0, reach),
                (reach, 0.0),
                (0.0, centre),
            )
        )
        below, through, above = geo.addLine(origin, pole), geo.addLine(pole, top), geo.addLine(top, end)
        lower, upper = geo.addCircleArc(pole, middle, equator), geo.addCircleArc(equator, middle, top)
        outer, mirror = geo.addCircleArc(side, origin, end), geo.addLine(origin, side)
        sphere = geo.addPlaneSurface([geo.addCurveLoop([lower, upper, -through])])
        air = geo.addPlaneSurface([geo.addCurveLoop([mirror, outer, -above, -upper, -lower, -below])])
        geo.synchronize()
        for name, surface in (("sphere", sphere), ("air", air)):
            gmsh.model.addPhysicalGroup(2, [surface], name=name)
        for name, curves in (("axis", [below, through, above]), ("mirror", [mirror]), ("outer", [outer])):
            gmsh.model.addPhysicalGroup(1, curves, name=name)
        gmsh.model.mesh.setSizeCallback(size)
        gmsh.model.mesh.generate(2)
        mesh = read_section(gmsh)
    points = mesh.points.copy()
    points[np.unique(mesh.boundaries["mirror"]), 1] = 0.0
    _even_out(points, mesh, centre)
    return SectionMesh(points, mesh.triangles, mesh.regions, mesh.boundaries)


def _even_out(points: np.ndarray, mesh: SectionMesh, centre: float) -> None:
    """Move the sphere's nodes outwards until its polygon has the sphere's volume to the fourth order; in place."""
    sides = np.sort(mesh.triangles[mesh.regions["sphere"]][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    edges = edges[uses == 1]
    edges = edges[points[edges].max(axis=1)[:, 0] > 0.0]  # without the axis
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    nodes, place = np.unique(edges, return_inverse=True)
    place = place.reshape(edges.shape)
    square = np.zeros(nodes.size)
    np.add.at(square, place, (length**2)[:, None])
    square /= np.bincount(place.ravel())
    from_centre = points[nodes] - (0.0, centre)
    points[nodes] += square[:, None] / 12.0 * from_centre
