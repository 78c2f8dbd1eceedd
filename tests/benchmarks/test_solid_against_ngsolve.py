"""The field in 3D against NGSolve: sections, a slotted clutch, and the force of TEAM problem 20.

A scalar potential errs towards too much flux, a vector potential towards too little: on one mesh the truth
lies between, and the two are as close as the mesh is fine. Run: ``pytest tests/benchmarks -k ngsolve -s``.
"""

import math

import numpy as np
import pytest

pytest.importorskip("ngsolve")

from ngsolve_oracle import law_spline, solve_section
from ngsolve_solid import mesh_3d, solve_3d
from team_devices import Team20
from team_problems import team20_mesh

from field.laws.materials import material
from field.section.axisymmetric import AxisymmetricProblem
from field.three_d.current_source import FlatCoil
from field.three_d.scalar_potential import Problem3D
from geometry import Clutch, mesh_clutch
from geometry.slots import Slots
from geometry.slotted import mesh_slotted

DRIVE = 1500.0
STEEL = {name: material("steel_1010") for name in ("disc", "rotor", "housing")}
SLOTTED = Clutch(disc_slots=Slots(24, 0.4, 5e-3))
# Turned by a quarter of the pitch: near the greatest torque.
COGGING = Clutch(disc_slots=Slots(24, 0.4, 5e-3), rotor_slots=Slots(24, 0.4, 3e-3, angle=math.radians(4.0)))


def ring(clutch):
    half = 0.5 * clutch.coil_width
    return FlatCoil.ring((clutch.coil_inner_radius, clutch.coil_outer_radius), (-half, half))


def complete(mesh):
    return {name: STEEL.get(name, material("air")) for name in mesh.regions}


@pytest.mark.parametrize("name", ["steel_1010", "dc01", "team_steel"])
def test_the_spline_is_the_law(name):
    law = material(name)
    spline, B = law_spline(law), np.linspace(0.0, 4.0, 401)
    H, w = law.H_of_B(B)[0], law.energy_density(B)
    energy = spline.Integrate()
    assert np.array([spline(b) for b in B]) == pytest.approx(H, rel=1e-12, abs=1e-9)
    assert np.array([energy(b) for b in B]) == pytest.approx(w, rel=1e-11, abs=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_the_section_is_the_same_discrete_problem(order):
    """One mesh, one order, one quadrature: two codes must agree to what the Newton tolerance leaves."""
    mesh = mesh_clutch(Clutch(), size_factor=2.0)
    ours = AxisymmetricProblem(mesh, complete(mesh), order=order).solve(DRIVE)
    theirs = solve_section(mesh, STEEL, DRIVE, order)
    assert theirs["flux_linkage_per_turn"] == pytest.approx(ours.flux_linkage_per_turn, rel=1e-9)
    assert theirs["energy"] == pytest.approx(ours.energy, rel=1e-9)


def test_the_converted_mesh_has_the_same_curved_volumes():
    import ngsolve as ngs

    mesh = mesh_slotted(SLOTTED, size_factor=4.0, gap_layers=2)
    converted = mesh_3d(mesh)
    for name in mesh.regions:
        volume = ngs.Integrate(ngs.CF(1.0) * ngs.dx(definedon=converted.Materials(name)), converted)
        assert mesh.n_sectors * volume == pytest.approx(mesh.volume(name), rel=1e-9), name


@pytest.mark.parametrize(
    ("clutch", "layers", "typical", "worst"),
    [(Clutch(), 2, 0.015, 0.08), (SLOTTED, 2, 0.015, 0.08), (COGGING, 1, 0.06, 0.15)],
    ids=["plain", "slotted", "cogging"],
)
def test_scalar_and_vector_potential_bracket_the_slotted_clutch(clutch, layers, typical, worst):
    """A whole pitch has only one layer across the gap here, else edge elements take ten minutes."""
    mesh = mesh_slotted(clutch, size_factor=2.0 * (3 - layers), gap_layers=layers, wedge=math.pi / 24)
    ours = Problem3D(mesh, complete(mesh), ring(clutch), outer="flux_wall").solve(DRIVE)
    theirs = solve_3d(mesh, STEEL, ring(clutch), DRIVE, bodies=("disc",))
    print(
        f"\n{len(mesh.tetrahedra)} elements: linkage {ours.flux_linkage_per_turn * 1e3:.4f} mWb (scalar potential), "
        f"{theirs['flux_linkage_per_turn'] * 1e3:.4f} mWb (NGSolve, {theirs['dofs']} dofs)"
    )
    assert theirs["flux_linkage_per_turn"] < ours.flux_linkage_per_turn < 1.03 * theirs["flux_linkage_per_turn"]
    side = mesh.points[np.unique(mesh.boundaries["low_side"])]
    first = np.arctan2(*side[np.argmax(np.hypot(side[:, 0], side[:, 1])), 1::-1])
    angle = first + mesh.sector_angle * np.linspace(0.03, 0.97, 41)
    r = clutch.mean_gap_radius
    points = np.column_stack((r * np.cos(angle), r * np.sin(angle), np.full_like(angle, 9e-3)))
    B = np.array([theirs["B"](theirs["ng_mesh"](*point)) for point in points])
    difference = np.linalg.norm(ours.flux_density(points) - B, axis=1)
    # at the slots' edges B is singular, and neither code's raw B is smooth
    assert np.median(difference) < typical * np.linalg.norm(B, axis=1).max()
    assert np.sqrt(np.mean(difference**2)) < worst * np.linalg.norm(B, axis=1).max()
    if mesh.periodic is not None:
        torque = ours.body_force("disc").torque[2]
        print(f"torque {torque:.4f} N m, NGSolve {theirs['torques']['disc'][2]:.4f} N m")
        # with one layer across the gap the two lie 9 % apart; ours is 2.33 N m with two layers
        assert theirs["torques"]["disc"][2] == pytest.approx(torque, rel=0.12)


def test_without_slots_the_sector_is_the_axisymmetric_clutch():
    """The gap's B within 1 % of the section's, by both codes."""
    clutch = Clutch()
    section = mesh_clutch(clutch)
    plane = AxisymmetricProblem(section, complete(section)).solve(DRIVE)
    mesh = mesh_slotted(clutch, size_factor=2.0, wedge=math.pi / 24)
    space = Problem3D(mesh, complete(mesh), ring(clutch), outer="flux_wall").solve(DRIVE)
    z = np.concatenate((np.linspace(-13e-3, -5e-3, 9), np.linspace(5e-3, 13e-3, 9)))
    r, angle = clutch.mean_gap_radius, math.pi / 48
    B_plane = plane.flux_density(np.column_stack((np.full_like(z, r), z)))
    B_space = space.flux_density(
        np.column_stack((np.full_like(z, r * math.cos(angle)), np.full_like(z, r * math.sin(angle)), z))
    )
    radial = B_space[:, 0] * math.cos(angle) + B_space[:, 1] * math.sin(angle)
    assert np.abs(radial / B_plane[:, 0] - 1.0).max() < 0.01


def test_the_force_of_team_problem_20():
    """Both codes on a coarse mesh, at 5020 ampere-turns: 79.7 N were measured (Takahashi et al. 1994)."""
    it, mesh = Team20(), team20_mesh(2.0)
    drive, measured = it.measured[-1]
    ours = Problem3D(mesh, {name: it.laws.get(name, material("air")) for name in mesh.regions}, it.coil).solve(drive)
    theirs = solve_3d(mesh, it.laws, it.coil, drive, bodies=("pole",))
    pull = -ours.body_force("pole").force[2], -theirs["forces"]["pole"][2]
    print(f"\npull {pull[0]:.2f} N (scalar potential), {pull[1]:.2f} N (NGSolve), {measured} N measured")
    assert pull[0] == pytest.approx(pull[1], rel=0.02)
    assert pull[0] == pytest.approx(measured, rel=0.03)
