"""Band of the brake: percentiles and shares of known surfaces are found again."""

import math

import numpy as np
import pytest
from brake_band import FrictionLines, Prediction, Ranges, band_over_current, fit_surface, sentence
from dry_brakes import RATED

from emclutch.results.torque_curves import TorqueCurve
from particles.bulk_friction.friction_table import measured_table

pytestmark = pytest.mark.physics
RANGES = Ranges(fill=(0.015, 0.025), repose=(28.0, 34.0), coefficient=(2.0, 2.0, 2.0), exponent=1.0)
LINES = FrictionLines(measured_table(), RANGES.friction)


def points(law, noise=0.0):
    """Thirty runs over the joint range at two currents, some coarser than others: columns of a table of points."""
    rng = np.random.default_rng(7)
    friction, place, current = rng.uniform(0.3, 0.8, 30), rng.uniform(0.1, 1.0, 30), np.repeat([RATED, 0.4], [24, 6])
    table = measured_table()
    found = {"friction": friction, "rolling_friction": place, "fill": rng.uniform(0.014, 0.026, 30),
             "across": np.repeat([5.0, 8.0], 15), "current": current}  # fmt: skip
    bulk = np.array([table.bulk_friction(*pair)[0] for pair in zip(friction, place, strict=True)])
    size = (1.0 + 2.0 / found["across"]) / (1.0 + 2.0 / RANGES.across)
    torque = law(bulk, found["fill"], current) * size * np.exp(noise * rng.standard_normal(30))
    return found | {"torque": torque, "standard_error": noise * torque}


def predicted(of, current=RATED, ranges=RANGES):
    return Prediction(fit_surface(of, ranges), ranges, LINES, current, of["across"])


def power(bulk, fill, current):
    return 12.0 * (bulk / bulk) * (fill / 0.02) ** 2 * (current / RATED) ** 1.4


def test_the_fill_alone_decides_where_the_law_says_so():
    """T = 12 N m (fill/20 g)^2 (I/I_r)^1.4 at real size, fill uniform: its percentiles are those of the fill."""
    of = points(power)
    for current in (RATED, 0.4):
        found = predicted(of, current)
        fill = 0.015 + 0.01 * np.array([0.05, 0.5, 0.95])
        assert found.band() == pytest.approx(power(1.0, fill, current), rel=0.01)
    shares = predicted(of).shares()
    assert shares == pytest.approx([0.0, 0.0, 1.0, 0.0, 0.0], abs=0.02)
    said = sentence(np.array([7.2, 12.0, 18.4]), shares, RATED)
    assert said.startswith("the torque at 0.94 A is 12 N m, between 7.2 and 18.4") and said.count("%") == 1


def test_two_inputs_share_the_variance_as_their_own_variances_say():
    """T = f(angle) g(fill): f's share is var(f) E[g]^2 over var(f g); at one angle T does not depend on the pair."""

    def law(bulk, fill, current):
        return 12.0 * np.exp(4.0 * (bulk - 0.5)) * fill / 0.02 * (current / RATED) ** 1.4

    found = predicted(points(law))
    angle = np.radians(np.linspace(28.0, 34.0, 4001))
    f, g = np.exp(4.0 * (np.sin(angle) - 0.5)), np.linspace(0.75, 1.25, 4001)
    whole = np.mean(f**2) * np.mean(g**2) - (np.mean(f) * np.mean(g)) ** 2
    shares = [np.var(f) * np.mean(g) ** 2 / whole, 0.0, np.var(g) * np.mean(f) ** 2 / whole, 0.0, 0.0]
    assert found.shares() == pytest.approx(shares, abs=0.03)
    product = np.quantile(12.0 * np.outer(f[::40], g[::40]), [0.05, 0.5, 0.95])
    assert found.band() == pytest.approx(product, rel=0.01)


def test_the_error_of_the_grain_size_is_that_of_its_law():
    """With a between 1 and 3 the torque of points at 5 and 8 across moves to real size by the law's factor."""
    of = points(lambda bulk, fill, current: 12.0 * (bulk / bulk) * (current / RATED) ** 1.4)
    ranges = Ranges(fill=RANGES.fill, repose=RANGES.repose, coefficient=(2.0, 1.0, 3.0), exponent=1.0)
    low, middle, high = predicted(of, ranges=ranges).band()

    def torque(a):  # of the points at real size, by their geometric mean
        return 12.0 * math.exp(np.mean(ranges.size_factor(of["across"], a) - ranges.size_factor(of["across"], 2.0)))

    spread = 1.645 / 1.96
    assert (low, middle, high) == pytest.approx((torque(2.0 + spread), 12.0, torque(2.0 - spread)), rel=0.01)
    assert predicted(of, ranges=ranges).shares()[3] == pytest.approx(1.0, abs=0.02)


def test_leaving_one_out_says_the_error_of_points_with_noise():
    of = points(power, noise=0.03)
    surface = fit_surface(of, RANGES)
    assert 0.02 < surface.left_out < 0.045 and surface.noise == pytest.approx(0.03)
    assert len(surface.terms) < 8 and "leaving one out" in surface.in_words()


def test_pairs_on_a_line_have_its_angle_and_the_asked_for_friction():
    rng, table = np.random.default_rng(3), measured_table()
    bulk, place = np.sin(np.radians(rng.uniform(28.0, 36.5, 40))), rng.uniform(0.0, 1.0, 40)
    friction, rolling = LINES.pairs(bulk, place)
    assert (friction >= 0.3).all() and (friction <= 0.8).all()
    of_pairs = [table.bulk_friction(*pair)[0] for pair in zip(friction, rolling, strict=True)]
    assert of_pairs == pytest.approx(bulk, abs=2e-3)


def test_a_torque_curve_is_scaled_to_the_bands_at_their_currents():
    x = np.array([0.2, 0.4, 0.94, 1.2])
    curve = TorqueCurve({}, x, 15.0 * x**1.2, np.full(4, np.nan), np.ones(4, bool))
    bands = {0.4: np.array([3.0, 4.0, 5.0]), RATED: np.array([9.0, 12.0, 18.0])}
    current, *found = band_over_current(bands, curve).T
    assert current.tolist() == x.tolist()
    for one, at in ((1, 0.4), (2, RATED)):
        assert [column[one] for column in found] == pytest.approx(bands[at])
    assert [column[0] / column[1] for column in found] == pytest.approx([0.5**1.2] * 3)  # the curve's shape
    assert [column[3] / column[2] for column in found] == pytest.approx([(1.2 / RATED) ** 1.2] * 3)
