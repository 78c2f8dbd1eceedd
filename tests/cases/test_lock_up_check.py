"""A shipped scene leaves no effect out that its own check says may matter: lock_up.toml has a constant current."""

from pathlib import Path

import emclutch


def test_check_of_lock_up_has_no_open_question():
    checked = emclutch.check(Path(__file__).parents[2] / "cases" / "lock_up.toml")
    assert [line.effect for line in checked.omitted_effects if line.is_reservation] == []
