"""Stokes drag: the closed form of a slowed grain, Couette flow, torque and work in the balances."""

from math import pi

import numpy as np
import pytest
from dem_laws import DENSITY, MASS, RADIUS, law

import emclutch
from coupling import Simulation, run_staggered
from coupling.effects.effect import Effect
from coupling.effects.fluid_drag import CouetteFlow, FluidDrag
from coupling.staggered import forces_of_the_field
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from geometry import Box
from particles import DEM, Body, Grains

pytestmark = pytest.mark.physics

SPEED, LEVER, TIME = 0.05, 0.004, 2e-3
DECAY = 1e-3
"""m / (3 pi eta d) [s]."""


class Pull(Effect):
    """A constant force [N] of a field."""

    of_the_field = True

    def __init__(self, force):
        self.force = force

    def add_forces(self, simulation, force):
        force += self.force
        return {}


def slowed(lagged_steps, decay=DECAY, more=()):
    """Velocity [m/s] and rows of a lone grain in a box, its drag constant for so many steps; and the simulation."""
    grains = Grains.create(np.array([[LEVER, 0.0, 0.01]]), RADIUS, DENSITY, velocity=np.array([[0.0, SPEED, 0.0]]))
    motion = DEM(grains, Box((0.02, 0.02, 0.02)).walls(), [Body("housing")], law("linear"), dt=2e-6, energy_budget=True)
    drag = FluidDrag(MASS / (6.0 * pi * RADIUS * decay))
    rows = []
    simulation = Simulation(motion, [drag, *more], None, None, steps_per_update=lagged_steps, steps=100)
    run_staggered(simulation, TIME, [lambda _, row: rows.append(row)])
    return motion.grains.velocity[0, 1], rows, simulation


@pytest.mark.parametrize("lagged_steps", [1, 4, 50])
@pytest.mark.parametrize("decay", [1e-2, 1e-3, 2e-4])
def test_a_lone_grain_slows_by_the_closed_form(lagged_steps, decay):
    """v = v_0 exp(-t/tau), whatever the time for which the force lags."""
    assert slowed(lagged_steps, decay)[0] == pytest.approx(SPEED * np.exp(-TIME / decay), rel=1e-9)


def test_the_force_of_the_field_is_without_the_drag():
    """At the terminal speed the grain holds no force in all, and that of the field is minus the drag."""
    duration = 4 * 2e-6
    terminal = np.array([0.0, -MASS * np.expm1(-duration / DECAY) / duration * SPEED, 0.0])
    speed, _, simulation = slowed(4, more=[Pull(terminal)])
    assert speed == pytest.approx(SPEED, rel=1e-9)
    assert np.abs(simulation.motion.external_force).max() < 1e-9 * terminal[1]
    assert forces_of_the_field(simulation)[0] == pytest.approx(terminal, rel=1e-9)


def test_a_stiff_drag_neither_overshoots_nor_diverges():
    """Held for 50 relaxation times the grain stops; the explicit force would multiply its speed by -49."""
    assert abs(slowed(50, decay=2e-6)[0]) < 1e-9 * SPEED


def test_its_torque_and_work_close_the_balances():
    rows = slowed(2)[1]
    assert len(rows) == 10
    taken = 0.0
    for row in rows:
        on_the_fluid = -row.other_torque["fluid_drag"]
        assert not row.field_torque and not row.lagged_is_magnetic
        assert on_the_fluid > 0.0  # with the grain's motion
        assert abs(row.torque_residual) < 1e-9 * on_the_fluid
        assert abs(row.energy.residual) < 1e-9 * abs(row.energy.work_lagged)
        taken += row.energy.work_lagged
    assert taken == pytest.approx(-0.5 * MASS * SPEED**2 * (1.0 - np.exp(-2.0 * TIME / DECAY)), rel=1e-9)


def test_couette_flow_obeys_its_equation_and_boundaries():
    """No slip at both cylinders; d/dr (1/r d(r u)/dr) = 0 between, so no net torque: r^3 d(u/r)/dr is constant."""
    inner, outer = Body("disc"), Body("rotor")
    inner.speed, outer.speed = -3.0, 7.0
    flow = CouetteFlow(0.01, 0.03, inner, outer)
    r = np.linspace(0.01, 0.03, 400)
    u = flow(np.column_stack((r, 0.0 * r, 0.0 * r)))
    assert np.abs(u[:, [0, 2]]).max() == 0.0
    assert u[0, 1] == pytest.approx(-3.0 * 0.01) and u[-1, 1] == pytest.approx(7.0 * 0.03)
    stress = r**3 * np.gradient(u[:, 1] / r, r, edge_order=2)
    np.testing.assert_allclose(stress[1:-1], 2.0 * 10.0 * 0.01**2 * 0.03**2 / (0.03**2 - 0.01**2), rtol=1e-3)
    turned = flow(np.array([[0.0, 0.02, 0.5]]))[0]
    assert turned[0] == pytest.approx(-flow(np.array([[0.02, 0.0, 0.0]]))[0, 1]) and turned[1] == 0.0
    inner.speed = outer.speed = 5.0  # as a rigid body
    np.testing.assert_allclose(flow(np.array([[0.02, 0.0, 0.0]]))[0], [0.0, 0.1, 0.0])


CELL = {
    "scene": {"title": "Grains in oil"},
    "geometry": {"kind": "shear_cell", "inner_radius": "20 mm", "outer_radius": "40 mm", "height": "30 mm"},
    "particles": {"diameter": "1 mm", "count": 20, "density": "7800 kg/m^3"},
    "contact": {"friction": 0.3, "restitution": 0.5, "stiffness": "50 kN/m"},
    "motion": {"rotor": {"speed": "60 rpm"}},
    "effects": {"fluid_drag": {"viscosity": "20 Pa s", "flow": "couette"}},
    "time": {"end": "20 ms", "window": "2 ms"},
    "output": {"snapshots": 1, "pictures": False},
}


@pytest.mark.parametrize("method", ["dem", "dvi"])
def test_grains_in_a_scene_follow_the_flow(method, tmp_path):
    """Relaxation of 22 us: after 20 ms every grain goes with the fluid around it."""
    result = emclutch.run(case_from(CELL, {"contact.method": method}), out=tmp_path / method)
    history = result.history
    assert "torque_fluid_drag" in history and result.summary["effects"] == ["fluid_drag"]
    assert abs(history["torque_residual"].iloc[-1]) < 1e-6 * abs(history["torque_fluid_drag"]).max()
    state = emclutch.results.checkpoint.read_checkpoint(result.folder.path / "checkpoint.h5")["dem"]
    x, v = state["position_radius"][:, :2], state["velocity_force"][:, :2]
    r = np.hypot(*x.T)
    turned = (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) / r
    a, b, speed = 0.02**2, 0.04**2, 2.0 * pi
    np.testing.assert_allclose(turned, speed * b / (b - a) * (r - a / r), rtol=0.02)


def test_what_a_scene_gets_wrong_is_reported():
    with pytest.raises(SceneError, match=r"fluid_drag\.viscosity"):
        case_from(CELL, {"effects.fluid_drag.viscosity": "1 m"})
    box = {"geometry": {"kind": "box", "size": ["10 mm", "10 mm", "10 mm"]}, "motion": {}}
    with pytest.raises(SceneError, match=r"fluid_drag\.flow.*needs a gap between two coaxial cylinders"):
        case_from(CELL | box, {})
