"""A plan holds what was decided and why as data; it has words for each decision."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import sheared_annulus

from emclutch import SceneError, plan
from emclutch.device_model.decision import warnings_of
from emclutch.device_model.device import build_device
from emclutch.scene.case import case_from, load_case
from emclutch.simulation.field_plan import field_plan
from emclutch.simulation.plan_in_words import plan_in_words
from emclutch.simulation.windows import UpdateRule, coupling_windows
from geometry.time_profile import TimeProfile

FIELD = {"field": sheared_annulus.CELL["field"], "effects": sheared_annulus.CELL["effects"]}
CELL = {name: table for name, table in sheared_annulus.CELL.items() if name not in ("field", "motion")} | {
    "effects": {"gravity": {"direction": [0.0, 0.0, -1.0]}}, "time": {"end": "10 ms"}, "accuracy": {"replicas": 1},
}  # fmt: skip


STARTERS = Path(__file__).resolve().parents[2] / "emclutch" / "devices" / "starters"


def planned(changes=()):
    case = case_from(CELL, dict(changes))
    made = plan(case, threads=1)
    return made, plan_in_words(build_device(case.scene), made)


@pytest.mark.parametrize(("width", "bypasses"), [("6 mm", False), ("12 mm", True)])
def test_a_wide_winding_whose_leakage_exceeds_the_powders_share_is_a_warning(width, bypasses):
    """At equal ampere-turns and housing: the poles beside the winding, 4 mm and 1 mm wide, carry the flux."""
    found = field_plan(load_case(STARTERS / "field.toml", {"geometry.coil_width": width}))
    warnings = warnings_of(found).get("ampere-turns", [])
    assert len(warnings) == bypasses and all("much flux bypasses the powder" in text for text in warnings)


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
    assert asked.contact.stiffness.is_soft and "too soft" in words["stiffness"].warnings[0]


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
    assert made.division.rule is rule
    assert 10e-3 - made.division.length < made.end <= 10e-3 * (1.0 + 1e-9)
    if rule is UpdateRule.ASKED:
        assert made.steps_per_update == 7
    if rule is UpdateRule.PARTING:
        held = made.steps_per_update * made.dt
        assert 1 < made.steps_per_update and held <= 0.5 * made.contact.parting_time * (1.0 + 1e-9)
    assert made.contact_data["method"] == ("dvi" if rule in (UpdateRule.EVERY_STEP, UpdateRule.PARTING) else "dem")


SOFT = {"effects.gravity.acceleration": 1e-7, "motion.rotor": {"speed": 1e-4}, "contact.max_overlap": 0.05}
"""Hardly anything loads the contacts: the step that follows from them is longer than the run."""
RIGID = {"contact.method": "dvi", "contact.dvi.springs": False, "particles.sector": None}


@pytest.mark.parametrize("changes", [{}, RIGID], ids=["dem", "dvi"])
@pytest.mark.parametrize("window", ["5 us", None], ids=["window", "automatic"])
def test_no_automatic_step_is_longer_than_the_window_or_the_run(changes, window):
    slow = SOFT | changes | {"time.end": "1.5 ms"}
    free, _ = planned({**slow, "time.end": "1000 s"})
    assert free.dt > 1.5e-3
    made, _ = planned(slow | ({} if window is None else {"time.window": window}))
    longest = 1.5e-3 if window is None else 5e-6
    assert made.dt <= longest * (1.0 + 1e-9) and made.division.length <= longest * (1.0 + 1e-9)
    assert made.end == pytest.approx(1.5e-3, rel=1e-9)
    assert "no longer than a coupling window" in made.contact.step.reason
    if window is not None:
        assert made.windows == 300


@pytest.mark.parametrize("changes", [{}, FIELD], ids=["contacts", "held forces"])
def test_a_window_that_is_given_is_rounded_down_to_whole_steps_and_reported(changes):
    step = planned(changes)[0].dt
    for steps in (1.9, 7.99, 63.5):
        made, words = planned(changes | {"time.window": steps * step, "time.end": 200.5 * step})
        assert made.division.steps == int(steps) and made.steps_per_update <= int(steps)
        assert made.windows == 200 // int(steps)
        assert f"{int(steps)} steps = " in words["coupling window"]
        assert "is rounded down to whole steps" in words["coupling window"]


def test_a_step_or_an_update_that_is_longer_than_its_window_is_refused():
    asked = FIELD | {"effects.dipoles": {"model": "mutual", "update_every": 50}, "time.window": "1 us"}
    with pytest.raises(SceneError, match=r"effects\.dipoles\.update_every = 50 steps .* than time\.window = 1e-06 s"):
        planned(asked)
    rigid = RIGID | {"contact.dvi.step": "5 us", "contact.dvi.allow_long_step": True, "time.window": "1 us"}
    with pytest.raises(SceneError, match=r"contact\.dvi\.step = 5e-06 s is longer than the coupling window"):
        planned(rigid)
    strained = {"time.end": "strain 1e-6", "time.step": "10 ns", "motion.rotor": {"speed": "300 rpm"}}
    with pytest.raises(SceneError, match=r"time\.step = 1e-08 s; allowed: .* nor than the run"):
        planned(strained)


def test_automatic_windows_resolve_the_drive_of_the_coil_and_each_frame():
    """Ten windows in each change of a table and in a time constant; a jump shortens none, and is named."""
    step = 1e-6

    def windows(end, times, values, snapshots=0, time_constant=None):
        scene = SimpleNamespace(
            time=SimpleNamespace(end_time=end, window=None), output=SimpleNamespace(snapshots=snapshots),
            coil=SimpleNamespace(current=TimeProfile(times, values), voltage=None),
            geometry=SimpleNamespace(barostat=lambda scene: None),
        )  # fmt: skip
        return coupling_windows(scene, step, 0.0, 0.0, held=False, time_constant=time_constant)

    usual = windows(1.0, (0.0, 1.0), (0.0, 1.0))
    assert usual.length == pytest.approx(5e-3) and usual.jump is None
    pulse = windows(1.0, (0.0, 1e-3, 0.5, 0.502), (0.0, 1.0, 1.0, 0.0))
    assert pulse.length == pytest.approx(1e-4) and pulse.jump is None
    jump = windows(1.0, (0.5, 0.50001), (1.0, 0.0))
    assert jump.length == pytest.approx(5e-3) and jump.jump == pytest.approx(1e-5)
    assert windows(1.0, (0.0,), (1.0,), time_constant=0.02).length == pytest.approx(2e-3)
    assert windows(1.0, (0.0,), (1.0,), snapshots=1000).count == 1000


def test_a_sector_of_magnetised_grains_is_at_least_as_wide_as_the_gap():
    """A gap of 1.2 mm at r = 10.6 mm is 6.49 deg wide, and 360/6.49 = 55.5: 55 sectors of 6.545 deg at the most."""
    for width, changes, narrow in (("6.428571429 deg", FIELD, True), ("6.545454545 deg", FIELD, False),
                                   ("6.428571429 deg", {}, False)):  # fmt: skip
        cutoff = {"effects.dipoles.cutoff": 1.5} if changes else {}
        _, words = planned(changes | cutoff | {"particles.sector": width})
        assert ("widen particles.sector to '6.545454545 deg' or more" in "".join(words["sector"].warnings)) == narrow
