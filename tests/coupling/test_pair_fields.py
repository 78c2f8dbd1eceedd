"""Factors of two dipoles and charges: each interaction is an energy that fades at its reach, and forces its slope."""

import numba
import numpy as np
import pytest

from coupling.pair_fields import (
    charge_factors,
    charge_force,
    field_factors,
    field_slopes,
    pair_force,
    self_potential_factor,
)

A = 5.0  # reach
BOTH = pytest.mark.parametrize("smear", [False, True], ids=["whole", "less the smear"])


@numba.njit
def factors(r, reach, smear):
    """c1, c2, p, psi and their slopes."""
    c1, c2, p = field_factors(r, reach, smear)
    psi, p_r = charge_factors(r, reach, smear)
    c1_r, c2_r = field_slopes(r, reach, smear)
    return np.array([c1, c2, p, psi]), np.array([c1_r, c2_r, p_r, -p])


@numba.njit
def force(a, qa, b, qb, d, reach, smear):
    r = np.sqrt((d * d).sum())
    n = d / r
    f = pair_force(a[0], a[1], a[2], b[0], b[1], b[2], n[0], n[1], n[2], r, reach, smear)
    g = charge_force(a[0], a[1], a[2], qa, b[0], b[1], b[2], qb, n[0], n[1], n[2], r, reach, smear)
    return np.array([f[0] + g[0], f[1] + g[1], f[2] + g[2]])


def energy(a, qa, b, qb, d, smear):
    r = np.linalg.norm(d)
    n = d / r
    c1, c2, p, psi = factors(r, A, smear)[0]
    return c2 * a @ b - c1 * (a @ n) * (b @ n) + p * (qa * b @ n - qb * a @ n) + psi * qa * qb


@BOTH
def test_slopes_are_those_of_the_factors(smear):
    for r in (0.3, 1.0, 3.0, 4.4, 4.6, 4.9, 4.99):
        step = 1e-5
        result = (factors(r + step, A, smear)[0] - factors(r - step, A, smear)[0]) / (2.0 * step)
        assert factors(r, A, smear)[1] == pytest.approx(result, rel=1e-7, abs=1e-9)


@BOTH
def test_factors_begin_as_those_of_open_space_and_end_with_their_slopes(smear):
    open_space = np.array([3.0 / 0.01**3, 1.0 / 0.01**3, 1.0 / 0.01**2, 1.0 / 0.01])
    own = 4.0 * np.pi * self_potential_factor(A, smear)
    result = factors(0.01, A, smear)[0]
    assert result[:3] == pytest.approx(open_space[:3], rel=3e-7)
    assert result[3] == pytest.approx(open_space[3] + own, rel=1e-7)
    ends, slopes = factors(A, A, smear)
    assert ends == pytest.approx(np.zeros(4), abs=1e-14)
    assert slopes == pytest.approx(np.zeros(4), abs=1e-14)


def test_less_the_smear_all_are_of_one_potential():
    for r in (0.3, 1.0, 3.0, 4.9):
        (c1, c2, p, _), (_, _, p_r, _) = factors(r, A, True)
        assert c2 == pytest.approx(p / r, rel=1e-13)
        assert c1 == pytest.approx(c2 - p_r, rel=1e-13)


@BOTH
def test_the_force_is_the_slope_of_the_energy(smear):
    random = np.random.default_rng(5)
    for r in (1.0, 4.4, 4.7, 4.95):
        (a, b, d), (qa, qb) = random.normal(size=(3, 3)), random.normal(size=2)
        d *= r / np.linalg.norm(d)
        result = force(a, qa, b, qb, d, A, smear)
        for axis in range(3):
            step = 1e-5 * np.eye(3)[axis]
            slope = (energy(a, qa, b, qb, d + step, smear) - energy(a, qa, b, qb, d - step, smear)) / 2e-5
            assert result[axis] == pytest.approx(-slope, rel=1e-7, abs=1e-8)
        assert force(b, qb, a, qa, -d, A, smear) == pytest.approx(-result, rel=1e-13)
