"""The coil's transients as the coupled loop takes them: by windows, with a fill that moves, stopped and resumed."""

from types import SimpleNamespace

import numpy as np
import pytest
from flux_linkage_curve import current_of_linkage
from graded_lines import graded_lines
from pot_core import pot_core
from scipy.integrate import solve_ivp
from section_grid import section_grid

from coupling import CircuitCoilField, CoilField, EddyCoilField
from coupling.coil_row import CoilRow
from field import AxisymmetricProblem, GrainLaw, PowderLaw, PowderState, material
from field.coil.coil_circuit import solve_at_flux_linkage
from field.coil.inductance import apparent_inductance
from field.coil.winding import Winding
from field.section.eddy_currents import EddyCurrentProblem, VoltageDrive
from geometry import Clutch, mesh_clutch
from geometry.time_profile import TimeProfile

pytestmark = pytest.mark.physics

N, R, V = 400, 8.0, 16.0
WINDOW, WINDOWS = 2e-4, 120


@pytest.fixture(scope="module")
def problem():
    return pot_core(PowderLaw(GrainLaw(273.0, 1.5e6)))


def circuit_source(problem, **more):
    more = {"resistance": R, "largest_current": V / R, "current_tolerance": 0.02, **more}
    return CircuitCoilField(problem, N, TimeProfile.constant(V), powder_tolerance=0.05, **more)


def eddy_source(problem, sigma=5e6, **more):
    eddy = EddyCurrentProblem(problem, {"core": sigma}, turns=N)
    return EddyCoilField(problem, N, eddy, **more)


def march(source, windows=WINDOWS, first=0):
    """(rows of the history, fields solved)."""
    rows, new = [], source.refresh(0.0) if first == 0 else 0
    for k in range(first, windows):
        new += source.refresh((k + 1) * WINDOW)
        rows.append(source.window_part())
    return rows, new


def test_course_of_the_current_is_as_it_was(problem):
    """Without the effects nothing has changed: the plain source solves exactly what the problem solves, bit for bit."""
    source = CoilField(problem, N, TimeProfile((0.0, 1.0), (1.0, 101.0)))
    guess = None
    for time in (0.0, 0.02, 0.05):
        source.refresh(time)
        guess = problem.solve(N * (1.0 + 100.0 * time), guess=guess)
        assert np.array_equal(source.solution.psi, guess.psi)
    assert not source.refresh(0.05001) and source.solves == 3
    assert source.window_part() == CoilRow(6.0, source.solution.flux_linkage(N), source.solution.energy)


def test_current_rises_and_the_energies_close(problem):
    source = circuit_source(problem)
    rows, new = march(source)
    current = np.array([row.current for row in rows])
    assert np.all(np.diff(current) > 0.0) and 0.8 * V / R < current[-1] < V / R
    assert 20 < new < 70, "a solve for every two per cent of the current"
    supplied, copper, into_field = (
        sum(getattr(row, name) for row in rows) for name in ("coil_supplied", "copper_loss", "into_field")
    )
    assert supplied == pytest.approx(copper + into_field, rel=1e-12)
    end = WINDOWS * WINDOW
    stored = problem.solve(N * source.current(end)).energy
    # the lines between solves: of second order in the tolerance of 2 %
    assert into_field == pytest.approx(stored, rel=5e-3)
    assert rows[-1].field_energy == pytest.approx(stored, rel=5e-3)
    exact = current_of_linkage(problem, N, 1.01 * V / R, points=121)
    miss = [row.current - float(exact(row.flux_linkage)) for row in rows]
    assert np.abs(miss).max() < 0.005 * V / R, "current and linkage of a row are of one instant"
    assert V * np.sum(current) * WINDOW == pytest.approx(supplied, rel=0.02)


def test_moving_powder_changes_the_current_and_not_the_linkage(problem):
    """The fill rises at once: the linkage continues, the current drops to what the better iron circuit needs."""
    jump = 60

    class EvenPowder:
        """A feedback of even powder, in place of that of grains."""

        residual = SimpleNamespace(total=0.0)
        fill = 0.1

        def state(self, solution):
            return np.full(problem.powder_elements.size, self.fill)

        def sampler_after_solve(self, solution):
            self.residual.total = 0.0

    source = circuit_source(problem, begin_steady=True, feedback=EvenPowder())
    rows, _ = march(source, jump)
    before = source.circuit
    source.feedback.fill, source.feedback.residual.total = 0.5, 1.0
    source.refresh((jump + 1) * WINDOW)
    after = source.circuit
    assert after.linkage == pytest.approx(before.linkage, rel=1e-6)
    assert after.current < 0.98 * before.current
    assert source.solution.flux_linkage(N) == pytest.approx(after.linkage, rel=1e-9)
    assert rows[-1].current == pytest.approx(V / R, rel=1e-6), "steady before"
    # and comes back to V/R in the end
    rows, _ = march(source, jump + 600, jump + 1)
    assert rows[-1].current == pytest.approx(V / R, rel=1e-2)


@pytest.mark.parametrize("share", [0.0, 1e-12, 1e-8, -1e-4])
def test_a_flux_linkage_near_zero_needs_a_current_against_magnetised_powder(problem, share):
    """The current of the linkage, given, has this linkage; none at all only where nothing is magnetised."""
    fill = np.full(problem.powder_elements.size, 0.4)
    source = np.zeros((fill.size, 2, problem.elements.n_quadrature))
    source[:, 1] = 2e5
    powder = PowderState(fill, None, source)
    of_powder = problem.solve(0.0, powder).flux_linkage_per_turn
    field = solve_at_flux_linkage(problem, share * of_powder, powder)
    again = problem.solve(field.ampere_turns, powder).flux_linkage_per_turn
    assert again == pytest.approx(share * of_powder, abs=1e-6 * of_powder) and field.ampere_turns < -1.0
    assert solve_at_flux_linkage(problem, 0.0, fill).ampere_turns == 0.0


@pytest.mark.parametrize("share", [1e-12, -1e-12, 1e-5])
def test_a_guess_of_hardly_any_flux_linkage_leads_to_the_same_current(problem, share):
    """The current that cancels the flux of magnetised powder is large; scaled to a larger linkage it is enormous."""
    fill = np.full(problem.powder_elements.size, 0.4)
    source = np.zeros((fill.size, 2, problem.elements.n_quadrature))
    source[:, 1] = 2e5
    powder = PowderState(fill, None, source)
    linkage = 2.0 * problem.solve(0.0, powder).flux_linkage_per_turn
    guess = solve_at_flux_linkage(problem, share * linkage, powder)
    result = solve_at_flux_linkage(problem, linkage, powder, guess)
    assert result.flux_linkage_per_turn == pytest.approx(linkage, rel=1e-9)
    assert problem.solve(result.ampere_turns, powder).flux_linkage_per_turn == pytest.approx(linkage, rel=1e-6)


@pytest.mark.parametrize("kind", ["circuit", "eddy at a voltage", "eddy at a current"])
def test_resumed_is_bit_for_bit_what_went_on(problem, kind):
    def build():
        if kind == "circuit":
            return circuit_source(problem)
        if kind == "eddy at a voltage":
            return eddy_source(problem, supply=TimeProfile.constant(V), resistance=R)
        return eddy_source(problem, supply=TimeProfile((0.0, 5e-3), (0.0, 1.0)))

    whole = build()
    rows, _ = march(whole, windows=50)
    first = build()
    march(first, windows=23)
    second = build()
    second.restore(first.state())
    rest, _ = march(second, windows=50, first=23)
    assert rest == rows[23:]
    assert np.array_equal(second.solution.psi, whole.solution.psi)
    assert build().state() is None


def test_eddy_currents_vanish_with_the_conductivity(problem):
    """sigma -> 0: the field with eddy currents is that of the circuit."""
    circuit = circuit_source(problem, current_tolerance=0.01)
    eddy = eddy_source(problem, 0.0, supply=TimeProfile.constant(V), resistance=R, change_tolerance=0.01)
    expected = np.array([row.current for row in march(circuit)[0]])
    result = np.array([row.current for row in march(eddy)[0]])
    assert np.abs(result - expected).max() < 0.03 * V / R


def test_eddy_source_balances_its_energy_and_rests(problem):
    source = eddy_source(problem, supply=TimeProfile.constant(V), resistance=R, change_tolerance=0.01)
    rows, new = march(source, windows=400)
    supplied, copper, eddy = (
        sum(getattr(row, name) for row in rows) for name in ("coil_supplied", "copper_loss", "eddy_loss")
    )
    stored = source.solution.energy
    assert supplied == pytest.approx(copper + eddy + stored, rel=2e-3)
    assert eddy > 1e-3 * stored
    late = source.solves
    march(source, windows=600, first=400)
    assert new < 250 and source.solves - late < 10, "a field at rest is left alone"
    static = problem.solve(N * V / R)
    assert np.abs(source.solution.psi - static.psi).max() < 0.02 * np.abs(static.psi).max()


@pytest.mark.parametrize("before", [1e-19, 1e-13, 1e-10, 1e-8, 1e-5])
def test_an_instant_of_the_voltage_just_before_a_windows_end_leaves_the_current(problem, before):
    """A constant voltage whose profile has an instant there gives the current of one without."""
    end, currents = 5 * WINDOW, []
    for supply in (TimeProfile.constant(V), TimeProfile((0.0, end - before, 1.0), (V, V, V))):
        source = eddy_source(problem, supply=supply, resistance=R, newton_tolerance=1e-6)
        currents.append([row.current for row in march(source, windows=7)[0]])
    assert np.allclose(currents[1], currents[0], rtol=0.0, atol=1e-3 * V / R), currents


def test_a_jump_of_the_voltage_just_before_a_windows_end_belongs_to_the_next_window(problem):
    """Up to the end the field has the voltage before the jump, in the next window that after it."""
    end, jumps = 5 * WINDOW, []
    for at in (end - 1e-13, end):
        supply = TimeProfile((at, at + 2e-14), (V, -V))
        source = eddy_source(problem, supply=supply, resistance=R, begin_steady=True)
        jumps.append([row.flux_linkage for row in march(source, windows=7)[0]])
    assert np.allclose(jumps[0], jumps[1], rtol=1e-6, atol=0.0) and jumps[0][4] > 1.01 * jumps[0][5]


def test_a_field_that_decays_for_long_takes_few_steps(problem):
    """Its local error is relative to the largest field so far: 25 solves in each tenth of a second, until it failed."""
    source = eddy_source(problem, supply=TimeProfile((0.01, 0.0101), (V, 0.0)), resistance=R)
    window, solves = 2e-3, []
    for k in range(1000):
        source.refresh(k * window)
        source.window_part()
        solves.append(source.solves)
    assert solves[-1] - solves[250] < 10 and abs(source.transient.current) < 1e-3 * V / R


def test_a_ramp_that_begins_at_a_windows_end_is_followed_at_once(problem):
    """A field that rests waits for long, but not beyond the instant at which its drive begins to change."""
    begin = 21 * WINDOW  # steps of a field at rest end at 1, 5, 21, 85 windows
    for bend in (begin, begin - 1e-13):
        ramp = TimeProfile((bend, 2 * begin), (V, 2 * V))
        rows, _ = march(eddy_source(problem, supply=ramp, resistance=R, begin_steady=True), windows=31)
        assert rows[20].flux_linkage < rows[21].flux_linkage < rows[30].flux_linkage


def test_prescribed_current_is_followed_by_a_late_field(problem):
    """The current is there at once, the flux is not; after the switch it stays a while."""
    switched_off = TimeProfile((30.5 * WINDOW, 30.5001 * WINDOW), (1.0, 0.0))
    source = eddy_source(problem, supply=switched_off)
    full = problem.solve(N * 1.0).flux_linkage_per_turn
    shares = []
    for k in range(60):
        source.refresh(k * WINDOW)
        shares.append(source.solution.flux_linkage_per_turn / full)
    assert shares[0] == 0.0 and 0.05 < shares[2] < 0.95 and shares[30] > 0.9
    assert 0.02 < shares[32] < shares[31] < shares[30] and shares[59] < 0.1


def test_a_field_that_outlasts_its_current_keeps_the_feedback_of_the_powder(problem):
    """After the current is off the powder follows from the present field, and a change of it asks for another one."""
    asked = []

    class EvenPowder:
        residual = SimpleNamespace(total=0.0)

        def state(self, solution):
            asked.append(solution)
            return np.full(problem.powder_elements.size, 0.3)

        def sampler_after_solve(self, solution):
            self.residual.total = 0.0

    switched_off = TimeProfile((0.0, 9.5 * WINDOW, 9.5001 * WINDOW), (1.0, 1.0, 0.0))
    source = eddy_source(problem, supply=switched_off, begin_steady=True, feedback=EvenPowder(), powder_tolerance=0.05)
    assert not source.has_field(0.0)
    march(source, 10)
    source.refresh(11 * WINDOW)
    assert source.current(11 * WINDOW) == 0.0 and source.has_field(0.0) and asked[-1] is not None
    assert source.solution.estimated_errors() is None  # a static field has none without a current
    source.feedback.residual.total = 1.0
    assert source.is_stale(0.0)


@pytest.mark.parametrize(
    ("arguments", "words"), [({"resistance": 0.0}, "resistance"), ({"resistance": np.nan}, "resistance")]
)
def test_bad_circuits_are_explained(problem, arguments, words):
    with pytest.raises(ValueError, match=words):
        circuit_source(problem, **arguments)


def test_bad_eddy_sources_are_explained(problem):
    with pytest.raises(ValueError, match="same field problem"):
        EddyCoilField(problem, 2 * N, EddyCurrentProblem(problem, {}, turns=N), TimeProfile.constant(1.0))


def test_rise_of_a_clutch_at_a_voltage():
    """The quickstart's clutch at 24 V: rise of current and flux, in air gaps and saturated, without and with eddy
    currents. Solid steel delays the flux the more, the better it conducts; in saturation the current rises sooner."""
    clutch = Clutch(
        disc_radius=20e-3, disc_thickness=8e-3, gap=1e-3, face_gap=1e-3, seal_radius=19e-3, rotor_wall=3e-3,
        ring_width=3e-3, cover_thickness=2e-3, clearance=0.3e-3, coil_width=6e-3, coil_height=6e-3, yoke=4e-3,
        shaft_radius=4e-3,
    )  # fmt: skip
    mesh = mesh_clutch(clutch, gap_layers=3, size_factor=2.5)
    iron = ("disc", "rotor", "housing")
    laws = {name: material("steel_1010" if name in iron else "air") for name in mesh.regions if name != "coil"}
    problem = AxisymmetricProblem(mesh, laws)
    winding = Winding(500.0, clutch.coil_area, clutch.coil_mean_radius)
    static = {}
    rise: dict[tuple[float, float], tuple[float, float]] = {}
    for voltage in (24.0, 480.0):
        final = voltage / winding.resistance
        static[voltage] = problem.solve(500.0 * final).flux_linkage(500.0)
        for sigma in (0.0, 2e6, 7e6):
            eddy = EddyCurrentProblem(problem, dict.fromkeys(iron, sigma), turns=500.0)
            states = eddy.run(
                eddy.at_rest(), 0.03, VoltageDrive(lambda t, v=voltage: v, winding.resistance), tolerance=1e-2
            )
            t, i, linkage = np.array([(s.time, s.current, s.linkage) for s in states]).T
            rise[voltage, sigma] = (
                float(np.interp(0.632 * final, i, t)),
                float(np.interp(0.95 * static[voltage], linkage, t)),
            )
    for voltage in (24.0, 480.0):
        current, flux = (np.array([rise[voltage, sigma][k] for sigma in (0.0, 2e6, 7e6)]) for k in (0, 1))
        assert np.all(np.diff(flux) > 0.0), rise
        assert np.all(current < flux), rise
    # without eddy currents and below saturation: L/R
    tau = apparent_inductance(problem.solve(50.0), 500.0) / winding.resistance
    assert rise[24.0, 0.0][0] == pytest.approx(tau, rel=0.05)
    assert rise[480.0, 0.0][0] < 0.8 * tau, rise


@pytest.fixture(scope="module", params=["steel_1010", "dc01"])
def closed(request):
    """(a closed iron circuit, i(lambda) of a fine sweep, lambda(t) at V from rest of a tight integrator)."""
    r = np.unique(np.round(np.concatenate((graded_lines(4e-3, (0.0, 20e-3), (0.0, 0.1)), [8e-3, 16e-3])), 9))
    z = np.unique(np.round(np.concatenate((graded_lines(4e-3, (0.0, 16e-3), (0.0, 0.1)), [12e-3])), 9))
    regions = {"core": (0.0, 20e-3, -16e-3, 16e-3), "coil": (8e-3, 16e-3, -12e-3, 12e-3)}
    mesh = section_grid(r, np.concatenate((-z, z)), {**regions, "powder": (40e-3, 60e-3, -16e-3, 16e-3)})
    problem = AxisymmetricProblem(mesh, {"core": material(request.param)})
    current = current_of_linkage(problem, N, 1.01 * V / R, points=121)

    def rate(t, y):
        return [V - R * float(current(min(y[0], current.x[-1])))]

    course = solve_ivp(rate, (0.0, 0.1), [0.0], method="LSODA", rtol=1e-9, atol=1e-12, dense_output=True).sol
    return problem, current, lambda times: np.minimum(course(times)[0], current.x[-1])


def rise(source, closed, window, end=0.06):
    """(largest miss of the current in V/R, largest current in V/R, error of the energies in what was supplied)."""
    _, current, linkage = closed
    times, rows = window * np.arange(1, round(end / window) + 1), []
    source.refresh(0.0)
    for time in times:
        source.refresh(time)
        rows.append(source.window_part())
    result = np.array([row.current for row in rows]) / (V / R)
    supplied, copper = (sum(getattr(row, key) for row in rows) for key in ("coil_supplied", "copper_loss"))
    miss = np.abs(result - current(linkage(times)) / (V / R)).max()
    return miss, result.max(), abs(supplied - copper - rows[-1].field_energy) / supplied


@pytest.mark.parametrize("window", [20e-3, 5e-3, 1e-3])
def test_a_window_of_any_length_has_the_current_of_a_saturating_core(closed, window):
    """i(t) of V = R i + d lambda/dt: never above V/R, within half the tolerance, whose order the error has."""
    result = {}
    for tolerance in (0.04, 0.02, 0.005):
        source = CircuitCoilField(
            closed[0], N, TimeProfile.constant(V), R, largest_current=V / R, current_tolerance=tolerance
        )
        result[tolerance], largest, energy = rise(source, closed, window)
        assert result[tolerance] < 0.5 * tolerance and largest < 1.001 and energy < 0.05 * tolerance, result
    assert result[0.005] < 0.5 * result[0.04], result


@pytest.mark.parametrize("window", [20e-3, 5e-3, 1e-3, 1e-4])
def test_eddy_steps_of_any_window_follow_a_saturating_core(closed, window):
    """Without conductors; where the windows are short the current is held by no more than the tolerance."""
    result = {}
    for tolerance in (0.04, 0.02):
        eddy = EddyCurrentProblem(closed[0], {}, turns=N)
        source = EddyCoilField(
            closed[0], N, eddy, TimeProfile.constant(V), R, largest_current=V / R, change_tolerance=tolerance
        )
        result[tolerance], _, energy = rise(source, closed, window)
        assert result[tolerance] < 1.25 * tolerance and energy < 3e-3, result


def test_the_field_in_conductors_does_not_depend_on_the_window(problem):
    """A voltage on a conducting core: one window of 6 ms from rest has the linkage of fine steps."""
    source = eddy_source(problem, supply=TimeProfile.constant(V), resistance=R)
    fine = source.eddy.run(source.eddy.at_rest(), 12e-3, VoltageDrive(lambda t: V, R), tolerance=1e-4)
    linkage = np.interp([6e-3, 12e-3], [state.time for state in fine], [state.linkage for state in fine])
    source.refresh(0.0)
    for time, exact in zip((6e-3, 12e-3), linkage, strict=True):
        source.refresh(time)
        assert source.transient.linkage == pytest.approx(exact, abs=2e-3 * linkage[1])


def test_current_of_a_closed_iron_circuit_does_not_lag_its_linkage(closed):
    """No gap: past the knee the current runs away within a per cent of the linkage, and before it hardly moves."""
    source = CircuitCoilField(
        closed[0], N, voltage=TimeProfile.constant(V), resistance=R, largest_current=V / R, current_tolerance=0.02
    )
    miss, _, _ = rise(source, closed, window=1e-4, end=0.04)
    assert miss < 0.01 and source.solves < 200
