"""`emclutch check` advises on the contact method where both were measured, and says nothing elsewhere."""

from pathlib import Path

import pytest

import emclutch
from emclutch.simulation.check import methods_compared

CASES = Path(__file__).resolve().parents[2] / "cases"


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("thesis/centrifugal_held", "DEM is cheaper than DVI"),
        ("thesis/electromagnetic", "DEM is cheaper than DVI: a sheared box"),
        ("quickstart", "DEM is cheaper than DVI: a sheared box"),
    ],
)
@pytest.mark.parametrize("method", ["dem", "dvi"])
def test_scenes_that_were_run_by_both_are_advised(name, start, method):
    case = emclutch.load_case(CASES / f"{name}.toml").with_values({"contact.method": method})
    assert methods_compared(case.scene).startswith(start)


def test_a_scene_of_another_kind_is_not():
    case = emclutch.load_case(CASES / "quickstart.toml").with_values({"effects.dipoles.model": "mutual"})
    assert methods_compared(case.scene) == ""


def test_check_prints_it():
    decisions = emclutch.check(CASES / "thesis" / "centrifugal_held.toml").decisions
    assert decisions["method"].startswith("dem; DEM is cheaper than DVI")
