"""The field before a run says with which powder it was solved; surfaces from files say that they are not magnetic."""

import re
from pathlib import Path

import meshio
import numpy as np
import pytest

from coupling import magnetised_cluster
from emclutch.scene.case import load_case
from emclutch.simulation.check import check
from emclutch.simulation.forecast.expected_field import CHAIN_FACTOR, powder_in_words
from field import GrainLaw
from geometry.triangle_wall import box_surface

CASES = Path(__file__).resolve().parents[2] / "cases"
COARSE = {"field.size_factor": 3.0, "particles.sector": None}


def test_the_factor_of_chains_is_that_of_the_sum_over_their_dipoles():
    """M = H/(N + 1/chi) in the middle of a long chain of touching dipoles that magnetise one another."""
    n, chi, H = 61, 500.0, 100.0
    x = np.column_stack((np.zeros(n), np.zeros(n), 2e-4 * np.arange(n)))
    found = magnetised_cluster(x, 1e-4, GrainLaw(chi, 1.7e6), [0.0, 0.0, H], model="mutual")
    assert H / found.magnetisation[n // 2, 2] - 1.0 / chi == pytest.approx(CHAIN_FACTOR, rel=0.01)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "the run feeds back their own moments"),
        ({"effects.back_reaction": None}, "without powder"),
    ],
)
def test_which_powder_the_field_is_solved_with_is_reported(values, words):
    reported = powder_in_words(load_case(CASES / "quickstart.toml", values).scene, 0.35)
    assert words in reported and ("Maxwell Garnett" in reported) == ("effects.back_reaction" not in values)


def test_the_plan_tells_the_field_of_chains_and_of_surfaces_that_mirror_nothing(tmp_path):
    """Chains carry more flux than grains without order, at most in proportion to mu_r = 1 + phi/(N + 1/chi) of both;
    a wall of triangles beside wall_images is reported of."""
    wall = box_surface("vane", "rotor", (20.5e-3, 0.0, 0.0), (0.4e-3, 1e-3, 1e-3))
    meshio.write(tmp_path / "vane.stl", meshio.Mesh(wall.vertices, [("triangle", wall.triangles)]))
    surface = {"surfaces": {"vane": {"file": str(tmp_path / "vane.stl"), "body": "rotor"}}}
    reasons = check(load_case(CASES / "quickstart.toml", COARSE | surface), threads=1).decisions
    even, chains, *means = map(float, re.findall(r"([\d.]+) T", reasons["field"]))
    ratio = (1.0 + 0.35 / (CHAIN_FACTOR + 1.0 / 200.0)) / (1.0 + 0.35 / (0.65 / 3.0 + 1.0 / 200.0))
    assert even < chains < ratio * even
    assert means[0] < means[1] and means[0] < even and means[1] < chains
    assert "no bounds" in reasons["powder in that field"]
    assert "not magnetic" in reasons["surface vane"] and "wall_images" in reasons["surface vane"]
