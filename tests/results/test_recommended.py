"""The cheapest combination of a ladder's settings that reaches a target, by comparison with a search of them all."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from emclutch.results.ladder import Basis, KnobLadder, Ladder, Rung
from emclutch.results.recommended import (
    PACKINGS,
    Combinations,
    Obstacle,
    choice_with,
    own_choice,
    reaching,
    recommended,
    statistical_half_width,
)
from emclutch.results.replicated_mean import replicated_mean
from emclutch.simulation.stopping_rule import COUNTS

SCATTER = 0.03


def noisy(name, settings, values, costs, *, grains=None, order=2.0):
    """A knob measured by torques; `grains` over those at the own, first, setting."""
    grains = grains or [1.0] * len(settings)
    rungs = tuple(
        Rung(s, 1.0 / s, v, SCATTER / math.sqrt(g * 4), 4, 10.0 * c, c)
        for s, v, c, g in zip(settings, values, costs, grains, strict=True)
    )
    return KnobLadder(name, f"key.{name}", Basis.TORQUE, settings[0], order, 0.0, rungs, 20.0)


def standing(name, settings, values, costs):
    rungs = tuple(Rung(s, s, v, 0.0, 1, 0.5, c) for s, v, c in zip(settings, values, costs, strict=True))
    return KnobLadder(name, f"key.{name}", Basis.MOMENTS, settings[1], None, 0.0, rungs)


def start_up():
    """Of an average that may begin at any time."""
    rungs = tuple(Rung(s, 1.0 / s, 1.1, 0.0, 4, 10.0, s / 9.0) for s in (9.0, 13.5))
    return KnobLadder("start_up", "time.average_from", Basis.LATER, 9.0, None, 0.0, rungs)


def ladder(**unknown):
    knobs = (
        start_up(),
        standing("mesh", (2.0, 1.0, 0.5, 0.25), (1.08, 1.02, 1.005, 1.00125), (0.9, 1.0, 1.2, 2.0)),
        noisy("grains", (4.0, 6.0, 8.0), (1.1, 1.045, 1.025), (1.0, 3.3, 8.0), grains=(1.0, 2.25, 4.0)),
        noisy("step", (10.0, 20.0, 40.0), (1.1, 1.101, 1.1), (1.0, 2.0, 4.0)),
    )
    return Ladder("abc", "case", {}, 1.1, SCATTER, 20.0, 9.0, 4, 10.0, knobs, unknown)


def by_search(whole, target):
    """Processor time of the cheapest of all combinations [s], with the error of `Ladder.total`."""
    best = math.inf
    for rungs in itertools.product(*(one.rungs for one in whole.knobs)):
        total = whole.total({k.knob: r.step_size for k, r in zip(whole.knobs, rungs, strict=True)})
        scatter = math.prod(r.error * math.sqrt(r.packings) / SCATTER for r in rungs if r.error) * SCATTER
        for n in PACKINGS:
            if math.hypot(statistical_half_width(whole, scatter, n), total.half_width) <= target:
                best = min(best, 10.0 * n * math.prod(r.cost for r in rungs))
    return best


@pytest.mark.parametrize("target", [0.12, 0.08, 0.06, 0.05])
def test_the_first_choice_is_the_cheapest_that_reaches_the_target(target):
    found = list(reaching(ladder(), target))
    assert recommended(ladder(), target) == found[0]
    assert found[0].seconds == pytest.approx(by_search(ladder(), target))
    assert all(one.half_width <= target for one in found)
    assert [one.seconds for one in found] == sorted(one.seconds for one in found)


@pytest.mark.parametrize("packings", [4, 12])
def test_where_the_start_up_is_not_known_more_packings_are_needed_to_exclude_a_drift(packings):
    """The rule would end a run of so many packings with half the scatter, if all of it is within packings."""
    without = replace(ladder(), knobs=ladder().knobs[1:])
    half = own_choice(without, packings).statistical
    assert half > 1.4 * own_choice(ladder(), packings).statistical
    rng = np.random.default_rng(packings)
    length, windows = 1.0, 40
    dt = np.full(windows, length / windows)
    ended = []
    for _ in range(200):
        noise = SCATTER * math.sqrt(windows) * rng.standard_normal((packings, windows))
        found = replicated_mean(
            [(np.cumsum(dt), 1.0 + one, dt) for one in noise], average_from=0.0, wanted=lambda mean: half
        )
        ended.append(found.converged)
    assert 0.3 < np.mean(ended) < 0.9


def test_a_choice_has_the_error_of_its_settings():
    whole = ladder()
    choice = recommended(whole, 0.06)
    assert choice.total == whole.total({
        one.knob: next(r.step_size for r in one.rungs if r.setting == choice.settings[one.knob]) for one in whole.knobs
    })  # fmt: skip
    assert choice.half_width == pytest.approx(math.hypot(choice.statistical, choice.total.half_width))
    assert choice.figure_of_merit == pytest.approx((1.96 / choice.half_width) ** 2 / choice.seconds, rel=1e-3)
    assert choice.parts[choice.largest] == max(choice.parts.values())


def test_more_grains_scatter_less():
    whole = ladder()
    grains = whole.knob("grains")
    finest = choice_with(whole, grains, grains.rungs[-1], 8)
    assert finest.statistical == pytest.approx(0.5 * own_choice(whole, 8).statistical)
    assert finest.seconds == pytest.approx(8.0 * own_choice(whole, 8).seconds)


def test_what_is_not_reached_names_its_limit_and_by_noise_a_time_that_falls_with_the_square():
    best = Combinations(ladder()).nearest()
    lasting = math.sqrt(best.half_width**2 - best.total.noise**2)
    targets = [lasting + share * (best.half_width - lasting) for share in (0.2, 0.6)]
    longer, shorter = (recommended(ladder(), target) for target in targets)
    assert longer.knob == best.largest and longer.half_width == best.parts[longer.knob]
    ratio = (targets[1] ** 2 - lasting**2) / (targets[0] ** 2 - lasting**2)
    assert longer.seconds == pytest.approx(ratio * shorter.seconds)
    beyond = recommended(ladder(), 0.9 * lasting)
    assert beyond.seconds is None and beyond.knob == "grains"  # the order of which stays unknown


def test_where_the_law_is_what_is_not_known_a_longer_study_measures_a_finer_setting():
    """(F - 1) |b| is not noise: what is advised is the time so far, and two packings of a setting that had no time."""
    large = noisy("grains", (4.0, 6.0), (1.6, 1.2), (1.0, 3.0))
    finer = Rung(9.0, 1.0 / 9.0, None, 0.0, 0, 80.0, 8.0)
    known, left = (
        Ladder("abc", "case", {}, 1.6, SCATTER, 20.0, None, 4, 10.0, (replace(large, rungs=rungs),))
        for rungs in (large.rungs, (*large.rungs, finer))
    )
    assert recommended(known, 0.02).seconds is None
    spent = 4 * 10.0 + 4 * 30.0
    found, closer = recommended(left, 0.05), recommended(left, 0.005)
    assert found.seconds == pytest.approx(spent + 2 * 80.0) and "more than" in found.in_words()
    assert closer.seconds == pytest.approx(spent * (closer.best.total.noise / 0.005) ** 2)  # the noise must fall too


def test_a_knob_that_was_not_measured_is_in_the_way():
    found = recommended(ladder(sector="not measured in this budget: about 7 min more"), 0.2)
    assert isinstance(found, Obstacle)
    assert (found.knob, found.half_width) == ("sector", None)
    assert "7 min" in found.reason


def test_no_cheaper_combination_is_as_accurate_as_one_on_the_frontier():
    seconds, half = Combinations(ladder()).frontier()
    assert (seconds[1:] > seconds[:-1]).all()
    assert (half[1:] < half[:-1]).all()
    for target in (0.1, 0.06):
        assert seconds[half <= target][0] == pytest.approx(by_search(ladder(), target))


def test_many_knobs_are_combined_within_bounds():
    """Settings that others beat go first, then some of each knob; the scene's own and the finest remain."""
    knobs = tuple(
        noisy(f"knob{n}", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (1.0,) * 6, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)) for n in range(12)
    )
    whole = Ladder("abc", "case", {}, 1.0, SCATTER, 20.0, None, 4, 10.0, knobs)
    found = Combinations(whole)
    assert 2 <= len(found.cost) <= 1_000_000
    assert found.cost.min() == 1.0


def test_packings_are_those_that_a_run_looks_at():
    first = COUNTS.index(PACKINGS[0])
    assert COUNTS[first : first + len(PACKINGS)] == PACKINGS
