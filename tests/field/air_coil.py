"""The coil in air that the field's accuracy is measured on: its meshes, its exact field, and errors against it.

r 20 to 30 mm, z +-8 mm, 800 ampere-turns; the exact field is a superposition of loops.
"""

import numpy as np
from closed_forms import rectangular_coil_field

from field import MU_0
from geometry.mesher import SECTION_OPTIONS, gmsh_model, read_section

R_COIL, Z_COIL, NI = (20e-3, 30e-3), (-8e-3, 8e-3), 800.0
GAP = (32e-3, 36e-3, -12e-3, 12e-3)
RADIUS = 80e-3  # of the air; beyond it an open boundary


def half_disc(parts, step, growth, radius):
    """Rectangles {name: (r0, r1, z0, z1)} in a half-disc of air; element sizes step[name] + growth * distance."""
    mm = 1e3
    with gmsh_model(SECTION_OPTIONS) as gmsh:
        occ = gmsh.model.occ
        arc = occ.addCircle(0.0, 0.0, 0.0, radius * mm, angle1=-0.5 * np.pi, angle2=0.5 * np.pi)
        occ.synchronize()
        (_, south), (_, north) = gmsh.model.getBoundary([(1, arc)], combined=False)
        axis = occ.addLine(north, south)
        disc = occ.addPlaneSurface([occ.addCurveLoop([arc, axis])])
        tools = [(2, occ.addRectangle(a * mm, c * mm, 0, (b - a) * mm, (d - c) * mm)) for a, b, c, d in parts.values()]
        _, pieces = occ.fragment([(2, disc)], tools)
        occ.synchronize()
        surfaces = {name: [tag for _, tag in piece] for name, piece in zip(parts, pieces[1:], strict=True)}
        taken = {tag for tags in surfaces.values() for tag in tags}
        surfaces["air"] = [tag for _, tag in pieces[0] if tag not in taken]
        for name, tags in surfaces.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        rim = gmsh.model.getBoundary(
            [(2, t) for tags in surfaces.values() for t in tags], combined=True, oriented=False
        )
        curves = {"axis": [], "outer": []}
        for _, tag in rim:
            curves["axis" if occ.getCenterOfMass(1, tag)[0] < 1e-6 else "outer"].append(tag)
        for name, tags in curves.items():
            gmsh.model.addPhysicalGroup(1, tags, name=name)

        def size(dim, tag, r, z, _z, _size):
            near = [
                step[name] * mm + growth * np.hypot(max(a * mm - r, r - b * mm, 0.0), max(c * mm - z, z - d * mm, 0.0))
                for name, (a, b, c, d) in parts.items()
            ]
            return min(*near, radius * mm / 6.0)

        gmsh.model.mesh.setSizeCallback(size)
        gmsh.model.mesh.generate(2)
        return read_section(gmsh)


def coil_in_air(scale=1.0, growth=0.25):
    """Elements of 0.6 mm in the gap and 0.8 mm in the coil at scale 1, growing with the distance."""
    parts = {"coil": (*R_COIL, *Z_COIL), "powder": GAP}
    return half_disc(parts, {"coil": 0.8e-3 * scale, "powder": 0.6e-3 * scale}, growth * scale, RADIUS)


def exact(r, z, coil=(R_COIL, Z_COIL, NI)):
    """H (2, n) and its derivatives (2, 2, n): along z by differences of sixth order, along r from curl and div."""

    def H_at(z):
        return np.array(rectangular_coil_field(*coil, r, z))

    H, d = H_at(z), 1e-4
    along_z = sum(c * (H_at(z + k * d) - H_at(z - k * d)) for k, c in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))) / d
    along_r = np.array([-H[0] / r - along_z[1], along_z[0]])
    return H, np.stack((along_r, along_z), axis=1)


class Reference:
    """Random points, the exact field there, and relative RMS errors against it."""

    def __init__(self, n, low, high, field=exact):
        self.r, self.z = np.random.default_rng(1).uniform(low, high, (n, 2)).T
        self.position = np.column_stack((self.r, np.zeros(n), self.z))
        self.H, self.dH = field(self.r, self.z)

    def errors(self, H, dH):
        hoop = ((H[0] - self.H[0]) / self.r, self.H[0] / self.r)
        size = np.sqrt((self.dH**2).sum() + (hoop[1] ** 2).sum())
        return (
            np.linalg.norm(H - self.H) / np.linalg.norm(self.H),
            np.sqrt(((dH - self.dH) ** 2).sum() + (hoop[0] ** 2).sum()) / size,
        )

    def of(self, sampler):
        H, grad = sampler.sample(self.position)
        return self.errors(H[:, ::2].T, grad[:, ::2, ::2].transpose(1, 2, 0))

    def of_raw(self, field):
        """H of the finite elements themselves, and its differences over 2 um (few of which leave an element)."""
        d, points = 1e-6, np.column_stack((self.r, self.z))
        dH = [(field.flux_density(points + e) - field.flux_density(points - e)).T / (2 * d) for e in d * np.eye(2)]
        return self.errors(field.flux_density(points).T / MU_0, np.stack(dH, axis=1) / MU_0)
