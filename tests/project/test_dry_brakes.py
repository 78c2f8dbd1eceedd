"""Torque against current of measured dry powder brakes: exponents, hysteresis, and where the shipped brake lies."""

import numpy as np
import pytest
from dry_brakes import PAGE, RANGES, brakes, exponent, ours, page_with, tables

pytestmark = pytest.mark.physics
BRAKES = ("B15", "B5Z")


def test_an_exponent_is_that_of_a_power_law_and_a_part_of_a_range_has_none():
    x = np.linspace(0.1, 0.5, 9)
    law = np.column_stack([x, 0.7 * x**1.7])
    found, error = exponent(law, 0.1, 0.4)
    assert found == pytest.approx(1.7, abs=1e-9) and 0.02 < error < 0.1
    assert exponent(law, 0.4, 0.8) is None


def test_torque_rises_steeper_than_it_falls_and_neither_is_proportional_to_the_current():
    """To 60 % of the rated current with exponents of 1.7 to 2.2 and of 1.4 to 1.6."""
    measured = brakes()
    for brake in BRAKES:
        for low, high in RANGES:
            rising, error = exponent(measured[f"{brake} rising"], low, high)
            falling, _ = exponent(measured[f"{brake} falling"], low, high)
            assert rising > falling + error and falling > 1.0 + error
            if high <= 0.6:
                assert 1.7 < rising < 2.2 and 1.4 < falling < 1.6
    low, error = exponent(measured["B5ZD rising"], *RANGES[0])
    assert 1.7 < low < 1.8 and error < 0.1


def test_falling_torque_is_above_rising_torque_and_both_end_at_the_rated_point():
    for brake in BRAKES:
        rising, falling = (brakes()[f"{brake} {way}"] for way in ("rising", "falling"))
        assert rising[-1].tolist() == falling[-1].tolist() == [1.0, 1.0]
        inside = (rising[:, 0] > 0.0) & (rising[:, 0] < 1.0)
        assert (np.interp(rising[inside, 0], *falling.T) > rising[inside, 1]).all()
        assert rising[0, 1] < 0.02  # what is left without current


def test_a_model_without_hysteresis_lies_between_the_branches():
    """From the lowest rising to the highest falling branch, within 0.03 of the rated torque."""
    measured = brakes()
    for curve in ours():
        x = curve.x[curve.x < 1.0]
        rising, falling = (
            np.array([np.interp(x, *measured[f"{brake} {way}"].T) for brake in BRAKES]) for way in ("rising", "falling")
        )
        torque = curve.torque[curve.x < 1.0]
        assert x.size and (rising.min(axis=0) - 0.03 < torque).all() and (torque < falling.max(axis=0) + 0.03).all()


def test_the_page_has_the_tables_of_the_data_and_the_table_of_record():
    """Where it has not: python tests/benchmarks/dry_brakes.py docs/dry_brakes.png."""
    text = PAGE.read_text(encoding="utf-8")
    assert page_with(text, tables()) == text
