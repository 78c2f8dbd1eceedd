"""The view along the shaft: parts stand where their bodies have turned to, and nothing is needed to draw it."""

import math

import numpy as np
import pytest

from emclutch.results.pictures.axial import axial_picture
from geometry.centrifugal import CentrifugalClutch
from geometry.triangle_wall import TriangleWall


def is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("count", [0, 1, 50])
def test_drawn_with_any_number_of_grains(tmp_path, count):
    position = np.random.default_rng(0).uniform(-0.05, 0.05, (count, 3))
    chains = (position, position[::-1], np.arange(float(count))) if count else None
    walls = CentrifugalClutch().walls()
    path = axial_picture(tmp_path / "a.png", position, np.full(count, 5e-3), np.ones(count), walls=walls, chains=chains)
    assert is_picture(path)


def test_vanes_are_drawn_where_the_rotor_has_turned_to(tmp_path, monkeypatch):
    """A wall turned by hand and a body turned by its angle give the same polygons."""
    from matplotlib import collections

    drawn = []
    original = collections.PolyCollection.__init__

    def remember(self, polygons, *arguments, **options):
        drawn.append(np.array(polygons))
        original(self, polygons, *arguments, **options)

    monkeypatch.setattr(collections.PolyCollection, "__init__", remember)
    vanes = [wall for wall in CentrifugalClutch().walls() if isinstance(wall, TriangleWall) and wall.body == "rotor"]
    nothing = (np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    angle = math.radians(17.0)
    axial_picture(tmp_path / "a.png", *nothing, walls=vanes[:1], angles={"rotor": angle, "disc": 1.0})
    axial_picture(tmp_path / "b.png", *nothing, walls=[vanes[0].turned(angle)])
    assert len(drawn) == 2
    assert drawn[0] == pytest.approx(drawn[1], abs=1e-9)
    tip = drawn[0].reshape(-1, 2)[np.argmax(np.linalg.norm(drawn[0].reshape(-1, 2), axis=1))]
    assert math.atan2(tip[1], tip[0]) == pytest.approx(angle, abs=0.03)  # half the vane's thickness over its length
