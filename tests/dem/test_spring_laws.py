"""The compiled springs: textbook forces, energies, tangential stiffness, similarity."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.integrate import quad

from particles.laws.columns import N_LAW
from particles.laws.elastic import Elastic, effective_modulus, effective_shear_modulus
from particles.laws.hertz import HertzContact
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.springs import SPRINGS, law_table
from particles.laws.springs import spring as spring_of
from particles.laws.thesis import ThesisContact
from particles.laws.walton_braun import WaltonBraun

GLASS, RUBBER = Elastic(48e9, 0.2), Elastic(2e7, 0.49)
LAWS = {
    "linear": LinearContact(1e4, 2e3, 0.2, 0.1, 0.3),
    "hertz_mindlin": HertzMindlin(GLASS, RUBBER, 0.2, 0.1, 0.3),
    "hertz": HertzContact(1e8, 4e7, 0.5, 0.2, 0.3),
    "thesis sqrt": ThesisContact(1e5, 2e4, 900.0, 450.0, 1e-3, 0.5, 0.3),
    "thesis one": ThesisContact(1e5, 2e4, 900.0, 450.0, 1e-3, 0.0, 0.3),
    "walton_braun": WaltonBraun(1e4, 4e4, 2e3, 0.1, 0.3),
}
M, R = 2e-6, 0.25e-3  # reduced mass [kg] and effective radius [m]


def spring(law, delta, m_eff=M, r_eff=R, memory=0.0):
    return spring_of(law_table(law.kernel, law.row()[None]), 0, delta, m_eff, r_eff, memory)


def textbook(name, d):
    """(f_elastic, k_t, gamma_n, gamma_t) of `LAWS`, each formula as its source prints it."""
    if name == "linear":  # Cundall & Strack
        return 1e4 * d, 2e3, 2 * 0.2 * math.sqrt(1e4 * M), 2 * 0.1 * math.sqrt(1e4 * M)
    if name == "hertz_mindlin":  # Hertz, Mindlin, Tsuji
        E = 1 / ((1 - 0.2**2) / 48e9 + (1 - 0.49**2) / 2e7)
        G = 1 / ((2 - 0.2) / (48e9 / 2.4) + (2 - 0.49) / (2e7 / 2.98))
        S_n, S_t = 2 * E * math.sqrt(R * d), 8 * G * math.sqrt(R * d)
        unit = 2 * math.sqrt(5 / 6)
        return 4 / 3 * E * R**0.5 * d**1.5, S_t, unit * 0.2 * math.sqrt(S_n * M), unit * 0.1 * math.sqrt(S_t * M)
    if name == "hertz":
        return 1e8 * d**1.5, 4e7 * d**0.5, 0.5, 0.2
    f = math.sqrt(d / 1e-3) if name == "thesis sqrt" else 1.0  # Silbert et al.
    if name.startswith("thesis"):
        return f * 1e5 * d, f * 2e4, f * 900 * M, f * 450 * M
    return 1e4 * d, 2e3, 0.0, 2 * 0.1 * math.sqrt(1e4 * M)  # Walton & Braun, first loading


@njit
def compiled(table, delta, memory):
    return spring_of(table, 0, delta, M, R, memory)


def test_kernels_have_the_spring_of_every_law():
    """Each law of `SPRINGS` has its own branch: what is compiled is the law's function."""
    assert {law.kernel for law in LAWS.values()} == set(SPRINGS)
    for law in LAWS.values():
        for delta, memory in ((3e-7, 0.0), (3e-7, 5e-7)):
            found = compiled(law_table(law.kernel, law.row()[None]), delta, memory)
            assert found == pytest.approx(spring(law, delta, memory=memory), rel=1e-13)


@pytest.mark.parametrize("name", LAWS)
def test_spring_is_the_textbook_formula(name):
    for delta in (1e-9, 3e-7, 2e-5):
        assert spring(LAWS[name], delta)[:4] == pytest.approx(textbook(name, delta), rel=1e-13)


@pytest.mark.parametrize("name", LAWS)
def test_energy_is_the_integral_of_the_force(name):
    law, depth = LAWS[name], 1.7e-5
    work, _ = quad(lambda d: spring(law, d)[0], 0.0, depth, epsabs=0.0, epsrel=1e-10)
    recovered = 0.25 if name == "walton_braun" else 1.0  # k_1/k_2; the rest is lost
    assert spring(law, depth)[4] == pytest.approx(recovered * work, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_stiffness_is_the_derivative_of_the_force(name):
    law, d, h = LAWS[name], 1.8e-5, 1e-9
    peak = 2e-5 if name == "walton_braun" else 0.0  # it reports the stiffer branch
    slope = (spring(law, d + h, memory=peak)[0] - spring(law, d - h, memory=peak)[0]) / (2 * h)
    assert law.stiffness_at(d, R) == pytest.approx(slope, rel=1e-6 if peak == 0.0 else 1e-5)


@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=25, deadline=None)
@given(a=st.floats(1e-9, 1e-4), b=st.floats(1e-9, 1e-4), peak=st.floats(0.0, 1e-4))
def test_force_repels_and_grows_with_the_overlap(name, a, b, peak):
    """Along any branch: with the same memory a deeper contact presses at least as hard."""
    shallow, deep = (spring(LAWS[name], d, memory=peak) for d in sorted((a, b)))
    assert 0.0 <= shallow[0] <= deep[0] and shallow[4] <= deep[4]
    assert min(shallow[1:5]) >= 0.0


@pytest.mark.parametrize("name", sorted(set(LAWS) - {"walton_braun"}))
def test_laws_without_memory_return_it_unchanged(name):
    assert spring(LAWS[name], 1e-5, memory=0.125)[5] == 0.125


@pytest.mark.parametrize("nu", [0.0, 0.2, 0.5])
def test_mindlin_ratio_of_like_bodies(nu):
    """k_t/k_n = 2 (1 - nu)/(2 - nu): Mindlin 1949; Johnson, Contact Mechanics, eq. 7.43."""
    material = Elastic(1e9, nu)
    law = HertzMindlin(material, material, 0.1, 0.1, 0.3)
    _, k_t, _, _, _, _ = spring(law, 1e-5)
    assert k_t / law.stiffness_at(1e-5, R) == pytest.approx(2 * (1 - nu) / (2 - nu), rel=1e-13)


def test_moduli_of_a_rigid_partner():
    """Against a rigid body 1/E* = (1 - nu^2)/E and 1/G* = (2 - nu)/G; partners may be exchanged."""
    rigid = Elastic(1e30, 0.3)
    assert effective_modulus(GLASS, rigid) == pytest.approx(48e9 / 0.96, rel=1e-12)
    assert effective_shear_modulus(GLASS, rigid) == pytest.approx(20e9 / 1.8, rel=1e-12)
    assert effective_modulus(GLASS, RUBBER) == effective_modulus(RUBBER, GLASS)
    assert Elastic(48e9, 0.2, 1e9).G == 1e9


@settings(max_examples=25, deadline=None)
@given(scale=st.floats(0.01, 100.0), delta=st.floats(1e-8, 1e-5))
def test_elastic_spheres_are_similar(scale, delta):
    """All lengths times s (mass s^3), one material and speed: forces s^2, stiffness s, dashpots s^2, times s."""
    law = LAWS["hertz_mindlin"]
    small = np.array(spring(law, delta)[:5])
    large = np.array(spring(law, scale * delta, scale**3 * M, scale * R)[:5])
    assert large == pytest.approx(small * scale ** np.array([2, 1, 2, 2, 3]), rel=1e-12)
    times = [law.contact_time(s**3 * M, s * R, 0.3) for s in (1.0, scale)]
    assert times[1] == pytest.approx(scale * times[0], rel=1e-12)


def test_walton_braun_follows_its_three_branches():
    """Load to 2e-5, unload, reload on the same line up to the peak, then load on."""
    law, peak = LAWS["walton_braun"], 0.0
    rest = 2e-5 * (1 - 1 / 4)  # delta_0
    expected = {1e-5: 0.1, 2e-5: 0.2, 1.75e-5: 0.1, rest: 0.0, 1e-5 + 1e-12: 0.0, 1.8e-5: 0.12, 2.5e-5: 0.25}
    for delta, force in expected.items():
        f, _, _, _, energy, peak = spring(law, delta, memory=peak)
        assert f == pytest.approx(force, abs=1e-12)
        assert energy == pytest.approx(0.5 * force**2 / 4e4, abs=1e-18)
    assert peak == 2.5e-5


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.0, 1e-4), min_size=1, max_size=12))
def test_walton_braun_never_gives_more_than_it_took(turns):
    """Any cycle of overlaps that ends apart does work on the contact, and what is stored has been put in."""
    law, peak, x, work = LAWS["walton_braun"], 0.0, 0.0, 0.0
    for turn in [*turns, 0.0]:
        path = np.linspace(x, turn, 60)
        forces = []
        for delta in path:
            f, _, _, _, energy, peak = spring(law, delta, memory=peak)
            forces.append(f)
        # the force is convex along a branch and the trapezium only errs where the branch changes: by one interval
        work += np.trapezoid(forces, path) + 4e4 * (path[1] - path[0]) ** 2
        x = turn
        assert work >= energy
    assert work >= 0.0 and energy == 0.0


@pytest.mark.parametrize("name", LAWS)
def test_row_has_the_columns_of_the_table(name):
    row = LAWS[name].row()
    assert row.shape == (N_LAW,) and row[6] == 0.3 and not row[7:11].any()


@pytest.mark.parametrize(
    "make",
    [
        lambda: LinearContact(0.0, 1.0, 0.1, 0.1, 0.1),
        lambda: LinearContact(1.0, 1.0, 0.1, 0.1, float("nan")),
        lambda: HertzMindlin(GLASS, GLASS, -0.1, 0.1, 0.3),
        lambda: HertzContact(1e8, 1e8, float("inf"), 0.1, 0.3),
        lambda: HertzContact.from_restitution(-1.0, 0.5, 0.3, m_eff=M, speed=1.0),
        lambda: HertzContact.from_restitution(1e8, 0.5, 0.3, m_eff=M, speed=0.0),
        lambda: ThesisContact(1e5, 1e5, 1.0, 1.0, 0.0, 0.5, 0.3),
        lambda: ThesisContact(1e5, 1e5, 1.0, 1.0, 1e-3, 1.5, 0.3),
        lambda: ThesisContact.from_restitution(1e5, 0.5, -1.0, diameter=1e-3, exponent=0.5, m_eff=M, speed=1.0),
        lambda: WaltonBraun(1e4, 0.9e4, 1e3, 0.1, 0.3),
        lambda: Elastic(0.0, 0.3),
        lambda: Elastic(1e9, 0.6),
        lambda: Elastic(1e9, 0.3, -1.0),
    ],
)
def test_bad_parameters_are_refused_with_the_allowed_range(make):
    with pytest.raises(ValueError, match=r"= .*allowed"):
        make()
