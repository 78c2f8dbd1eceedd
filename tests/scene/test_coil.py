"""[coil]: driven by a current or a voltage; what resistance, turns and current follow from each other."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from emclutch.device_model.coil_heat import winding_in_words
from emclutch.effects.coil_circuit import CoilCircuitSection
from emclutch.effects.eddy_currents import EddyCurrentsSection
from emclutch.scene.case import load_case
from emclutch.scene.coil import CoilSection
from geometry.time_profile import TimeProfile

CASES = Path(__file__).resolve().parents[2] / "cases"
AREA, RADIUS = 36e-6, 26e-3


def test_resistance_follows_from_the_turns_in_copper():
    """And gives the turns back: one winding, described from two sides."""
    coil = CoilSection.model_validate({"voltage": "24 V", "turns": 500})
    resistance = coil.resistance_in(AREA, RADIUS)
    back = CoilSection.model_validate({"voltage": "24 V", "resistance": resistance})
    assert back.winding_in(AREA, RADIUS).turns == pytest.approx(500.0, rel=1e-12)
    currents = coil.currents_in(AREA, RADIUS)
    assert currents.is_constant and currents(0.0) == pytest.approx(24.0 / resistance)
    assert coil.winding_in(AREA, RADIUS).copper_loss(currents(0.0)) == pytest.approx(24.0 * currents(0.0))


@pytest.mark.parametrize("turns", [None, 700])
def test_the_winding_in_words_is_one_winding(turns):
    """U = R I, P = U I, J = I/(pi d^2/4), N wires of d fill the window as is said, and rho N l has the resistance."""
    case = load_case(CASES / "powder_clutch.toml", {"coil.current": None, "coil.voltage": "24 V", "coil.turns": turns})
    words = winding_in_words(case.scene)
    given, found = turns, map(float, re.findall(r"(?<![\^\w])\d[\d.]*", words))
    turns, diameter, fill, R, _, current, density, loss = found
    assert R * current == pytest.approx(24.0, rel=0.01) and loss == pytest.approx(24.0 * current, rel=0.01)
    copper = 0.25 * math.pi * diameter**2  # mm^2
    assert density == pytest.approx(current / copper, rel=0.02)
    shape = case.scene.shape()
    assert turns * copper == pytest.approx(1e4 * fill * shape.coil_area, rel=0.02)
    assert R == pytest.approx(1.72e-2 * turns * 2.0 * math.pi * shape.coil_mean_radius / copper, rel=0.02)
    assert turns == given or fill == 60.0
    over = winding_in_words(case.with_values({"coil.turns": 5000}).scene)
    assert "fills 100 % of the window" in over and "more copper than fits: 5000 turns have" in over


def test_a_warm_coil_takes_less_current():
    cold, warm = (
        CoilSection.model_validate({"voltage": "24 V", "turns": 500, "resistance": "30 ohm", "temperature": t})
        for t in (20, 100)
    )
    assert cold.resistance_in(AREA, RADIUS) == 30.0
    assert warm.resistance_in(AREA, RADIUS) == pytest.approx(30.0 * (1.0 + 80.0 * 3.93e-3))
    assert warm.winding_in(AREA, RADIUS).turns == cold.winding_in(AREA, RADIUS).turns == 500.0


def test_voltage_in_time_switches_off_and_reverses():
    coil = CoilSection.model_validate(
        {"voltage": {"times": ["0 s", "1 ms", "2 ms"], "values": ["24 V", "0 V", "-6 V"]}, "resistance": "12 ohm"}
    )
    assert coil.is_at_voltage
    assert coil.currents_in(AREA, RADIUS) == TimeProfile((0.0, 1e-3, 2e-3), (2.0, 0.0, -0.5))


def test_beside_a_current_a_voltage_is_the_supply():
    coil = CoilSection.model_validate({"current": "0.94 A", "voltage": "24 V", "resistance": "25.5 ohm"})
    assert not coil.is_at_voltage and coil.currents_in(AREA, RADIUS) == coil.current


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"turns": 500}, r"give current, e\.g\. '1 A', or voltage"),
        ({"current": "1 A", "turns": 500, "voltage": {"times": [0, 1], "values": [24, 12]}}, "remove coil.current"),
        ({"current": "1 A", "turns": 500, "voltage": "-24 V"}, "above 0 V"),
        ({"current": "1 A", "turns": 500, "resistance": "20 ohm"}, "keep one of them"),
        ({"current": "1 A", "turns": 500, "fill_factor": 0.5}, "no meaning"),
        ({"voltage": "24 V", "turns": 500, "resistance": "20 ohm", "fill_factor": 0.5}, "no meaning"),
        ({"voltage": "24 V"}, "give turns"),
        ({"voltage": "24 A", "turns": 500}, "is a current; a voltage is needed"),
        ({"voltage": "24 V", "turns": 500, "temperature": 900}, "out of range"),
        ({"voltage": {"times": [0, 0], "values": [1, 2]}, "turns": 500}, "must increase"),
    ],
)
def test_faults_of_the_coil_are_reported(table, words):
    with pytest.raises(ValidationError, match=words):
        CoilSection.model_validate(table)


def test_transient_effects_have_their_keys():
    assert CoilCircuitSection().begin == EddyCurrentsSection().begin == "off"
    assert EddyCurrentsSection.model_validate({"conductivity": {"steel_1010": "5 MS/m"}}).conductivity == {
        "steel_1010": 5e6
    }
    for table in ({"begin": "on"}, {"tolerance": 0.0}):
        with pytest.raises(ValidationError):
            CoilCircuitSection.model_validate(table)
