"""Packings go where they lower the half widths of the knobs' errors most for their time, and stay within the budget."""

import math

import pytest

from emclutch.studies.accuracy_plan import (
    BASE,
    MAX_PACKINGS,
    OfferedKnob,
    OfferedRung,
    allocate,
    makespan,
    packings_for,
)

OWN = OfferedRung(20.0, 1 / 20, 10.0, 1.0)


def knob(name, *seconds, order=2.0, variance=1.0):
    """A knob whose rungs, of a half, a third, ... of the own step size's inverse, take these seconds."""
    rungs = tuple(OfferedRung(20.0 / (n + 2), (n + 2) / 20.0, one, variance) for n, one in enumerate(seconds))
    return OfferedKnob(name, order, 0.0, OWN, rungs)


def spent(found, knobs, base=10.0):
    seconds = {(one.name, rung.setting): rung.seconds for one in knobs for rung in one.rungs} | {(BASE, 0.0): base}
    return [seconds[one] for one in found.packings]


def test_every_knob_that_can_be_paid_gets_its_minimum_and_the_dearest_are_left_out():
    knobs = [knob("dear", 400.0), knob("cheap", 5.0, 5.0), knob("usual", 10.0, 12.0), knob("endless", 1e6)]
    found = allocate(knobs, 4, 10.0, 300.0, 2)
    names = [name for name, _ in found.packings]
    assert {"cheap", "usual"} <= set(names) and len({one for one in found.packings if one[0] == "usual"}) == 2
    assert set(found.left_out) == {"dear", "endless"} and found.left_out["dear"] == 400.0
    assert "dear" not in names and names.index("cheap") < names.index("usual")


@pytest.mark.parametrize("room", [0.0, 20.0, 75.0, 200.0])
@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_the_budget_is_kept(room, jobs):
    knobs = [knob("a", 7.0, 9.0), knob("b", 31.0, 17.0, variance=0.5), knob("c", 60.0)]
    found = allocate(knobs, 4, 10.0, room, jobs)
    assert makespan(spent(found, knobs), jobs) <= room
    assert {name for name, _ in found.packings} - {BASE} | set(found.left_out) == {"a", "b", "c"}
    assert allocate(knobs, 4, 10.0, room, jobs) == found


def test_dearer_rungs_get_fewer_packings_and_more_of_them_lower_every_half_width():
    knobs = [knob("dear", 40.0), knob("cheap", 10.0)]
    count = {
        name: [one for one, _ in allocate(knobs, 4, 10.0, 500.0, 2).packings].count(name) for name in ("dear", "cheap")
    }
    assert count["dear"] < count["cheap"]
    few, many = (
        sum(one.spread({(BASE, 0.0): 4} | counted(allocate(knobs, 4, 10.0, room, 2))) ** 2 for one in knobs)
        for room in (200.0, 500.0)
    )
    assert many < few


def counted(found):
    base = sum(one == (BASE, 0.0) for one in found.packings)
    return {one: found.packings.count(one) for one in set(found.packings)} | {(BASE, 0.0): 4 + base}


def test_half_widths_are_those_of_two_means_where_a_knob_has_two_settings():
    """b = c h^p with c from the difference of two means, of errors 1/sqrt(4) and sqrt(0.5/3)."""
    one = knob("a", 10.0, variance=0.5)
    x, x_own = (2 / 20) ** 2, (1 / 20) ** 2
    expected = 1.96 * math.sqrt(1 / 4 + 0.5 / 3) * x_own / (x - x_own)
    assert one.spread({(BASE, 0.0): 4, ("a", 10.0): 3}) == pytest.approx(expected, rel=1e-9)
    assert math.isinf(one.spread({(BASE, 0.0): 4}))


def test_an_ample_budget_ends_at_the_largest_number_of_packings():
    found = allocate([knob("a", 1.0)], 4, 1.0, 1e6, 1)
    assert counted(found) == {(BASE, 0.0): MAX_PACKINGS, ("a", 10.0): MAX_PACKINGS}


def test_without_a_knob_that_is_measured_nothing_is_run():
    assert allocate([knob("a")], 4, 10.0, 100.0, 1).packings == ()


def test_packings_for_a_difference():
    """1.96 s sqrt(2/n) = difference."""
    assert packings_for(0.05, 0.08) == math.ceil(2 * (1.96 * 0.08 / 0.05) ** 2) == 20
    assert packings_for(1.0, 0.01) == 1
