"""Hard cases of the field: every solve converges, within ten factorisations, and says what it did.

`make stability` runs every test that is marked hard: these, and those of the grains.
"""

import numpy as np
import pytest

from field import MU_0, AxisymmetricProblem, FroehlichLaw, LinearLaw, material, material_names
from field.laws.magnetisation_curve import TableLaw
from field.section.current_sweep import predict, sweep_currents
from geometry.clutch import Clutch
from geometry.meshing import mesh_clutch

pytestmark = [pytest.mark.hard, pytest.mark.physics]

STEELS = [name for name in material_names() if not isinstance(material(name), LinearLaw)]
STEEL_PARTS = ("disc", "rotor", "housing")


def clutch_problem(clutch, steel, *, size_factor=2.0, order=2, **options):
    """A clutch of one steel, everything else non-magnetic, powder chamber empty."""
    mesh = mesh_clutch(clutch, gap_layers=3, size_factor=size_factor)
    laws = {name: steel if name in STEEL_PARTS else LinearLaw(1.0) for name in mesh.regions}
    return AxisymmetricProblem(mesh, laws, order=order, **options)


@pytest.fixture(scope="module")
def clutch():
    return Clutch()


@pytest.mark.parametrize("steel", STEELS)
@pytest.mark.parametrize("ampere_turns", [1.0, 1e3, 3e3, 1e5, 1e7])
def test_cold_start_takes_about_ten_steps_at_most(clutch, steel, ampere_turns):
    """Factorisations; from a thousandth of the working point over the knee to iron saturated through and through."""
    case = clutch_problem(clutch, material(steel))
    field = case.solve(ampere_turns)
    residuals = [r for r, _ in field.newton]
    assert residuals[-1] <= 1e-8
    # pure iron with its sharp knee needs 10 there; a secant step costs a fifth of what a factorisation does
    assert case._solver.factorisations <= (10 if steel == "vacofer_s2" else 8)
    assert len(residuals) - 1 <= 13
    assert np.all(np.isfinite(field.psi))


def test_gap_of_a_tenth_of_a_millimetre_in_a_device_of_200_mm():
    """Elements from 0.03 mm to 75 mm; the gap's field is that of Ampere's law around the circuit to 5 %."""
    clutch = Clutch(
        disc_radius=75e-3, disc_thickness=60e-3, gap=0.1e-3, face_gap=1e-3, seal_radius=65e-3, clearance=0.1e-3,
        coil_width=20e-3, coil_height=12e-3, yoke=10e-3, ring_width=15e-3,
    )  # fmt: skip
    case = clutch_problem(clutch, LinearLaw(1e5, "ideal iron"))
    field = case.solve(100.0)
    assert field.newton[-1][0] <= 1e-8
    gap = np.array([[clutch.disc_radius + 0.5 * clutch.gap, 0.5 * clutch.disc_thickness - 5e-3]])
    across = np.abs(field.flux_density(gap)[0, 0])
    # two working gaps and two clearances carry the ampere-turns, the flux 2 pi r l B is the same in each:
    # the clearance's field is smaller by (r l)_gap/(r l)_clearance, which is at least 0.6 and at most 1
    sum_of_gaps = 2.0 * clutch.gap + 2.0 * clutch.clearance * np.array([0.6, 1.0])
    low, high = np.sort(MU_0 * 100.0 / sum_of_gaps)
    assert 0.95 * low < across < 1.05 * high


@pytest.mark.parametrize("mu_r", [1e3, 1e4, 1e5])
def test_permeability_of_a_hundred_thousand(clutch, mu_r):
    """Linear iron: one step, two where round-off asks for it; and the linkage settles as mu_r grows."""
    field = clutch_problem(clutch, LinearLaw(mu_r)).solve(500.0)
    assert len(field.newton) - 1 <= 2
    ideal = clutch_problem(clutch, LinearLaw(1e7)).solve(500.0)
    lost = 1.0 - field.flux_linkage_per_turn / ideal.flux_linkage_per_turn
    # the iron's reluctance is that of some 200 mm of path against 2.6 mm of gaps
    assert 0.0 < lost < 500.0 / mu_r


def test_a_table_with_an_inflection_converges():
    """Steel 1010: H(B) is not convex near 0.2 to 0.8 T, where naive Newton cycles."""
    law = material("steel_1010")
    B = np.linspace(0.05, 0.9, 200)
    _, slope = law.H_of_B(B)
    assert np.any(np.diff(slope) < 0.0) and np.any(np.diff(slope) > 0.0), "the curve has its inflection"
    case = clutch_problem(Clutch(), law)
    for ampere_turns in (100.0, 300.0, 500.0, 700.0):
        assert case.solve(ampere_turns).newton[-1][0] <= 1e-8


def test_a_table_with_a_kink_and_one_with_a_plateau_converge(clutch):
    """A slope that falls by 3000 within one interval, and dH/dB of nearly zero in the next."""
    kink = TableLaw(np.array([0.0, 50.0, 100.0, 1e6]), np.array([0.0, 0.7, 1.4, 1.4 + MU_0 * 1.001e6]), "kink")
    field = clutch_problem(clutch, kink).solve(3000.0)
    assert field.newton[-1][0] <= 1e-8


def test_sweep_up_and_down_is_one_curve(clutch):
    """No hysteresis: down again the linkage is that of the way up, zero current is exactly no field."""
    case = clutch_problem(clutch, material("steel_1010"))
    up = np.linspace(0.0, 4000.0, 33)
    before = case._solver.factorisations
    fields = list(sweep_currents(case, np.concatenate((up, up[-2::-1]))))
    linkage = np.array([field.flux_linkage_per_turn for field in fields])
    assert np.allclose(linkage, linkage[::-1], rtol=1e-6, atol=1e-15)
    assert linkage[0] == 0.0 and linkage[-1] == 0.0
    assert np.all(np.diff(linkage[:33]) > 0.0)
    # 1.3 a point; zero current and the turning point need none
    assert case._solver.factorisations - before <= 1.3 * 62


def test_a_sweep_through_zero_is_odd(clutch):
    case = clutch_problem(clutch, material("stainless_430"))
    linkage = [f.flux_linkage_per_turn for f in sweep_currents(case, np.linspace(-1000.0, 1000.0, 9))]
    assert np.allclose(linkage, -np.array(linkage[::-1]), rtol=1e-6, atol=1e-15)


def test_predictor_is_of_second_order(clutch):
    """Error of the secant's start against the solution: a quarter when the steps are halved."""
    case = clutch_problem(clutch, FroehlichLaw(2000.0, 1.4e6))  # smooth: the tables' slopes have kinks
    errors = []
    for step in (100.0, 50.0):
        earlier = [case.solve(1500.0 - 2.0 * step), case.solve(1500.0 - step)]
        truth = case.solve(1500.0).psi
        errors.append(np.linalg.norm(predict(1500.0, earlier) - truth))
    assert 1.6 < np.log2(errors[0] / errors[1]) < 2.6
