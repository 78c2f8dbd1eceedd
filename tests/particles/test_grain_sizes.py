"""Sizes of grains: moments against quadrature, draws against moments, volumes met to half a grain."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from particles.packing.sizes import (
    EqualSizes,
    ListedSizes,
    LogNormalSizes,
    NormalSizes,
    PercentileSizes,
    UniformSizes,
    read_sizes,
)

KINDS = {
    "equal": EqualSizes(1e-3),
    "uniform": UniformSizes(1e-3, 1.5e-3),
    "normal": NormalSizes(1e-3, 0.1e-3),
    "normal cut short": NormalSizes(1e-3, 0.4e-3, 0.5e-3, 1.2e-3),
    "log-normal": LogNormalSizes(1e-3, 1.3),
    "log-normal cut short": LogNormalSizes(1e-3, 1.5, 0.8e-3, 2e-3),
    "percentiles": PercentileSizes(0.8e-3, 1e-3, 1.4e-3),
    "percentiles by number": PercentileSizes(0.8e-3, 1e-3, 1.4e-3, 0.5e-3, by_mass=False),
    "list": ListedSizes([2e-3, 1e-3, 1.2e-3], [1.0, 2.0, 0.5]),
    "list by mass": ListedSizes([2e-3, 1e-3, 1.2e-3], [1.0, 2.0, 0.5], by_mass=True),
}
kinds = pytest.mark.parametrize("sizes", KINDS.values(), ids=KINDS.keys())


@kinds
def test_moments_are_those_of_the_inverse_distribution(sizes):
    """The mean of d^k over the grains is the integral of at(u)^k over 0 < u < 1, by the definition of `at`."""
    steps = [] if not isinstance(sizes, ListedSizes) else np.cumsum(sizes._share)[:-1]
    for power in (1, 2, 3):
        found, _ = quad(lambda u, p=power: float(sizes.at(np.array(u))) ** p * 1e3**p, 0.0, 1.0, points=steps or None
                        if not len(steps) else steps, epsrel=1e-10)  # fmt: skip
        assert sizes.moment(power) * 1e3**power == pytest.approx(found, rel=1e-8)
    assert sizes.moment(0) == pytest.approx(1.0, rel=1e-14)


@kinds
def test_draws_have_the_moments(sizes):
    """Mean and mean volume of n draws lie within 5 standard errors of the exact ones (one in 2e6 misses)."""
    n = 40_000
    d = sizes.draw(n, seed=7)
    assert d.shape == (n,)
    low, high = sizes.limits
    assert (d >= low).all() and (d <= high).all()
    error = sizes.deviation / math.sqrt(n)
    assert abs(d.mean() - sizes.mean) <= 5.0 * error + 1e-12 * sizes.mean
    volume = math.pi / 6.0 * d**3
    assert abs(volume.mean() - sizes.mean_volume) <= 5.0 * volume.std() / math.sqrt(n) + 1e-12 * sizes.mean_volume
    # the standard error of a standard deviation, from the fourth moment of the draw itself
    fourth = np.mean((d - d.mean()) ** 4)
    spread = math.sqrt(max(0.0, fourth - d.std() ** 4) / n) / max(2.0 * d.std(), 1e-30)
    assert abs(d.std() - sizes.deviation) <= 5.0 * spread + 1e-12 * sizes.mean


def test_known_moments():
    """Textbook: uniform (a + b)/2 and (b - a)/sqrt 12; log-normal E d^3 = median^3 exp(9 s^2/2) without a cut."""
    uniform = UniformSizes(1.0, 1.5)
    assert uniform.mean == pytest.approx(1.25) and uniform.deviation == pytest.approx(0.5 / math.sqrt(12.0))
    wide = LogNormalSizes(1.0, 1.3, 1e-6, 1e6)
    assert wide.moment(3) == pytest.approx(math.exp(4.5 * math.log(1.3) ** 2), rel=1e-12)
    assert NormalSizes(1.0, 0.1).mean == pytest.approx(1.0, rel=1e-14)  # cut evenly
    by_mass = ListedSizes([1.0, 2.0], [1.0, 1.0], by_mass=True)  # half the mass each: eight small ones for a large one
    assert by_mass.mean == pytest.approx((8.0 * 1.0 + 2.0) / 9.0)
    assert by_mass.mean_by_volume == pytest.approx(1.5)  # half the volume each


def test_a_draw_has_the_percentiles_of_the_maker():
    """Of what is drawn, 10, 50 and 90 % by mass (by number) are finer than d10, d50, d90.

    Within five standard errors of a share: by mass sum(m_i (1[d_i < d] - q))/sum(m_i) has the variance
    sum(m_i^2 (1 - q)^2 or q^2)/sum(m_i)^2.
    """
    for by_mass in (True, False):
        sizes = PercentileSizes(45e-6, 60e-6, 100e-6, by_mass=by_mass)
        d = sizes.draw(40_000, seed=5)
        weight = d**3 if by_mass else np.ones(len(d))
        for share, diameter in ((0.1, 45e-6), (0.5, 60e-6), (0.9, 100e-6)):
            finer = d < diameter
            error = math.sqrt(np.sum((weight * (finer - share)) ** 2)) / weight.sum()
            assert error < 0.01
            assert abs(weight[finer].sum() / weight.sum() - share) < 5.0 * error
    # symmetrical in ln d at a narrow spread, mass and number agree to the factor exp(3 ln(d/d50)) of the section
    narrow = [PercentileSizes(0.999, 1.0, 1.0 / 0.999, by_mass=by_mass).mean for by_mass in (True, False)]
    assert narrow[0] == pytest.approx(narrow[1], rel=1e-5)


@kinds
@pytest.mark.parametrize("grains", [0.3, 1.0, 57.3, 20_000.0])
def test_volume_is_met_to_half_a_grain(sizes, grains):
    wanted = grains * sizes.mean_volume
    d = sizes.draw_volume(wanted, seed=3)
    assert abs(math.pi / 6.0 * np.sum(d**3) - wanted) <= 0.5 * math.pi / 6.0 * sizes.limits[1] ** 3 * (1.0 + 1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**63 - 1), st.integers(1, 300), st.integers(0, 300))
def test_a_longer_draw_begins_with_the_shorter(seed, few, more):
    for sizes in (KINDS["log-normal"], KINDS["list"]):
        long = sizes.draw(few + more, seed)
        assert np.array_equal(sizes.draw(few, seed), long[:few])
        by_volume = sizes.draw_volume(few * sizes.mean_volume, seed)
        assert np.array_equal(by_volume, sizes.draw(len(by_volume), seed))


def test_seeds_differ():
    assert not np.array_equal(KINDS["normal"].draw(50, 1), KINDS["normal"].draw(50, 2))


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: EqualSizes(0.0), "more than 0"),
        (lambda: UniformSizes(2e-3, 1e-3), "from 2 to 1 mm"),
        (lambda: NormalSizes(1e-3, 0.4e-3), "three standard deviations below the mean is -0.2 mm"),
        (lambda: NormalSizes(1e-3, 0.1e-3, 1.1e-3), "not between the limits"),
        (lambda: LogNormalSizes(1e-3, 1.0), "geometric standard deviation = 1;"),
        (lambda: PercentileSizes(2e-3, 1e-3, 3e-3), "d10, d50, d90, largest = 4, 2, 1, 3, 9 mm"),
        (lambda: PercentileSizes(1e-3, 2e-3, 3e-3, 1e-3), "each above the one before"),
        (lambda: ListedSizes([]), "empty"),
        (lambda: ListedSizes([1e-3], [1.0, 2.0]), "1 diameters but 2 weights"),
        (lambda: ListedSizes([1e-3, -1e-3]), "diameter 2 of the list"),
        (lambda: ListedSizes([1e-3], [0.0]), "every weight"),
    ],
)
def test_impossible_sizes_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_sizes_from_a_sieve_file(tmp_path):
    path = tmp_path / "sieve.csv"
    path.write_text("diameter [um], mass [%]\n# coarse\n200, 50\n100, 50\n")
    assert read_sizes(path).mean == pytest.approx(1e-4 * (8.0 * 1.0 + 2.0) / 9.0)
    path.write_text("diameter [furlong]\n1\n")
    with pytest.raises(ValueError, match=r"line 1: the column 'diameter' is in 'furlong', .*; known: .*um"):
        read_sizes(path)
    path.write_text("diameter [mm]\n1\nx\n")
    with pytest.raises(ValueError, match="line 3: diameter = 'x' is not a number"):
        read_sizes(path)


@pytest.mark.parametrize("head", ["mass [%]", "Volume [%]", "weight (%)", "mass_g", "volume [mm3]", "mass [-]"])
def test_fractions_by_mass_weight_and_volume_are_one(tmp_path, head):
    """Half of the mass each: of 0.2 mm are an eighth of the grains of 0.1 mm, so <d^3> = 2 / (1/d_1^3 + 1/d_2^3)."""
    path, half = tmp_path / "sizes.csv", 0.5 if "-" in head else 50
    path.write_text(f"diameter [um]; {head}\n200; {half}\n100; {half}\n")
    assert read_sizes(path).moment(3) == pytest.approx(2.0 / (200e-6**-3 + 100e-6**-3))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("diameter [um], volume [%]\n60, 5\n90, 25\n120, 75\n180, 100\n", "add up to 205; are they cumulative"),
        ("diameter [um], mass [-]\n60, 0.05\n90, 0.25\n120, 0.75\n180, 1\n", "add up to 205; are they cumulative"),
        ("diameter [um], number\n60, 5\n90, 25\n120, 75\n180, 100\n", "are they cumulative"),
        ("diameter [um], number\n60, 100\n90, 40\n120, 10\n", "descend from 100; .* largest .*divide .*sum, 150"),
        ("diameter [um], number [%]\n60, 40\n90, 50\n", "add up to 90; .* rows missing"),
        ("diameter [um], mass [%]\n60, 40\n90, 58.9\n", "add up to 98.9; are they cumulative, or are rows missing"),
        ("diameter [um], passing [%]\n60, 40\n90, 60\n", "passing beside the diameter; write number"),
        ("diameter [um], fraction [%]\n60, 40\n90, 60\n", "fraction beside the diameter; write number"),
        ("diameter [um], mass\n60, 40\n90, 60\n", "'mass' has no unit; .*%"),
        ("diameter, mass [%]\n60, 40\n90, 60\n", "'diameter' has no unit; .*m"),
        ("diameter [um], mass [mm]\n60, 40\n90, 60\n", "'mass' is in 'mm', which is unknown or of another quantity"),
        ("diameter [um], mass [%], number [%]\n60, 40, 50\n90, 60, 50\n", "by mass and by number; keep one"),
    ],
)
def test_fractions_that_are_not_understood_are_refused(tmp_path, text, words):
    (tmp_path / "sizes.csv").write_text(text)
    with pytest.raises(ValueError, match=words):
        read_sizes(tmp_path / "sizes.csv")


@pytest.mark.parametrize("head", ["number", "number [-]", "Number [1]"])
def test_numbers_of_grains_may_have_any_sum(tmp_path, head):
    """10, 20 and 10 grains of 60, 90 and 120 um have a mean of 90 um and a mean square of 8550 um^2."""
    (tmp_path / "sizes.csv").write_text(f"diameter [um], {head}\n60, 10\n90, 20\n120, 10\n")
    sizes = read_sizes(tmp_path / "sizes.csv")
    assert (sizes.mean, sizes.moment(2)) == pytest.approx((90e-6, 8550e-12))


def test_fractions_that_add_up_to_100_within_1_are_taken(tmp_path):
    (tmp_path / "sizes.csv").write_text("diameter [um], mass [%], passing [%]\n60, 40, 40\n90, 59.1, 99.1\n")
    with pytest.warns(UserWarning, match="not used: passing"):
        assert read_sizes(tmp_path / "sizes.csv").limits == pytest.approx((60e-6, 90e-6))
    (tmp_path / "sizes.csv").write_text("diameter [um], number\n60, 40\n90, 20\n")
    assert read_sizes(tmp_path / "sizes.csv").mean == pytest.approx(70e-6)


@pytest.mark.parametrize(
    "text",
    ["diameter [um];mass [%]\n63;5,5\n90;20,5\n125;74\n", "diameter (µm)\tmass (%)\n63\t5.5\n90\t20.5\n125\t74\n",
     "sep=;\nDiameter;Mass\nµm;%\n63;5,5\n90;20,5\n125;74\n",
     "% sieves\ndiameter / mm;mass / %\n0,063;5,5\n0,090;20,5\n0,125;74\n"],
)  # fmt: skip
def test_a_table_of_sieves_has_any_marks(text, tmp_path):
    """Semicolons, tabs, decimal commas, a row of units: the same mean cube of the diameter, 1/sum(share/d^3)."""
    (tmp_path / "sieves.csv").write_text(text, encoding="utf-8")
    expected = 1.0 / (0.055 / 63e-6**3 + 0.205 / 90e-6**3 + 0.74 / 125e-6**3)
    assert read_sizes(tmp_path / "sieves.csv").moment(3) == pytest.approx(expected)
