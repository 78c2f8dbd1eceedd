"""Conduction of heat: closed forms of fin, cylinder, wall and lumped body, rates of convergence, closed balances.

Temperatures in degrees C; sources: Carslaw and Jaeger, Conduction of Heat in Solids, 1959; Incropera and DeWitt,
chapters 3 and 5.
"""

import numpy as np
import pytest
from scipy.linalg import expm
from section_grid import section_grid

from field.heat.conduction import (
    KELVIN,
    STEFAN_BOLTZMANN,
    CooledSurface,
    HeatNotConverged,
    HeatProblem,
    ThermalRunaway,
    outer_edges,
)
from field.heat.transient import HeatInTime
from field.laws.heat_properties import (
    heat_properties,
    powder_conductivity,
    turning_disc_film,
    winding_properties,
)
from field.laws.materials import material_names

pytestmark = pytest.mark.physics
AMBIENT = 20.0


def ring(r, z, *, k, capacity=3e6, film=0.0, emissivity=0.0, where=None, order=1, sources=None, behind=0.0):
    """A ring on a tensor grid of lines r, z [m], cooled where `where(r, z)` of an edge's middle says."""
    mesh = section_grid(r, z, {"body": (r[0], r[-1], z[0], z[-1])})
    elements = np.arange(len(mesh.triangles))
    edges, _ = outer_edges(mesh, elements)
    if where is not None:
        edges = edges[where(*mesh.points[edges].mean(axis=1).T)]
    surface = CooledSurface("outside", edges, film, emissivity, AMBIENT, behind)
    heated = {"body": elements} if sources is None else sources(mesh)
    full = np.full(len(elements), 1.0)
    return HeatProblem(mesh, elements, k * full, capacity * full, [surface], heated, order)


def constant(*watts):
    return lambda *_: (np.array(watts), np.zeros(len(watts)))


def hollow_cylinder(n, order):
    """q everywhere in a < r < b, insulated inside, film outside: error of the temperature [K] at the unknowns."""
    a, b, length, k, q, h = 0.01, 0.05, 0.02, 20.0, 2e6, 50.0
    outside = lambda r, z: np.isclose(r, b)  # noqa: E731
    problem = ring(
        np.linspace(a, b, n + 1), np.linspace(0, length, n // 2 + 1), k=k, film=h, where=outside, order=order
    )
    power = q * np.pi * (b * b - a * a) * length
    found, r = problem.steady(constant(power)), problem.points[:, 0]
    wall = AMBIENT + q * (b * b - a * a) / (2.0 * b * h)
    exact = wall + q / (4.0 * k) * (b * b - r * r) + q * a * a / (2.0 * k) * np.log(r / b)
    assert sum(problem.losses(found).values()) == pytest.approx(power, rel=1e-9)
    return np.sqrt(np.mean((found - exact) ** 2)), exact.max() - AMBIENT


@pytest.mark.parametrize(("order", "rate"), [(1, 1.9), (2, 2.6)])
def test_hollow_cylinder_with_a_source_converges(order, rate):
    """T = T_b + q (b^2 - r^2)/(4 k) + q a^2/(2 k) ln(r/b), with an error of h^2 (P1) and nearly h^3 (P2)."""
    errors = [hollow_cylinder(n, order)[0] for n in (4, 8, 16)]
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > rate)
    assert errors[-1] < 1e-4 * hollow_cylinder(4, order)[1]


def test_a_fin_conducts_as_its_hyperbolic_cosine():
    """A thin annular fin of great radius: heat of its root k A m theta tanh(m L), m^2 = 2 h/(k t)."""
    root, length, t, k, h = 10.0, 0.1, 2e-3, 50.0, 40.0  # radius so great that it is straight
    r = root + np.linspace(0.0, length, 41)
    sides = lambda r, z: np.isclose(z, 0.0) | np.isclose(z, t)  # noqa: E731
    first = lambda mesh: {"root": np.flatnonzero(mesh.centroid()[:, 0] < root + length / 40)}  # noqa: E731
    problem = ring(r, np.linspace(0.0, t, 3), k=k, film=h, where=sides, order=2, sources=first)
    watts = 2.0 * np.pi * root * 1e3
    found = problem.steady(constant(watts))
    m = np.sqrt(2.0 * h / (k * t))
    at_root = watts / (2.0 * np.pi * root * t * k * m * np.tanh(m * length))
    x = problem.points[:, 0] - root
    beyond = x > length / 10
    exact = at_root * np.cosh(m * (length - x)) / np.cosh(m * length)
    assert np.allclose((found - AMBIENT)[beyond], exact[beyond], rtol=0.03)
    assert (found - AMBIENT)[x == x.max()].mean() / exact[x == x.max()].mean() == pytest.approx(1.0, rel=0.02)


def test_a_sphere_cools_by_radiation_alone():
    """epsilon sigma A (T^4 - T_a^4) = P on a small, well conducting body."""
    problem = ring(np.linspace(0.0, 0.02, 4), np.linspace(0, 0.03, 4), k=1e5, emissivity=0.8)
    area = 2.0 * np.pi * 0.02 * 0.05
    found = problem.steady(constant(20.0))
    exact = (20.0 / (0.8 * STEFAN_BOLTZMANN * area) + (AMBIENT + KELVIN) ** 4) ** 0.25 - KELVIN
    assert np.allclose(found, exact, atol=0.02)


def test_a_body_that_conducts_far_better_than_it_is_cooled_has_one_temperature():
    """P = h S (T - T_0), where round-off of K T is 1e-8 of the largest difference."""
    film, r, length = 0.01, (0.01, 0.05), 0.02
    problem = ring(np.linspace(*r, 61), np.linspace(0.0, length, 31), k=5000.0, film=film, order=2)
    surface = 2.0 * np.pi * (sum(r) * length + r[1] ** 2 - r[0] ** 2)
    assert np.allclose(problem.steady(constant(60.0 * film * surface)), AMBIENT + 60.0, rtol=0.0, atol=1e-3)


def test_a_plane_wall_cools_by_its_first_mode():
    """Biot 1, late: T falls with exp(-zeta^2 k t/(C L^2)), zeta tan zeta = 1, zeta = 0.8603 (Incropera, table 5.1)."""
    length, k, capacity = 0.05, 2.0, 2e6
    problem = ring(
        np.linspace(5.0, 5.0 + length, 17), np.linspace(0, 0.01, 2), k=k, capacity=capacity, film=k / length,
        where=lambda r, z: np.isclose(r, 5.0 + length), order=2,
    )  # fmt: skip
    march = HeatInTime(problem, constant(0.0), tolerance=0.02)
    tau = capacity * length**2 / k
    first = march.start(120.0)
    *_, one = march.run(first, [1.0 * tau])
    *_, two = march.run(one, [2.0 * tau])
    inner = np.isclose(problem.points[:, 0], 5.0)
    ratio = (two.temperature[inner].mean() - AMBIENT) / (one.temperature[inner].mean() - AMBIENT)
    assert ratio == pytest.approx(np.exp(-(0.8603**2)), rel=0.005)
    assert (one.temperature[inner].mean() - AMBIENT) / 100.0 == pytest.approx(1.1191 * np.exp(-(0.8603**2)), rel=0.005)


def lumped(film=20.0, capacity=0.0):
    """A cylinder that has one temperature: the problem, its film's conductance [W/K] and heat capacity [J/K]."""
    problem = ring(np.linspace(0, 0.02, 3), np.linspace(0, 0.03, 3), k=1e6, film=film, behind=capacity)
    return problem, film * 2.0 * np.pi * 0.02 * 0.05, 3e6 * np.pi * 0.02**2 * 0.03


@pytest.mark.parametrize("growth", [0.0, 0.002, -0.004])
def test_a_lumped_body_follows_its_time_constant(growth):
    """C dT/dt = P (1 + growth (T - T_a)) - G (T - T_a): an exponential with the rate (G - growth P)/C; heat closes."""
    problem, G, C = lumped()
    P, errors = 15.0, []
    rate = (G - growth * P) / C
    for tolerance in (0.4, 0.1):
        powers = lambda t, T: (P * (1.0 + growth * (T - AMBIENT)), np.array([P * growth]))  # noqa: E731
        march = HeatInTime(problem, powers, tolerance)
        state = start = march.start(AMBIENT)
        for state in march.run(start, [1.0 / rate, 3.0 / rate]):
            exact = AMBIENT + P / (C * rate) * (1.0 - np.exp(-rate * state.time))
            assert np.allclose(state.temperature, exact, atol=tolerance)
        errors.append(abs(state.temperature.mean() - exact))
        stored = problem.heat_content @ (state.temperature - start.temperature)
        assert state.made.sum() - state.left == pytest.approx(stored, rel=1e-7)
    assert errors[1] < errors[0] < 0.2  # half of the tolerance; round-off decides which steps are accepted


def test_a_current_that_copper_cannot_carry_runs_away_and_says_so():
    """T - T_a = P_0/(G - alpha P_0) below P_0 = G/alpha; above there is none, and in time the growth is exponential."""
    problem, G, C = lumped()
    alpha = 0.00393

    def copper(P):
        return lambda *means: (P * (1.0 + alpha * (means[-1] - AMBIENT)), np.array([P * alpha]))

    below = 0.5 * G / alpha
    assert np.allclose(problem.steady(copper(below)), AMBIENT + below / (G - alpha * below), rtol=1e-4)
    with pytest.raises(ThermalRunaway, match="faster"):
        problem.steady(copper(1.01 * G / alpha))
    rate = 0.5 * G / C
    march = HeatInTime(problem, copper(1.5 * G / alpha), 2.0)
    for state in march.run(march.start(AMBIENT), [1.0 / rate]):
        assert np.all(np.isfinite(state.temperature))
    exact = AMBIENT + 1.5 * G / alpha / (C * rate) * (np.exp(rate * state.time) - 1.0)
    assert state.temperature.mean() == pytest.approx(exact, rel=0.01)


def test_a_shaft_behind_a_surface_is_a_second_capacity():
    """C_1 T_1' = P - 2 G (T_1 - T_2), C_2 T_2' = 2 G (T_1 - T_2) - 2 G (T_2 - T_a), by the matrix' exponential.

    Heat closes; the steady temperature P/G is that without the capacity.
    """
    plain, G, C1 = lumped()
    n = plain.n_dofs
    P, C2 = 15.0, 2.0 * C1
    problem, _, _ = lumped(capacity=C2)
    march = HeatInTime(problem, constant(P), 0.02)
    state = first = march.start(AMBIENT)
    A = np.array([[-2.0 * G / C1, 2.0 * G / C1], [2.0 * G / C2, -4.0 * G / C2]])
    steady = np.array([P / G, 0.5 * P / G])
    for state in march.run(first, [0.5 * C1 / G, 3.0 * C1 / G]):
        exact = AMBIENT + steady - expm(A * state.time) @ steady
        assert np.allclose(state.temperature[:n], exact[0], atol=0.1)
        assert np.allclose(state.temperature[n:], exact[1], atol=0.1)
    stored = problem.heat_content @ (state.temperature - first.temperature)
    assert state.made.sum() - state.left == pytest.approx(stored, rel=1e-7)
    assert exact[0] < AMBIENT + 0.9 * P / G  # the shaft still warms
    found, without = problem.steady(constant(P)), plain.steady(constant(P))
    assert np.allclose(found[:n], without, rtol=1e-9) and np.allclose(found[n:], AMBIENT + 0.5 * P / G, atol=1e-3)
    assert problem.losses(found)["outside"] == pytest.approx(P, rel=1e-8)  # k = 1e6: round-off
    with pytest.raises(ValueError, match="leads into a body"):
        problem.with_films({"outside": 30.0})
    with pytest.raises(ValueError, match="capacity"):
        CooledSurface("shaft", np.zeros((1, 2), int), 0.0, 0.0, AMBIENT, 1.0)


@pytest.mark.parametrize(("high", "low"), [(60.0, 1.0), (20.0, 5.0)])
def test_a_power_that_falls_steeply_has_its_temperature(high, low):
    """From `high` to `low` W between 60 and 61 degrees C, on either side constant: G (T - T_a) = P(T) in between."""
    problem, G, _ = lumped()

    def powers(means):
        inside = 60.0 < means[0] < 61.0
        return np.interp(means, [60.0, 61.0], [high, low]), np.array([(low - high) * inside])

    exact = (high + 60.0 * (high - low) + G * AMBIENT) / (G + high - low)
    for start in (250.0, AMBIENT):
        assert np.allclose(problem.steady(powers, start), exact, atol=1e-3)


def test_switching_is_met_and_a_repeated_duty_keeps_its_matrices():
    """On for a tenth of each period: what is made is the power times the time on; few lengths of steps."""
    problem, _, _ = lumped()
    march = HeatInTime(problem, lambda t, T: (np.array([40.0 * (t % 100.0 < 10.0)]), np.zeros(1)), 0.05)
    cuts = [t for k in range(20) for t in (100.0 * k + 10.0, 100.0 * (k + 1))]
    *_, last = march.run(march.start(AMBIENT), cuts)
    assert last.time == 2000.0 and last.made[0] == pytest.approx(20 * 400.0, rel=1e-9)
    assert len(march._factors) <= 12


def test_a_source_that_ramps_makes_its_integral():
    """P (t/T)^n in every period T: P T/(n + 1) in each, whatever the step, and the temperature of the mean power.

    Long after, T - T_a = P/(n + 1) R: an error of a period adds up, however small it is against the tolerance.
    """
    problem, G, C = lumped()
    period = 2e-3 * C / G
    for n in (1, 2, 3):
        march = HeatInTime(problem, lambda t, _: (np.array([30.0 * (t % period / period) ** n]), np.zeros(1)), 1.0)  # noqa: B023
        *_, last = march.run(march.start(AMBIENT), [period * (k + 1) for k in range(200)])
        assert march.steps < 250
        assert last.made[0] == pytest.approx(30.0 / (n + 1) * last.time, rel=1e-9)
        exact = -30.0 / (n + 1) / G * np.expm1(-G / C * last.time)
        assert last.temperature.mean() - AMBIENT == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("share", [1e-4, 0.1, 1.0, 6.0])
def test_the_ripple_of_a_lumped_body_is_that_of_its_pulse_train(share):
    """Peak T_a + P R (1 - exp(-t_on/tau))/(1 - exp(-T/tau)), lowest exp(-(T - t_on)/tau) of it, T/tau = share."""
    problem, G, C = lumped()
    tau, P = C / G, 40.0
    period, on = share * tau, 0.3 * share * tau
    march = HeatInTime(problem, lambda t, _: (np.array([P * (t % period < on)]), np.zeros(1)))
    mean = problem.steady(constant(0.3 * P))
    ripple = march.ripple(mean, [on, period])
    peak = P / G * -np.expm1(-on / tau) / -np.expm1(-period / tau)
    lowest = peak * np.exp(-(period - on) / tau)
    found = mean + ripple.departures - AMBIENT
    assert np.allclose([found.max(), found.min()], [peak, lowest], atol=0.03 * (peak - lowest), rtol=2e-5)
    assert np.ptp(found) == pytest.approx(peak - lowest, rel=0.03)
    assert np.allclose(ripple.weights @ ripple.departures, 0.0, atol=1e-9)
    assert np.allclose(found[-1], found[0], atol=0.02 * (peak - lowest))


def test_nothing_moves_at_the_temperature_of_the_room():
    problem, _, C = lumped()
    march = HeatInTime(problem, constant(0.0))
    *_, last = march.run(march.start(AMBIENT), [1e5])
    assert np.allclose(last.temperature, AMBIENT, atol=1e-6) and abs(last.left) < 1e-5 * C


def test_what_cannot_be_is_refused():
    r, z = np.linspace(0.0, 0.02, 3), np.linspace(0, 0.03, 3)
    with pytest.raises(ValueError, match="nothing cools"):
        ring(r, z, k=1.0)
    with pytest.raises(ValueError, match="conductivity"):
        ring(r, z, k=0.0, film=1.0)
    with pytest.raises(ValueError, match="order"):
        ring(r, z, k=1.0, film=1.0, order=3)
    with pytest.raises(ValueError, match="tolerance"):
        HeatInTime(lumped()[0], constant(0.0), 0.0)
    with pytest.raises(HeatNotConverged):
        lumped()[0].steady(lambda means: (np.array([np.nan]), np.zeros(1)))


def test_every_material_of_the_library_has_its_properties():
    for name in material_names():
        found = heat_properties(name)
        assert 0.02 < found.conductivity < 450.0 and found.source
        assert 1e3 < found.capacity < 4e6
    with pytest.raises(ValueError, match="copper"):
        heat_properties("coper")


def test_steels_of_one_table_lie_within_its_values():
    """AISI 1010 has 64 W/(m K) at 27 and 59 at 127 degrees C (Incropera, table A.1): near 62 at 50 degrees C."""
    for name in ("steel_1008", "steel_1010"):
        assert heat_properties(name).conductivity == pytest.approx(64.0 - 5.0 * 23.0 / 100.0, abs=1.0)


def test_mixtures_lie_between_their_parts():
    """The powder's conductivity is that of gas without grains; measured ones of steel: 0.2 to 0.6 W/(m K)."""
    gas = heat_properties("air").conductivity
    assert powder_conductivity(0.0) == gas and powder_conductivity(0.3, gas, gas) == gas
    values = [powder_conductivity(phi) for phi in np.linspace(0.0, 0.74, 20)]
    assert np.all(np.diff(values) > 0.0) and 0.3 < powder_conductivity(0.6) < 0.6
    assert winding_properties(0.0).conductivity == 0.2
    assert winding_properties(1.0).conductivity == heat_properties("copper").conductivity
    assert 0.5 < winding_properties(0.6).conductivity < 1.2
    assert turning_disc_film(4.0 * 10.0) == pytest.approx(2.0 * turning_disc_film(10.0))
    with pytest.raises(ValueError, match="phi"):
        powder_conductivity(0.8)
