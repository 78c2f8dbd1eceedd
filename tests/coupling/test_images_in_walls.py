"""Images of moments and charges in steel walls: one energy, against plain sums over grains and their images."""

from dataclasses import replace
from typing import NamedTuple

import numba
import numpy as np
import pytest

from coupling.image_kernels import (
    N_HEIGHTS,
    N_LIST,
    clear_blocks,
    clear_forces,
    columns_twice,
    field_of_images,
    find_forces,
    influences_of_grains,
    influences_of_pairs,
    list_grain_images,
    list_pair_images,
    wall_sides,
)
from coupling.influence import pair_subset
from coupling.kernel_state import PairModel
from coupling.moment_kernels import wall_heights
from coupling.neighbour_rows import neighbour_rows
from coupling.row_kernels import IMAGED, columns_of
from field import MU_0
from particles import CyclicSector

pytestmark = pytest.mark.physics

A = 1e-3
FLOOR = [0.0, -0.5 * A, 1.0, 0.0, 1.0, 0.8]  # z = -a/2, normal +z, reflection 0.8
CEILING = [0.0, 4.5 * A, 1.0, 0.0, 1.0, 0.7]
BORE = [12.0 * A, -1.0, 0.0, 1.0, 2.0, 0.9]  # r = 12 a, normal -r
SHAFT = [7.0 * A, -1.0, 0.0, 1.0, 2.0, 1.0]
CONE = [6.0 * A, -9.0 * A, np.sqrt(0.5), np.sqrt(0.5), 1.0, 1.0]
WALLS = {"plane": [FLOOR], "two planes": [FLOOR, CEILING], "cylinders": [BORE, SHAFT], "cone": [CONE]}
SECTOR = CyclicSector(0.5 * np.pi)
EVERY_WALL = pytest.mark.parametrize("kind", list(WALLS))
# reach [m] and smear: open space, ended within the cluster, less the smear
ENDS = {"open": (1.0, False), "ended": (5.0 * A, False), "less the smear": (5.0 * A, True)}
EVERY_END = pytest.mark.parametrize("end", list(ENDS))


class Faced(NamedTuple):
    """What `wall_sides` reads of grains."""

    height: np.ndarray
    radius: np.ndarray


@numba.njit(error_model="numpy")
def images_of(model, grains, place, source, rows, imaged, walls):
    """Blocks of pairs and of grains, field and potential, forces of pairs and of grains [N], of images alone."""
    n, k, room = place.shape[0], imaged.entry.shape[0], 8 * 64 * walls.shape[0] + 8
    image_list, heights, faces = np.empty((N_LIST, room), np.int32), np.empty((N_HEIGHTS, room)), wall_sides(grains)
    width = 16 if model.near else 12
    blocks, own = np.empty((k + 1, width)), np.zeros((n, width))
    pulls, pull = np.empty((k, 4)), np.zeros((n, 4))
    clear_blocks(0, imaged.pairs, imaged, blocks)
    clear_forces(0, imaged.pairs, imaged, pulls)
    m = list_pair_images(0, imaged.pairs, model.reach, faces, imaged, image_list, heights)
    influences_of_pairs(m, model, place, rows, walls, image_list, heights, blocks)
    find_forces(m, model, place, source, rows, walls, image_list, heights, pulls)
    field, twice = np.empty((n, 4)), columns_twice(source, source[:, 3])
    for i in range(n):
        field[i] = field_of_images(i, imaged.start, imaged.entry, rows.other, blocks, twice)
    m = list_grain_images(0, n, model.reach, faces, rows, image_list, heights)
    influences_of_grains(m, model, place, rows, walls, image_list, heights, own)
    find_forces(m, model, place, source, rows, walls, image_list, heights, pull)
    return blocks[:k].copy().reshape(k, -1, 4), own.reshape(n, -1, 4), field, pulls, pull


@numba.njit
def place_of(x, radius):
    return columns_of(x, radius)


def found_by_kernels(walls, x, v, rows, end, charged=True):
    """Blocks, field and potential (n, 4), or the field alone, and forces (n, 3) of images alone."""
    reach, smear = ENDS[end]
    walls, radius = np.array(walls), np.full(len(x), 1e-6)
    height = np.empty((len(x), len(walls)))
    wall_heights(x, walls, 1.0, height)
    every = np.full(len(rows.other), IMAGED, dtype=np.uint8)
    twin = np.full(len(rows.other), -1, np.int32) if rows.twin is None else rows.twin
    imaged = pair_subset(rows.arrays, twin, every, IMAGED)
    blocks, own, field, pulls, pull = images_of(
        PairModel(reach, smear, charged, 1e-3), Faced(height, radius), place_of(x, radius), v, rows.arrays, imaged,
        walls,
    )  # fmt: skip
    field, force = field[:, : own.shape[1]], pull[:, :3].copy()
    field += np.einsum("iab,ib->ia", own, v)
    for i, f in zip(seen_from(rows), pulls, strict=True):
        force[i] += f[:3]
    return blocks, own, field, force


def seen_from(rows):
    return np.repeat(np.arange(len(rows.start) - 1), np.diff(rows.start))


def factors(r, end):
    """c1, c2, p and psi of the theory, 0 beyond reach."""
    reach, smear = ENDS[end]
    x = r / reach
    if x >= 1.0:
        return np.zeros(4)
    if smear:
        out = 1.0 - (35.0 * x**3 - 42.0 * x**5 + 15.0 * x**7) / 8.0
        psi = 1.0 / r - (1.0 + (9.5 - 17.5 * x**2 + 10.5 * x**4 - 2.5 * x**6) / 8.0) / reach
        return np.array([3.0 * out / r**3 + 105.0 / (8.0 * reach**3) * (1.0 - x**2) ** 2, out / r**3, out / r**2, psi])
    t = max((x - 0.9) / 0.1, 0.0)
    s = 1.0 - x**2 * t**2 * (3.2 - 2.2 * t)
    psi = 1.0 / r - (1.0 + 0.1 * (3.2 / 3.0 - 0.55) - 0.1 * t**3 * (3.2 / 3.0 - 0.55 * t)) / reach
    return np.array([3.0 * s / r**3, s / r**3, s / r**2, psi])


def mutual_energy(a, b, d, end):
    """E(a, b) over mu_0 of moments and charges a, b (4) with d from b to a."""
    r = np.linalg.norm(d)
    n = d / r
    c1, c2, p, psi = factors(r, end) / (4.0 * np.pi)
    return (
        c2 * a[:3] @ b[:3]
        - c1 * (a[:3] @ n) * (b[:3] @ n)
        + p * (a[3] * b[:3] @ n - b[3] * a[:3] @ n)
        + psi * a[3] * b[3]
    )


def image(wall, x, v):
    """Place, moment and charge of an image, by the section's reflection."""
    e = np.array([x[0], x[1], 0.0]) / np.hypot(x[0], x[1])
    n = -wall[3] * e + np.array([0.0, 0.0, wall[2]])
    h = (np.hypot(x[0], x[1]) - wall[0]) * -wall[3] + (x[2] - wall[1]) * wall[2]
    return x - 2.0 * h * n, wall[5] * np.append(2.0 * (v[:3] @ n) * n - v[:3], -v[3])


def turned(rows, entry, vector):
    c, s = rows.images[rows.image[entry], :2]
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], *vector[2:]])


def pair_energy(walls, x, v, y, w, end):
    """Sum of U_ij* over walls, over mu_0, of v at x and w at y."""
    U = 0.0
    for wall in walls:
        (a, p), (b, q) = image(wall, x, v), image(wall, y, w)
        U += 0.5 * (mutual_energy(v, q, x - b, end) + mutual_energy(p, w, a - y, end))
    return U


def energy(walls, x, v, rows, end):
    """Sum of U_ij* over pairs and of U_ii* over grains, over mu_0."""
    U = sum(0.5 * pair_energy(walls, a, b, a, b, end) for a, b in zip(x, v, strict=True))
    for e, i in enumerate(seen_from(rows)):
        if e < rows.twin[e]:
            U += pair_energy(
                walls, x[i], v[i], turned(rows, e, x[rows.other[e]]), turned(rows, e, v[rows.other[e]]), end
            )
    return U


def cluster(kind, cyclic=False):
    """Five grains near walls, apart from each other, with moments of any direction and charges of both signs."""
    random = np.random.default_rng(3)
    if "plane" in kind:
        x = np.array([[3.0, 1.0, 1.2], [5.2, 1.4, 1.0], [4.0, 3.1, 1.9], [2.0, 3.0, 3.0], [3.5, 1.5, 3.4]]) * A
    else:
        angle = np.array([0.1, 0.32, 0.2, 0.5, 0.4])
        r, z = np.array([10.5, 10.2, 8.0, 10.8, 8.6]) * A, np.array([0.0, 0.7, 1.5, -0.4, 0.5]) * A
        if kind == "cone":
            r, z = np.array([12.0, 12.6, 12.0, 13.0, 11.4]) * A, np.array([0.0, 0.7, 2.0, 1.0, 0.9]) * A
        x = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    v = random.normal(size=(5, 4)) * [1e-3, 1e-3, 1e-3, 1e-3 / A]
    v[:, 3] -= v[:, 3].mean()
    if cyclic:  # the last grain to the sector's other face
        c, s = np.cos(SECTOR.angle - 0.5), np.sin(SECTOR.angle - 0.5)
        x[4, 0], x[4, 1] = c * x[4, 0] - s * x[4, 1], s * x[4, 0] + c * x[4, 1]
    return x, v, neighbour_rows(x, (5.5 if cyclic else 8.0) * A, SECTOR if cyclic else None)


@EVERY_END
@EVERY_WALL
def test_blocks_are_those_of_one_bilinear_energy(kind, end):
    """S = -dU/dm and phi = dU/dQ over mu_0, column by column; 16 numbers that both grains share."""
    walls, sign = WALLS[kind], np.array([-1.0, -1.0, -1.0, 1.0])
    x, v, rows = cluster(kind, "plane" not in kind)
    assert (rows.image != len(rows.images) // 2).any() == ("plane" not in kind)
    blocks, own, _, _ = found_by_kernels(walls, x, v, rows, end)
    unit = np.eye(4)
    scale = np.array([[1.0, 1.0, 1.0, A]]) * np.array([[1.0, 1.0, 1.0, A]]).T
    size = np.abs(own * scale).max()
    for i in range(5):
        # U_ii* is quadratic: its derivative is that of U_ij* with j = i
        whole = [[sign[a] * pair_energy(walls, x[i], unit[a], x[i], unit[b], end) for b in range(4)] for a in range(4)]
        assert own[i] * scale == pytest.approx(np.array(whole) * scale, rel=1e-10, abs=1e-12 * size)
    for e, i in enumerate(seen_from(rows)):
        j = rows.other[e]
        place = turned(rows, e, x[j])
        whole = np.array(
            [
                [sign[a] * pair_energy(walls, x[i], unit[a], place, turned(rows, e, unit[b]), end) for b in range(4)]
                for a in range(4)
            ]
        )
        assert blocks[e] * scale == pytest.approx(whole * scale, rel=1e-10, abs=1e-12 * size)
        there = blocks[rows.twin[e]]
        assert sign[:, None] * blocks[e] * scale == pytest.approx(
            (sign[:, None] * there * scale).T, rel=1e-10, abs=1e-12 * size
        )


@EVERY_END
@EVERY_WALL
def test_field_potential_and_force_are_derivatives_of_the_energy(kind, end):
    walls = WALLS[kind]
    x, v, rows = cluster(kind, "plane" not in kind)
    _, _, field, force = found_by_kernels(walls, x, v, rows, end)
    most = np.abs(field).max(axis=0)
    for i in range(5):
        for axis in range(4):
            step = np.zeros((5, 4))
            step[i, axis] = 1e-3 * np.abs(v[:, axis]).max()
            dU = energy(walls, x, v + step, rows, end) - energy(walls, x, v - step, rows, end)
            slope = dU / (2.0 * step[i, axis]) * (1.0 if axis == 3 else -1.0)
            assert field[i, axis] == pytest.approx(slope, abs=1e-9 * most[axis])
        for axis in range(3):
            step = np.zeros((5, 3))
            step[i, axis] = 1e-5 * A
            dU = energy(walls, x + step, v, rows, end) - energy(walls, x - step, v, rows, end)
            assert force[i, axis] == pytest.approx(-MU_0 * dU / 2e-5 / A, abs=1e-7 * np.abs(force).max())


@EVERY_END
@pytest.mark.parametrize("kind", ["cylinders", "cone"])
def test_walls_of_revolution_turn_nothing_by_themselves(kind, end):
    """The energy does not change when grains and moments turn about the axis together: sum x x F + m x B = 0 there."""
    x, v, rows = cluster(kind)
    _, _, field, force = found_by_kernels(WALLS[kind], x, v, rows, end)
    torque = np.cross(x, force)[:, 2].sum() + MU_0 * np.cross(v[:, :3], field[:, :3])[:, 2].sum()
    assert torque == pytest.approx(0.0, abs=1e-13 * np.abs(force).max() * 12.0 * A)


@EVERY_END
def test_charges_alone_take_no_torque_from_a_coaxial_cylinder(end):
    x, v, rows = cluster("cylinders")
    v[:, :3] = 0.0
    _, _, _, force = found_by_kernels(WALLS["cylinders"], x, v, rows, end)
    each = np.cross(x, force)[:, 2]
    assert np.abs(each).max() > 1e-3 * np.abs(force).max() * 12.0 * A
    assert each.sum() == pytest.approx(0.0, abs=1e-13 * np.abs(force).max() * 12.0 * A)


@EVERY_END
def test_a_plane_acts_as_the_grains_behind_it(end):
    """Field, potential and force on every grain are those of image grains that stand there; the energy is half."""
    x, v, rows = cluster("plane")
    _, _, field, force = found_by_kernels([FLOOR], x, v, rows, end)
    behind = [image(FLOOR, a, b) for a, b in zip(x, v, strict=True)]

    def of_image_grains(i, place, source):
        return sum(mutual_energy(source, q, place - y, end) for y, q in behind)

    unit = np.eye(4)
    for i in range(5):
        real = [of_image_grains(i, x[i], unit[a]) * (1.0 if a == 3 else -1.0) for a in range(4)]
        assert field[i] == pytest.approx(real, rel=1e-10, abs=1e-12 * np.abs(field[:, :3]).max())
        for axis in range(3):
            step = 1e-5 * A * unit[axis, :3]
            dU = of_image_grains(i, x[i] + step, v[i]) - of_image_grains(i, x[i] - step, v[i])
            assert force[i, axis] == pytest.approx(-MU_0 * dU / 2e-5 / A, abs=1e-7 * np.abs(force).max())
    half = 0.5 * sum(of_image_grains(i, x[i], v[i]) for i in range(5))
    assert energy([FLOOR], x, v, rows, end) == pytest.approx(half, rel=1e-12)


def test_the_image_of_a_neutral_pair_at_the_end_of_a_chain():
    """Charges q and -q at heights h and h + r over a plane, in closed form; the constant in psi cancels."""
    q, k, h, r = 0.7, FLOOR[5], 1.05 * A, 2.1 * A
    x = np.array([[3.0 * A, 0.0, FLOOR[1] + h], [3.0 * A, 0.0, FLOOR[1] + h + r]])
    v = np.array([[0.0, 0.0, 0.0, q], [0.0, 0.0, 0.0, -q]])
    _, _, field, force = found_by_kernels([FLOOR], x, v, neighbour_rows(x, 1.0), "open")
    far, farthest = 2.0 * h + r, 2.0 * (h + r)
    phi = k * q / (4.0 * np.pi) * np.array([1.0 / far - 0.5 / h, 1.0 / farthest - 1.0 / far])
    assert field[:, 3] == pytest.approx(phi, rel=1e-10)
    pull = -k * q / (4.0 * np.pi) * np.array([0.25 / h**2 - 1.0 / far**2, 1.0 / far**2 - 1.0 / farthest**2])
    assert field[:, 2] == pytest.approx(pull, rel=1e-10)
    assert force[:, 2] == pytest.approx(MU_0 * v[:, 3] * pull, rel=1e-10)
    assert np.abs(force[:, :2]).max() < 1e-14 * np.abs(force).max()


@EVERY_WALL
def test_what_is_found_once_is_the_same_from_both_sides(kind):
    """Rows that know each pair's twin, and rows that do not: every entry is then computed for itself."""
    x, v, rows = cluster(kind)
    for one, other in zip(
        found_by_kernels(WALLS[kind], x, v, rows, "ended"),
        found_by_kernels(WALLS[kind], x, v, replace(rows, twin=None), "ended"),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * np.abs(other).max())


@EVERY_WALL
def test_moments_alone_have_the_same_field_and_forces_without_charges(kind):
    x, v, rows = cluster(kind)
    v[:, 3] = 0.0
    _, _, field, force = found_by_kernels(WALLS[kind], x, v, rows, "less the smear")
    _, _, alone, pull = found_by_kernels(WALLS[kind], x, v, rows, "less the smear", charged=False)
    np.testing.assert_allclose(alone, field[:, :3], rtol=1e-12)
    np.testing.assert_allclose(pull, force, rtol=1e-12)
