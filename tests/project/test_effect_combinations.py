"""The table of effects that do not run together is what the checks of a scene answer, pair by pair."""

from effect_combinations import NAMES, SETTINGS, base, in_page, reason, refused, table


def test_the_table_of_the_page_is_that_of_the_checks():
    assert in_page() == table(), "python tests/project/effect_combinations.py"


def test_each_effect_and_setting_is_valid_without_a_second_one():
    """Otherwise a refusal would not be that of the pair; what a setting excludes stands in its own line."""
    scene = base()
    assert {name: why for name in NAMES if (why := reason(scene, name))} == {}


def test_pairs_that_are_known_to_be_refused_are():
    found = refused()
    assert "history" in found["hysteresis", "coil_circuit"] and "history" in found["hysteresis", "eddy_currents"]
    (slots,) = (name for name in SETTINGS if name.startswith("slots"))
    assert {effect for effect, other in found if other == slots} == {"hysteresis", "eddy_currents", "heat"}
    assert ("coil_circuit", "eddy_currents") not in found and ("back_reaction", slots) not in found
