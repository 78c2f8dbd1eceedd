"""Axial forces: two coils against elliptic integrals, an ideal gap, balance, virtual work, and their convergence."""

import dataclasses
import math

import numpy as np
import pytest
from graded_lines import graded_lines
from scipy.special import ellipe, ellipk
from section_grid import section_grid

from field import MU_0, AxisymmetricProblem, GrainLaw, LinearLaw, PowderLaw, material
from field.section.maxwell_force import (
    _corner_forces,
    axial_force,
    body_weight,
    force_by_virtual_work,
    force_of_weight,
    lorentz_force,
    pole_pressure,
)

pytestmark = pytest.mark.physics

LEFT, RIGHT, NI = (20e-3, 30e-3, -22e-3, -8e-3), (24e-3, 32e-3, 4e-3, 14e-3), 800.0


def lines(values):
    """Sorted, without doubles to the nanometre, which would make slivers of elements."""
    return np.unique(np.round(values, 9))


def loop_force(R, S, distance):
    """Force along z on the farther of two coaxial loops with 1 A each [N]: dM/dz.

    M = mu_0 sqrt(RS) [(2/k - k) K - 2 E/k],  dM/dz = (mu_0 k z/(4 sqrt(RS))) [2 K - (2 - k^2)/(1 - k^2) E]
    (Maxwell, Treatise, art. 701).
    """
    m = 4.0 * R * S / ((R + S) ** 2 + distance**2)
    bracket = 2.0 * ellipk(m) - (2.0 - m) / (1.0 - m) * ellipe(m)
    return MU_0 * np.sqrt(m) * distance / (4.0 * np.sqrt(R * S)) * bracket


def coil_pull(a, b, ampere_turns_a, ampere_turns_b, n=14):
    """Pull towards one another of two coils with rectangular sections, by n^4 pairs of loops."""
    node, weight = np.polynomial.legendre.leggauss(n)
    axes = [np.array([0.5 * (lo + hi) + 0.5 * (hi - lo) * node]) for lo, hi in (a[:2], a[2:], b[:2], b[2:])]
    R, z, S, y = np.meshgrid(*axes, indexing="ij")
    w = np.einsum("i,j,k,l->ijkl", *[0.5 * weight] * 4)
    return ampere_turns_a * ampere_turns_b * float((w * -loop_force(R, S, y - z)).sum())


def test_the_oracle_is_the_derivative_of_the_mutual_inductance():
    def mutual(R, S, z):
        m = 4.0 * R * S / ((R + S) ** 2 + z**2)
        k = math.sqrt(m)
        return MU_0 * math.sqrt(R * S) * ((2.0 / k - k) * ellipk(m) - 2.0 / k * ellipe(m))

    slope = (mutual(0.02, 0.03, 0.01 + 1e-6) - mutual(0.02, 0.03, 0.01 - 1e-6)) / 2e-6
    assert loop_force(0.02, 0.03, 0.01) == pytest.approx(slope, rel=1e-8)


def two_coils(step, order):
    """Both coils carry the same current density in one region `coil`; the right one is its own region too."""
    growth = 1.4 ** (step / 2e-3)
    r = graded_lines(step, (18e-3, 34e-3), (0.0, 0.4), growth)
    z = graded_lines(step, (-24e-3, 16e-3), (-0.4, 0.4), growth)
    mesh = section_grid(r, z, {"left": LEFT, "right": RIGHT})
    both = {"air": mesh.regions["air"], "coil": np.union1d(mesh.regions["left"], mesh.regions["right"])}
    split = type(mesh)(mesh.points, mesh.triangles, both, mesh.boundaries)
    return AxisymmetricProblem(split, {}, order=order).solve(NI), mesh


def weight_of(mesh, field, name):
    """1 on one of the two coils, 0 on the other: the weight of a problem in which they are two regions."""
    other = "left" if name == "right" else "right"
    problem = AxisymmetricProblem(mesh, {name: material("air")}, coil_region=other)
    return body_weight(problem, [name])


def force_errors(step, order):
    areas = [(c[1] - c[0]) * (c[3] - c[2]) for c in (LEFT, RIGHT)]
    exact = coil_pull(LEFT, RIGHT, *[NI * area / sum(areas) for area in areas])
    field, mesh = two_coils(step, order)
    left, right = (force_of_weight(field, weight_of(mesh, field, name)) for name in ("left", "right"))
    assert right < 0.0 < left, "like currents attract"
    return abs(left / exact - 1.0), abs(right / -exact - 1.0)


def test_two_air_coils_against_elliptic_integrals():
    errors = np.array([force_errors(step, 2) for step in (2e-3, 1e-3)])
    # the flux wall at 0.4 m leaves some 5e-6
    assert errors.max() < 5e-5 and errors[1].max() < 1e-5, errors


@pytest.mark.parametrize(("order", "rate"), [(1, 2.0), (2, 4.0)])
def test_force_converges_at_twice_the_order(order, rate):
    """Uniform refinement of two coils in a flux box; quartic elements on the finest mesh are the truth."""
    regions = {"left": (20e-3, 28e-3, -24e-3, -8e-3), "coil": (24e-3, 32e-3, 8e-3, 16e-3)}

    def force(step, order):
        r, z = (lines(np.linspace(low, 60e-3, round((60e-3 - low) / step) + 1)) for low in (0.0, -60e-3))
        mesh = section_grid(r, z, regions)
        both = {
            "air": mesh.regions["air"],
            "coil": np.union1d(mesh.regions["left"], mesh.regions["coil"]),
        }
        solved = AxisymmetricProblem(type(mesh)(mesh.points, mesh.triangles, both, mesh.boundaries), {}, order=order)
        weight = body_weight(AxisymmetricProblem(mesh, {"left": material("air")}), ["left"])
        return force_of_weight(solved.solve(NI), weight)

    truth = force(2e-3, 4)
    errors = np.array([abs(force(step, order) - truth) for step in (4e-3, 2e-3, 1e-3)])
    assert np.log2(errors[0] / errors[2]) / 2.0 > 0.85 * rate, errors / abs(truth)


def plunger(step):
    """A steel plunger half out of a coil; the air's lines too are refined with the step."""
    growth = max(1.6 ** (step / 4e-3), 1.12)
    r = lines(np.concatenate((graded_lines(step, (0.0, 32e-3), (0.0, 0.3), growth), [10e-3, 14e-3, 22e-3])))
    z = graded_lines(step, (-32e-3, 32e-3), (-0.3, 0.3), growth)
    regions = {"iron": (0.0, 10e-3, -4e-3, 28e-3), "coil": (14e-3, 22e-3, -12e-3, 12e-3)}
    problem = AxisymmetricProblem(section_grid(r, z, regions), {"iron": material("steel_1010")})
    return problem.solve(3000.0, tolerance=1e-12)


@pytest.fixture(scope="module")
def plungers():
    """On meshes of 4, 2, 1 and 0.5 mm."""
    return [plunger(step) for step in (4e-3, 2e-3, 1e-3, 0.5e-3)]


def test_virtual_work_is_the_maxwell_stress(plungers):
    """The same derivative of the same discrete energy, once by hand and once by two solves: equal to O(d^2)."""
    field = plungers[1]
    force = axial_force(field, "iron", virtual_work=True)
    assert force.virtual_work == pytest.approx(force.maxwell_stress, rel=1e-4)
    assert abs(force.virtual_work - force.maxwell_stress) < force.error
    weight = body_weight(field.problem, ["iron"])
    errors = [abs(force_by_virtual_work(field, weight, d) - force.maxwell_stress) for d in (0.4e-3, 0.2e-3, 0.1e-3)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.2), errors


def test_displaced_solves_share_one_factorisation_and_are_those_of_the_moved_mesh(plungers):
    """Both forces for one factorisation; unknowns that moved with the body solve the problem rebuilt there."""
    field = plungers[1]
    before = field.problem._solver.factorisations
    weight = axial_force(field, "iron", virtual_work=True).weight
    assert field.problem._solver.factorisations == before + 1
    points = field.problem.mesh.points + 0.2e-3 * np.column_stack((np.zeros_like(weight), weight))
    moved = field.problem.with_points(points).solve(3000.0, guess=field, factorised=True, tolerance=1e-12)
    mesh = dataclasses.replace(field.problem.mesh, points=points)
    again = AxisymmetricProblem(mesh, {"iron": material("steel_1010")}).solve(3000.0, tolerance=1e-12)
    assert np.abs(moved.psi - again.psi).max() < 1e-10 * np.abs(again.psi).max()
    assert moved.energy == pytest.approx(again.energy, rel=1e-12)
    inside = np.array([[5e-3, 0.0]])
    assert moved.flux_density(inside) == pytest.approx(again.flux_density(inside), rel=1e-9)


def test_action_is_reaction(plungers):
    """Iron + coil + the rest = 0 to round-off; the rest is the discretisation's error and goes to nothing."""
    left = []
    for field in plungers:
        scale = 2.0 * np.pi * np.abs(_corner_forces(field)).sum()
        assert abs(force_of_weight(field, np.ones(len(field.problem.mesh.points)))) < 1e-12 * scale
        iron, coil = body_weight(field.problem, ["iron"]), body_weight(field.problem, ["coil"])
        # what the two leave is the weight of the air between and of the wall
        rest = force_of_weight(field, 1.0 - iron - coil)
        both = force_of_weight(field, iron) + force_of_weight(field, coil)
        assert abs(both + rest) < 1e-12 * scale
        left.append(abs(both / force_of_weight(field, iron)))
    assert left[0] < 1e-3 and left[-1] < 0.1 * left[0], left


def test_lorentz_force_converges_to_the_maxwell_stress(plungers):
    """J x B inside the coil against the stress in the air around it."""
    errors = [abs(lorentz_force(f) / axial_force(f, "coil").maxwell_stress - 1.0) for f in plungers]
    assert errors[0] < 3e-2 and errors[-1] < 1e-3, errors
    # iron corners: the energy, and so the force, is of order h^(4/3)
    assert np.all(np.diff(np.log2(errors)) < -1.0), errors


def test_error_estimate_is_of_the_errors_size(plungers):
    """Against the mesh of 0.5 mm: the difference of two shells is between a quarter of the error and ten times it."""
    *forces, best = (axial_force(field, "iron") for field in plungers)
    errors = [abs(force.maxwell_stress - best.maxwell_stress) for force in forces]
    assert np.all(np.diff(errors) < 0.0), errors
    for force, error in zip(forces, errors, strict=True):
        assert 1 / 4 < force.error / error < 10.0, (force, best)


def test_body_in_the_middle_feels_nothing():
    r = lines(np.concatenate((graded_lines(2e-3, (0.0, 24e-3), (0.0, 0.2)), [10e-3, 14e-3])))
    z = graded_lines(2e-3, (0.0, 20e-3), (0.0, 0.2))
    mesh = section_grid(
        r, np.concatenate((-z, z)), {"iron": (0.0, 10e-3, -8e-3, 8e-3), "coil": (14e-3, 22e-3, -12e-3, 12e-3)}
    )
    field = AxisymmetricProblem(mesh, {"iron": material("steel_1010")}).solve(2000.0)
    scale = MU_0 * 2000.0**2  # N: what the coil's force is made of
    assert abs(axial_force(field, "iron").maxwell_stress) < 1e-3 * scale
    assert abs(lorentz_force(field)) < 1e-3 * scale


def test_pole_pressure_in_an_ideal_gap():
    """A pot magnet's armature across a flat gap: F = B^2 A/(2 mu_0) of both poles, ideal iron.

    Gap 0.1 mm against poles of 9 and 10 mm: what fringes is a fraction of gap/pole.
    """
    gap = 0.1e-3
    r = lines(np.concatenate((graded_lines(1e-3, (0.0, 40e-3), (0.0, 0.1)), [14e-3, 28e-3, 34e-3])))
    below, above = graded_lines(0.4e-3, (-2e-3, 0.0), (-0.1, 0.0)), graded_lines(0.4e-3, (gap, gap + 2e-3), (gap, 0.1))
    z = lines(np.concatenate((np.linspace(0.0, gap, 5), below, above, [-16e-3, -24e-3, 12e-3])))
    regions = {
        "pot": (0.0, 34e-3, -24e-3, 0.0),
        "coil": (14e-3, 28e-3, -16e-3, 0.0),
        "armature": (0.0, 34e-3, gap, 12e-3),
    }
    iron = LinearLaw(1e5, "ideal iron")
    NI = 200.0
    field = AxisymmetricProblem(section_grid(r, z, regions), {"pot": iron, "armature": iron}).solve(NI)
    inner, outer = math.pi * 14e-3**2, math.pi * (34e-3**2 - 28e-3**2)
    flux = MU_0 * NI / (gap / inner + gap / outer)
    expected = float(pole_pressure(flux / inner)) * inner + float(pole_pressure(flux / outer)) * outer
    # the pull is towards the pot; the fringes beside the poles pull too
    assert axial_force(field, "armature").maxwell_stress == pytest.approx(-expected, rel=0.03)
    B = field.B_along(np.array([[7e-3, gap / 2]]))[0, 1]
    assert abs(B) == pytest.approx(flux / inner, rel=0.02)


def test_force_of_a_coil_in_an_imposed_uniform_field():
    """A linear rod beside a coil, a uniform field besides: F = a I^2 + b I B + c B^2, and c = 0.

    The field is linear in current and imposed field and the stress quadratic, so four solves must obey the
    parallelogram law to round-off. A uniform field alone pulls at no rod; together with the coil's it pulls far more
    than the coil alone, and to the other side with the field reversed.
    """
    r = lines(np.concatenate((graded_lines(2e-3, (0.0, 20e-3), (0.0, 0.2)), [8e-3, 12e-3])))
    z = graded_lines(2e-3, (-20e-3, 20e-3), (-0.2, 0.2))
    regions = {"iron": (0.0, 8e-3, -14e-3, -4e-3), "coil": (12e-3, 16e-3, 6e-3, 14e-3)}
    problem = AxisymmetricProblem(section_grid(r, z, regions), {"iron": LinearLaw(50.0)})
    field = problem.solve(500.0, boundary_field=0.05, tolerance=1e-12)
    force = axial_force(field, "iron", virtual_work=True)
    assert force.virtual_work == pytest.approx(force.maxwell_stress, rel=1e-3)

    def pull(ampere_turns, B):
        return axial_force(problem.solve(ampere_turns, boundary_field=B, tolerance=1e-12), "iron").maxwell_stress

    both, against, coil, alone = pull(500.0, 0.05), pull(500.0, -0.05), pull(500.0, 0.0), pull(0.0, 0.05)
    assert both == pytest.approx(force.maxwell_stress, rel=1e-9)
    assert both + against == pytest.approx(2.0 * (coil + alone), abs=1e-9 * abs(both))
    assert pull(-500.0, -0.05) == pytest.approx(both, rel=1e-9)
    assert abs(alone) < 0.01 * abs(both)  # the flux wall at 0.2 m mirrors the rod
    assert both * against < 0.0 and abs(both) > 3.0 * abs(coil)


def test_powder_is_deformable_only_when_asked():
    """Powder between two poles: refused without `yielding`; with it, virtual work of the powder as a fluid agrees."""
    r = lines(np.concatenate((graded_lines(1e-3, (0.0, 22e-3), (0.0, 0.1)), [8e-3, 12e-3, 20e-3])))
    z = graded_lines(1e-3, (-14e-3, 14e-3), (-0.1, 0.1))
    regions = {
        "left": (0.0, 8e-3, -12e-3, -2e-3),
        "right": (0.0, 8e-3, 2e-3, 12e-3),
        "powder": (0.0, 8e-3, -2e-3, 2e-3),
        "coil": (12e-3, 20e-3, -8e-3, 8e-3),
    }
    steel = material("steel_1010")
    problem = AxisymmetricProblem(
        section_grid(r, z, regions), {"left": steel, "right": steel}, powder_law=PowderLaw(GrainLaw(273.0, 1.5e6))
    )
    fill = np.full(problem.powder_elements.size, 0.4)
    field = problem.solve(800.0, fill, tolerance=1e-12)
    with pytest.raises(ValueError, match=r"touches powder.*yielding"):
        axial_force(field, "right")
    force = axial_force(field, "right", yielding=["powder"], virtual_work=True)
    assert force.virtual_work == pytest.approx(force.maxwell_stress, rel=1e-3)
    assert force.maxwell_stress < -10.0 * force.error, "the poles pull at each other"


@pytest.mark.parametrize(
    ("body", "words"), [("hub", "no region 'hub'"), ([], "at all"), ("air", "touches|outer boundary")]
)
def test_bad_bodies_are_explained(plungers, body, words):
    with pytest.raises(ValueError, match=words):
        axial_force(plungers[0], body)


def test_no_coil_no_lorentz_force():
    mesh = section_grid(np.linspace(0, 1, 4), np.linspace(0, 1, 4), {})
    with pytest.raises(ValueError, match="no region 'coil'"):
        lorentz_force(AxisymmetricProblem(mesh, {}).solve(0.0, boundary_field=1.0))
