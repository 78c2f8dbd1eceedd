"""Two spheres of different radii on the axis of a uniform field: force and moments by the axisymmetric solver.

    python tests/benchmarks/unequal_spheres.py > tests/coupling/unequal_spheres.csv

writes the truth of `tests/coupling/test_one_energy.py` for such pairs. The smaller sphere has the radius 1; gaps are in
2 a_1 a_2/(a_1 + a_2), forces in mu_0 Ms^2, moments are mean magnetisations in Ms; Froehlich's law with a
susceptibility of 999. Elements of order 3, ten seconds; at a resolution of 1.25 forces are 1e-4 away.
"""

import argparse
import math

import numpy as np

from field import MU_0, AxisymmetricProblem, FroehlichLaw
from field.section.maxwell_force import _harmonic, force_of_weight
from geometry.mesher import MILLIMETRE, SECTION_OPTIONS, gmsh_model, read_section
from geometry.section import SectionMesh

LAW = FroehlichLaw(999.0, 1.7e6)
RADII, GAPS = (1.0, 1.5, 2.0), (0.01, 0.03, 0.1)
FIELDS = (18e3, 46e3, 80e3, 120e3, 200e3)  # A/m
# Element sizes, see `field.spheres.pair_mesh`
NECK, GROWTH, SURFACE, INSIDE, AIR, ROOM = 0.45, 0.4, 0.13, 0.25, 0.5, 1.3


def unequal_mesh(lower: float, upper: float, gap: float, resolution: float) -> SectionMesh:
    """Section with the regions `lower`, `upper` and `air`; lengths in metres, the outline's middle at 0."""
    half = lower + upper + 0.5 * gap
    radii = {"lower": lower, "upper": upper}
    centres = {"lower": lower - half, "upper": half - upper}
    middle = 2.0 * lower - half + 0.5 * gap
    a = 2.0 * lower * upper / (lower + upper)
    reach = ROOM * half

    def size(dim: int, tag: int, r: float, z: float, _: float, wanted: float) -> float:
        r, z = r * MILLIMETRE, z * MILLIMETRE
        thickness = gap + r * r / a
        sizes = [NECK * thickness + GROWTH * max(abs(z - middle) - 0.5 * thickness, 0.0), AIR]
        for name, radius in radii.items():
            depth = math.hypot(r, z - centres[name]) - radius
            sizes.append(
                min(SURFACE * radius - GROWTH * min(depth, 0.0), INSIDE * radius)
                if depth < 0.0
                else SURFACE * radius + GROWTH * depth
            )
        return min(sizes) / resolution / MILLIMETRE

    with gmsh_model(SECTION_OPTIONS) as gmsh:
        geo = gmsh.model.geo

        def point(r: float, z: float) -> int:
            return geo.addPoint(r / MILLIMETRE, z / MILLIMETRE, 0.0)

        origin, bottom, top, side = point(0.0, 0.0), point(0.0, -reach), point(0.0, reach), point(reach, 0.0)
        surfaces, arcs, through, ends = {}, [], [], [bottom]
        for name, radius in radii.items():
            z = centres[name]
            south, east, north, centre = point(0.0, z - radius), point(radius, z), point(0.0, z + radius), point(0.0, z)
            outline = [geo.addCircleArc(south, centre, east), geo.addCircleArc(east, centre, north)]
            axis = geo.addLine(south, north)
            surfaces[name] = geo.addPlaneSurface([geo.addCurveLoop([*outline, -axis])])
            arcs.append(outline)
            through.append(axis)
            ends += [south, north]
        ends.append(top)
        below, between, above = (geo.addLine(*ends[2 * n : 2 * n + 2]) for n in range(3))
        outer = [geo.addCircleArc(bottom, origin, side), geo.addCircleArc(side, origin, top)]
        loop = [
            *outer,
            -above,
            *(-one for one in reversed(arcs[1])),
            -between,
            *(-one for one in reversed(arcs[0])),
            -below,
        ]
        surfaces["air"] = geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.synchronize()
        for name, surface in surfaces.items():
            gmsh.model.addPhysicalGroup(2, [surface], name=name)
        gmsh.model.addPhysicalGroup(1, [below, between, above, *through], name="axis")
        gmsh.model.addPhysicalGroup(1, outer, name="outer")
        gmsh.model.mesh.setSizeCallback(size)
        gmsh.model.mesh.generate(2)
        mesh = read_section(gmsh)
    points = mesh.points.copy()
    for name, z in centres.items():
        even_out(points, mesh, name, z, radii[name])
    return SectionMesh(points, mesh.triangles, mesh.regions, mesh.boundaries)


def even_out(points: np.ndarray, mesh: SectionMesh, name: str, z: float, radius: float) -> None:
    """Give the polygon of a sphere the sphere's volume to the fourth order, as in `field.spheres.pair_mesh`."""
    sides = np.sort(mesh.triangles[mesh.regions[name]][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    edges = edges[uses == 1]
    edges = edges[points[edges].max(axis=1)[:, 0] > 0.0]
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    nodes, place = np.unique(edges, return_inverse=True)
    square = np.zeros(nodes.size)
    np.add.at(square, place.reshape(edges.shape), (length**2)[:, None])
    square /= np.bincount(place.ravel())
    points[nodes] += square[:, None] / (12.0 * radius**2) * (points[nodes] - (0.0, z))


def rows(lower: float, upper: float, gap: float, resolution: float):
    """Yield h [Ms], attraction [mu_0 Ms^2] and both mean magnetisations [Ms]."""
    mesh = unequal_mesh(lower, upper, gap * 2.0 * lower * upper / (lower + upper), resolution)
    problem = AxisymmetricProblem(mesh, {"lower": LAW, "upper": LAW}, order=3, open_boundary=True)
    moving, standing = np.zeros((2, len(mesh.points)), dtype=bool)
    moving[mesh.triangles[mesh.regions["upper"]]] = True
    standing[mesh.triangles[mesh.regions["lower"]]] = True
    standing[np.unique(mesh.boundaries["outer"])] = True
    u = np.clip(_harmonic(mesh, moving, standing), 0.0, 1.0)
    weight = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    psi = None
    for H in FIELDS:
        solution = problem.solve(0.0, guess=psi, boundary_field=MU_0 * H, tolerance=1e-8)
        psi = solution.psi
        gradient, B = problem.elements.flux(psi)
        moments = []
        for name, radius in (("lower", lower), ("upper", upper)):
            inside = mesh.regions[name]
            nu = LAW.H_of_B(B[inside])[0] / np.where(B[inside] > 0.0, B[inside], 1.0)
            moment = 2.0 * math.pi * ((1.0 / MU_0 - nu) * gradient[inside, 0] * problem.elements.weight[inside]).sum()
            moments.append(moment / (4.0 / 3.0 * math.pi * radius**3) / LAW.Ms)
        yield H / LAW.Ms, -force_of_weight(solution, weight) / (MU_0 * LAW.Ms**2), *moments


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resolution", type=float, default=2.0)
    chosen = parser.parse_args()
    print("radius,gap,h,force,moment_small,moment_large")
    for radius in RADII:
        for gap in GAPS:
            for row in rows(1.0, radius, gap, chosen.resolution):
                print(f"{radius:g},{gap:g}," + ",".join(f"{value:.6g}" for value in row), flush=True)
