"""Grains at steel walls: images and necks of one energy, a steel plane as the mirrored half of a pair."""

from dataclasses import replace

import numpy as np
import pytest

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import MU_0, GrainLaw
from field.spheres.pair_table import pair_table

pytestmark = pytest.mark.physics

MS = 1.7e6
IRON = GrainLaw(999.0, MS)
A = 1e-3
UNIT = MU_0 * MS**2 * A**2
VOLUME = 4.0 / 3.0 * np.pi * A**3
PLANE = [0.0, 0.0, 1.0, 0.0, 1.0, 1.0]  # z = 0, normal +z, reflection 1
FLOOR = [0.0, -0.5 * A, 1.0, 0.0, 1.0, 0.8]
BORE = [12.0 * A, -1.0, 0.0, 1.0, 2.0, 0.9]  # r = 12 a, normal -r
CONE = [6.0 * A, -9.0 * A, np.sqrt(0.5), np.sqrt(0.5), 1.0, 1.0]
EVERY_WALL = pytest.mark.parametrize("wall", [FLOOR, BORE, CONE], ids=["plane", "cylinder", "cone"])
MODELS = pytest.mark.parametrize("model", ["mutual", "near_field"])


class Solved:
    """Grains ``x`` [m] at walls in the field H [A/m], with their forces and energy."""

    def __init__(self, x, H, walls=None, radius=A, *, model="near_field", table=None, smallest_gap=3e-4, **start):
        x = np.atleast_2d(x)
        radius, H = np.full(len(x), radius), np.array(np.broadcast_to(H, x.shape), dtype=float)
        table = grain_table(IRON, model) if table is None else table
        walls = None if walls is None else np.atleast_2d(walls)
        self.solver = MutualMoments(
            table, near=model == "near_field", reach=1.0, walls=walls, smallest_gap=smallest_gap
        )
        rows = neighbour_rows(x, 1.0)
        self.state = self.solver.solve(x, radius, H, rows, tolerance=1e-13, max_sweeps=3000, **start)
        assert self.state.residual <= 1e-13
        self.moment, self.lagged = self.state.moment, self.solver.forces(x, radius, rows, self.state)
        self.force, self.energy = self.lagged.force, self.solver.energy(x, radius, self.state)


@pytest.mark.parametrize("gap", [0.001, 0.01, 0.03, 0.1, 0.3, 0.9])
def test_a_grain_over_a_steel_plane_is_half_of_the_mirrored_pair(gap):
    """Moment and force are the pair's, which are the finite elements'; the energy is half."""
    above = np.array([5.0 * A, 0.0, (1.0 + 0.5 * gap) * A])
    for field in (1e3, 18e3, 80e3, 200e3, 500e3):
        H = [0.0, 0.0, field]
        half, pair = Solved(above, H, PLANE), Solved([above, above * [1.0, 1.0, -1.0]], H)
        assert half.moment[0] == pytest.approx(pair.moment[0], rel=1e-11, abs=1e-20)
        assert half.force[0] == pytest.approx(pair.force[0], rel=1e-11, abs=1e-12 * UNIT)
        assert 2.0 * half.energy == pytest.approx(pair.energy, rel=1e-12)
        table = pair_table(IRON)
        assert -half.force[0, 2] / UNIT == pytest.approx(float(table.force_of(gap, field / MS)), rel=1e-3)
        assert half.moment[0, 2] / (VOLUME * MS) == pytest.approx(float(table.moment_of(gap, field / MS)), rel=1e-3)


def test_a_heap_over_a_steel_plane_is_half_of_the_mirrored_heap():
    """In any field, the image's tangent part reversed; without what two spheres lack across, which a wall has not.

    A grain has a neck with its own image alone, so all others are farther than a neck reaches.
    """
    table = grain_table(IRON, "near_field")
    table = table._replace(across=np.zeros_like(table.across))
    x = np.array([[5.0, 0.0, 1.01], [7.6, 0.2, 1.02], [6.3, 1.2, 2.2], [4.6, -0.5, 3.0]]) * A
    flip = np.array([1.0, 1.0, -1.0])
    for H in np.array([[3e4, -2e4, 9e4], [2e5, 1e5, -1e4]]):
        half = Solved(x, H, PLANE, table=table)
        fields = np.concatenate([np.tile(H, (4, 1)), np.tile(-flip * H, (4, 1))])
        whole = Solved(np.concatenate([x, x * flip]), fields, table=table)
        assert half.moment == pytest.approx(whole.moment[:4], rel=1e-9, abs=1e-11 * VOLUME * MS)
        # the flux into the plane sees the field across it alone; one of a pair all that there is at its grain
        along = MU_0 * half.state.wall_neck[:, :1, 0] * (H * [1.0, 1.0, 0.0])
        assert np.abs(along[:2]).min(axis=0)[:2].min() > 1e-4 * UNIT
        assert half.force == pytest.approx(whole.force[:4] - along, rel=1e-9, abs=1e-11 * UNIT)
        assert 2.0 * half.energy == pytest.approx(whole.energy, rel=1e-11)


@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_a_chain_that_ends_at_a_steel_plane_is_half_of_twice_the_chain(count):
    heights = np.arange(count) * 2.01 * A + 1.005 * A
    up = np.column_stack([np.full(count, 5.0 * A), np.zeros(count), heights])
    H = [0.0, 0.0, 46e3]
    half, whole = Solved(up, H, PLANE), Solved(np.concatenate([up, up * [1.0, 1.0, -1.0]]), H)
    assert half.moment == pytest.approx(whole.moment[:count], rel=1e-9, abs=1e-15 * VOLUME * MS)
    assert half.force == pytest.approx(whole.force[:count], rel=1e-8, abs=1e-10 * UNIT)
    pull = -half.force[:, 2].sum() / UNIT
    assert pull == pytest.approx(-whole.force[:count, 2].sum() / UNIT, rel=1e-9)
    assert pull > 0.05  # a grain alone has 0.05, in a long chain 0.13


def test_a_wall_that_is_hardly_magnetic_is_hardly_there():
    """A wall saturates: what it does goes to zero with its reflection, and grows with it."""
    above, H = [5.0 * A, 0.0, 1.005 * A], [2e4, 0.0, 4e4]
    free, pulls = Solved(above, H), []
    for k in (1e-6, 1e-3, 0.3, 0.7, 1.0):
        at_wall = Solved(above, H, [*PLANE[:5], k])
        pulls.append(-at_wall.force[0, 2] / UNIT)
        if k <= 1e-3:
            assert at_wall.moment == pytest.approx(free.moment, rel=10.0 * k)
    assert pulls[0] == pytest.approx(1e-3 * pulls[1], rel=1e-2)
    assert np.all(np.diff(pulls) > 0.0)
    assert Solved(above, H, [*PLANE[:5], 0.0]).energy == pytest.approx(free.energy, rel=1e-12)


def cluster(wall):
    """Grains near a wall and each other, two of them with a neck at the wall."""
    if wall is FLOOR:
        return np.array([[3.0, 1.0, 0.55], [5.1, 1.3, 0.7], [4.0, 3.1, 1.2], [2.0, 3.0, 3.0]]) * A
    if wall is BORE:
        angle, r = np.array([0.1, 0.3, 0.2, 0.5]), np.array([10.96, 10.85, 9.0, 10.5]) * A
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), np.array([0.0, 0.7, 1.5, -0.4]) * A])
    angle, r = np.array([0.1, 0.27, 0.3, 0.8]), np.array([13.6, 13.7, 12.0, 13.0]) * A
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), np.array([0.0, 0.1, 2.0, 1.0]) * A])


@MODELS
@EVERY_WALL
def test_forces_at_walls_are_differences_of_the_energy(wall, model):
    """Pairs, images, necks at the wall with the turning of its normal: in uniform fields of any direction."""
    x = cluster(wall)
    for H in ([3e3, -2e3, 9e3], [30e3, 50e3, -60e3], [2e5, 1e5, 1e5]):
        force = Solved(x, H, wall, 0.98 * A, model=model).force
        for i in range(4):
            for axis in range(3):
                step = np.zeros((4, 3))
                step[i, axis] = 3e-5 * A
                W = {k: Solved(x + k * step, H, wall, 0.98 * A, model=model).energy for k in (-2, -1, 1, 2)}
                slope = (8.0 * (W[1] - W[-1]) - (W[2] - W[-2])) / (12.0 * step[i, axis])
                assert force[i, axis] == pytest.approx(-slope, abs=1e-7 * np.abs(force).max())


@EVERY_WALL
def test_a_wall_of_revolution_turns_nothing_by_itself(wall):
    """Grains and field turn about the axis together and W is the same: sum x x F = sum (m x B_0) there."""
    x, H = cluster(wall), np.array([30e3, 50e3, -60e3])
    solved = Solved(x, H, wall, 0.98 * A)
    on_grains = np.cross(x, solved.force)[:, 2].sum()
    by_field = MU_0 * np.cross(solved.moment, H)[:, 2].sum()
    assert on_grains == pytest.approx(by_field, abs=1e-12 * np.abs(solved.force).max() * 12.0 * A)
    charges = MU_0 * (solved.state.charge[:, None] * np.cross(x, H))[:, 2].sum()
    assert solved.lagged.torque_pairs + solved.lagged.torque_walls + charges == pytest.approx(on_grains, rel=1e-9)


@EVERY_WALL
def test_a_loop_past_a_wall_does_no_work(wall):
    """One grain of a cluster on a circle that leaves the wall's neck and comes back to it."""
    x, H = cluster(wall), [30e3, 50e3, -60e3]
    rho = np.hypot(x[0, 0], x[0, 1])
    outward, up = np.array([x[0, 0] / rho, x[0, 1] / rho, 0.0]), np.array([0.0, 0.0, 1.0])
    normal = -wall[3] * outward + wall[2] * up
    along = wall[2] * outward + wall[3] * up
    phi = 2.0 * np.pi * np.arange(96) / 96
    work, most = 0.0, 0.0
    for p in phi:
        y = x.copy()
        y[0] += 0.35 * A * ((1.0 - np.cos(p)) * normal + 0.2 * np.sin(p) * along)
        tangent = 0.35 * A * (np.sin(p) * normal + 0.2 * np.cos(p) * along)
        power = Solved(y, H, wall, 0.98 * A).force[0] @ tangent * (2.0 * np.pi / 96)
        work, most = work + power, most + abs(power)
    assert abs(work) < 2e-5 * most  # of the quadrature: the bicubic table has kinks in its second derivative


def between_bores():
    """Grains that touch the bores and each other: places, radii, bores, a field H = c/r and its direction."""
    angle, r = np.array([0.0, 0.21, 0.11, 0.34, 0.25]), np.array([8.02, 8.1, 9.95, 8.6, 10.4]) * A
    z = np.array([0.0, 0.4, 0.3, 1.9, 2.2]) * A
    x = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    radius = np.array([1.0, 0.7, 1.0, 0.8, 0.6]) * A
    bores = np.array([[7.0 * A, -1.0, 0.0, 1.0, 2.0, 0.9], [11.0 * A, -1.0, 0.0, 1.0, 2.0, 0.95]])
    e_r = x * [1.0, 1.0, 0.0] / r[:, None]
    return x, radius, bores, 60e3 * 9.0 * A / r[:, None] * e_r, e_r


@MODELS
def test_grains_between_bores_take_no_torque_from_a_field_of_revolution(model):
    """Pairs, images, necks at walls and the hoop force of H = c/r cancel at the fixed point: such iron turns nothing.

    The hoop force is that on the dipole parts; the field's on the charges is radial.
    """
    x, radius, bores, H, e_r = between_bores()
    solver = MutualMoments(grain_table(IRON, model), near=model == "near_field", reach=1.0, walls=bores)
    rows = neighbour_rows(x, 1.0)
    state = solver.solve(x, radius, H, rows, tolerance=1e-14, max_sweeps=3000)
    lagged = solver.forces(x, radius, rows, state)
    e_phi = np.column_stack([-e_r[:, 1], e_r[:, 0], np.zeros(5)])
    hoop = MU_0 * float(((state.dipole * e_phi).sum(axis=1) * np.hypot(H[:, 0], H[:, 1])).sum())
    turning = lagged.torque_pairs + lagged.torque_walls
    assert np.cross(x, lagged.force)[:, 2].sum() == pytest.approx(turning, rel=1e-9)
    assert abs(lagged.torque_walls) > 1e-3 * abs(hoop)
    assert abs(turning + hoop) < 1e-10 * abs(hoop)


def test_a_pair_that_is_found_once_is_the_same_from_both_sides():
    """Rows that know each pair's twin, and rows that do not: the images of every entry are then computed for itself.

    Necks are of one pair, so the grains here have none with each other.
    """
    x, radius, bores, H, _ = between_bores()
    x, radius, H = x[[0, 2, 3]], radius[[0, 2, 3]] * 0.3, H[[0, 2, 3]]
    rows, states = neighbour_rows(x, 1.0), []
    for own in (rows, replace(rows, twin=None)):
        solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=1.0, walls=bores)
        state = solver.solve(x, radius, H, own, tolerance=1e-13, max_sweeps=3000)
        lagged = solver.forces(x, radius, own, state)
        states.append((state.field, state.potential, lagged.force, lagged.torque_pairs, lagged.torque_walls))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-11 * np.abs(other).max())


@pytest.mark.hard
@MODELS
def test_a_grain_that_overlaps_a_wall_is_as_at_touching_it(model):
    """Down to where its centre has passed the face: finite, and the force does not grow with the overlap."""
    H = [2e4, 0.0, 46e3]
    touching = Solved([5.0 * A, 0.0, A], H, PLANE, model=model, smallest_gap=3e-3)
    for height in (1.0 - 1e-9, 0.999, 0.95, 0.5, 1e-9, 0.0, -1e-9, -0.5, -1.0):
        inside = Solved([5.0 * A, 0.0, height * A], H, PLANE, model=model, smallest_gap=3e-3)
        assert np.isfinite(inside.force).all() and np.isfinite(inside.energy)
        assert np.abs(inside.force).max() < 1.3 * np.abs(touching.force).max()
        if height > 0.95:
            assert inside.force == pytest.approx(touching.force, rel=0.03)


@pytest.mark.hard
@MODELS
def test_a_grain_that_leaves_a_walls_end_takes_its_state_along(model):
    """Beyond the end it is free, back on it the neck begins again: also from the state of the other side."""
    wall = [4.0 * A, 0.0, 1.0, 0.0, 2.0 * A, 1.0]
    H, z = [1e4, 0.0, 46e3], 1.003 * A
    on, off = ([x * A, 0.0, z] for x in (6.0 - 1e-9, 6.0 + 1e-9))
    cold_on, cold_off = Solved(on, H, wall, model=model), Solved(off, H, wall, model=model)
    free = Solved(off, H, model=model)
    assert cold_off.moment == pytest.approx(free.moment, rel=1e-12) and np.all(cold_off.force == 0.0)
    start = {"start": cold_on.state.dipole, "necks": cold_on.solver.necks_of(cold_on.state)}
    assert Solved(off, H, wall, model=model, **start).moment == pytest.approx(free.moment, rel=1e-10)
    start = {"start": cold_off.state.dipole, "necks": cold_off.solver.necks_of(cold_off.state)}
    back = Solved(on, H, wall, model=model, **start)
    assert back.moment == pytest.approx(cold_on.moment, rel=1e-10)
    assert back.force == pytest.approx(cold_on.force, rel=1e-9, abs=1e-12 * UNIT)
