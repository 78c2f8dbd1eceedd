"""Restitution to damping, and the tangential spring taken by itself."""

import numpy as np
import pytest

from particles import LinearContact, damping_ratio, restitution_of
from particles.dem.step_kernel import _contact


@pytest.mark.parametrize("asked, clipped", [(0.9, 0.9020), (0.5, 0.5503), (0.2, 0.3249)])
def test_clipping_raises_the_textbook_restitution(asked, clipped):
    """Reference numbers of the non-tensile contact at zeta = -ln e/sqrt(pi^2 + ln^2 e)."""
    zeta = -np.log(asked) / np.hypot(np.pi, np.log(asked))
    assert restitution_of(zeta) == pytest.approx(clipped, abs=6e-5)


@pytest.mark.parametrize("e", [0.05, 0.1353, 0.2, 0.5, 0.9, 0.999, 1.0])
def test_damping_is_solved_for_the_clipped_law(e):
    assert restitution_of(damping_ratio(e)) == pytest.approx(e, rel=1e-10)


def test_restitution_is_continuous_at_critical_damping():
    assert restitution_of(1.0 - 1e-7) == pytest.approx(restitution_of(1.0 + 1e-7), rel=1e-4)


@pytest.mark.parametrize("e", [0.0, -0.1, 1.1, float("nan")])
def test_impossible_restitution_is_refused(e):
    with pytest.raises(ValueError, match=r"restitution = .*allowed: 0\.05 to 1"):
        damping_ratio(e)


def test_defaults_of_the_tangential_part():
    law = LinearContact.from_restitution(700.0, 0.5, 0.3)
    assert law.stiffness_t == pytest.approx(200.0)
    assert law.damping_t == pytest.approx(0.5 * law.damping_n)


@pytest.mark.parametrize("change", [{"stiffness_n": 0.0}, {"friction": -1.0}, {"wall_friction": float("nan")}])
def test_bad_parameters_are_refused(change):
    values = dict(stiffness_n=1.0, stiffness_t=1.0, damping_n=0.1, damping_t=0.1, friction=0.1) | change
    with pytest.raises(ValueError, match="allowed"):
        LinearContact(**values)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.48, 0.6, 0.64)])
def test_spring_turns_rigidly_with_the_pair(axis):
    """A loaded pair turned by 90 degrees as one body keeps |F_t|, and F_t turns with it."""
    from scipy.spatial.transform import Rotation

    axis, steps = np.array(axis), 400
    law = LinearContact(1000.0, 300.0, 0.0, 0.0, 10.0).table()
    n0, history = np.array([1.0, 0.0, 0.0]), np.array([[0.0, 1e-4, 2e-4]])
    start, dt, angle = history[0].copy(), 1e-3, 0.5 * np.pi
    spin = axis * angle / (steps * dt)
    for k in range(1, steps + 1):
        n = Rotation.from_rotvec(axis * angle * k / steps).apply(n0)
        force = _contact(law, 0, 1.0, dt, 1e-3, *n, 0.0, 0.0, 0.0, float(spin @ n), history, 0)
        tangential = np.array(force[:3]) + force[3] * n
        assert np.linalg.norm(tangential) == pytest.approx(300.0 * np.linalg.norm(start), rel=1e-12)
    expected = -300.0 * Rotation.from_rotvec(axis * angle).apply(start)
    assert tangential == pytest.approx(expected, abs=0.01 * np.linalg.norm(expected))


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_each_step_dissipates_and_respects_the_cap(friction):
    """Random sliding: |F_t| <= mu |F_n|, and no term of the loss is negative; the work is accounted for."""
    law = LinearContact.from_restitution(1000.0, 0.5, friction).table()
    rng, history, dt = np.random.default_rng(7), np.zeros((1, 3)), 1e-4
    n = np.array([0.0, 0.0, 1.0])
    for _ in range(2000):
        u = rng.normal(size=3) * [2.0, 2.0, 0.3]
        old = history[0].copy()
        fx, fy, _, f_n, _, _, lost_t, lost_s = _contact(law, 0, 1e-3, dt, 1e-4, *n, *u, 0.0, history, 0)
        assert f_n >= 0.0 and lost_t >= 0.0 and lost_s >= 0.0
        assert np.hypot(fx, fy) <= friction * f_n * (1.0 + 1e-12) + 1e-15
        k_t, change = law[0, 1], history[0] - old
        stored = 0.5 * k_t * (history[0] @ history[0] - old @ old) + 0.5 * k_t * (change @ change)
        assert -(fx * u[0] + fy * u[1]) * dt == pytest.approx(stored + lost_t + lost_s, rel=1e-9, abs=1e-15)


def test_contact_without_tangential_stiffness_has_no_tangential_force():
    law = LinearContact(1000.0, 0.0, 0.1, 0.0, 0.5).table()
    force = _contact(law, 0, 1e-3, 1e-4, 1e-4, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, np.zeros((1, 3)), 0)
    assert force[0] == 0.0 and np.isfinite(force).all()
