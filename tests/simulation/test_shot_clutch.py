"""The shot clutch's closed forms against integrations of what they are derived from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emclutch.simulation.forecast.shot_clutch import (
    shot_clutch_torque,
    shot_ring_radius,
)

SHOT = {"friction": 0.3, "bulk_density": 4500.0, "width": 0.09, "drum_radius": 0.12, "ring_radius": 0.09}
OMEGA = 1000.0 * math.pi / 30.0


def test_torque_is_friction_on_the_stress_that_radial_equilibrium_builds_up():
    """d(sigma r)/dr = rho omega^2 r^2 without hoop stress, sigma = 0 at r_i; then T = mu sigma(r_o) 2 pi r_o L r_o."""
    rho, r_i, r_o = SHOT["bulk_density"], SHOT["ring_radius"], SHOT["drum_radius"]
    found = solve_ivp(lambda r, s: rho * OMEGA**2 * r - s / r, (r_i, r_o), [0.0], rtol=1e-10, atol=1e-6)
    stress = found.y[0, -1]
    torque = SHOT["friction"] * stress * 2.0 * math.pi * r_o * SHOT["width"] * r_o
    assert shot_clutch_torque(OMEGA, **SHOT) == pytest.approx(torque, rel=1e-7)


def test_torque_is_friction_on_the_centrifugal_force_of_every_bit_of_shot():
    rng = np.random.default_rng(2)
    r = np.sqrt(rng.uniform(SHOT["ring_radius"] ** 2, SHOT["drum_radius"] ** 2, 200_000))  # even over the ring
    mass = SHOT["bulk_density"] * math.pi * (0.12**2 - 0.09**2) * SHOT["width"]
    torque = SHOT["friction"] * mass * OMEGA**2 * r * SHOT["drum_radius"]
    error = torque.std() / math.sqrt(len(r))
    assert shot_clutch_torque(OMEGA, **SHOT) == pytest.approx(torque.mean(), abs=4.0 * error)


def test_a_thin_ring_presses_like_a_fluid_and_a_full_drum_two_thirds_as_hard():
    def fluid(ring):
        pressure = 0.5 * SHOT["bulk_density"] * OMEGA**2 * (0.12**2 - ring**2)
        return SHOT["friction"] * pressure * 2.0 * math.pi * 0.12**2 * SHOT["width"]

    thin, full = (shot_clutch_torque(OMEGA, **{**SHOT, "ring_radius": ring}) / fluid(ring) for ring in (0.1199, 0.0))
    assert thin == pytest.approx(1.0, abs=1e-3)
    assert full == pytest.approx(2.0 / 3.0, rel=1e-12)


@given(st.floats(1.0, 500.0), st.floats(0.1, 5.0))
def test_torque_is_quadratic_in_speed_and_follows_its_sense(speed, factor):
    torque = shot_clutch_torque(speed, **SHOT)
    assert shot_clutch_torque(factor * speed, **SHOT) == pytest.approx(factor**2 * torque)
    assert shot_clutch_torque(-speed, **SHOT) == -torque


@given(st.floats(1e-5, 4e-3))
def test_the_ring_holds_the_shot(volume):
    ring = shot_ring_radius(volume, 0.09, 0.12)
    held = math.pi * (0.12**2 - ring**2) * 0.09
    assert held == pytest.approx(min(volume, math.pi * 0.12**2 * 0.09))
