"""The field before a run says with which powder it was solved; surfaces from files say that they are not magnetic."""

import re
from pathlib import Path

import meshio
import pytest

from emclutch.scene.case import load_case
from emclutch.simulation.check import check
from emclutch.simulation.forecast.expected_field import powder_in_words
from emclutch.simulation.forecast.powder_law import powder_of, shipped_laws
from geometry.triangle_wall import box_surface

CASES = Path(__file__).resolve().parents[2] / "cases"
COARSE = {"field.size_factor": 3.0, "particles.sector": None}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "In a run the field becomes stronger"),
        ({"effects.back_reaction": None}, "without powder"),
    ],
)
def test_which_powder_the_field_is_solved_with_is_reported(values, words):
    reported = powder_in_words(load_case(CASES / "quickstart.toml", values).scene, 0.35)
    assert words in reported and ("Maxwell Garnett" in reported) == ("effects.back_reaction" not in values)


def test_the_plan_tells_the_field_of_sheared_powder_and_of_surfaces_that_mirror_nothing(tmp_path):
    """Sheared powder carries more flux than grains without order, at most in proportion to mu_r = 1 + phi/(N + 1/chi)
    of both; a wall of triangles beside wall_images is reported of."""
    wall = box_surface("vane", "rotor", (20.5e-3, 0.0, 0.0), (0.4e-3, 1e-3, 1e-3))
    meshio.write(tmp_path / "vane.stl", meshio.Mesh(wall.vertices, [("triangle", wall.triangles)]))
    surface = {"surfaces": {"vane": {"file": str(tmp_path / "vane.stl"), "body": "rotor"}}}
    case = load_case(CASES / "quickstart.toml", COARSE | surface)
    reasons = check(case, threads=1).decisions
    even, mean, sheared, sheared_mean = map(float, re.findall(r"([\d.]+) T", reasons["field"]))
    N, phi, chi = shipped_laws().of(*powder_of(case.scene)).factor(0.0, 0.45, 1.0), 0.45, 200.0
    ratio = (1.0 + phi / (float(N) + 1.0 / chi)) / (1.0 + phi / ((1.0 - phi) / 3.0 + 1.0 / chi))
    assert even < sheared < ratio * even
    assert mean < sheared_mean and mean < even and sheared_mean < sheared
    assert "field becomes stronger" in reasons["powder in that field"]
    assert "not magnetic" in reasons["surface vane"] and "wall_images" in reasons["surface vane"]
    assert "surfaces from files" in reasons["expected torque"]
