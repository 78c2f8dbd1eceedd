"""A plan holds what was decided and why as data; it has words for each decision."""

import pytest
import sheared_annulus

from emclutch import plan
from emclutch.device_model.device import build_device
from emclutch.scene.case import case_from
from emclutch.simulation.plan_in_words import plan_in_words
from emclutch.simulation.windows import UpdateRule

FIELD = {"field": sheared_annulus.CELL["field"], "effects": sheared_annulus.CELL["effects"]}
CELL = {name: table for name, table in sheared_annulus.CELL.items() if name not in ("field", "motion")} | {
    "effects": {"gravity": {"direction": [0.0, 0.0, -1.0]}}, "time": {"end": "10 ms"}, "accuracy": {"replicas": 1},
}  # fmt: skip


def planned(changes=()):
    case = case_from(CELL, dict(changes))
    made = plan(case, threads=1)
    return made, plan_in_words(build_device(case.scene), made)


@pytest.mark.parametrize(("changes", "source"), [({}, "gravity"), (FIELD, "magnetism")])
def test_the_largest_load_sets_the_stiffness(changes, source):
    """k_n delta carries the load, at an overlap no larger than the one that the scene allows."""
    made, _ = planned(changes)
    stiffness = made.contact.stiffness
    assert stiffness.load.source == source and stiffness.value == made.stiffness
    assert stiffness.load.force <= made.stiffness * stiffness.overlap * 0.3e-3 * 1.001
    assert stiffness.overlap <= case_from(CELL).scene.contact.max_overlap * 1.001
    assert not stiffness.asked and not stiffness.is_soft


def test_a_stiffness_that_is_asked_for_may_be_soft_and_says_so():
    follows, _ = planned()
    # under a load overlaps go as 1/k, in impacts as 1/sqrt(k): about 5 % of the diameter under both
    softer = follows.stiffness * (follows.contact.stiffness.overlap / 0.05) ** 1.4
    asked, words = planned({"contact.stiffness": softer})
    assert asked.contact.stiffness.asked and asked.stiffness == pytest.approx(softer)
    assert asked.contact.stiffness.is_soft and "too soft" in words["stiffness"]


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({}, None),
        (FIELD, UpdateRule.CONTACT),
        (FIELD | {"effects.dipoles": {"model": "mutual", "update_every": 7}}, UpdateRule.ASKED),
        (FIELD | {"contact.method": "dvi", "particles.sector": None}, UpdateRule.EVERY_STEP),
        (FIELD | {"contact.method": "dvi", "effects.dipoles": {"model": "near_field"}}, UpdateRule.PARTING),
    ],
)
def test_windows_reach_the_end_and_no_more(changes, rule):
    made, _ = planned(changes)
    window = made.division.steps * made.dt
    assert made.division.rule is rule
    assert made.end - window < 10e-3 * (1.0 + 1e-9) and made.end >= 10e-3 * (1.0 - 1e-9)
    if rule is UpdateRule.ASKED:
        assert made.steps_per_update == 7
    if rule is UpdateRule.PARTING:
        held = made.steps_per_update * made.dt
        assert 1 < made.steps_per_update and held <= 0.5 * made.contact.parting_time * (1.0 + 1e-9)
    assert made.contact_data["method"] == ("dvi" if rule in (UpdateRule.EVERY_STEP, UpdateRule.PARTING) else "dem")


def test_a_sector_of_magnetised_grains_is_at_least_as_wide_as_the_gap():
    """A gap of 1.2 mm at r = 10.6 mm is 6.49 deg wide, and 360/6.49 = 55.5: 55 sectors of 6.545 deg at the most."""
    for width, changes, narrow in (("6.428571429 deg", FIELD, True), ("6.545454545 deg", FIELD, False),
                                   ("6.428571429 deg", {}, False)):  # fmt: skip
        cutoff = {"effects.dipoles.cutoff": 1.5} if changes else {}
        _, words = planned(changes | cutoff | {"particles.sector": width})
        assert ("widen particles.sector to '6.545454545 deg' or more" in words["sector"]) == narrow
