"""The law of the grain size: torques of a known law give it back, within intervals that hold it as often as said."""

from dataclasses import replace

import numpy as np
import pytest

from emclutch.results.grain_size_law import Convergence, grain_size_law
from emclutch.results.seed_average import averaged_over_seeds
from emclutch.results.torque_curves import ACROSS, REAL_ACROSS, TorqueCurve, torque_curves

LIMIT, COEFFICIENT, REAL = 12.0, 5.0, 50.0 / 3.0
SIZES = np.array([4.0, 5.0, 8.0, 12.0, 16.0])


def law(n, order=2.0, coefficient=COEFFICIENT):
    return LIMIT * (1.0 + coefficient * np.asarray(n) ** -order)


def curve(n, torque, error):
    n = np.asarray(n, dtype=float)
    return TorqueCurve({}, n, np.asarray(torque), np.broadcast_to(error, n.shape), np.ones(n.size, bool), REAL)


def test_exact_torques_give_the_law_whatever_their_order():
    mixed = np.random.default_rng(4).permutation(SIZES)
    found = grain_size_law(curve(mixed, law(mixed), 0.01))
    assert found.limit.value == pytest.approx(LIMIT) and found.coefficient.value == pytest.approx(COEFFICIENT)
    assert found.real_torque.value == pytest.approx(law(REAL)) and found.order.value == pytest.approx(2.0, rel=3e-3)
    assert found.verdict is Convergence.ASYMPTOTIC and (found.sizes, found.coarsest, found.finest) == (5, 4.0, 16.0)
    assert found.convergence_index == pytest.approx(1.25 * (law(16.0) / law(REAL) - 1.0))
    to_limit = grain_size_law(replace(curve(mixed, law(mixed), 0.01), real_across=None))
    assert to_limit.convergence_index == pytest.approx(1.25 * COEFFICIENT / 16.0**2) and to_limit.real_torque is None
    mean, half = found.torque([4.0, REAL, np.inf])
    assert mean == pytest.approx([law(4.0), law(REAL), LIMIT])
    assert half[1:] == pytest.approx([found.real_torque.high - law(REAL), found.limit.high - LIMIT])


@pytest.mark.parametrize("order", [0.5, 1.0, 3.0])
def test_another_exponent_is_found_and_is_not_asymptotic(order):
    found = grain_size_law(curve(SIZES, law(SIZES, order, 3.0), 0.01))
    assert found.order.value == pytest.approx(order, rel=3e-3) and found.order.low < order < found.order.high
    assert found.verdict is Convergence.NOT_ASYMPTOTIC
    assert found.free_limit.value == pytest.approx(LIMIT, rel=2e-3)
    assert found.free_real_torque.low < law(REAL, order, 3.0) < found.free_real_torque.high
    excess = law(16.0, order, 3.0) / law(REAL, order, 3.0) - 1.0
    assert found.convergence_index == pytest.approx(3.0 * excess, rel=0.02)
    asked = grain_size_law(curve(SIZES, law(SIZES, order, 3.0), 0.01), exponent=order)
    assert asked.limit.value == pytest.approx(LIMIT) and asked.coefficient.value == pytest.approx(3.0)
    assert asked.torque([REAL, np.inf])[0] == pytest.approx([law(REAL, order, 3.0), LIMIT])
    assert asked.verdict is Convergence.ASYMPTOTIC


@pytest.mark.parametrize("packings", [None, 3])
def test_intervals_hold_the_truth_as_often_as_they_promise(packings):
    """95 % of 400 draws, less three deviations; 91 % with errors, and so weights, from three packings a size."""
    rng, draws, held, wide = np.random.default_rng(5), 400, np.zeros(4), 0
    error = 0.02 * law(SIZES)
    for _ in range(draws):
        if packings is None:
            found = grain_size_law(curve(SIZES, law(SIZES) + error * rng.standard_normal(5), error))
        else:
            rows = [
                {"n": n, "seed": seed, ACROSS: n, REAL_ACROSS: REAL, "converged": True,
                 "torque": law(n) + of * rng.standard_normal()}
                for n, of in zip(SIZES, error, strict=True) for seed in range(packings)
            ]  # fmt: skip
            (of_seeds,) = torque_curves(averaged_over_seeds(rows, "seed", ["n"]), ACROSS, [])
            found = grain_size_law(of_seeds)
        truths = (found.limit, LIMIT), (found.real_torque, law(REAL)), (found.coefficient, COEFFICIENT)
        held[:3] += [one.low < truth < one.high for one, truth in truths]
        excluded = found.order is not None and not (found.order.low or 0.0) < 2.0 < (found.order.high or np.inf)
        held[3] += not excluded
        wide += found.limit.high - found.limit.low
    promised = 0.95 if packings is None else 0.91
    assert (held / draws > promised - 3.0 * np.sqrt(promised * (1.0 - promised) / draws)).all(), held / draws
    if packings is None:
        assert (held[:3] / draws < 0.99).all()
        mean = np.average(SIZES**-2, weights=error**-2)
        off = SIZES**-2 - mean
        known = np.sqrt(1.0 / np.sum(error**-2) + mean**2 / np.sum(off**2 / error**2))  # of a weighted line at 0
        assert wide / draws > 2.0 * 1.96 * known * 0.999


def test_three_sizes_check_the_law_and_two_do_not():
    three = grain_size_law(curve([5.0, 10.0, 16.0], law([5.0, 10.0, 16.0]), 0.005))
    assert three.verdict is Convergence.ASYMPTOTIC and three.order.value == pytest.approx(2.0, rel=3e-3)
    two = grain_size_law(curve([5.0, 10.0], law([5.0, 10.0]), 0.005))
    assert two.verdict is Convergence.NOT_CHECKED and two.order is None
    assert two.limit.value == pytest.approx(LIMIT) and "two sizes leave nothing to check" in two.reason
    assert grain_size_law(curve([5.0, 5.0], [14.0, 14.1], 0.1)) is None
    assert grain_size_law(curve([5.0, 10.0], law([5.0, 10.0]), [0.1, np.nan])) is None


def test_noise_that_hides_the_exponent_leaves_it_undecided():
    found = grain_size_law(curve(SIZES, law(SIZES), 2.0))
    assert found.verdict is Convergence.UNDECIDED and found.order.low is None and found.free_limit.low is None
    assert "unbounded" in found.reason


def test_points_that_scatter_beyond_their_errors_widen_the_interval():
    """By the root of chi^2 per degree of freedom, and with Student's quantile of the three."""
    off = 0.5 * np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    narrow, wide = (grain_size_law(curve(SIZES, law(SIZES) + off, error)) for error in (1e-3, 0.01))
    assert narrow.verdict is wide.verdict is Convergence.NOT_ASYMPTOTIC
    assert narrow.limit.high == pytest.approx(wide.limit.high) and narrow.limit.low < LIMIT < narrow.limit.high
    residual = off - np.polyval(np.polyfit(SIZES**-2, off, 1), SIZES**-2)
    cov = np.linalg.inv([[5.0, np.sum(SIZES**-2)], [np.sum(SIZES**-2), np.sum(SIZES**-4)]])
    half = 3.1824 * np.sqrt(residual @ residual / 3.0 * cov[0, 0])  # Student's t of three, 97.5 %
    assert narrow.limit.high - narrow.limit.value == pytest.approx(half, rel=1e-4)


def test_torques_that_are_not_converged_are_counted():
    of = curve(SIZES, law(SIZES), 0.01)
    of.converged[2:4] = False
    found = grain_size_law(of)
    assert found.unconverged == 2 and "not converged, with errors too small: 2" in found.reason
