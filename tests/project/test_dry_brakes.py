"""Torque against current of measured dry powder brakes: exponents, hysteresis, and where the shipped brake lies."""

import numpy as np
import pytest
from dry_brakes import (
    BRAKE_PAGE,
    CASE,
    PAGE,
    RANGES,
    RATED,
    brake_tables,
    brakes,
    exponent,
    law,
    of_law,
    other_powders,
    page_with,
    runs,
    tables,
)
from measured import ROOT
from two_scales import misfit

from emclutch.device_model.device import build_device
from emclutch.scene.case import load_case
from emclutch.studies.design_search import expectation_of

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


def test_the_law_of_the_powder_lies_on_the_falling_branches():
    """T/T_r at each current of the map from 10 % on: within 0.04 of the mean of both branches, 0.05 of each."""
    measured = brakes()
    x, torque = of_law()[of_law()[:, 0] > 0.1].T
    falling = np.array([np.interp(x, *measured[f"{brake} falling"].T) for brake in BRAKES])
    assert len(x) > 6 and x[-1] == 1.0
    assert np.abs(torque - falling.mean(axis=0)).max() < 0.04 and np.abs(torque - falling).max() < 0.05
    rising = np.array([np.interp(x, *measured[f"{brake} rising"].T) for brake in BRAKES])
    assert (torque > rising)[:, x < 0.8].all()  # powder that still gathers, in steel that was not magnetised
    rises, falls = (exponent(measured[f"B15 {way}"], 0.1, 0.4)[0] for way in ("rising", "falling"))
    assert abs(exponent(of_law(), 0.1, 0.4)[0] - falls) < 0.1 < rises - falls


def test_runs_of_the_brake_lie_in_the_interval_of_the_law():
    current, torque, _ = runs().T
    found = law().loc[current[current < 1.15]]
    torque = torque[current < 1.15]
    assert len(found) >= 4 and ((found.low < torque) & (torque < found.high)).all()
    assert ((found.unknown_low < found.low) & (found.high < found.unknown_high)).all()


def test_runs_with_other_powders_lie_in_the_interval_of_the_law_or_within_a_factor_of_two():
    """Where grains nearly jam, or the law is a guess, the interval says that it is wide: the strongest powders."""
    rows = other_powders()
    miss, _, half = misfit(rows)
    guess = np.array([bool(row["guess"]) for row in rows])
    assert len(rows) == 15 and guess.sum() == 2
    assert (np.abs(miss) < np.where(guess, np.log(2.0), 1.96 * half)).all()
    assert np.abs(miss)[1.96 * half < 0.2].max() < 0.11
    assert (half[-3:] > 2.0 * np.median(half)).all()


def test_the_map_of_the_table_is_that_of_today():
    case = load_case(CASE)
    device = build_device(case.scene)
    for current in (0.2, RATED):
        scene = case.with_values({"coil.current": current})
        expected = expectation_of(scene, device.driven_as(scene.scene), unknown_powder=current == RATED)
        row = law().loc[current]
        found = expected.real.mean, expected.real.low, expected.real.high
        assert found == pytest.approx(row[["torque", "low", "high"]].tolist(), rel=0.01)
    assert expected.unknown_powder == pytest.approx(row[["unknown_low", "unknown_high"]].tolist(), rel=0.01)


def test_the_pages_have_the_tables_of_the_data_and_the_readme_the_number():
    """Where they have not: python tests/benchmarks/dry_brakes.py docs/dry_brakes.png."""
    for page, blocks in ((PAGE, (tables(),)), (BRAKE_PAGE, brake_tables())):
        said = page.read_text(encoding="utf-8")
        assert page_with(said, *blocks) == said
    row, readme = law().loc[RATED], " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    half = 100.0 * (row.high / row.torque - 1.0)
    assert f"One number: {row.torque:.1f} N m ± {half:.0f} % (95 %)" in readme and f"{RATED:g} A" in readme
    assert f"{row.unknown_low:.1f} to {row.unknown_high:.1f} N m (90 % range)" in readme
