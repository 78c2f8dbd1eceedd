"""A value or a table in time becomes one time profile, and is written as it was given."""

import pytest
from pydantic import ValidationError

from emclutch.scene.motion import ShaftMotionSection
from geometry.time_profile import TimeProfile

TURN = 0.10471975511965977  # [rad/s], one rpm


@pytest.mark.parametrize(
    ("given", "profile", "written"),
    [
        ("1 rpm", TimeProfile.constant(TURN), TURN),
        ({"times": ["1 s"], "values": ["1 rpm"]}, TimeProfile.constant(TURN), TURN),
        (
            {"times": ["0 s", "2 ms"], "values": [0.0, "1 rpm"]},
            TimeProfile((0.0, 2e-3), (0.0, TURN)),
            {"times": [0.0, 2e-3], "values": [0.0, TURN]},
        ),
    ],
)
def test_value_and_table_make_a_profile_and_go_back(given, profile, written):
    section = ShaftMotionSection.model_validate({"speed": given})
    assert section.speed == profile
    assert section.model_dump(mode="json", exclude_none=True) == {"speed": written}
    assert ShaftMotionSection.model_validate({"speed": written}) == section
    assert ShaftMotionSection(speed=profile) == section


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"times": [0.0, 1.0], "values": [0.0]}, "has 2 times and 1 values"),
        ({"times": [1.0, 0.0], "values": [0.0, 1.0]}, "must increase"),
        ({"times": [0.0], "values": ["1 A"]}, "is a current; an angular speed is needed"),
        ("1 A", "is a current; an angular speed is needed"),
    ],
)
def test_faults_of_a_table_are_reported(given, words):
    with pytest.raises(ValidationError, match=words):
        ShaftMotionSection.model_validate({"speed": given})
