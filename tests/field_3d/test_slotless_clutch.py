"""A clutch whose slots vanish: the field in 3D must be that of the section, mesh by mesh.

A scalar potential has too much energy, a vector potential too little (Hammond and Penman 1976): the section's
P2 answer and that in 3D enclose the truth, and their mean is closer to it than either.
Run with -s for the table.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from field import AIR, MU_0, AxisymmetricProblem, material
from field.three_d import FlatCoil, Problem3D
from geometry import Clutch, mesh_clutch
from geometry.slots import Slots
from geometry.slotted import mesh_slotted

pytestmark = pytest.mark.physics

SMALL = Clutch(
    disc_radius=20e-3, disc_thickness=8e-3, gap=1e-3, face_gap=1e-3, seal_radius=19e-3, rotor_wall=3e-3,
    ring_width=3e-3, cover_thickness=2e-3, clearance=0.3e-3, coil_width=6e-3, coil_height=6e-3, yoke=4e-3,
    shaft_radius=4e-3,
)  # fmt: skip
CLUTCHES = {"default": (Clutch(), 1500.0), "quickstart": (SMALL, 500.0)}
# size factor, layers: the small clutch takes finer meshes to as small an error
MESHES = {"default": ((4.0, 2), (2.0, 2)), "quickstart": ((4.0, 2), (1.0, 3))}


def laws(mesh):
    steel = material("steel_1010")
    return {name: steel if name in ("disc", "rotor", "housing") else AIR for name in mesh.regions}


def coil(clutch):
    half = 0.5 * clutch.coil_width
    return FlatCoil.ring((clutch.coil_inner_radius, clutch.coil_outer_radius), (-half, half))


def pole_points(clutch):
    """(r, z) in the middle of the rim gap under the poles, a gap's width and more from their edges."""
    low, high = 0.5 * clutch.ring_width + clutch.gap, 0.5 * clutch.disc_thickness - clutch.gap
    z = np.linspace(low, high, 12)[1:-1] if high > low else np.array([0.5 * (low + high)])
    z = np.concatenate((-z, z))
    return np.column_stack((np.full_like(z, clutch.mean_gap_radius), z))


def gap_B(field, points, angles):
    """B_r [T] from the recovered H at points (r, z) and angles, shape (angles, points)."""
    r, z = points.T
    x = [np.column_stack((r * np.cos(a), r * np.sin(a), z)) for a in angles]
    H = field.sampler().sample(np.concatenate(x))[0].reshape(len(angles), -1, 3)
    return MU_0 * (H[..., 0] * np.cos(angles)[:, None] + H[..., 1] * np.sin(angles)[:, None])


@pytest.mark.parametrize("name", CLUTCHES)
def test_without_slots_it_is_the_axisymmetric_clutch(name):
    """Same laws, same open boundary: gap B within 0.6 % on the finer mesh, nearer than on the coarser one."""
    clutch, drive = CLUTCHES[name]
    section = mesh_clutch(clutch, size_factor=0.7, gap_layers=4)
    truth = AxisymmetricProblem(section, laws(section), order=3, open_boundary=True).solve(drive)
    points = pole_points(clutch)
    B = truth.flux_density(points)[:, 0]
    errors, linkages, means = [], [], []
    for factor, layers in MESHES[name]:
        mesh = mesh_slotted(clutch, size_factor=factor, gap_layers=layers, wedge=math.pi / 24)
        space = Problem3D(mesh, laws(mesh), coil(clutch)).solve(drive, tolerance=1e-4)
        flat = mesh_clutch(clutch, size_factor=factor, gap_layers=max(layers, 3))
        plane = AxisymmetricProblem(flat, laws(flat), open_boundary=True).solve(drive)
        found = gap_B(space, points, np.array([0.01, 0.07, 0.12]))
        errors.append(np.abs(found / B - 1.0).max())
        linkages.append([x.flux_linkage_per_turn / truth.flux_linkage_per_turn - 1.0 for x in (space, plane)])
        means.append(abs(0.5 * (found.mean(axis=0) + plane.flux_density(points)[:, 0]) / B - 1.0).max())
        print(
            f"\n{name}: {space.problem.n_dofs} unknowns, gap B within {100 * errors[-1]:.2f} %, "
            f"linkage {100 * linkages[-1][0]:+.2f} %; section of {plane.problem.n_dofs}: linkage "
            f"{100 * linkages[-1][1]:+.2f} %; mean of both: gap B within {100 * means[-1]:.2f} %",
            end="",
        )
    above, below = np.transpose(linkages)
    assert errors[-1] < 0.006 and max(errors) < 0.013
    assert errors[0] > errors[1]
    assert np.all(above > 0.0) and np.all(below < 0.0)
    assert np.all(np.diff(above) < 0.0) and above[-1] < 0.006
    assert all(mean < 0.7 * error for mean, error in zip(means, errors, strict=True))


def test_slots_full_of_steel_are_no_slots():
    """Layers graded towards the slots' sides, steel in the slots: the field of the clutch without slots."""
    slotted, drive = replace(SMALL, disc_slots=Slots(12, 0.4, 3e-3)), 500.0
    graded = mesh_slotted(slotted, size_factor=4.0, gap_layers=2)
    plain = mesh_slotted(SMALL, size_factor=4.0, gap_layers=2, wedge=math.pi / 12)
    steel = {**laws(graded), "slots": material("steel_1010")}
    found = Problem3D(graded, steel, coil(slotted)).solve(drive, tolerance=1e-4)
    expected = Problem3D(plain, laws(plain), coil(slotted)).solve(drive, tolerance=1e-4)
    points = pole_points(slotted)
    angles = np.array([0.005, 0.03, 0.052, 0.1])
    assert np.allclose(gap_B(found, points, angles), gap_B(expected, points, angles), rtol=0.003)
    assert found.flux_linkage_per_turn == pytest.approx(expected.flux_linkage_per_turn, rel=0.002)
