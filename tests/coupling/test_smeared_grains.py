"""The kernel that spreads grains over the section: its integrals, its folding at steel, its gradient, its bits."""

import numba
import numpy as np
import pytest
from scipy.integrate import quad

from coupling.pair_fields import self_field_factor
from coupling.smeared_grains import SectionSmear, ring_smear

A = 0.7e-3  # width
V, R = 2e-11, 10e-3
ANGLE = 0.3


def kernel(r):
    """K of the module [1/m^3]."""
    return 105.0 / (32.0 * np.pi * A**3) * np.maximum(1.0 - (r / A) ** 2, 0.0) ** 2


def smear_of(places, moments=None, walls=None, width=A):
    places = np.array(places, dtype=float).reshape(-1, 2)
    moments = np.zeros_like(places) if moments is None else np.array(moments, dtype=float).reshape(-1, 2)
    return SectionSmear(places, np.full(len(places), V), moments, width, ANGLE, walls)


def at(smear, points, folds=None):
    points = np.array(points, dtype=float).reshape(-1, 2)
    none = np.zeros((len(points), len(smear.walls)), dtype=bool)
    return smear.at(points, none if folds is None else none | folds)


def integral(smear, low, high, folds=None, n=400):
    """Of (phi, M_r, M_z) over r dr dz angle, by midpoints: the kernel's slope ends smoothly, so n^-3 and better."""
    r = low[0] + (high[0] - low[0]) * (np.arange(n) + 0.5) / n
    z = low[1] + (high[1] - low[1]) * (np.arange(n) + 0.5) / n
    points = np.stack(np.meshgrid(r, z, indexing="ij"), axis=-1).reshape(-1, 2)
    cell = (high[0] - low[0]) * (high[1] - low[1]) / n**2
    return (at(smear, points, folds)[:3] * points[:, 0]).sum(axis=1) * cell * ANGLE


def test_the_sections_kernel_is_the_line_integral_of_the_spherical_one():
    """K2(rho) = integral of K along a line at the distance rho, and K holds one; K(0)/3 is a grain's own part."""
    assert quad(lambda r: 4.0 * np.pi * r**2 * kernel(r), 0.0, A)[0] == pytest.approx(1.0, rel=1e-10)
    assert self_field_factor(A, True) == pytest.approx(float(kernel(0.0)) / 3.0, rel=1e-14)
    assert self_field_factor(A, False) == 0.0
    smear = smear_of([[R, 0.0]])
    for rho in (0.0, 0.2 * A, 0.6 * A, 0.95 * A):
        line = quad(lambda s, rho=rho: kernel(np.hypot(rho, s)), 0.0, np.sqrt(A**2 - rho**2))[0] * 2.0
        assert at(smear, [[R, rho]])[0, 0] == pytest.approx(V * line / (ANGLE * R), rel=1e-9)
    assert np.all(at(smear, [[R, 1.0001 * A], [R + 1.0001 * A, 0.0]]) == 0.0)


def test_a_grain_keeps_its_volume():
    """Integral of phi r dr dz angle = V to (a/r)^2: sqrt(r/r_i) is 1 + x/2 - x^2/8, the mean of x^2 (a/r)^2/9."""
    left = []
    for r in (R, 2.0 * R):
        result = integral(smear_of([[r, 0.0]], [[0.0, 1e-6]]), (r - A, -A), (r + A, A))
        assert result[2] == pytest.approx(1e-6 * result[0] / V, rel=1e-12)
        left.append(1.0 - result[0] / V)
        assert left[-1] == pytest.approx((A / r) ** 2 / 72.0, rel=0.02)
    assert left[0] / left[1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("height", [0.1, 0.5, 0.9])
def test_folding_at_a_plane_keeps_the_volume_and_mirrors_the_moment(height):
    """Of the fraction q that would lie in the steel all the volume stands beside it, k m_n, and -k m_t."""
    k, h = 0.8, height * A
    floor = np.array([[0.0, 0.0, 1.0, 0.0, 1.0, k]])
    low, high = (R - A, 0.0), (R + A, 2.0 * A)
    m_r, m_z = 3e-6, -2e-6
    bare = integral(smear_of([[R, h]], [[m_r, m_z]]), low, high)
    whole = integral(smear_of([[R, h]], [[m_r, m_z]]), (R - A, -2.0 * A), high)
    fold = integral(smear_of([[R, h]], [[m_r, m_z]], floor), low, high, True)
    assert fold[0] == pytest.approx(whole[0], rel=1e-5)
    q = 1.0 - bare[0] / whole[0]
    assert fold[1] == pytest.approx(m_r * whole[0] / V * (1.0 - q - k * q), rel=1e-5)
    assert fold[2] == pytest.approx(m_z * whole[0] / V * (1.0 - q + k * q), rel=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["shaft", "bore"])
def test_folding_at_a_cylinder_keeps_the_volume(side):
    """Rings in the steel are shorter or longer than where they fold to: R/r takes care of it, to (a/r)^2 as without."""
    shaft = np.array([[R, -1.0, 0.0, 1.0, 2.0, 1.0]])
    place = [[R + 0.3 * A * side, 0.0]]
    low, high = ((R, -A), (R + 2.0 * A, A)) if side > 0.0 else ((R - 2.0 * A, -A), (R, A))
    fold = integral(smear_of(place, walls=shaft), low, high, True)[0]
    whole = integral(smear_of(place), (R - 2.0 * A, -A), (R + 2.0 * A, A))[0]
    assert fold == pytest.approx(whole, rel=1e-5)
    assert fold == pytest.approx(V, rel=(A / R) ** 2 / 50.0)


def test_at_a_face_the_fold_is_even_in_volume_and_normal_moment():
    """On the face itself phi and M_n are twice what they would be, M_t vanishes where the steel mirrors all of it."""
    floor = np.array([[0.0, 0.0, 1.0, 0.0, 1.0, 1.0]])
    points = [[R + 0.2 * A, 0.0]]
    free = at(smear_of([[R, 0.4 * A]], [[1e-6, 2e-6]]), points)[:, 0]
    fold = at(smear_of([[R, 0.4 * A]], [[1e-6, 2e-6]], floor), points, True)[:, 0]
    assert fold[[0, 2]] == pytest.approx(2.0 * free[[0, 2]], rel=1e-12)
    assert fold[1] == pytest.approx(0.0, abs=1e-12 * abs(free[1]))
    assert fold[6] == pytest.approx(0.0, abs=1e-9 * abs(free[6]))  # dM_z/dz: even over the face


WALLS = {
    "none": np.zeros((0, 6)),
    "plane": np.array([[0.0, -0.5 * A, 1.0, 0.0, 1.0, 0.8]]),
    "shaft": np.array([[R - 0.5 * A, -1.0, 0.0, 1.0, 2.0, 0.9]]),
    "cone": np.array([[R - A, -A, np.sqrt(0.5), np.sqrt(0.5), 1.0, 1.0]]),
}


@pytest.mark.parametrize("name", WALLS)
def test_the_gradient_is_that_of_the_magnetisation(name):
    """Central differences over 1e-4 a: 1e-6 of the largest."""
    random = np.random.default_rng(0)
    places = np.array([R, 0.0]) + A * random.uniform(0.0, 1.0, (12, 2))
    smear = smear_of(places, random.normal(size=(12, 2)) * 1e-6, WALLS[name])
    points = np.array([R, 0.0]) + A * random.uniform(0.05, 0.95, (30, 2))
    result = at(smear, points, True)
    for axis in range(2):
        step = 1e-4 * A * np.eye(2)[axis]
        slope = (at(smear, points + step, True) - at(smear, points - step, True))[1:3] / (2e-4 * A)
        scale = np.abs(result[3:]).max()
        assert result[[3 + axis, 5 + axis]] == pytest.approx(slope, abs=1e-6 * scale)


def test_it_is_symmetric_in_the_two_places():
    """K2/sqrt(r r_i): what one of two grains puts where the other is, is what it gets from there; so the third law."""
    one, two = [R, 0.0], [R + 0.5 * A, 0.3 * A]
    there, back = (at(smear_of([a], [[1e-6, 0.0]]), [b])[:, 0] for a, b in ((one, two), (two, one)))
    assert there[:2] == pytest.approx(back[:2], rel=1e-14)
    # by r alone they would differ
    assert there[0] * two[0] != pytest.approx(back[0] * one[0], rel=1e-3)


def test_bits_do_not_depend_on_threads_nor_does_any_grain_go_missing():
    """Cells are only a way to find near grains: the sum over all of them one by one is the same to round-off."""
    random = np.random.default_rng(1)
    n = 400
    angle = random.uniform(0.0, ANGLE, n)
    r, z = R + 8.0 * A * random.uniform(size=n), 9.0 * A * random.uniform(-1.0, 1.0, n)
    x = np.column_stack((r * np.cos(angle), r * np.sin(angle), z))
    m = random.normal(size=(n, 3)) * 1e-6
    floor = np.array([[R, -9.5 * A, 1.0, 0.0, 1.0, 1.0]])
    smear = ring_smear(x, np.full(n, V), m, A, ANGLE, floor)
    points = np.column_stack((R + 8.0 * A * random.uniform(size=500), 9.5 * A * random.uniform(-1.0, 1.0, 500)))
    folds = np.ones((500, 1), dtype=bool)
    before, answers = numba.get_num_threads(), []
    for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
        numba.set_num_threads(threads)
        answers.append(smear.at(points, folds))
    numba.set_num_threads(before)
    assert all(np.array_equal(answers[0], other) for other in answers)
    m_r = (x[:, 0] * m[:, 0] + x[:, 1] * m[:, 1]) / r
    singly = sum(at(smear_of([[r[i], z[i]]], [[m_r[i], m[i, 2]]], floor), points, True) for i in range(n))
    scale = np.abs(singly).max(axis=1, keepdims=True)
    assert np.abs(answers[0] - singly).max() < 1e-12 * scale.max()
    assert np.all(np.abs(answers[0] - singly) < 1e-12 * scale)


@pytest.mark.hard
def test_nothing_and_one_grain():
    """No grain at all, one on a cell's corner, points far away and next to the axis: zeros and no NaN."""
    empty = ring_smear(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), A, ANGLE)
    assert np.all(at(empty, [[R, 0.0]]) == 0.0)
    one = smear_of([[R, 0.0]], [[0.0, 1e-6]])
    result = at(one, [[R, 0.0], [R, 1.0], [1e-9, 0.0], [R + 1.0001 * A, 0.0]])
    assert np.all(np.isfinite(result)) and result[0, 0] > 0.0
    assert np.all(result[:, 1:] == 0.0)
