"""The coil's R-L circuit: exponential rise, its order, energies, a saturating coil against its flux linkage curve."""

import math

import numpy as np
import pytest
from flux_linkage_curve import current_of_linkage
from graded_lines import graded_lines
from scipy.integrate import solve_ivp
from section_grid import section_grid

from field import AxisymmetricProblem, LinearLaw, material
from field.coil.coil_circuit import CircuitState, LinearisedCoil, solve_at_flux_linkage
from field.coil.inductance import apparent_inductance
from field.section.eddy_currents import EddyCurrentProblem, VoltageDrive

pytestmark = pytest.mark.physics

N, R, V = 400, 4.0, 12.0


@pytest.fixture(scope="module")
def pot():
    """pot(law): a pot core with a gap of 0.5 mm on a coarse mesh; steel saturates from some 2 A on."""
    gap = 0.5e-3
    r = np.unique(np.round(np.concatenate((graded_lines(2e-3, (0.0, 20e-3), (0.0, 0.1)), [8e-3, 16e-3, 20e-3])), 9))
    z = np.unique(np.round(np.concatenate((graded_lines(2e-3, (0.0, 16e-3), (0.0, 0.1)), [gap / 2, 12e-3])), 9))
    regions = {
        "core": (0.0, 20e-3, -16e-3, 16e-3),
        "coil": (8e-3, 16e-3, -12e-3, 12e-3),
        "slit": (0.0, 8e-3, -gap / 2, gap / 2),
    }
    mesh = section_grid(r, np.concatenate((-z, z)), regions)
    return lambda law: AxisymmetricProblem(mesh, {"core": law, "slit": material("air")})


@pytest.fixture(scope="module")
def linear(pot):
    return pot(LinearLaw(500.0))


@pytest.fixture(scope="module")
def steel(pot):
    return pot(material("steel_1010"))


def test_linear_coil_rises_exponentially_in_any_step(linear):
    """i = V/R (1 - exp(-t/tau)), tau = L/R: the line between solves is integrated exactly."""
    L = apparent_inductance(linear.solve(N), N)
    coil = LinearisedCoil.about(linear.solve(0.0), N, R)
    for steps in (1, 7):
        state = CircuitState(0.0, 0.0, 0.0)
        for k in range(steps):
            state = coil.advance(state, (k + 1) / steps * 1.7 * L / R, lambda t: V)
        exact = V / R * (1.0 - math.exp(-1.7))
        assert state.current == pytest.approx(exact, rel=1e-9)
        assert state.linkage == pytest.approx(L * exact, rel=1e-9)
        # what went into the field is there
        assert state.into_field == pytest.approx(0.5 * L * exact**2, rel=1e-9)
        charge = V / R * (1.7 - (1.0 - math.exp(-1.7))) * L / R
        assert state.supplied == pytest.approx(V * charge, rel=1e-9)


def test_voltage_of_pieces_and_a_jump(linear):
    """A ramp and then a jump, both inside one step, against an integrator with a tight tolerance."""
    L = apparent_inductance(linear.solve(N), N)
    tau = L / R

    def voltage(t):
        return V * t / (0.3 * tau) if t < 0.3 * tau else (V if t < tau else -0.5 * V)

    coil = LinearisedCoil(0.0, 0.0, L, R)
    found = coil.advance(CircuitState(0.0, 0.0, 0.0), 2.0 * tau, voltage, [0.3 * tau, tau])
    i = 0.0
    for begin, end in ((0.0, 0.3 * tau), (0.3 * tau, tau), (tau, 2.0 * tau)):
        # inside a piece the voltage is smooth
        i = solve_ivp(
            lambda t, y, a=begin, b=end: (voltage(min(max(t, a + 1e-9 * tau), b - 1e-9 * tau)) - R * y) / L,
            (begin, end), [i], rtol=1e-10, atol=1e-12,
        ).y[0, -1]  # fmt: skip
    assert found.current == pytest.approx(i, rel=1e-6)
    whole = coil.advance(CircuitState(0.0, 0.0, 0.0), 1.4 * tau, voltage, [0.3 * tau, tau])
    assert coil.advance(whole, 2.0 * tau, voltage, [0.3 * tau, tau]).current == pytest.approx(found.current, rel=1e-6)


@pytest.mark.parametrize(("method", "order"), [("backward_euler", 1), ("sdirk2", 2)])
def test_implicit_steps_have_their_order_on_the_linear_coil(linear, method, order):
    L = apparent_inductance(linear.solve(N), N)
    exact, errors = V / R * (1.0 - math.exp(-1.0)), []
    eddy = EddyCurrentProblem(linear, {}, turns=N)
    for steps in (4, 8, 16):
        state = eddy.at_rest()
        for _ in range(steps):
            state = eddy.step(state, L / R / steps, VoltageDrive(lambda t: V, R), method=method)
        errors.append(abs(state.current / exact - 1.0))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(order, abs=0.15), errors


@pytest.mark.parametrize("share", [1e-3, 1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_the_current_after_a_step_does_not_depend_on_how_short_it_is(linear, share, tolerance):
    """i = i_0 + (V/R - i_0)(1 - exp(-dt/tau)) from half of V/R, also where dt/tau is far below Newton's tolerance."""
    half = linear.solve(0.5 * N * V / R, tolerance=1e-12)
    dt = share * apparent_inductance(half, N) / R
    eddy = EddyCurrentProblem(linear, {}, turns=N)
    found = eddy.step(eddy.steady(half), dt, VoltageDrive(lambda t: V, R), tolerance=tolerance)
    assert found.current == pytest.approx(V / R * (1.0 - 0.5 * math.exp(-share)), rel=2e-4)


def march(problem, tolerance, end, voltage=lambda t: V, solves=None):
    """The circuit as a run takes it: small windows, a new field when the current has left the last one's line."""
    largest, time, window = V / R, 0.0, end / 400
    state, solution = CircuitState(0.0, 0.0, 0.0), problem.solve(0.0)
    coil, course = LinearisedCoil.about(solution, N, R), []
    for k in range(400):
        time = (k + 1) * window
        state = coil.advance(state, time, voltage)
        if abs(state.current - coil.current) > tolerance * largest:
            solution = solve_at_flux_linkage(problem, state.linkage / N, guess=solution)
            coil = LinearisedCoil.about(solution, N, R)
            state = CircuitState(time, state.linkage, coil.current, state.supplied, state.copper_loss)
            if solves is not None:
                solves.append(time)
        course.append((time, state.current, state.linkage, state.supplied, state.copper_loss))
    return np.array(course), solution


def test_saturating_coil_follows_its_flux_linkage_curve(steel):
    """lambda(i) of a fine sweep and a tight integrator are the truth; the error falls with the tolerance squared."""
    current = current_of_linkage(steel, N, 3.2, points=60)
    end = 1.5 * steel.solve(N * V / R).flux_linkage(N) / V
    exact = solve_ivp(lambda t, y: V - R * current(y), (0.0, end), [0.0], rtol=1e-9, atol=1e-12, dense_output=True)
    errors = []
    for tolerance in (0.2, 0.1, 0.05):
        course, _ = march(steel, tolerance, end)
        truth = current(exact.sol(course[:, 0])[0])
        errors.append(np.abs(course[:, 1] - truth).max() / (V / R))
    assert errors[-1] < 1e-2 and np.log2(errors[0] / errors[-1]) / 2.0 > 1.4, errors


def test_energy_of_the_saturating_coil(steel):
    """What the supply gave is in the copper and in the field; the balance closes with the tolerance squared."""
    left = []
    for tolerance in (0.1, 0.05, 0.025):
        course, _ = march(steel, tolerance, 0.03)
        _, _, linkage, supplied, copper = course[-1]
        stored = solve_at_flux_linkage(steel, linkage / N).energy
        left.append(abs(supplied - copper - stored) / supplied)
    assert left[-1] < 1e-3 and left[-1] < 0.3 * left[0], left


def test_circuit_and_implicit_transient_agree(steel):
    """Two programs for one circuit: prescribed linkage with lines between, and the implicit steps of the field."""
    end = 0.02
    course, _ = march(steel, 0.02, end)
    eddy = EddyCurrentProblem(steel, {}, turns=N)
    states = eddy.run(eddy.at_rest(), end, VoltageDrive(lambda t: V, R), tolerance=1e-4)
    t, i = np.array([(s.time, s.current) for s in states]).T
    at = np.linspace(0.1 * end, end, 8)
    assert np.allclose(np.interp(at, course[:, 0], course[:, 1]), np.interp(at, t, i), rtol=0.0, atol=0.01 * V / R)


def test_few_solves_suffice(steel):
    """The field is solved for every few per cent of the current, not in every window."""
    solves: list[float] = []
    march(steel, 0.05, 0.03, solves=solves)
    assert 5 < len(solves) < 60


def test_switching_off_reverses(steel):
    """Without voltage the current falls and copper takes what the field gives back."""
    course, _ = march(steel, 0.02, 0.06, voltage=lambda t: V if t < 0.03 else 0.0)
    half = course[199]
    # beyond the switching instant the supply gives nothing
    assert course[-1, 3] == pytest.approx(half[3], rel=1e-6)
    assert course[-1, 1] < 0.2 * half[1]
    given_back = course[-1, 4] - half[4]
    assert 0.0 < given_back <= 1.02 * solve_at_flux_linkage(steel, half[2] / N).energy


@pytest.mark.parametrize("length", [39.0, 41.0, 1e4, 1e7])
def test_a_step_of_ages_is_exact(length):
    """V = v t: i = v/R (t - tau (1 - e)), e = exp(-t/tau); with e = 0 at the end T, the integral of i^2 is known."""
    L, v = 1e-3, 2.0
    tau, T = L / R, length * L / R
    end = LinearisedCoil(0.0, 0.0, L, R).advance(CircuitState(0.0, 0.0, 0.0), T, lambda t: v * t)
    assert end.time == pytest.approx(T, rel=1e-15)
    assert end.current == pytest.approx(v / R * (T - tau), rel=1e-9)
    squares = ((T - tau) ** 3 + tau**3) / 3.0 + 0.5 * tau**3
    assert end.copper_loss == pytest.approx(v**2 / R * squares, rel=1e-9)
    assert end.supplied == pytest.approx(v**2 / R * (T**3 / 3.0 - 0.5 * tau * T**2 + tau**3), rel=1e-9)


def test_a_coil_of_ages_without_voltage_gives_all_that_it_stores():
    """1/2 L i^2 heats the copper; then nothing is left."""
    L = 1e-3
    end = LinearisedCoil(0.0, 0.0, L, R).advance(CircuitState(0.0, 3.0 * L, 3.0), 1e6 * L / R, lambda t: 0.0)
    assert end.current == pytest.approx(0.0, abs=1e-15) and end.supplied == 0.0
    assert end.copper_loss == pytest.approx(0.5 * L * 3.0**2, rel=1e-12)
