"""Energy of the neck over gap and mmf: the isolated pair gets its force and moment back; derivatives; the ends."""

import numpy as np
import pytest
from scipy.optimize import root

from field import GrainLaw
from field.spheres import pair_table as pair_module
from field.spheres.neck_energy import LOG_GAP, LOG_MMF, neck_energy
from field.spheres.pair_table import pair_table
from field.spheres.transverse_pair import (
    transverse_fraction,
    transverse_moment,
    transverse_response,
)

VOLUME = 4.0 / 3.0 * np.pi
FIELDS = np.array([1.0, 5.0, 18.0, 46.0, 80.0, 120.0, 200.0, 300.0, 500.0]) / 1700.0  # Ms


def isolated_pair(table, chi, g, h):
    """Force [mu_0 Ms^2 a^2] and moment [Ms] of a pair on the axis of the field h: stationary in M and D."""
    R = 2.0 + g

    def rest(unknowns):
        M, D = 1.0 - np.exp(unknowns[0]), np.exp(unknowns[1])
        neck = table.at(g, D, 1.0 - M)
        T = M + neck.q * R / (2.0 * VOLUME)
        inside = M / 3.0 + M / (chi * (1.0 - M)) - (4.0 * M - 2.0 * T) / (3.0 * R**3) - neck.w_s / (2.0 * VOLUME)
        mmf = h * R - 2.0 / 3.0 * M / R**2 - (1.0 - 1.0 / R) * neck.q / (2.0 * np.pi)
        return [inside / h - 1.0, mmf / D - 1.0]

    start = np.log1p(-min(3.0 * h * chi / (chi + 3.0), 0.95)), np.log(0.5 * h * R)
    found = root(rest, start, tol=1e-12)
    assert np.abs(found.fun).max() < 1e-8
    M, D = 1.0 - np.exp(found.x[0]), np.exp(found.x[1])
    neck = table.at(g, D, 1.0 - M)
    force = 8.0 * np.pi / 3.0 * M**2 / R**4 - 4.0 / 3.0 * M * neck.q / R**3
    force += neck.q**2 / (4.0 * np.pi * R**2) - neck.q * h + neck.w_g
    return float(force), float(M + neck.q * R / (2.0 * VOLUME))


@pytest.mark.parametrize("chi", [10.0, 50.0, 999.0])
def test_an_isolated_pair_has_force_and_moment_of_its_table(chi):
    law = GrainLaw(chi, 1.7e6)
    table, pair = neck_energy(law), pair_table(law)
    for g in (1e-3, 4e-3, 0.02, 0.03, 0.1, 0.3, 1.0):
        for h in FIELDS:
            force, moment = isolated_pair(table, chi, g, h)
            assert force == pytest.approx(float(pair.force_of(g, h)), rel=1e-3), (g, h)
            # far apart at the knee the moments of the pair's table are 2e-4 off themselves
            assert moment == pytest.approx(float(pair.moment_of(g, h)), rel=1e-3 if g < 1.0 else 1.2e-3), (g, h)


def test_a_susceptibility_between_those_that_ship():
    """Near the pair table that is interpolated there itself: 0.8 % of force, 0.05 % of moment."""
    law = GrainLaw(35.0, 1.7e6)
    table, pair = neck_energy(law), pair_table(law)
    for g in (1e-3, 0.03, 0.3):
        for h in FIELDS:
            force, moment = isolated_pair(table, 35.0, g, h)
            assert force == pytest.approx(float(pair.force_of(g, h)), rel=8e-3), (g, h)
            assert moment == pytest.approx(float(pair.moment_of(g, h)), rel=5e-4), (g, h)


@pytest.fixture(scope="module")
def iron():
    return neck_energy(GrainLaw(999.0, 1.7e6))


def test_shape_and_grids(iron):
    assert iron.patch.shape == (LOG_GAP.size, LOG_MMF.size, 4) and iron.patch.flags.c_contiguous
    assert np.array_equal(iron.y, iron.patch[:, :, 0]) and np.all(iron.y < 0.0)
    assert neck_energy(GrainLaw(999.0, 1.7e6)) is iron


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_derivatives_are_those_of_the_energy(iron, sign):
    rng = np.random.default_rng(3)
    g, s = np.exp(rng.uniform(np.log(3e-4), np.log(1.19), 400)), rng.uniform(0.005, 1.0, 400)
    D = sign * np.exp(rng.uniform(np.log(1e-6), np.log(5.0), 400))
    here = iron.at(g, D, s)

    def slope(name, along):
        def value(step):
            values = [g, D, s]
            values[along] = values[along] * (1.0 + step)
            return getattr(iron.at(*values), name)

        e = 1e-5
        return (8.0 * (value(e) - value(-e)) - (value(2.0 * e) - value(-2.0 * e))) / (12.0 * e * (g, D, s)[along])

    size = np.abs(here.w)
    for derivative, name, along, unit in (
        (-here.q, "w", 1, size / np.abs(D)),
        (here.w_s, "w", 2, size / s),
        (here.w_g, "w", 0, size / g),
        (here.dq_dD, "q", 1, size / D**2),
        (here.dq_ds, "q", 2, size / np.abs(D) / s),
        (here.w_ss, "w_s", 2, size / s**2),
    ):
        # second derivatives jump at the nodes and a difference reaches over some of them
        allowed = 1e-7 if name == "w" else 3e-3
        assert np.all(np.abs(slope(name, along) - derivative) <= allowed * unit), (name, along)


def test_the_neck_is_linear_below_and_carries_its_capacity_beyond(iron):
    low, high = np.exp(iron.log_mmf[0]), np.exp(iron.log_mmf[-1])
    g = np.array([4e-4, 0.03, 0.9])
    small = [iron.at(g, f * low, 1.0) for f in (1e-6, 1.0)]
    assert np.allclose(small[0].q / (1e-6 * low), small[1].q / low, rtol=1e-12)
    assert np.all(np.abs(small[0].w_s) < 1e-12 * np.abs(small[0].q)) and np.allclose(iron.at(g, 0.0, 0.5).q, 0.0)
    large = [iron.at(g, f * high * 0.1, 0.1) for f in (1.0, 100.0)]
    assert np.allclose(large[0].q, large[1].q, rtol=1e-12)
    assert np.allclose(iron.at(g, high, 0.2).q, 2.0 * iron.at(g, high * 10.0, 0.1).q, rtol=1e-12)


@pytest.mark.parametrize("end", [-1, 1])
def test_flux_and_force_have_no_jump_at_the_ends_of_the_mmf(iron, end):
    mmf = np.exp(iron.log_mmf[0 if end < 0 else -1])
    inside, outside = (iron.at([4e-4, 0.03, 0.9], mmf * (1.0 + side * 1e-9), 1.0) for side in (-1.0, 1.0))
    for name in ("w", "q", "w_g"):
        assert np.allclose(getattr(inside, name), getattr(outside, name), rtol=1e-7)


def test_the_energy_fades_without_a_bend(iron):
    assert np.all(iron.at([1.2, 1.5, 30.0], 0.1, 1.0).w == 0.0)
    for end in (1.0, 1.2):
        left, right = (iron.at(end + side * 1e-7, 0.1, 1.0) for side in (-1.0, 1.0))
        assert left.w_g == pytest.approx(right.w_g, abs=1e-5 * abs(iron.at(1.0, 0.1, 1.0).w_g))


def test_wrong_arguments_are_refused(iron):
    with pytest.raises(ValueError, match="first of the table"):
        iron.at(2e-4, 0.1, 1.0)
    with pytest.raises(ValueError, match="above 0"):
        iron.at(0.1, 0.1, 0.0)
    with pytest.raises(ValueError, match="saturat"):
        neck_energy(GrainLaw(999.0))


def test_every_shipped_table_gives_an_energy_of_one_sign():
    for chi in pair_module._SHIPPED_CHI:
        assert np.all(neck_energy(GrainLaw(chi, 1.0e6)).y < 0.0)


def test_the_whole_transverse_share_is_what_multipoles_leave_of_the_repulsion():
    """-dW/dR at constant H0 of two dipoles with W_t: the repulsion of ideal spheres."""
    for g in (1e-3, 0.05, 0.5):
        R = 2.0 + g
        fraction, slope = (float(one) for one in transverse_fraction(g, odd=False))
        M = transverse_moment(np.inf, g)
        energy = VOLUME**2 / (4.0 * np.pi) * M**2
        force = energy * (3.0 * (1.0 - fraction) / R**4 + slope / R**3)
        e = 1e-4
        slope = (transverse_moment(np.inf, g + e) - transverse_moment(np.inf, g - e)) / (2.0 * e)
        assert force == pytest.approx(VOLUME * slope, rel=1e-4)  # of two in H0: F = mu_0 H0 dm/dR
        assert force < 3.0 * energy / R**4  # less than two dipoles repel each other


def test_the_odd_share():
    """A third of the fraction of all orders, and its derivative with the fade."""
    g = np.array([3e-3, 0.03, 0.1, 0.3])
    odd, every = transverse_fraction(g)[0], transverse_fraction(g, odd=False)[0]
    assert np.all((odd / every > 0.28) & (odd / every < 0.37))
    e = 1e-6
    for g in (0.03, 0.6, 1.1):
        assert transverse_fraction(g)[1] == pytest.approx(
            (transverse_fraction(g + e)[0] - transverse_fraction(g - e)[0]) / (2.0 * e), rel=1e-6
        )
    assert transverse_fraction(1.2)[0] == 0.0


def test_the_response_of_a_sphere_is_that_of_froehlichs_law():
    chi, M = 40.0, np.array([0.0, 0.3, 0.9])
    inside, slope = 1.0 / (chi * (1.0 - M)), 1.0 / (chi * (1.0 - M) ** 2)  # h_in/M and dh_in/dM
    c = transverse_response(1.0 / (1.0 / 3.0 + inside), 1.0 / (1.0 / 3.0 + slope))
    assert np.allclose(c, ((1.0 + 3.0 * inside) * (1.0 + 3.0 * slope)) ** -0.6, rtol=1e-13)
