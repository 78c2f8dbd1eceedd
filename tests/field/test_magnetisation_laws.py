"""H(B) laws: consistent slope and energy, reference values, limits, one spline for all of them, faults explained."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from field import (
    AIR,
    MU_0,
    NU_0,
    FroehlichLaw,
    GrainLaw,
    LinearLaw,
    PermeabilityLaw,
    PowderLaw,
    TableLaw,
    material,
    material_names,
)
from field.laws.brauer import BrauerLaw
from field.laws.langevin import LangevinLaw
from field.laws.materials import _STEEL_1010

LAWS = {
    "brauer": BrauerLaw(0.3774, 2.970, 388.33),
    "brauer, sharp": BrauerLaw(1e-3, 5.0, 100.0),
    "langevin": LangevinLaw(200.0, 1.3e6),
    "langevin, soft": LangevinLaw(1e5, 1.7e6),
    "langevin, hard": LangevinLaw(0.5, 4e5),
    "froehlich": FroehlichLaw(200.0, 1.3e6),
    "froehlich, soft": FroehlichLaw(1e5, 1.7e6),
    "froehlich, hard": FroehlichLaw(0.1, 1e5),
}
ALL = LAWS | {name: material(name) for name in material_names()}
# the whole range of a solve: from the remanence of a few nanotesla to beyond any magnet
B_RANGE = np.concatenate((np.logspace(-9.0, 0.0, 200, endpoint=False), np.linspace(1.0, 20.0, 400)))

STEELS = [name for name in material_names() if not isinstance(material(name), LinearLaw)]


@pytest.mark.parametrize("name", ALL)
def test_slope_and_energy_belong_to_H(name):
    law = ALL[name]
    # off round numbers: at a break point of a table the slope itself jumps
    B = np.linspace(0.0131, 19.87, 3000)
    H, slope = law.H_of_B(B)
    step = 1e-6
    up, down = law.H_of_B(B + step)[0], law.H_of_B(B - step)[0]
    # round-off of H over the step, and the change of slope within it
    assert np.allclose((up - down) / (2 * step), slope, rtol=2e-3, atol=1e-15 * H.max() / step)
    energy = (law.energy_density(B + step) - law.energy_density(B - step)) / (2 * step)
    # 1e-16 of the energy over the step
    assert np.allclose(energy, H, rtol=1e-5, atol=1e-15 * law.energy_density(B).max() / step)


@pytest.mark.parametrize("name", ALL)
def test_H_grows_from_the_origin_and_never_faster_than_in_vacuum_at_the_end(name):
    law = ALL[name]
    H, slope = law.H_of_B(B_RANGE)
    assert law.source
    assert np.all(slope > 0.0) and np.all(np.diff(H) > 0.0) and np.all(H > 0.0)
    assert law.H_of_B(np.zeros(1))[0][0] == 0.0 and law.energy_density(np.zeros(1))[0] == 0.0
    # w is convex in B, which is what makes Newton with a line search converge: w'' = slope > 0, seen in w itself
    w = law.energy_density(np.linspace(0.0, 20.0, 500))
    assert np.all(np.diff(w, 2) > 0.0)
    # M never falls at the end: dH/dB <= nu_0
    assert slope[-1] <= NU_0 * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ALL)
def test_energy_is_the_integral_of_H(name):
    """By quadrature, break points given: an independent way to the closed forms."""
    law = ALL[name]
    ends = [0.0, 0.02, 0.3, 0.9, 1.4, 1.8, 2.5]
    for start, end in pairwise(ends):
        by_quadrature, error = quad(
            lambda B: float(law.H_of_B(np.array([B]))[0][0]), start, end, limit=200, epsrel=1e-10
        )
        both = law.energy_density(np.array([start, end]))
        assert both[1] - both[0] == pytest.approx(by_quadrature, rel=1e-7, abs=2 * error)


@pytest.mark.parametrize("name", LAWS)
def test_weak_and_strong_fields_are_the_limits(name):
    law = LAWS[name]
    weak = np.array([1e-9])
    H, slope = law.H_of_B(weak)
    initial = law.k1 + law.k3 if isinstance(law, BrauerLaw) else NU_0 / (1.0 + law.chi)
    assert H[0] == pytest.approx(initial * weak[0], rel=1e-6) and slope[0] == pytest.approx(initial, rel=1e-6)
    assert law.energy_density(weak)[0] == pytest.approx(0.5 * initial * weak[0] ** 2, rel=1e-6)
    strong = np.array([1e4])
    H, slope = law.H_of_B(strong)
    Ms = law.B_s * NU_0 - law.H_s if isinstance(law, BrauerLaw) else law.Ms
    assert slope[0] == pytest.approx(NU_0, rel=1e-4) and NU_0 * strong[0] - H[0] == pytest.approx(Ms, rel=5e-3)


@pytest.mark.parametrize("chi", [0.5, 200.0, 1e5])
def test_langevin_is_inverted_exactly(chi):
    law, Ms = LangevinLaw(chi, 1.3e6), 1.3e6
    B = np.logspace(-6, 1.5, 40)
    H = law.H_of_B(B)[0]
    # coth a - 1/a by its series below a = 1e-2 (next term a^5 2/945), as written above it
    a = 3.0 * chi * H / Ms
    L = np.where(a < 1e-2, a / 3 - a**3 / 45, 1.0 / np.tanh(np.maximum(a, 1e-2)) - 1.0 / np.maximum(a, 1e-2))
    assert np.allclose(MU_0 * (H + Ms * L), B, rtol=1e-10)
    for k in (5, 20, 35):  # and by bisection

        def excess(H, B=B[k]):
            a = 3.0 * chi * H / Ms
            return H + Ms * (1.0 / np.tanh(a) - 1.0 / a if a > 1e-2 else a / 3 - a**3 / 45) - B / MU_0

        assert H[k] == pytest.approx(brentq(excess, 1e-12, B[k] / MU_0, rtol=1e-13), rel=1e-9)


def test_langevin_takes_any_shape():
    law = LangevinLaw(1e4, 1.7e6)
    assert law.H_of_B(np.full((3, 4), 1.0))[0].shape == (3, 4) and law.H_of_B(1.0)[0].shape == ()
    assert law.H_of_B(np.zeros((0, 6)))[0].shape == (0, 6)
    B = np.linspace(0.0, 3.0, 301)
    together = law.H_of_B(B)[0]
    # a point's answer does not depend on its company beyond the last step, which all of them make
    assert np.allclose(
        together[::30], np.concatenate([law.H_of_B(B[k : k + 1])[0] for k in range(0, 301, 30)]), rtol=1e-13
    )


def test_froehlich_is_the_grain_law_at_solid_fraction_one():
    grain, bulk = PowderLaw(GrainLaw(200.0, 1.3e6)), FroehlichLaw(200.0, 1.3e6)
    B = np.logspace(-9, 2, 500)
    for of_grain, of_bulk in zip(grain.H_of_B(B, 1.0), bulk.H_of_B(B), strict=True):
        assert np.allclose(of_grain, of_bulk, rtol=1e-12)
    assert np.allclose(grain.energy_density(B, 1.0), bulk.energy_density(B), rtol=1e-9)


def test_froehlich_at_one_field_strength_by_hand():
    """chi H = Ms: M = Ms/2, and B = mu_0 (Ms/chi + Ms/2)."""
    H, _ = FroehlichLaw(200.0, 1.3e6).H_of_B(np.array([MU_0 * (1.3e6 / 200.0 + 0.65e6)]))
    assert H[0] == pytest.approx(1.3e6 / 200.0, rel=1e-13)


def test_brauer_is_its_formula_until_the_slope_of_vacuum():
    k1, k2, k3 = 0.3774, 2.970, 388.33
    law = BrauerLaw(k1, k2, k3)
    B = np.linspace(0.0, law.B_s, 50)
    assert np.allclose(law.H_of_B(B)[0], (k1 * np.exp(k2 * B**2) + k3) * B, rtol=1e-14)
    u = k2 * law.B_s**2
    assert k1 * np.exp(u) * (1 + 2 * u) + k3 == pytest.approx(NU_0, rel=1e-12)
    assert law.H_of_B(np.array([law.B_s * (1 + 1e-9)]))[1][0] == NU_0


def test_steel_1010_passes_through_its_table():
    H, B = _STEEL_1010.T
    assert np.allclose(material("steel_1010").H_of_B(B)[0], H, rtol=1e-12)


def test_steel_1010_is_not_convex_and_grows_all_the_same():
    """Its permeability rises between 240 and 640 A/m: H(B) is concave there, and naive Newton on it fails."""
    law = material("steel_1010")
    slope = law.H_of_B(np.linspace(0.05, 0.75, 300))[1]
    assert slope.max() > 1.3 * slope[-1] and slope.min() > 0.0


@pytest.mark.parametrize("name", STEELS)
def test_saturated_steel_has_the_slope_of_vacuum(name):
    law = material(name)
    assert np.allclose(law.H_of_B(np.array([8.0, 20.0]))[1], NU_0)
    M = NU_0 * np.array([8.0, 20.0]) - law.H_of_B(np.array([8.0, 20.0]))[0]
    assert M[0] == pytest.approx(M[1]) and 1.2e6 < M[0] < 2.2e6  # the DC01 fit ends at 2.13e6


def test_fitted_permeability_is_the_formula_until_M_is_held():
    law = material("stainless_430")
    B = np.linspace(0.05, 2.2, 50)
    b = B / 1.1
    mu_r = 1 + (274 - 1 + 970 * b) / (1 + 1.2 * b + b**8.3)  # Modelica FluxTubes, X6Cr17
    assert np.allclose(law.H_of_B(B)[0], B / (MU_0 * mu_r), rtol=1e-5)
    assert law.saturation_B() == pytest.approx(2.23, abs=0.01)
    assert material("vacofer_s2").saturation_B() == pytest.approx(1.93, abs=0.01)


def test_air_is_linear():
    H, slope = AIR.H_of_B(np.array([1.0]))
    assert H[0] == pytest.approx(1 / MU_0) and slope[0] == pytest.approx(1 / MU_0)


# --- faults ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("H", "B", "words"),
    [
        ([0, 100, 90, 300], [0, 0.1, 0.2, 0.3], "not monotone: H"),
        ([0, 100, 200, 300], [0, 0.1, 0.1, 0.3], "not monotone: B"),
        ([0, 100, 200, 1e6], [0, 0.1, 0.2, 0.3], "below mu_0"),
        ([0, 100, 200], [0, 0.1, 0.2], "at least 3"),
        ([0, 100, 200, 300], [0, 0.1, 0.2], "one B"),
        ([10, 100, 200, 300], [0, 0.1, 0.2, 0.3], "origin"),
        ([0, 100, np.nan, 300], [0, 0.1, 0.2, 0.3], "finite"),
    ],
)
def test_faulty_table_is_explained(H, B, words):
    with pytest.raises(ValueError, match=words):
        TableLaw(np.array(H), np.array(B), "mine")


@pytest.mark.parametrize(
    ("law", "numbers", "words"),
    [
        (LinearLaw, (0.5,), "at least 1"),
        (PermeabilityLaw, (0.5, 1.0, 1.0, 1.0, 8.0), "mu_i > 1"),
        (FroehlichLaw, (0.0, 1.3e6), "chi"),
        (LangevinLaw, (200.0, -1.0), "Ms"),
        (BrauerLaw, (0.0, 2.0, 400.0), "k1 > 0"),
        (BrauerLaw, (1.0, 2.0, 8e5), "that of vacuum"),
        (BrauerLaw, (1.0, float("nan"), 400.0), "k2 > 0"),
    ],
)
def test_impossible_coefficients_are_explained(law, numbers, words):
    with pytest.raises(ValueError, match=words):
        law(*numbers)


@pytest.mark.parametrize("seed", range(60))
def test_every_monotone_table_has_a_finite_permeability(seed):
    """A second interval much steeper than the first made PCHIP's slope, and 1/mu_r, zero at the origin."""
    random = np.random.default_rng(seed)
    B = np.cumsum(random.uniform(0.05, 0.4, 6))
    H = np.cumsum(10.0 ** random.uniform(1.0, 4.5, 6))  # at most 0.05 T/mu_0 a step
    law = TableLaw(H, B)
    fine = np.linspace(0.0, 1.2 * B[-1], 5000)
    found, slope = law.H_of_B(fine)
    assert slope.min() > 0.0 and np.all(np.diff(found) > 0.0)


def random_table(seed):
    """Points of a law whose permeability only falls, coarse and with kinks; the last one near the slope of vacuum."""
    random = np.random.default_rng(seed)
    H = np.cumsum(10.0 ** random.uniform(1.5, 5.0, 6))
    mu_r = np.sort(1.0 + 10.0 ** random.uniform(-2.0, 3.5, 6))[::-1]
    B = np.cumsum(MU_0 * mu_r * np.diff(H, prepend=0.0))
    scale = min(1.0, 2.0 / (B - MU_0 * H)[-1])  # J of at most 2 T
    return H, scale * (B - MU_0 * H) + MU_0 * H


@pytest.mark.parametrize(
    "table",
    [
        ([100.0, 300.0, 1e3, 2e5], [1.0, 1.5, 1.7, 1.97]),
        ([100.0, 200.0, 300.0, 1e5], [1.0, 1.5, 1.6, 1.75]),
        ([100.0, 200.0, 300.0, 1e5], [1.0, 1.5, 1.6, 1.6 + MU_0 * 99_700.0]),  # no polarisation left: mu_0 itself
        *(random_table(seed) for seed in range(300)),
    ],
)
def test_no_kink_of_a_table_takes_the_slope_below_vacuum(table):
    """Where the points of a table have dB/dH >= mu_0, its cubics have it too; H and energy stay those of one curve."""
    H, B = np.array(table[0]), np.array(table[1])
    law = TableLaw(H, B)
    fine = np.linspace(0.0, 1.2 * B[-1], 5001)
    found, slope = law.H_of_B(fine)
    assert slope.min() >= 0.0 and slope.max() * MU_0 <= 1.0 + 1e-9
    assert np.allclose(law.H_of_B(B)[0], H, rtol=1e-12) and np.all(np.diff(found) > 0.0)
    work = np.diff(law.energy_density(fine))  # H grows: its integral is between those of the ends' values
    step = np.diff(fine)
    assert np.all(work >= found[:-1] * step * (1 - 1e-9) - 1e-9) and np.all(
        work <= found[1:] * step * (1 + 1e-9) + 1e-9
    )


def test_a_polarisation_that_no_material_has_is_refused():
    """1800 T, that is mT under a heading in T."""
    with pytest.raises(ValueError, match="check the unit of B"):
        TableLaw(np.array([100.0, 1e3, 1e4]), np.array([900.0, 1500.0, 1800.0]))
