"""docs/accuracy.md has the torques of three fidelities as they are today, and a dearer one has the smaller error."""

from pathlib import Path

import pytest
from three_fidelities import brake, disc_clutch
from two_scales import read_rows

pytestmark = pytest.mark.physics
DOCS = Path(__file__).parents[2] / "docs"
ROWS = read_rows(DOCS / "two_scales.csv")


@pytest.mark.parametrize("of", [brake, lambda: disc_clutch(ROWS)], ids=["brake", "disc clutch"])
def test_the_page_has_the_torques_of_today(of):
    device = of()
    lines = [
        line.split(" | ") for line in (DOCS / "accuracy.md").read_text().splitlines() if f"| {device.name} |" in line
    ]
    found = {line[0].removeprefix("| "): line[2] for line in lines}
    today = {"formula: gaps alone": device.gaps, "formula: magnetic circuit": device.circuit, "law": device.law.mean}
    for fidelity, torque in today.items():
        assert float(found[fidelity].split(" ±")[0]) == pytest.approx(torque, rel=0.01), fidelity
    assert float(found["law"].split("± ")[1].split()[0]) == pytest.approx(100.0 * device.law_half_width, rel=0.1)
    errors = [abs(device.gaps / device.law.mean - 1.0), abs(device.circuit / device.law.mean - 1.0),
              abs(device.law.mean / device.grains[0] - 1.0)]  # fmt: skip
    assert errors == sorted(errors, reverse=True) and errors[-1] < device.law_half_width
