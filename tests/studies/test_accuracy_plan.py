"""Replicas go where they lower the half widths of the errors most for their time, and stay within the budget."""

import dataclasses
import math

import pytest

from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.studies.accuracy.plan import (
    MAX_REPLICAS,
    OWN,
    Aim,
    OfferedSetting,
    OfferedValue,
    Torques,
    first_replicas,
    left_out,
    makespan,
    more_replicas,
    replicas_for,
)

OWN_VALUE = OfferedValue(20.0, 1 / 20, 10.0, 1.0)


def offer(name, *seconds, order=2.0, variance=1.0):
    """A setting whose values, of a half, a third, ... of the own step size's inverse, take these seconds."""
    values = tuple(OfferedValue(20.0 / (n + 2), (n + 2) / 20.0, one, variance) for n, one in enumerate(seconds))
    return OfferedSetting(name, order, 0.0, OWN_VALUE, values)


def seconds_of(settings, replicas, base=10.0):
    seconds = {(one.name, v.value): v.seconds for one in settings for v in one.values} | {OWN: base}
    return [seconds[one] for one in replicas]


def measured(settings, replicas, torque=lambda name, h: 1.0, scatter=0.02):
    """Counts and torques after some replicas: four of the scene's own, one of each other."""
    count = {OWN: 4} | {one: replicas.count(one) for one in replicas}
    h = {(one.name, v.value): v.step_size for one in settings for v in one.values} | {OWN: OWN_VALUE.step_size}
    return count, Torques({one: torque(one[0], h[one]) for one in count}, scatter, 3.0)


def test_every_setting_that_can_be_paid_gets_a_replica_and_the_dearest_are_left_out():
    settings = [offer("dear", 400.0), offer("cheap", 5.0, 5.0), offer("usual", 10.0, 12.0), offer("endless", 1e6)]
    found = first_replicas(settings, 4, 300.0, 2)
    assert sorted(name for name, _ in found) == ["cheap", "usual"]
    assert left_out(settings, found) == {"dear": 400.0, "endless": 1e6}
    assert seconds_of(settings, found) == sorted(seconds_of(settings, found), reverse=True)


@pytest.mark.parametrize("room", [0.0, 20.0, 75.0, 200.0])
@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_the_budget_is_kept(room, jobs):
    settings = [offer("a", 7.0, 9.0), offer("b", 31.0, 17.0, variance=0.5), offer("c", 60.0)]
    first = first_replicas(settings, 4, room, jobs)
    assert makespan(seconds_of(settings, first), jobs) <= room
    given = measured(settings, first)
    more = more_replicas(settings, *given, 10.0, room, jobs, [Aim()])
    assert makespan(seconds_of(settings, more), jobs) <= room
    assert more_replicas(settings, *given, 10.0, room, jobs, [Aim()]) == more
    if room == 200.0:
        assert not left_out(settings, [*first, *more])


def test_dearer_values_get_fewer_replicas_and_more_of_them_lower_the_half_width():
    settings = [offer("dear", 40.0), offer("cheap", 10.0)]
    first = first_replicas(settings, 4, 500.0, 2)
    count, found = measured(settings, first)
    more = more_replicas(settings, count, found, 10.0, 500.0, 2, [Aim()])
    names = [name for name, _ in more]
    assert names.count("dear") < names.count("cheap")
    more_of = count | {one: more.count(one) + count.get(one, 0) for one in more}
    assert half_width(settings, found, more_of) < 0.7 * half_width(settings, found, count)


def half_width(settings, found, counts, step_sizes=None):
    """Of the error of all settings at some step sizes, default their own, if the torques do not change."""
    torques = {one: found.means.get(one, 1.0) for one in counts}
    some = tuple(one.measured(torques, counts, found.scatter, found.freedom) for one in settings)
    whole = AccuracyStudy("abc", "case", {}, 1.0, found.scatter, found.freedom, None, counts[OWN], 10.0, some)
    return whole.total(step_sizes or {one.name: one.own.step_size for one in settings}).half_width


def test_a_large_error_gets_a_third_value_and_small_ones_more_replicas():
    """ln T = 25 h^2 of one setting: its order is known only from three values on."""
    settings = [offer("large", 40.0, 40.0), offer("small", 40.0, 40.0)]
    first = first_replicas(settings, 4, 100.0, 2)
    assert len(first) == 2
    given = measured(
        settings, first, lambda name, h: math.exp(25.0 * h**2) if name != "small" else math.exp(25.0 / 400.0)
    )
    more = more_replicas(settings, *given, 10.0, 45.0, 1, [Aim()])
    third = next(one for one in more if one[0] == "large")
    assert third not in first and all(name != "small" for name, _ in more)


def test_replicas_go_to_the_errors_of_the_settings_that_are_asked_for():
    """At the own settings b has the wider error; those that are asked for have none of it, and 16 times that of a."""
    settings = [offer("a", 10.0, variance=0.25), offer("b", 10.0, order=0.5)]
    count, found = measured(settings, first_replicas(settings, 4, 100.0, 1))
    aim = {"a": 4 / 20, "b": 1e-9}

    def reached(replicas):
        counts = count | {one: replicas.count(one) + count.get(one, 0) for one in replicas}
        return half_width(settings, found, counts, aim)

    without, asked = (more_replicas(settings, count, found, 10.0, 60.0, 1, [Aim(), *one]) for one in ((), [Aim(aim)]))
    assert len(without) == len(asked) and reached(asked) < reached(without)


def test_a_value_is_ranked_by_the_error_of_two_means_and_its_time():
    """b = c h^p with c from the difference of two means: |x_own/(x - x_own)| sqrt(1/4 + variance) sqrt(seconds)."""
    near, far = OfferedValue(10.0, 2 / 20, 10.0, 1.0), OfferedValue(5.0, 4 / 20, 10.0 * 26.0, 1.0)
    cheap = OfferedValue(5.0, 4 / 20, 10.0 * 24.0, 1.0)
    assert [one[1] for one in OfferedSetting("a", 2.0, 0.0, OWN_VALUE, (near, far)).ranked(4)] == [10.0, 5.0]
    assert [one[1] for one in OfferedSetting("a", 2.0, 0.0, OWN_VALUE, (near, cheap)).ranked(4)] == [5.0, 10.0]


def test_an_ample_budget_ends_at_the_largest_number_of_replicas():
    settings = [offer("a", 1.0)]
    count, found = measured(settings, first_replicas(settings, 4, 1e6, 1))
    more = more_replicas(settings, count, found, 1.0, 1e6, 1, [Aim()])
    assert more.count(OWN) == MAX_REPLICAS - 4 and more.count(("a", 10.0)) == MAX_REPLICAS - 1


def test_without_a_value_nothing_is_run():
    settings = [offer("a")]
    assert (
        first_replicas(settings, 4, 100.0, 1)
        == ()
        == more_replicas(settings, {OWN: 4}, Torques({OWN: 1.0}, 0.1, 3.0), 10.0, 100.0, 1, [Aim()])
    )


def test_replicas_for_a_difference():
    """1.96 s sqrt(2/n) = difference."""
    assert replicas_for(0.05, 0.08) == math.ceil(2 * (1.96 * 0.08 / 0.05) ** 2) == 20
    assert replicas_for(1.0, 0.01) == 1


@pytest.mark.parametrize("is_large", [False, True])
def test_a_scene_at_the_limit_of_a_setting_is_planned(is_large):
    """Without another value of that setting its law has no unit: it was a division by zero."""
    at_limit = dataclasses.replace(offer("b", 10.0, 12.0), limit=OWN_VALUE.step_size, is_large=is_large)
    count, found = measured([offer("a", 10.0, 12.0)], [("a", 10.0)])
    more = more_replicas([offer("a", 10.0, 12.0), at_limit], count, found, 10.0, 200.0, 1, [Aim()])
    assert more and set(more) <= {OWN, ("a", 10.0), ("a", 20.0 / 3.0), ("b", 10.0), ("b", 20.0 / 3.0)}


def test_torques_of_different_signs_are_no_use_and_alike_ones_need_no_other():
    settings = [offer("a", 10.0, 12.0), offer("b", 10.0, 12.0)]
    count, found = measured(settings, [("a", 10.0), ("b", 10.0)])
    opposite = dataclasses.replace(found, means=found.means | {("a", 10.0): -1.0})
    assert "a" not in {name for name, _ in more_replicas(settings, count, opposite, 10.0, 200.0, 1, [Aim()])}
    assert len(more_replicas(settings, count, dataclasses.replace(found, scatter=0.0), 10.0, 200.0, 1, [Aim()])) < 8
