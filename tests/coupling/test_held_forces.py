"""An effect that is no field acts in a scene without a field, on the clock of the held forces, and is booked."""

from math import pi

import numpy as np
import pytest
from dem_laws import DENSITY, MASS, RADIUS, law

from coupling import Effect, Simulation, run_staggered
from geometry import Box
from particles import DEM, Body, Grains

pytestmark = pytest.mark.physics

SPEED, LEVER, TIME = 0.05, 0.004, 2e-3
DECAY = 1e-3
"""m / (6 pi eta R) [s]."""


class StokesDrag(Effect):
    """F = -6 pi eta R v of a resting fluid."""

    name = "stokes_drag"

    def __init__(self, viscosity):
        self.viscosity = viscosity

    def add_forces(self, simulation, force):
        grains = simulation.motion.grains
        drag = -6.0 * pi * self.viscosity * grains.radius[:, None] * grains.velocity
        force += drag
        x = grains.position
        return {self.name: float((x[:, 0] * drag[:, 1] - x[:, 1] * drag[:, 0]).sum())}


def slowed(held):
    """Speed [m/s] and rows of a lone grain in a box, its drag held for so many steps."""
    grains = Grains.create(np.array([[LEVER, 0.0, 0.01]]), RADIUS, DENSITY, velocity=np.array([[0.0, SPEED, 0.0]]))
    motion = DEM(grains, Box((0.02, 0.02, 0.02)).walls(), [Body("housing")], law("linear"), dt=2e-6, energy_budget=True)
    drag = StokesDrag(MASS / (6.0 * pi * RADIUS * DECAY))
    rows = []
    simulation = Simulation(motion, [drag], None, None, steps_per_update=held, updates=100 // held)
    run_staggered(simulation, TIME, [lambda _, row: rows.append(row)])
    return motion.grains.velocity[0, 1], rows


def test_a_drag_slows_a_grain_without_a_field_by_its_closed_form():
    """v = v_0 exp(-t / tau); held for n steps each is v (1 - n dt / tau): first order in the time held."""
    expected = SPEED * np.exp(-TIME / DECAY)
    error = [abs(slowed(held)[0] / expected - 1.0) for held in (2, 4)]
    assert error[0] == pytest.approx(0.5 * TIME * 2 * 2e-6 / DECAY**2, rel=0.02)
    assert error[1] == pytest.approx(2.0 * error[0], rel=0.02)


def test_what_a_drag_takes_is_booked_beside_the_field():
    """Its torque has its own column and no field has any; its work is all that the grain loses."""
    rows = slowed(2)[1]
    assert len(rows) == 10
    taken = 0.0
    for row in rows:
        assert "torque_field" not in row and "work_magnetic" not in row
        assert row["torque_stokes_drag"] > 0.0  # on the fluid, with the grain's motion
        assert abs(row["torque_residual"]) < 1e-9 * row["torque_stokes_drag"]
        assert abs(row["energy_residual"]) < 1e-9 * abs(row["work_held"])
        taken += row["work_held"]
    assert taken == pytest.approx(-0.5 * MASS * SPEED**2 * (1.0 - np.exp(-2.0 * TIME / DECAY)), rel=0.01)
