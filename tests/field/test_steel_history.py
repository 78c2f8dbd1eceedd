"""A field with hysteresis: a solenoid with a steel core is the scalar law, Newton stays quadratic, budgets close."""

import numpy as np
import pytest
from scipy.optimize import brentq
from section_grid import section_grid

from field import MU_0, AxisymmetricProblem, material
from field.coil.inductance import incremental_inductance
from field.laws.pinning import Pinning
from field.newton import minimise
from field.section.current_sweep import sweep_currents
from field.section.error_estimate import next_order_field
from field.section.field_lines import field_along
from field.section.section_energy import SectionEnergy
from field.section.steel_history import SteelHistory
from geometry.section import SectionMesh

pytestmark = pytest.mark.physics

STEEL = material("steel_1010")
A, B_COIL, R, H = 10e-3, 12e-3, 30e-3, 2e-3  # core, coil, wall that the flux does not leave by, height [m]
UP_AND_DOWN = [50.0, 200.0, 70.0, 0.0, -40.0, 20.0, -40.0, -200.0, 0.0, 200.0]


def solenoid():
    """One slice of an infinite solenoid: steel core, coil, and air in which the flux comes back."""
    r = np.concatenate((np.linspace(0.0, A, 4), [0.5 * (A + B_COIL), B_COIL, 20e-3, R]))
    mesh = section_grid(r, np.array([0.0, H]), {"core": (0.0, A, 0.0, H), "coil": (A, B_COIL, 0.0, H)})
    at_wall = [pair for pair in mesh.boundaries["outer"] if np.all(np.isclose(mesh.points[pair, 0], R))]
    boundaries = {**mesh.boundaries, "outer": np.array(at_wall)}
    mesh = SectionMesh(mesh.points, mesh.triangles, mesh.regions, boundaries)
    return AxisymmetricProblem(mesh, {"core": STEEL}, order=3)


def core_in_closed_form(pinning, ampere_turns, position):
    """B of the core: no net flux, H falls through the coil by its current over the height."""
    J = ampere_turns / (H * (B_COIL - A))
    outside = J * ((B_COIL**3 - A**3) / 3.0 - A * (B_COIL**2 - A**2) / 2.0)  # integral of J (r - a) r dr over the coil
    outside += J * (B_COIL - A) * (R**2 - B_COIL**2) / 2.0

    def net_flux(B):
        H_core = np.sign(B) * STEEL.H_of_B(np.array(abs(B)))[0] + pinning.step(np.array([B, 0.0]), position)[0][0]
        return 0.5 * A**2 * B + MU_0 * (0.5 * (R**2 - A**2) * H_core - outside)

    return brentq(net_flux, -4.0, 4.0, xtol=1e-14)


def test_a_solenoid_follows_the_scalar_law():
    """B of the core, its loss, and that no current leaves the remanence of the closed form."""
    problem = solenoid()
    history = SteelHistory.demagnetised(problem, {"core": 143.0})
    pinning = Pinning.of(STEEL, 143.0)
    position = pinning.demagnetised()
    fields = sweep_currents(problem, UP_AND_DOWN, tolerance=1e-11, history=history)
    for ampere_turns, field in zip(UP_AND_DOWN, fields, strict=True):
        B = core_in_closed_form(pinning, ampere_turns, position)
        later = pinning.advanced(np.array([B, 0.0]), position)
        found = field.B_along(np.array([[2e-3, 1e-3], [8e-3, 0.5e-3]]))
        assert np.allclose(found, [[0.0, B]] * 2, atol=1e-9), ampere_turns
        volume = np.pi * A**2 * H
        assert field.hysteresis_loss == pytest.approx(volume * pinning.loss(position, later), abs=1e-12)
        position = later
        assert (abs(B) > 1e-3) if ampere_turns == 0.0 else (abs(B) > 0.05)


def test_the_field_along_a_line_obeys_amperes_law_with_history():
    """H of the core is H of the coil's inner face, on the falling branch as well."""
    problem = solenoid()
    *_, field = sweep_currents(
        problem, [20.0, 5.0], tolerance=1e-11, history=SteelHistory.demagnetised(problem, {"core": 143.0})
    )
    along = field_along(field, np.array([[5e-3, 1e-3], [25e-3, 1e-3]]))
    assert along.H[0, 1] - along.H[-1, 1] == pytest.approx(5.0 / H, rel=1e-6)


def test_no_coercivity_is_no_history_and_a_first_step_is_the_curve():
    """To the last bit: no cells, and a step from the demagnetised state."""
    problem = solenoid()
    assert SteelHistory.demagnetised(problem, {"core": 0.0, "coil": 0.0}) is None
    plain = problem.solve(20.0)
    history = SteelHistory.demagnetised(problem, {"core": 143.0})
    assert np.array_equal(problem.solve(20.0, history=history).psi, plain.psi)
    still = problem.solve(0.0, history=history)
    assert not still.psi.any() and still.newton == [(0.0, 0.0)]


@pytest.fixture(scope="module")
def pot():
    """A pot core with a gap of 0.5 mm, its steel bent through by the flux."""
    r = np.concatenate(
        (np.linspace(0.0, 20e-3, 8), [20.25e-3, 20.5e-3], [26e-3, 32e-3, 37.4e-3, 41e-3, 45e-3], [80e-3, 150e-3])
    )
    z = np.concatenate(
        ([-90e-3, -40e-3], [-18e-3, -14e-3, -10e-3, -5e-3, 0.0, 5e-3, 10e-3, 14e-3, 18e-3], [40e-3, 90e-3])
    )
    regions = {
        "disc": (0.0, 20e-3, -18e-3, 18e-3),
        "housing": (20.5e-3, 45e-3, -18e-3, 18e-3),
        "coil": (20.5e-3, 37.4e-3, -10e-3, 10e-3),
    }
    return AxisymmetricProblem(section_grid(r, z, regions), {"disc": STEEL, "housing": STEEL})


def steels(problem):
    return SteelHistory.demagnetised(problem, {"disc": 143.0, "housing": 143.0})


def test_newton_is_quadratic_with_history(pot):
    """On the falling branch each step squares the residual: the tangent is that of the step; no secant steps here."""
    *_, before = sweep_currents(pot, [1500.0, 600.0], history=steels(pot))
    source = 300.0 * pot.coil_load
    energy = SectionEnergy(pot, None, source, np.zeros(pot.n_dofs), before.later_history)

    class Newton:
        again_is_cheap = False
        solve = staticmethod(pot._solver.solve)

    scale = np.linalg.norm(source[pot._free])
    _, newton = minimise(energy, before.psi[pot._free], scale, solver=Newton, tolerance=1e-10, max_iterations=20)
    residual = np.array([r for r, _ in newton])
    # 1e-3: where the step before is within quadratic convergence; which step that is, round-off may shift
    assert residual[-3] < 1e-3 and residual[-2] < residual[-3] ** 1.7 and len(residual) < 9, residual


def test_the_result_does_not_depend_on_the_start(pot):
    """The step is the minimum of a convex energy: from no field, or from that of another current."""
    *_, before = sweep_currents(pot, [1500.0, 600.0], history=steels(pot))
    position = before.later_history.regions[0].position.copy()
    warm = pot.solve(100.0, guess=before, history=before.later_history, tolerance=1e-10)
    cold = pot.solve(100.0, history=before.later_history, tolerance=1e-10)
    assert np.allclose(warm.psi, cold.psi, atol=1e-7 * np.abs(warm.psi).max())
    assert np.array_equal(before.later_history.regions[0].position, position)


def test_a_repeated_solve_leaves_the_history_alone(pot):
    """Histories are constants: the same step taken twice is the same, whatever was solved between."""
    *_, before = sweep_currents(pot, [1500.0], history=steels(pot))
    first = pot.solve(500.0, guess=before, history=before.later_history)
    pot.solve(-1500.0, guess=before, history=before.later_history)
    again = pot.solve(500.0, guess=before, history=before.later_history)
    assert np.array_equal(first.psi, again.psi)


def test_work_of_the_current_goes_into_field_and_heat(pot):
    """Around a loop: integral of N I d(linkage) = heat; on the way, the rest is stored."""
    turns = np.concatenate(
        (np.linspace(0.0, 600.0, 13), np.linspace(550.0, -600.0, 24), np.linspace(-550.0, 600.0, 24))
    )
    fields = list(sweep_currents(pot, turns, history=steels(pot), tolerance=1e-9))
    linkage = np.array([field.flux_linkage_per_turn for field in fields])
    heat = np.cumsum([field.hysteresis_loss for field in fields])
    work = np.concatenate(([0.0], np.cumsum(0.5 * (turns[1:] + turns[:-1]) * np.diff(linkage))))
    stored = np.array([field.energy for field in fields])
    assert np.allclose(work, stored + heat, atol=0.01 * work.max())
    loop = slice(12, None)
    assert work[-1] - work[12] == pytest.approx(heat[-1] - heat[12], rel=0.03) and heat[-1] > heat[12] > 0.0
    assert linkage[-1] == pytest.approx(linkage[12], rel=1e-4), "the loop closes"
    falling, rising = linkage[loop][:25], linkage[loop][24:]
    assert np.allclose(falling, -rising, atol=1e-4 * linkage.max()) and np.all(np.diff(falling) < 0.0)
    assert falling[12] > 0.01 * linkage[12], "flux remains at 0 A"


def test_a_decaying_alternating_current_demagnetises(pot):
    """What remains at 0 A is a hundredth of what it was."""
    peaks = 600.0 * 0.8 ** np.arange(25) * (-1.0) ** np.arange(25)
    fields = list(sweep_currents(pot, [600.0, 0.0, *peaks, 0.0], history=steels(pot)))
    remains = [fields[i].flux_linkage_per_turn for i in (1, -1)]
    assert abs(remains[1]) < 0.01 * remains[0] and remains[0] > 0.0


def test_incremental_inductance_is_the_slope_along_the_branch(pot):
    history = steels(pot)
    *_, before = sweep_currents(pot, [1500.0, 800.0], history=history)
    field, further = sweep_currents(pot, [700.0, 699.0], history=before.later_history, tolerance=1e-11)
    slope = (field.flux_linkage_per_turn - further.flux_linkage_per_turn) / 1.0
    assert incremental_inductance(field, 1.0) == pytest.approx(slope, rel=2e-3)


def test_what_history_forbids_is_explained(pot):
    with pytest.raises(ValueError, match="no such region"):
        SteelHistory.demagnetised(pot, {"hub": 143.0})
    *_, field = sweep_currents(pot, [500.0], history=steels(pot))
    with pytest.raises(ValueError, match="co-energy"):
        _ = field.coenergy
    with pytest.raises(ValueError, match="another history"):
        next_order_field(field)
    assert field.estimated_errors() is None
