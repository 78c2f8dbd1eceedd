"""Images of mutual moments in steel walls: one energy, whose derivatives the fields and forces are."""

from dataclasses import replace

import numpy as np
import pytest

from coupling.grain_law_table import grain_table
from coupling.influence import find_influence
from coupling.kernel_state import MagneticGrains, PairModel
from coupling.moment_kernels import contact_forces, gather_fields, wall_heights
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import MU_0, GrainLaw

pytestmark = pytest.mark.physics

IRON = GrainLaw(999.0, 1.7e6)
A = 1e-3
FLOOR = [0.0, -0.5 * A, 1.0, 0.0, 1.0, 0.8]  # z = -a/2, normal +z, reflection 0.8
BORE = [12.0 * A, -1.0, 0.0, 1.0, 2.0, 0.9]  # r = 12 a, normal -r
CONE = [6.0 * A, -9.0 * A, np.sqrt(0.5), np.sqrt(0.5), 1.0, 1.0]


def dipole_field(m, d):
    r = np.linalg.norm(d)
    n = d / r
    return (3.0 * (m @ n) * n - m) / (4.0 * np.pi * r**3)


def image(wall, x, m):
    """Place and moment of an image, by the section's reflection."""
    e = np.array([x[0], x[1], 0.0]) / np.hypot(x[0], x[1])
    n = -wall[3] * e + np.array([0.0, 0.0, wall[2]])
    h = (np.hypot(x[0], x[1]) - wall[0]) * -wall[3] + (x[2] - wall[1]) * wall[2]
    return x - 2.0 * h * n, wall[5] * (2.0 * (m @ n) * n - m)


def energy(wall, position, moment):
    """The sum of U_ij* over pairs and of U_ii*."""
    U = 0.0
    for i, (x, m) in enumerate(zip(position, moment, strict=True)):
        y, p = image(wall, x, m)
        U -= 0.5 * MU_0 * m @ dipole_field(p, x - y)
        for j in range(i):
            z, q = image(wall, position[j], moment[j])
            U -= 0.5 * MU_0 * (m @ dipole_field(q, x - z) + moment[j] @ dipole_field(p, position[j] - y))
    return U


def cluster(wall):
    """Four grains near a wall, apart from it and from each other, with moments of any direction."""
    random = np.random.default_rng(3)
    if wall is FLOOR:
        x = np.array([[3.0, 1.0, 1.2], [5.2, 1.4, 1.0], [4.0, 3.1, 2.0], [2.0, 3.0, 3.0]]) * A
    elif wall is BORE:
        angle, r = np.array([0.1, 0.32, 0.2, 0.5]), np.array([10.5, 10.2, 8.0, 10.8]) * A
        x = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.array([0.0, 0.7, 1.5, -0.4]) * A])
    else:
        angle, z = np.array([0.1, 0.5, 0.3, 0.8]), np.array([0.0, 0.7, 2.0, 1.0]) * A
        r = np.array([12.0, 12.6, 12.0, 13.0]) * A
        x = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    return x, random.normal(size=(4, 3)) * 1e-3


def parts(wall, x, m):
    """Field and forces by the kernels, of images alone: those with the wall less those without."""
    rows, radius = neighbour_rows(x, 1.0), np.full(4, 1e-6)
    table, model = grain_table(IRON, "mutual"), PairModel(1.0, False, False, 1e-3)
    found = []
    for walls in (np.array([wall]), np.zeros((0, 6))):
        height, own = np.empty((4, len(walls))), np.zeros((4, len(walls)))
        field, potential, force = np.zeros((4, 3)), np.zeros(4), np.zeros((4, 3))
        none, torque = np.zeros((4, 3)), np.zeros((4, 2))
        wall_heights(x, walls, 1.0, height)
        grains = MagneticGrains(
            x, radius, radius, m, none, np.zeros((4, 4)), field, potential, np.zeros(4), np.zeros(4), height, own
        )
        known = find_influence(table, model, grains, rows.arrays, walls, own=0.0, twin=rows.twin)
        gather_fields(model, grains, rows.arrays, known, field, potential, own)
        contact_forces(
            table, model, grains, rows.arrays, walls, known, False, none, 0.0, force, torque, np.empty((100, 4))
        )
        found.append((field, force, torque[:, 1].sum()))
    return found[0][0] - found[1][0], found[0][1] - found[1][1], found[0][2]


@pytest.mark.parametrize("wall", [FLOOR, BORE, CONE], ids=["plane", "cylinder", "cone"])
def test_field_and_force_are_derivatives_of_one_energy(wall):
    x, m = cluster(wall)
    field, force, _ = parts(wall, x, m)
    for i in range(4):
        for axis in range(3):
            step = np.zeros((4, 3))
            step[i, axis] = 1e-6 * np.abs(m).max()
            dU = energy(wall, x, m + step) - energy(wall, x, m - step)
            scale = np.abs(field).max()
            assert field[i, axis] == pytest.approx(-dU / (2.0 * step[i, axis] * MU_0), abs=1e-6 * scale)
            step[i, axis] = 1e-4 * A
            dU = energy(wall, x + step, m) - energy(wall, x - step, m)
            assert force[i, axis] == pytest.approx(-dU / (2.0 * step[i, axis]), abs=1e-5 * np.abs(force).max())


@pytest.mark.parametrize("wall", [FLOOR, BORE, CONE], ids=["plane", "cylinder", "cone"])
def test_a_wall_of_revolution_turns_nothing_by_itself(wall):
    """The energy does not change when grains and moments turn about the axis together: sum x x F + m x B = 0 there."""
    x, m = cluster(wall)
    field, force, torque = parts(wall, x, m)
    on_grains = np.cross(x, force)[:, 2].sum()
    assert torque == pytest.approx(on_grains, rel=1e-12)
    on_moments = MU_0 * np.cross(m, field)[:, 2].sum()
    assert on_grains + on_moments == pytest.approx(0.0, abs=1e-12 * np.abs(force).max() * A)


def between_bores():
    """Grains that touch the bores and each other: places, radii, bores, a field H = c/r and its direction."""
    angle, r = np.array([0.0, 0.21, 0.11, 0.34, 0.25]), np.array([8.02, 8.1, 9.95, 8.6, 10.4]) * A
    z = np.array([0.0, 0.4, 0.3, 1.9, 2.2]) * A
    x = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    radius = np.array([1.0, 0.7, 1.0, 0.8, 0.6]) * A
    bores = np.array([[7.0 * A, -1.0, 0.0, 1.0, 2.0, 0.9], [11.0 * A, -1.0, 0.0, 1.0, 2.0, 0.95]])
    e_r = x * [1.0, 1.0, 0.0] / r[:, None]
    return x, radius, bores, 60e3 * 9.0 * A / r[:, None] * e_r, e_r


@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_grains_between_bores_take_no_torque_from_a_field_of_revolution(model):
    """Pairs, images, near walls and the hoop force of H = c/r cancel at the fixed point: such iron turns nothing.

    Near moments along the walls' normals take part.
    """
    x, radius, bores, H, e_r = between_bores()
    solver = MutualMoments(grain_table(IRON, model), near=model == "near_field", reach=1.0, walls=bores)
    rows = neighbour_rows(x, 1.0)
    found = solver.solve(x, radius, H, rows, tolerance=1e-14, most_sweeps=3000)
    force, pairs, walls = solver.forces(x, radius, rows, found)
    e_phi = np.column_stack([-e_r[:, 1], e_r[:, 0], np.zeros(5)])
    hoop = MU_0 * float(((found.moment * e_phi).sum(axis=1) * np.hypot(H[:, 0], H[:, 1])).sum())
    assert np.cross(x, force)[:, 2].sum() == pytest.approx(pairs + walls, rel=1e-9)
    assert abs(walls) > 1e-3 * abs(hoop)
    assert abs(pairs + walls + hoop) < 1e-10 * abs(hoop)


def test_a_pair_that_is_found_once_is_the_same_from_both_sides():
    """Rows that know each pair's twin, and rows that do not: every entry is then found for itself."""
    x, radius, bores, H, _ = between_bores()
    rows, answers = neighbour_rows(x, 1.0), []
    for own in (rows, replace(rows, twin=None)):
        solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=1.0, walls=bores)
        found = solver.solve(x, radius, H, own, tolerance=1e-13, most_sweeps=3000)
        force, pairs, walls = solver.forces(x, radius, own, found)
        answers.append((found.field, found.potential, found.fraction, force, pairs, walls))
    for one, other in zip(*answers, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-11 * np.abs(other).max())


def test_a_grain_over_steel_is_half_of_a_pair():
    """A pair in a field along its axis and one of its grains over a steel plane half way: moments and forces alike."""
    H = np.array([[0.0, 0.0, 46e3]])
    for gap in (0.01, 0.05, 0.3, 1.0):
        half = (1.0 + 0.5 * gap) * A
        pair = np.array([[5.0 * A, 0.0, half], [5.0 * A, 0.0, -half]])
        floor = np.array([[0.0, 0.0, 1.0, 0.0, 1.0, 1.0]])
        answer = []
        for x, walls in ((pair, None), (pair[:1], floor)):
            solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=1.0, walls=walls)
            rows, radius = neighbour_rows(x, 1.0), np.full(len(x), A)
            found = solver.solve(x, radius, np.repeat(H, len(x), axis=0), rows, tolerance=1e-13, most_sweeps=500)
            answer.append((found.moment[0], solver.forces(x, radius, rows, found)[0][0]))
        assert answer[1][0] == pytest.approx(answer[0][0], rel=1e-10, abs=1e-20)
        assert answer[1][1] == pytest.approx(answer[0][1], rel=1e-9, abs=1e-12 * abs(answer[0][1][2]))
