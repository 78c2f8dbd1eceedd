"""Eddy currents against Bessel series: diffusion into a rod, decay, skin depth; rates in time and space; energy.

The rod stands in an infinite solenoid: a slice of it between two planes z = const that no flux crosses, with the
axis as the only wall.  H outside the solenoid vanishes and inside is N I/h at once, whatever the rod does.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j0, j1, jn_zeros, jv
from section_grid import section_grid

from field import MU_0, AxisymmetricProblem, LinearLaw, material
from field.section.diffusion_time import diffusion_time
from field.section.eddy_currents import (
    CurrentDrive,
    EddyCurrentProblem,
    TransientState,
    VoltageDrive,
)
from geometry.time_profile import TimeProfile

pytestmark = pytest.mark.physics

A, H, SIGMA, MU_R, TURNS = 10e-3, 2e-3, 5e6, 100.0, 40
MU = MU_0 * MU_R
TAU = MU * SIGMA * A**2
NI = 200.0
B_END = MU * NI / H


@pytest.fixture(scope="module")
def solenoid():
    """solenoid(n, law, order): n cells across the rod's radius."""

    def build(n, law=None, order=2):
        r = np.round(np.concatenate((np.linspace(0.0, A, n + 1), [12e-3, 14e-3])), 9)
        mesh = section_grid(r, np.linspace(0.0, H, 2), {"rod": (0.0, A, -1.0, 1.0), "coil": (12e-3, 14e-3, -1.0, 1.0)})
        axis = mesh.boundaries["axis"]
        mesh = replace(mesh, boundaries={"outer": axis, "axis": axis})
        return AxisymmetricProblem(mesh, {"rod": law or LinearLaw(MU_R)}, order=order)

    return build


@pytest.fixture(scope="module")
def walled_rod():
    """walled_rod(n, order): the rod alone, psi given on its surface."""

    def build(n, order=2):
        mesh = section_grid(np.linspace(0.0, A, n + 1), np.linspace(0.0, H, 2), {"rod": (0.0, A, -1.0, 1.0)})
        outer = mesh.boundaries["outer"]
        surface = outer[np.isclose(mesh.points[outer][:, :, 0].min(axis=1), A)]
        mesh = replace(mesh, boundaries={"outer": surface, "axis": mesh.boundaries["axis"]})
        return AxisymmetricProblem(mesh, {"rod": LinearLaw(MU_R)}, order=order)

    return build


def rod_flux(problem, psi):
    """Flux through the rod [Wb]."""
    at = np.argmin(np.abs(problem.elements.dof_points[:, 0] - A))
    return 2.0 * np.pi * psi[at]


def exact_flux(t):
    """After a step of H: pi a^2 B (1 - 4 sum exp(-x_n^2 t/tau)/x_n^2), J_0(x_n) = 0 (Carslaw and Jaeger, 7.6)."""
    x = jn_zeros(0, 400)
    return np.pi * A**2 * B_END * (1.0 - 4.0 * np.sum(np.exp(-(x**2) * t / TAU) / x**2))


@pytest.mark.parametrize(("method", "order"), [("backward_euler", 1), ("sdirk2", 2)])
def test_flux_into_a_rod_after_a_step_of_the_current(solenoid, method, order):
    eddy = EddyCurrentProblem(solenoid(16), {"rod": SIGMA}, turns=TURNS)
    end, errors = 0.2 * TAU, []
    for steps in (10, 20, 40):
        state = eddy.at_rest()
        for _ in range(steps):
            state = eddy.step(state, end / steps, CurrentDrive(lambda t: NI / TURNS), method=method)
        errors.append(abs(rod_flux(eddy.problem, state.psi) / exact_flux(end) - 1.0))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(order, abs=0.1), errors
    assert errors[-1] < (6e-3 if order == 1 else 2e-5), errors


def test_flux_density_inside_follows_the_series(solenoid):
    """B(r, t) = B (1 - 2 sum J_0(x_n r/a) exp(-x_n^2 t/tau)/(x_n J_1(x_n)))."""
    eddy = EddyCurrentProblem(solenoid(24), {"rod": SIGMA}, turns=TURNS)
    states = eddy.run(eddy.at_rest(), 0.15 * TAU, CurrentDrive(lambda t: NI / TURNS), tolerance=1e-4)
    r = np.array([2.1e-3, 5.3e-3, 8.2e-3])
    found = eddy.field(states[-1]).flux_density(np.column_stack((r, np.full(3, 0.6e-3))))[:, 1]
    x = jn_zeros(0, 60)[:, None]
    exact = B_END * (1.0 - 2.0 * (j0(x * r / A) * np.exp(-(x**2) * 0.15) / (x * j1(x))).sum(axis=0))
    assert np.allclose(found, exact, rtol=0.0, atol=2e-3 * B_END)


@pytest.mark.parametrize(("order", "rate"), [(1, 1.4), (2, 2.4)])
def test_first_mode_decays_at_its_rate(walled_rod, order, rate):
    """psi = r J_1(x r/a), J_1(x) = 0, decays like exp(-x^2 t/tau).

    The error in space falls with h^(order + 1) but for the axis' cells, where the weight 1/r costs half an order.
    """
    x, errors = jn_zeros(1, 1)[0], []
    for n in (4, 8, 16):
        problem = walled_rod(n, order)
        r = problem.elements.dof_points[:, 0]
        eddy = EddyCurrentProblem(problem, {"rod": SIGMA})
        state = TransientState(0.0, r * j1(x * r / A), 0.0, 0.0)
        end = TAU / x**2
        for _ in range(60):
            state = eddy.step(state, end / 60, CurrentDrive(lambda t: 0.0))
        exact = r * j1(x * r / A) * np.exp(-1.0)
        errors.append(np.linalg.norm(state.psi - exact) / np.linalg.norm(exact))
    assert np.log2(errors[0] / errors[-1]) / 2.0 > rate, errors


def test_imposed_flux_redistributes(walled_rod):
    """A step of the total flux, psi = B r^2/2 on the surface: psi = B r^2/2 - sum B a r J_1(y r/a)/(y J_2(y)) exp.

    J_1(y) = 0: the field is first all in the surface and then uniform.
    """
    problem = walled_rod(24)
    eddy = EddyCurrentProblem(problem, {"rod": SIGMA})
    r, B = problem.elements.dof_points[:, 0], 0.1
    start = np.where(r > A * (1.0 - 1e-9), 0.5 * B * r**2, 0.0)
    state, end = TransientState(0.0, start, 0.0, 0.0), 0.05 * TAU
    for _ in range(60):
        state = eddy.step(state, end / 60, CurrentDrive(lambda t: 0.0), boundary_field=lambda t: B)
    y = jn_zeros(1, 60)[:, None]
    exact = 0.5 * B * r**2 - (B * A * r * j1(y * r / A) / (y * jv(2, y)) * np.exp(-(y**2) * 0.05)).sum(axis=0)
    assert np.abs(state.psi - exact).max() < 2e-3 * 0.5 * B * A**2


def test_skin_effect_in_a_steady_sinusoid(solenoid):
    """Complex flux pi a^2 B 2 J_1(k a)/(k a J_0(k a)), k = (1 - j)/delta, delta = sqrt(2/(omega mu sigma)) = a/4."""
    omega = 2.0 / (MU * SIGMA * (A / 4.0) ** 2)
    eddy = EddyCurrentProblem(solenoid(32), {"rod": SIGMA}, turns=TURNS)
    period, per_period = 2.0 * np.pi / omega, 80
    state, fluxes, times = eddy.at_rest(), [], []
    drive = CurrentDrive(lambda t: NI / TURNS * np.cos(omega * t))
    for k in range(4 * per_period):
        state = eddy.step(state, period / per_period, drive)
        if k >= 3 * per_period:
            fluxes.append(rod_flux(eddy.problem, state.psi))
            times.append(state.time)
    phasor = 2.0 * np.mean(np.array(fluxes) * np.exp(-1j * omega * np.array(times)))
    ka = (1.0 - 1.0j) * 4.0
    exact = np.pi * A**2 * B_END * 2.0 * jv(1, ka) / (ka * jv(0, ka))
    assert abs(phasor / exact - 1.0) < 5e-3


def nonlinear(solenoid, conductivity=None):
    return EddyCurrentProblem(
        solenoid(12, material("steel_1010")), {"rod": SIGMA} if conductivity is None else conductivity, turns=TURNS
    )


def test_energy_balance_of_a_saturating_rod_at_a_voltage(solenoid):
    """Supplied = copper + eddy + stored, to the method's order: 2 (of a smooth rise of the voltage)."""
    eddy, rise = nonlinear(solenoid), 4e-3
    drive = VoltageDrive(lambda t: 2.5 * min(t / rise, 1.0) ** 2, 0.5)
    left = []
    for steps in (20, 40, 80):
        state = eddy.at_rest()
        for _ in range(steps):
            state = eddy.step(state, rise / steps, drive)
        stored = eddy.field(state).energy
        left.append(abs(state.supplied - state.copper_loss - state.eddy_loss - stored) / state.supplied)
    assert left[-1] < 1e-3 and np.log2(left[0] / left[-1]) / 2.0 > 1.6, left
    assert state.eddy_loss > 0.1 * state.supplied, "a balance of something"


@pytest.mark.parametrize("law", [None, material("steel_1010")])
def test_energy_of_a_jump_of_the_current(solenoid, law):
    """At the jump 1/2 I lambda of the air between rod and coil is supplied, H falling linearly in the coil; then
    supplied = eddy + stored, to the tolerance."""
    eddy, current = EddyCurrentProblem(solenoid(16, law), {"rod": SIGMA}, turns=TURNS), NI / TURNS
    drive = CurrentDrive(lambda t: current)
    at_once = eddy.step(eddy.at_rest(), 1e-9 * TAU, drive)
    b, d = 12e-3, 2e-3
    area = np.pi * (b**2 - A**2) + 2.0 * np.pi * d * (b / 3.0 + d / 12.0)
    assert at_once.supplied == pytest.approx(0.5 * MU_0 * (NI / H) ** 2 * H * area, rel=1e-4)
    assert at_once.supplied == pytest.approx(eddy.field(at_once).energy, rel=1e-3)
    end = eddy.run(eddy.at_rest(), 0.05 * TAU, drive, tolerance=1e-3)[-1]
    assert end.supplied == pytest.approx(end.eddy_loss + eddy.field(end).energy, rel=1e-3)
    off = eddy.run(end, 0.1 * TAU, CurrentDrive(lambda t: 0.0), tolerance=1e-3)[-1]
    assert off.supplied == pytest.approx(off.eddy_loss + eddy.field(off).energy, rel=2e-3)


def test_a_ramp_of_no_length_is_a_jump(solenoid):
    """A table of the current can write a jump only as a ramp, here of 1e-7 of the interval."""
    eddy, current = EddyCurrentProblem(solenoid(8, LinearLaw(50.0)), {"rod": SIGMA}, turns=TURNS), NI / TURNS
    end = 0.05 * TAU
    jump = eddy.run(eddy.at_rest(), end, CurrentDrive(lambda t: current))[-1]
    table = TimeProfile((0.0, 1e-7 * end), (0.0, current))
    ramp = eddy.run(eddy.at_rest(), end, CurrentDrive(table), breaks=table.times)[-1]
    assert ramp.supplied == pytest.approx(jump.supplied, rel=1e-5)
    assert np.allclose(ramp.psi, jump.psi, rtol=0.0, atol=1e-5 * np.abs(jump.psi).max())


def test_voltage_and_current_drives_agree(solenoid):
    """Driven by the current that a voltage made, the field is the same; and V = R i + d lambda/dt."""
    eddy = nonlinear(solenoid)
    at_voltage = eddy.at_rest()
    dt, R, V, currents = 1e-4, 0.5, 2.5, {0: 0.0}
    for _ in range(30):
        before = at_voltage
        at_voltage = eddy.step(at_voltage, dt, VoltageDrive(lambda t: V, R), method="backward_euler")
        currents[round(at_voltage.time / dt)] = at_voltage.current
        assert V == pytest.approx(R * at_voltage.current + (at_voltage.linkage - before.linkage) / dt, rel=1e-6)
    drive = CurrentDrive(lambda t: currents[round(t / dt)])
    at_current = eddy.at_rest()
    for _ in range(30):
        at_current = eddy.step(at_current, dt, drive, method="backward_euler")
    assert np.allclose(at_current.psi, at_voltage.psi, rtol=0.0, atol=1e-6 * np.abs(at_voltage.psi).max())


def test_steady_state_is_the_static_field(solenoid):
    eddy = nonlinear(solenoid)
    states = eddy.run(eddy.at_rest(), 0.1, VoltageDrive(lambda t: 2.5, 0.5), tolerance=1e-2)
    static = eddy.problem.solve(TURNS * 5.0)
    assert np.allclose(states[-1].psi, static.psi, rtol=0.0, atol=1e-4 * np.abs(static.psi).max())
    assert states[-1].current == pytest.approx(5.0, rel=1e-4)
    # and a static field at its own drive stays
    held = eddy.step(eddy.steady(static), 1e-3, VoltageDrive(lambda t: 2.5, 0.5))
    assert np.allclose(held.psi, static.psi, rtol=0.0, atol=1e-6 * np.abs(static.psi).max())
    assert held.eddy_loss < 1e-9 * held.supplied


def test_better_conductors_delay_the_flux(solenoid):
    """Time to 90 % of the final flux linkage at a voltage: longer, the lower the resistance of the iron."""
    times, rises = [], []
    for sigma in (0.0, 2e6, 10e6):
        eddy = nonlinear(solenoid, {"rod": sigma})
        states = eddy.run(eddy.at_rest(), 0.06, VoltageDrive(lambda t: 2.5, 0.5), tolerance=5e-3)
        t, linkage = np.array([(s.time, s.linkage) for s in states]).T
        times.append(float(np.interp(0.9 * linkage[-1], linkage, t)))
        rises.append(float(np.interp(1e-3, t, [s.current for s in states])))
    assert times[0] < times[1] < times[2], times
    # eddy currents shield the iron from the coil, which sees less inductance: its current rises faster at first
    assert rises[0] < rises[1] < rises[2], rises


def test_steps_follow_the_tolerance(solenoid):
    eddy = EddyCurrentProblem(solenoid(12), {"rod": SIGMA}, turns=TURNS)
    exact, end = exact_flux(0.3 * TAU), 0.3 * TAU
    counts, errors = [], []
    for tolerance in (1e-2, 1e-3, 1e-4):
        states = eddy.run(eddy.at_rest(), end, CurrentDrive(lambda t: NI / TURNS), tolerance=tolerance)
        counts.append(len(states))
        errors.append(abs(rod_flux(eddy.problem, states[-1].psi) / exact - 1.0))
        steps = np.diff([s.time for s in states])
        assert states[-1].time == pytest.approx(end, rel=1e-12) and steps[-1] > 5.0 * steps[0]
    assert counts[0] < counts[1] < counts[2] and np.all(np.array(errors) < (1e-2, 1e-3, 1e-4)), (counts, errors)


def test_a_jump_of_the_voltage_is_a_stop(solenoid):
    eddy = nonlinear(solenoid)
    jump = 3e-3
    states = eddy.run(
        eddy.at_rest(), 6e-3, VoltageDrive(lambda t: 2.5 if t <= jump else 0.0, 0.5), tolerance=1e-2, breaks=[jump]
    )
    times = np.array([s.time for s in states])
    assert np.abs(times - jump).min() < 1e-12
    assert states[-1].current < max(s.current for s in states)


@pytest.mark.parametrize(
    ("conductivity", "words"),
    [({"hub": 1e6}, "hub"), ({"coil": 1e6}, "winding"), ({"rod": -1.0}, "conductivity"), ({"rod": np.inf}, "finite")],
)
def test_bad_conductors_are_explained(solenoid, conductivity, words):
    with pytest.raises(ValueError, match=words):
        EddyCurrentProblem(solenoid(4), conductivity)


def test_bad_steps_are_explained(solenoid):
    eddy = EddyCurrentProblem(solenoid(4), {"rod": SIGMA})
    with pytest.raises(ValueError, match="dt must be above 0"):
        eddy.step(eddy.at_rest(), 0.0, CurrentDrive(lambda t: 0.0))
    with pytest.raises(ValueError, match="method"):
        eddy.step(eddy.at_rest(), 1.0, CurrentDrive(lambda t: 0.0), method="euler")
    with pytest.raises(ValueError, match="resistance"):
        VoltageDrive(lambda t: 1.0, 0.0)
    with pytest.raises(ValueError, match="tolerance"):
        eddy.run(eddy.at_rest(), 1.0, CurrentDrive(lambda t: 0.0), tolerance=0.0)


def test_a_field_from_far_away_diffuses_in_through_an_open_boundary():
    """A rod in a field that is switched on and held: in the end the static solve of the same imposed field."""
    from half_disc import half_disc

    mesh = half_disc({"rod": (0.0, 5e-3, -20e-3, 20e-3)}, 60e-3, 2e-3)
    problem = AxisymmetricProblem(mesh, {"rod": LinearLaw(50.0)}, open_boundary=True)
    eddy = EddyCurrentProblem(problem, {"rod": 1e6}, turns=1.0)
    state, dt = eddy.at_rest(), 5e-3
    for _ in range(40):
        state = eddy.step(state, dt, CurrentDrive(lambda t: 0.0), boundary_field=lambda t: 0.1)
    static = problem.solve(0.0, boundary_field=0.1)
    assert np.abs(state.psi - static.psi).max() < 1e-6 * np.abs(static.psi).max()
    with pytest.raises(ValueError, match="no finite energy"):
        _ = static.energy


def test_the_static_field_tells_how_long_it_would_stay(solenoid):
    """Even field in a rod: mu sigma a^2/8, below the slowest mode's mu sigma a^2/2.405^2; the air's share is 0.7 %."""
    found = diffusion_time(solenoid(6).solve(NI), {"rod": SIGMA})
    assert found == pytest.approx(TAU / 8.0, rel=0.01) and found < TAU / jn_zeros(0, 1)[0] ** 2
