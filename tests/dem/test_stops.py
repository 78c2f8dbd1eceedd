"""The longest step allowed is stable and a longer one refused; a stop says which grain, where, when, and what to do."""

import numpy as np
import pytest
from dem_laws import DENSITY, LAWS, MASS, RADIUS, SPEED, energy, law, make_dem

from geometry.box import Box
from particles import (
    Body,
    DemError,
    DemErrorKind,
    Grains,
    choose_time_step,
)

pytestmark = [pytest.mark.hard, pytest.mark.physics]


@pytest.mark.parametrize("name", LAWS)
def test_the_longest_step_allowed_is_stable_and_a_longer_one_is_refused(name):
    """At the limit a gas in a box loses energy as it should; beyond it the refusal names the limit."""
    contact = law(name, 0.8, 0.5)
    low, high = 1e-8, 1e-3
    for _ in range(60):
        middle = np.sqrt(low * high)
        try:
            choose_time_step(contact, MASS, RADIUS, dt=middle)
            low = middle
        except ValueError:
            high = middle
    side = 12.0 * RADIUS
    cell = Box((side, side, side))
    k = np.arange(-1.5, 2.0) * 2.6 * RADIUS
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, k + 0.5 * side)], axis=1)
    v = np.random.default_rng(3).normal(size=x.shape) * 0.3

    def gas(dt):
        grains = Grains.create(x, RADIUS, DENSITY, velocity=v, angular_velocity=v[::-1] * 300.0)
        return make_dem(grains, cell.walls(), [Body("housing")], contact, dt=dt)

    # the limit of a Hertzian law is that of its lightest touch; here it is to resolve impacts at 1 m/s
    dt = min(low, contact.contact_time(0.5 * MASS, 0.5 * RADIUS, SPEED) / 5.0)
    dem = gas(dt)
    before = dem.grains.kinetic_energy()
    after = energy(dem.run(int(0.02 / dt)))
    assert after < 0.7 * before
    with pytest.raises(ValueError, match=r"dt = .* s; allowed: more than 0 and at most .* s \(.*\); leave it out"):
        gas(1.01 * high)


def test_stops_name_grain_place_time_and_remedy():
    """Too soft under load, too fast for the step, a force that is no number, a grain outside: each says what to do."""
    cell = Box((0.02, 0.02, 0.02))
    where = r"grain 1 at \(x, y, z\) = \(.*\) mm \(r = .* mm\), t = .* s: "

    def scene(velocity=(0.0, 0.0, 0.0), contact=None, x=(0.005, 0.0, 0.01)):
        grains = Grains.create([[-0.005, 0.0, 0.01], x], RADIUS, DENSITY, velocity=[[0.0, 0.0, 0.0], velocity])
        return make_dem(grains, cell.walls(), [Body("housing")], contact or law("linear"))

    heavy = scene()
    heavy.external_force = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -100.0]])
    with pytest.raises(DemError, match=where + r"it overlaps .* % .*raise the stiffness.*shorten dt") as too_deep:
        heavy.run(100_000)
    with pytest.raises(DemError, match=where + r"at 1e\+03 m/s it moves .* radii .*shorten dt") as too_fast:
        scene((1000.0, 0.0, 0.0)).run(1000)  # it would tunnel
    with pytest.raises(DemError, match=where + r"it overlaps .* % .*shorten dt"):
        scene((100.0, 0.0, 0.0)).run(1000)
    broken = scene()
    broken.external_force = np.array([[0.0, 0.0, 0.0], [0.0, np.inf, 0.0]])
    with pytest.raises(
        DemError, match=where + r"its position or velocity is not a finite number.*external forces"
    ) as not_finite:
        broken.run(10)
    spun = scene()
    spun.grains.angular_velocity[1, 2] = np.nan
    with pytest.raises(DemError, match=where + "its position or velocity is not a finite number"):
        spun.run(10)
    with pytest.raises(DemError, match=where + "its position or velocity is not a finite number"):
        scene((1e160, 0.0, 0.0)).run(10)  # the square of its speed is not
    lost = scene()
    lost.grains.position[int(np.flatnonzero(lost.grains.particle_id == 1)[0])] = [0.0, 0.0, 0.05]
    lost.invalidate()
    with pytest.raises(DemError, match=where + r"it has left the device .*(slot|raise the stiffness)") as escaped:
        lost.run(10)
    kinds = [stop.value.kind for stop in (too_deep, too_fast, not_finite, escaped)]
    assert kinds == [DemErrorKind.OVERLAP, DemErrorKind.TOO_FAST, DemErrorKind.NOT_FINITE, DemErrorKind.ESCAPED]


def test_a_stop_leaves_the_last_good_state_usable():
    """What was saved before the stop continues after it, once the cause is gone."""
    cell = Box((0.02, 0.02, 0.02))
    grains = Grains.create([[0.0, 0.0, 0.01]], RADIUS, DENSITY, velocity=[[0.3, 0.2, 0.1]])
    dem = make_dem(grains, cell.walls(), [Body("housing")], law("linear"))
    dem.run(500)
    saved, x = dem.state(), dem.grains.position.copy()
    dem.external_force = np.array([[np.nan, 0.0, 0.0]])
    with pytest.raises(DemError):
        dem.run(500)
    dem.restore(saved)
    assert np.array_equal(dem.grains.position, x) and dem.external_force is None
    totals = dem.run(500)
    assert np.isfinite(energy(totals)) and np.isfinite(dem.grains.position).all()
