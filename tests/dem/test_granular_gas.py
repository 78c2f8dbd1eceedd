"""A gas of smooth inelastic grains cools as Haff's law says."""

import numpy as np
import pytest
from dem_laws import DENSITY, MASS, RADIUS, energy, make_dem

from geometry.box import Box
from particles import (
    Body,
    Grains,
    LinearContact,
    PairLaws,
)

pytestmark = [pytest.mark.hard, pytest.mark.physics]


def test_a_cooling_gas_obeys_haff():
    """Smooth inelastic spheres in a box: E(t) = E_0/(1 + t/tau)^2 (Haff, J. Fluid Mech. 134 (1983) 401).

    tau from kinetic theory: dT/dt = -(1 - e^2) nu T/3 with the Enskog collision rate of hard spheres
    nu = 16 n R^2 g(phi) sqrt(pi T/m), T the temperature in one direction, so that 1/tau = (1 - e^2) nu/6. Walls are
    elastic; N = 3 375 at phi = 5 %, fitted while E falls to a twentieth: tau to 5 %, the power to 5 %. (Of 1 000
    grains, whose walls take more of the room, it is 4 % less, 1 % from start to start.)
    """
    e, n, phi = 0.8, 3375, 0.05
    side = (n * 4.0 / 3.0 * np.pi * RADIUS**3 / phi) ** (1.0 / 3.0)
    k = (np.arange(15) - 7.0) * side / 15.0
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, k + 0.5 * side)], axis=1)
    v = np.random.default_rng(1).normal(size=x.shape)
    v -= v.mean(axis=0)
    cell = Box((side, side, side))
    between, at_walls = LinearContact.from_restitution(1e4, e, 0.0), LinearContact.from_restitution(1e4, 1.0, 0.0)
    laws = PairLaws.of_one(between, at_walls=at_walls)
    dem = make_dem(Grains.create(x, RADIUS, DENSITY, velocity=v), cell.walls(), [Body("housing")], laws, steps=15.0)
    times, energies = [0.0], [dem.grains.kinetic_energy()]
    for _ in range(40):
        energies.append(energy(dem.run(int(4e-3 / dem.dt))))
        times.append(dem.time)
    t, E = np.array(times), np.array(energies)
    temperature = 2.0 * E[0] / (3.0 * n)
    pair = (1.0 - 0.5 * phi) / (1.0 - phi) ** 3  # Carnahan & Starling's pair function at contact
    rate = 16.0 * n / side**3 * RADIUS**2 * pair * np.sqrt(np.pi * temperature / MASS)
    tau = 6.0 / ((1.0 - e**2) * rate)
    # E^(-1/2) is a straight line of slope 1/tau, which the fit tells to 1 %
    fit, spread = np.polyfit(t, np.sqrt(E[0] / E), 1, cov=True)
    slope = fit[0]
    assert np.sqrt(spread[0, 0]) < 0.01 * slope and fit[1] == pytest.approx(1.0, abs=0.05)
    assert E[0] / E[-1] > 15.0
    assert slope * tau == pytest.approx(1.0, rel=0.1)  # five times 1/sqrt(n), and 1 % of the fit
    late = t > 1.0 / slope
    power = np.polyfit(np.log(1.0 + slope * t[late]), np.log(E[late]), 1)[0]
    assert power == pytest.approx(-2.0, rel=0.05)
