"""Coulomb's and Signorini's laws of one rigid contact alone, against their definition and an independent search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from particles.dvi.local_problem import coulomb_block, natural_map

finite = st.floats(-10.0, 10.0, allow_subnormal=False)


def coulomb_isotropic(w_n, w_t, mu, q_n, *q_t):
    """Exact Coulomb for W = diag(w_n, w_t, w_t), in closed form."""
    if q_n >= 0.0:
        return 0.0, 0.0, 0.0
    r_n, r_t = -q_n / w_n, -np.array(q_t) / w_t
    size = np.hypot(*r_t)
    return r_n, *(r_t * (mu * r_n / size) if size > mu * r_n else r_t)


def convex_isotropic(w_n, w_t, mu, q_n, *q_t):
    """Convex relaxation for W = diag(w_n, w_t, w_t), in closed form."""
    size, r_n = np.hypot(*q_t), -q_n / w_n
    if q_n >= mu * size:
        return 0.0, 0.0, 0.0
    if size / w_t <= mu * r_n:
        return r_n, *(-np.array(q_t) / w_t)
    r_n = (mu * size - q_n) / (w_n + mu * mu * w_t)
    return r_n, *(-mu * r_n * np.array(q_t) / size)


def _six(w):
    return w[0, 0], w[0, 1], w[0, 2], w[1, 1], w[1, 2], w[2, 2]


def _random_block(rng, spread=1.0):
    a = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-spread, spread, size=(3, 1))
    return a @ a.T + 1e-3 * np.trace(a @ a.T) * np.eye(3)


def test_which_cone():
    """tests/REFERENCE.md section 5: W = I, q = (-1, 1, 3), mu = 0.1 tells exact Coulomb from its convex relaxation."""
    exact, convex = (1.0, -0.0316228, -0.0948683), (1.3031958, -0.0412107, -0.1236320)
    assert coulomb_isotropic(1.0, 1.0, 0.1, -1.0, 1.0, 3.0) == pytest.approx(exact, abs=5e-8)
    assert coulomb_block(1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.1, -1.0, 1.0, 3.0) == pytest.approx(exact, abs=5e-8)
    assert convex_isotropic(1.0, 1.0, 0.1, -1.0, 1.0, 3.0) == pytest.approx(convex, abs=5e-8)


@settings(deadline=None, max_examples=200)
@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(0.0, 2.0), finite, finite, finite)
def test_general_block_contains_the_isotropic_one(w_n, w_t, mu, q_n, q_1, q_2):
    simple = coulomb_isotropic(w_n, w_t, mu, q_n, q_1, q_2)
    general = coulomb_block(w_n, 0.0, 0.0, w_t, 0.0, w_t, mu, q_n, q_1, q_2)
    assert general == pytest.approx(simple, rel=1e-11, abs=1e-11)


def test_laws_hold_on_random_blocks():
    """Signorini: r_n, u_n >= 0 and r_n u_n = 0; Coulomb: u_t opposes r_t, on the cone wherever u_t is not 0."""
    rng = np.random.default_rng(1)
    seen = {"open": 0, "stick": 0, "slide": 0}
    for _ in range(3000):
        w, q, mu = (
            _random_block(rng, 2.0),
            rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3),
            10.0 ** rng.uniform(-2, 0.5),
        )
        r = np.array(coulomb_block(*_six(w), mu, *q))
        u = w @ r + q
        size, speed = np.linalg.norm(r[1:]), np.linalg.norm(u[1:])
        scale = np.linalg.norm(q)
        assert r[0] >= 0.0 and size <= mu * r[0] * (1.0 + 1e-12)
        assert u[0] >= -1e-11 * scale and r[0] * abs(u[0]) <= 1e-11 * scale * max(r[0], 1e-300)
        if r[0] == 0.0:
            seen["open"] += 1
        elif speed <= 1e-9 * scale:
            seen["stick"] += 1
        else:
            seen["slide"] += 1
            assert size == pytest.approx(mu * r[0], rel=1e-12)
            assert r[1:] @ u[1:] == pytest.approx(-size * speed, rel=1e-9)
    assert min(seen.values()) > 100


def test_sliding_impulse_equals_a_search_over_directions():
    """Scan the direction d of r_t; u_n = 0 gives r_n, and u_t x d = 0 with u_t.d < 0 marks the solution."""
    rng = np.random.default_rng(2)
    found = 0
    while found < 40:
        # weak coupling only: then the solution is unique and the scan cannot meet another one
        w = np.diag(rng.uniform(0.5, 5.0, 3)) + 0.1 * _random_block(rng, 0.0)
        q, mu = rng.normal(size=3) - np.array([2.0, 0.0, 0.0]), rng.uniform(0.05, 0.5)
        r = np.array(coulomb_block(*_six(w), mu, *q))
        u = w @ r + q
        if r[0] == 0.0 or np.linalg.norm(u[1:]) < 1e-6:
            continue

        def impulse(angle, w=w, q=q, mu=mu):
            d = np.array([1.0, mu * np.cos(angle), mu * np.sin(angle)])
            return -q[0] / (w[0] @ d) * d

        def across(angle, w=w, q=q):
            s = w @ impulse(angle) + q
            return s[1] * np.sin(angle) - s[2] * np.cos(angle)

        angles = np.linspace(0.0, 2.0 * np.pi, 361)
        values = [across(a) for a in angles]
        roots = [
            brentq(across, a, b, xtol=1e-14)
            for a, b, x, y in zip(angles[:-1], angles[1:], values[:-1], values[1:], strict=True)
            if x * y < 0.0
        ]
        opposed = [a for a in roots if (w @ impulse(a) + q)[1:] @ [np.cos(a), np.sin(a)] < 0.0]
        assert len(opposed) == 1
        assert impulse(opposed[0]) == pytest.approx(r, rel=1e-9, abs=1e-12)
        found += 1


@settings(deadline=None, max_examples=200)
@given(st.floats(0.0, 1.0), st.floats(-3.0, 3.0), finite, finite)
def test_free_rotor_row_slows_the_circumferential_direction_alone(angle, log_inertia, q_1, q_2):
    """w_t + rho^2/J along one direction: sticks at (q_1/(w_t + rho^2/J), q_2/w_t) whatever J, if mu allows."""
    w_t, extra = 3.5, 10.0**-log_inertia
    r = coulomb_block(1.0, 0.0, 0.0, w_t + extra, 0.0, w_t, 1e6, -1.0, q_1, q_2)
    assert r == pytest.approx((1.0, -q_1 / (w_t + extra), -q_2 / w_t), rel=1e-12, abs=1e-12)
    # the frame in the tangent plane is free
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    w = turn @ np.diag([1.0, w_t + extra, w_t]) @ turn.T
    q = turn @ [-1.0, q_1, q_2]
    there = coulomb_block(*_six(w), 0.3, *q)
    here = coulomb_block(1.0, 0.0, 0.0, w_t + extra, 0.0, w_t, 0.3, -1.0, q_1, q_2)
    assert there == pytest.approx(tuple(turn @ here), rel=1e-9, abs=1e-9)


def test_convex_law_is_the_minimum_of_its_quadratic():
    """r minimises r'Wr/2 + q'r over the cone: no admissible neighbour is lower."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        w_n, w_t = rng.uniform(0.2, 5.0, 2)
        mu, q = rng.uniform(0.05, 1.5), rng.normal(size=3)
        r = np.array(convex_isotropic(w_n, w_t, mu, *q))
        w = np.array([w_n, w_t, w_t])

        def energy(x, w=w, q=q):
            return 0.5 * np.sum(w * x * x, axis=-1) + x @ q

        n = rng.uniform(0.0, 3.0, 500) + r[0] * rng.integers(0, 2, 500)
        a, fraction = rng.uniform(0.0, 2.0 * np.pi, 500), rng.uniform(0.0, 1.0, 500)
        other = np.stack([n, mu * n * fraction * np.cos(a), mu * n * fraction * np.sin(a)], axis=1)
        nearer = r + 1e-3 * (other - r)
        assert np.min(energy(other)) >= energy(r) - 1e-12
        assert np.min(energy(nearer)) >= energy(r) - 1e-12


def test_residual_sees_what_is_wrong_in_metres_a_second():
    """Zero at a solution; a gap violated by v counts v, whatever the mass; so does a held grain that should slide."""
    for mass in (1e-9, 1.0, 1e6):
        w_n = 1.0 / mass
        r = coulomb_isotropic(w_n, 3.5 * w_n, 0.3, -1.0, 0.5, 0.0)
        u = (w_n * r[0] - 1.0, 3.5 * w_n * r[1] + 0.5, 3.5 * w_n * r[2])
        assert natural_map(False, w_n, 0.3, *r, *u) < 1e-14
        assert natural_map(False, w_n, 0.3, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0) == pytest.approx(0.25)
        # kept in contact although it parts at 0.25 m/s, by an impulse that would change it by 1 m/s
        assert natural_map(False, w_n, 0.3, mass, 0.0, 0.0, 0.25, 0.0, 0.0) == pytest.approx(0.25)
        for mu in (0.0, 0.3):  # nor is anything wrong where it parts and carries nothing, also without friction
            assert natural_map(False, w_n, mu, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0) == 0.0
        # the convex law's own solution of a sliding contact is none of Coulomb's: it parts at mu |u_t|
        c = convex_isotropic(w_n, 3.5 * w_n, 0.3, -1.0, 5.0, 0.0)
        u = (w_n * c[0] - 1.0, 3.5 * w_n * c[1] + 5.0, 0.0)
        assert u[0] == pytest.approx(0.3 * u[1])
        assert natural_map(True, w_n, 0.3, *c, *u) < 1e-14
        assert natural_map(False, w_n, 0.3, *c, *u) > 0.1
