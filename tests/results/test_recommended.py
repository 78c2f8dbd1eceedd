"""The cheapest combination of a study's settings that reaches a target, by comparison with a search of them all."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, MeasuredValue
from emclutch.results.recommended import (
    REPLICAS,
    Combinations,
    LimitingError,
    choice_with,
    own_choice,
    reaching,
    recommended,
    statistical_half_width,
)
from emclutch.results.replicated_mean import replicated_mean
from emclutch.simulation.stopping_rule import COUNTS

SCATTER = 0.03


def noisy(name, values, torques, costs, *, grains=None, order=2.0):
    """A setting measured by torques; `grains` over those at the own, first, value."""
    grains = grains or [1.0] * len(values)
    measured = tuple(
        MeasuredValue(s, 1.0 / s, v, SCATTER / math.sqrt(g * 4), 4, 10.0 * c, c)
        for s, v, c, g in zip(values, torques, costs, grains, strict=True)
    )
    return MeasuredSetting(name, f"key.{name}", Basis.TORQUE, values[0], order, 0.0, measured, 20.0)


def frozen(name, values, torques, costs):
    measured = tuple(MeasuredValue(s, s, v, 0.0, 1, 0.5, c) for s, v, c in zip(values, torques, costs, strict=True))
    return MeasuredSetting(name, f"key.{name}", Basis.MOMENTS, values[1], None, 0.0, measured)


def start_up():
    """Of an average that may begin at any time."""
    measured = tuple(MeasuredValue(s, 1.0 / s, 1.1, 0.0, 4, 10.0, s / 9.0) for s in (9.0, 13.5))
    return MeasuredSetting("start_up", "time.average_from", Basis.START_UP, 9.0, None, 0.0, measured)


def study(**unknown):
    settings = (
        start_up(),
        frozen("mesh", (2.0, 1.0, 0.5, 0.25), (1.08, 1.02, 1.005, 1.00125), (0.9, 1.0, 1.2, 2.0)),
        noisy("grains", (4.0, 6.0, 8.0), (1.1, 1.045, 1.025), (1.0, 3.3, 8.0), grains=(1.0, 2.25, 4.0)),
        noisy("step", (10.0, 20.0, 40.0), (1.1, 1.101, 1.1), (1.0, 2.0, 4.0)),
    )
    return AccuracyStudy("abc", "case", {}, 1.1, SCATTER, 20.0, 9.0, 4, 10.0, settings, unknown)


def by_search(whole, target):
    """Processor time of the cheapest of all combinations [s], with the error of `AccuracyStudy.total`."""
    best = math.inf
    for measured in itertools.product(*(one.values for one in whole.settings)):
        total = whole.total({k.name: r.step_size for k, r in zip(whole.settings, measured, strict=True)})
        scatter = math.prod(r.error * math.sqrt(r.replicas) / SCATTER for r in measured if r.error) * SCATTER
        for n in REPLICAS:
            if math.hypot(statistical_half_width(whole, scatter, n), total.half_width) <= target:
                best = min(best, 10.0 * n * math.prod(r.cost for r in measured))
    return best


@pytest.mark.parametrize("target", [0.12, 0.08, 0.06, 0.05])
def test_the_first_choice_is_the_cheapest_that_reaches_the_target(target):
    found = list(reaching(study(), target))
    assert recommended(study(), target) == found[0]
    assert found[0].seconds == pytest.approx(by_search(study(), target))
    assert all(one.half_width <= target for one in found)
    assert [one.seconds for one in found] == sorted(one.seconds for one in found)


@pytest.mark.parametrize("replicas", [4, 12])
def test_where_the_start_up_is_not_known_more_replicas_are_needed_to_exclude_a_drift(replicas):
    """The rule would end a run of so many replicas with half the scatter, if all of it is within replicas."""
    without = replace(study(), settings=study().settings[1:])
    half = own_choice(without, replicas).statistical
    assert half > 1.4 * own_choice(study(), replicas).statistical
    rng = np.random.default_rng(replicas)
    length, windows = 1.0, 40
    dt = np.full(windows, length / windows)
    ended = []
    for _ in range(200):
        noise = SCATTER * math.sqrt(windows) * rng.standard_normal((replicas, windows))
        found = replicated_mean(
            [(np.cumsum(dt), 1.0 + one, dt) for one in noise], average_from=0.0, wanted=lambda mean: half
        )
        ended.append(found.converged)
    assert 0.3 < np.mean(ended) < 0.9


def test_a_choice_has_the_error_of_its_settings():
    whole = study()
    choice = recommended(whole, 0.06)
    assert choice.total == whole.total({
        one.name: next(r.step_size for r in one.values if r.value == choice.values[one.name]) for one in whole.settings
    })  # fmt: skip
    assert choice.half_width == pytest.approx(math.hypot(choice.statistical, choice.total.half_width))
    assert choice.figure_of_merit == pytest.approx((1.96 / choice.half_width) ** 2 / choice.seconds, rel=1e-3)
    assert choice.parts[choice.largest] == max(choice.parts.values())


def test_more_grains_scatter_less():
    whole = study()
    grains = whole.setting("grains")
    finest = choice_with(whole, grains, grains.values[-1], 8)
    assert finest.statistical == pytest.approx(0.5 * own_choice(whole, 8).statistical)
    assert finest.seconds == pytest.approx(8.0 * own_choice(whole, 8).seconds)


def test_what_is_not_reached_names_its_limit_and_by_noise_a_time_that_falls_with_the_square():
    best = Combinations(study()).nearest()
    lasting = math.sqrt(best.half_width**2 - best.total.noise**2)
    targets = [lasting + share * (best.half_width - lasting) for share in (0.2, 0.6)]
    longer, shorter = (recommended(study(), target) for target in targets)
    assert longer.setting == best.largest and longer.half_width == best.parts[longer.setting]
    ratio = (targets[1] ** 2 - lasting**2) / (targets[0] ** 2 - lasting**2)
    assert longer.seconds == pytest.approx(ratio * shorter.seconds)
    beyond = recommended(study(), 0.9 * lasting)
    assert beyond.seconds is None and beyond.setting == "grains"  # the order of which stays unknown


def test_where_the_law_is_what_is_not_known_a_longer_study_measures_a_finer_setting():
    """(F - 1) |b| is not noise: what is advised is the time so far, and two replicas at a value that had no time."""
    large = noisy("grains", (4.0, 6.0), (1.6, 1.2), (1.0, 3.0))
    finer = MeasuredValue(9.0, 1.0 / 9.0, None, 0.0, 0, 80.0, 8.0)
    known, left = (
        AccuracyStudy("abc", "case", {}, 1.6, SCATTER, 20.0, None, 4, 10.0, (replace(large, values=measured),))
        for measured in (large.values, (*large.values, finer))
    )
    assert recommended(known, 0.02).seconds is None
    spent = 4 * 10.0 + 4 * 30.0
    found, closer = recommended(left, 0.05), recommended(left, 0.005)
    assert found.seconds == pytest.approx(spent + 2 * 80.0) and "at least" in found.in_words()
    assert found.finer == 9.0 and "with grains 9 takes at least" in found.in_words()
    least = closer.best.total.noise * math.sqrt(spent / found.seconds)
    assert recommended(left, 1.01 * least).seconds == found.seconds < recommended(left, 0.99 * least).seconds
    assert closer.seconds == pytest.approx(spent * (closer.best.total.noise / 0.005) ** 2)  # the noise must fall too


def test_a_setting_that_was_not_measured_is_the_limit():
    found = recommended(study(sector="not measured in this budget: about 7 min more"), 0.2)
    assert isinstance(found, LimitingError)
    assert (found.setting, found.half_width) == ("sector", None)
    assert "7 min" in found.reason


def test_no_cheaper_combination_is_as_accurate_as_one_on_the_frontier():
    seconds, half = Combinations(study()).frontier()
    assert (seconds[1:] > seconds[:-1]).all()
    assert (half[1:] < half[:-1]).all()
    for target in (0.1, 0.06):
        assert seconds[half <= target][0] == pytest.approx(by_search(study(), target))


def test_many_settings_are_combined_within_bounds():
    """Dominated values go first, then some of each setting; the scene's own and the finest remain."""
    settings = tuple(
        noisy(f"setting {n}", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (1.0,) * 6, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
        for n in range(12)
    )
    whole = AccuracyStudy("abc", "case", {}, 1.0, SCATTER, 20.0, None, 4, 10.0, settings)
    found = Combinations(whole)
    assert 2 <= len(found.cost) <= 1_000_000
    assert found.cost.min() == 1.0


def test_numbers_of_replicas_are_those_that_a_run_looks_at():
    first = COUNTS.index(REPLICAS[0])
    assert COUNTS[first : first + len(REPLICAS)] == REPLICAS
