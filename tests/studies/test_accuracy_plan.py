"""Packings go where they lower the half widths of the knobs' errors most for their time, and stay within the budget."""

import dataclasses
import math

import pytest

from emclutch.results.ladder import Ladder
from emclutch.studies.accuracy.plan import (
    MAX_PACKINGS,
    OWN,
    Aim,
    OfferedKnob,
    OfferedRung,
    Torques,
    first_packings,
    left_out,
    makespan,
    more_packings,
    packings_for,
)

OWN_RUNG = OfferedRung(20.0, 1 / 20, 10.0, 1.0)


def knob(name, *seconds, order=2.0, variance=1.0):
    """A knob whose rungs, of a half, a third, ... of the own step size's inverse, take these seconds."""
    rungs = tuple(OfferedRung(20.0 / (n + 2), (n + 2) / 20.0, one, variance) for n, one in enumerate(seconds))
    return OfferedKnob(name, order, 0.0, OWN_RUNG, rungs)


def seconds_of(knobs, packings, base=10.0):
    seconds = {(one.name, rung.setting): rung.seconds for one in knobs for rung in one.rungs} | {OWN: base}
    return [seconds[one] for one in packings]


def measured(knobs, packings, torque=lambda name, h: 1.0, scatter=0.02):
    """Counts and torques after some packings: four of the scene's own, one of each other."""
    count = {OWN: 4} | {one: packings.count(one) for one in packings}
    h = {(one.name, rung.setting): rung.step_size for one in knobs for rung in one.rungs} | {OWN: OWN_RUNG.step_size}
    return count, Torques({one: torque(one[0], h[one]) for one in count}, scatter, 3.0)


def test_every_knob_that_can_be_paid_gets_a_packing_and_the_dearest_are_left_out():
    knobs = [knob("dear", 400.0), knob("cheap", 5.0, 5.0), knob("usual", 10.0, 12.0), knob("endless", 1e6)]
    found = first_packings(knobs, 4, 300.0, 2)
    assert sorted(name for name, _ in found) == ["cheap", "usual"]
    assert left_out(knobs, found) == {"dear": 400.0, "endless": 1e6}
    assert seconds_of(knobs, found) == sorted(seconds_of(knobs, found), reverse=True)


@pytest.mark.parametrize("room", [0.0, 20.0, 75.0, 200.0])
@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_the_budget_is_kept(room, jobs):
    knobs = [knob("a", 7.0, 9.0), knob("b", 31.0, 17.0, variance=0.5), knob("c", 60.0)]
    first = first_packings(knobs, 4, room, jobs)
    assert makespan(seconds_of(knobs, first), jobs) <= room
    given = measured(knobs, first)
    more = more_packings(knobs, *given, 10.0, room, jobs, [Aim()])
    assert makespan(seconds_of(knobs, more), jobs) <= room
    assert more_packings(knobs, *given, 10.0, room, jobs, [Aim()]) == more
    if room == 200.0:
        assert not left_out(knobs, [*first, *more])


def test_dearer_rungs_get_fewer_packings_and_more_of_them_lower_the_half_width():
    knobs = [knob("dear", 40.0), knob("cheap", 10.0)]
    first = first_packings(knobs, 4, 500.0, 2)
    count, found = measured(knobs, first)
    more = more_packings(knobs, count, found, 10.0, 500.0, 2, [Aim()])
    names = [name for name, _ in more]
    assert names.count("dear") < names.count("cheap")
    more_of = count | {one: more.count(one) + count.get(one, 0) for one in more}
    assert half_width(knobs, found, more_of) < 0.7 * half_width(knobs, found, count)


def half_width(knobs, found, counts, step_sizes=None):
    """Of the error of all knobs at some step sizes, default their own, if the torques do not change."""
    torques = {one: found.means.get(one, 1.0) for one in counts}
    ladders = tuple(one.ladder(torques, counts, found.scatter, found.freedom) for one in knobs)
    whole = Ladder("abc", "case", {}, 1.0, found.scatter, found.freedom, None, counts[OWN], 10.0, ladders)
    return whole.total(step_sizes or {one.name: one.own.step_size for one in knobs}).half_width


def test_a_large_error_gets_a_third_setting_and_small_ones_more_packings():
    """ln T = 25 h^2 of one knob: its order is known only from three settings on."""
    knobs = [knob("large", 40.0, 40.0), knob("small", 40.0, 40.0)]
    first = first_packings(knobs, 4, 100.0, 2)
    assert len(first) == 2
    given = measured(knobs, first, lambda name, h: math.exp(25.0 * h**2) if name != "small" else math.exp(25.0 / 400.0))
    more = more_packings(knobs, *given, 10.0, 45.0, 1, [Aim()])
    third = next(one for one in more if one[0] == "large")
    assert third not in first and all(name != "small" for name, _ in more)


def test_packings_go_to_the_errors_of_the_settings_that_are_asked_for():
    """At the own settings b has the wider error; those that are asked for have none of it, and 16 times that of a."""
    knobs = [knob("a", 10.0, variance=0.25), knob("b", 10.0, order=0.5)]
    count, found = measured(knobs, first_packings(knobs, 4, 100.0, 1))
    aim = {"a": 4 / 20, "b": 1e-9}

    def reached(packings):
        counts = count | {one: packings.count(one) + count.get(one, 0) for one in packings}
        return half_width(knobs, found, counts, aim)

    without, asked = (more_packings(knobs, count, found, 10.0, 60.0, 1, [Aim(), *one]) for one in ((), [Aim(aim)]))
    assert len(without) == len(asked) and reached(asked) < reached(without)


def test_a_setting_is_ranked_by_the_error_of_two_means_and_its_time():
    """b = c h^p with c from the difference of two means: |x_own/(x - x_own)| sqrt(1/4 + variance) sqrt(seconds)."""
    near, far = OfferedRung(10.0, 2 / 20, 10.0, 1.0), OfferedRung(5.0, 4 / 20, 10.0 * 26.0, 1.0)
    cheap = OfferedRung(5.0, 4 / 20, 10.0 * 24.0, 1.0)
    assert [one[1] for one in OfferedKnob("a", 2.0, 0.0, OWN_RUNG, (near, far)).ranked(4)] == [10.0, 5.0]
    assert [one[1] for one in OfferedKnob("a", 2.0, 0.0, OWN_RUNG, (near, cheap)).ranked(4)] == [5.0, 10.0]


def test_an_ample_budget_ends_at_the_largest_number_of_packings():
    knobs = [knob("a", 1.0)]
    count, found = measured(knobs, first_packings(knobs, 4, 1e6, 1))
    more = more_packings(knobs, count, found, 1.0, 1e6, 1, [Aim()])
    assert more.count(OWN) == MAX_PACKINGS - 4 and more.count(("a", 10.0)) == MAX_PACKINGS - 1


def test_without_a_knob_nothing_is_run():
    knobs = [knob("a")]
    assert (
        first_packings(knobs, 4, 100.0, 1)
        == ()
        == more_packings(knobs, {OWN: 4}, Torques({OWN: 1.0}, 0.1, 3.0), 10.0, 100.0, 1, [Aim()])
    )


def test_packings_for_a_difference():
    """1.96 s sqrt(2/n) = difference."""
    assert packings_for(0.05, 0.08) == math.ceil(2 * (1.96 * 0.08 / 0.05) ** 2) == 20
    assert packings_for(1.0, 0.01) == 1


@pytest.mark.parametrize("is_large", [False, True])
def test_a_scene_at_the_limit_of_a_setting_is_planned(is_large):
    """Without another value of that setting its law has no unit: it was a division by zero."""
    at_limit = dataclasses.replace(knob("b", 10.0, 12.0), limit=OWN_RUNG.step_size, is_large=is_large)
    count, found = measured([knob("a", 10.0, 12.0)], [("a", 10.0)])
    more = more_packings([knob("a", 10.0, 12.0), at_limit], count, found, 10.0, 200.0, 1, [Aim()])
    assert more and set(more) <= {OWN, ("a", 10.0), ("a", 20.0 / 3.0), ("b", 10.0), ("b", 20.0 / 3.0)}


def test_torques_of_different_signs_are_no_use_and_alike_ones_need_no_other():
    knobs = [knob("a", 10.0, 12.0), knob("b", 10.0, 12.0)]
    count, found = measured(knobs, [("a", 10.0), ("b", 10.0)])
    opposite = dataclasses.replace(found, means=found.means | {("a", 10.0): -1.0})
    assert "a" not in {name for name, _ in more_packings(knobs, count, opposite, 10.0, 200.0, 1, [Aim()])}
    assert len(more_packings(knobs, count, dataclasses.replace(found, scatter=0.0), 10.0, 200.0, 1, [Aim()])) < 8
