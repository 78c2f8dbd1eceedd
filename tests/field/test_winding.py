"""The winding: resistance, wire, temperature and loss against hand arithmetic."""

import math

import pytest

from field.coil.winding import COPPER_RESISTIVITY, Winding, copper_resistivity, resistance_ratio


def test_resistance_is_that_of_its_wire():
    winding = Winding(500.0, 36e-6, 26e-3, 0.6)
    length = 500.0 * 2.0 * math.pi * 26e-3
    assert winding.wire_section == pytest.approx(0.6 * 36e-6 / 500.0)
    assert winding.resistance == pytest.approx(1.72e-8 * length / (0.6 * 36e-6 / 500.0))
    assert math.pi / 4.0 * winding.wire_diameter**2 == pytest.approx(winding.wire_section)
    assert winding.copper_mass == pytest.approx(8890.0 * length * winding.wire_section)
    assert winding.current_density(1.5) == pytest.approx(1.5 / winding.wire_section)


def test_loss_is_current_squared_and_grows_with_temperature():
    cold, hot = Winding(500.0, 36e-6, 26e-3), Winding(500.0, 36e-6, 26e-3, temperature=100.0)
    assert cold.copper_loss(2.0) == pytest.approx(4.0 * cold.copper_loss(1.0))
    # 80 K at 0.393 % a kelvin
    assert hot.copper_loss(1.0) / cold.copper_loss(1.0) == pytest.approx(1.0 + 80.0 * 3.93e-3)
    assert resistance_ratio(20.0) == 1.0 and copper_resistivity() == COPPER_RESISTIVITY


def test_loss_in_a_full_window_does_not_depend_on_the_wire():
    """At the same ampere-turns and copper share, thick wire or thin: rho 2 pi r (N I)^2/(f A)."""
    thick, thin = Winding(100.0, 1e-4, 30e-3), Winding(2000.0, 1e-4, 30e-3)
    assert thick.copper_loss(8.0) == pytest.approx(thin.copper_loss(0.4))


def test_turns_from_resistance_and_back():
    winding = Winding.of_resistance(25.5, 196e-6, 59e-3, 0.6)
    assert winding.resistance == pytest.approx(25.5, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"turns": 0.0}, "turns"),
        ({"fill_factor": 1.2}, "fill_factor"),
        ({"temperature": 400.0}, "temperature"),
        ({"window_area": math.nan}, "window_area"),
    ],
)
def test_bad_windings_are_explained(change, words):
    with pytest.raises(ValueError, match=words):
        Winding(**{"turns": 100.0, "window_area": 1e-4, "mean_radius": 0.03, **change})
