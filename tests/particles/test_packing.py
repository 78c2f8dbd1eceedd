"""Packings: no overlap, inside the walls, spread evenly, reproducible; refused where nothing fits."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.walls import AnnularBox, cylinder
from particles import CyclicSector, PackingError, find_pairs, pack


def _largest_overlap(x, r):
    pairs = cKDTree(x).query_pairs(2.0 * r, output_type="ndarray")
    return np.max(2.0 * r - np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1), initial=0.0) / (2.0 * r)


@pytest.mark.parametrize("fraction", [0.1, 0.4, 0.55])
def test_box_is_filled_without_overlap(fraction):
    r, count = 0.5e-3, 2000
    side = (count * 4 / 3 * np.pi * r**3 / fraction) ** (1 / 3)
    box = Box((side, side, side))
    x = pack(box, box.walls(), count, r, seed=3)
    assert x.shape == (count, 3)
    assert _largest_overlap(x, r) < 0.01
    assert (x - box.lower).min() > 0.98 * r and (box.upper - x).min() > 0.98 * r
    middle = 0.5 * (box.lower + box.upper)
    assert np.abs(np.mean(x, axis=0) - middle).max() < 0.04 * side  # spread evenly


def test_same_seed_same_packing():
    box = Box((0.01, 0.01, 0.01))
    first, again, other = (pack(box, box.walls(), 300, 0.5e-3, seed=s) for s in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_sector_of_a_ring_is_filled_across_its_faces():
    cell, sector, r = ShearCell(0.02, 0.0225, 0.004), CyclicSector(math.radians(30.0)), 0.25e-3
    box = cell.fill_boxes()["annulus"]
    count = int(0.45 * box.volume(sector.angle) / (4 / 3 * np.pi * r**3))
    x = pack([box], cell.walls(), count, r, seed=1, sector=sector)
    theta, radius = np.arctan2(x[:, 1], x[:, 0]), np.hypot(x[:, 0], x[:, 1])
    assert (theta >= -1e-12).all() and (theta < sector.angle + 1e-12).all()
    assert radius.min() > 0.02 + 0.98 * r and radius.max() < 0.0225 - 0.98 * r
    pairs = find_pairs(x, 2.0 * r, sector)
    there = sector.turn(x[pairs.other], pairs.shift)
    overlap = 2.0 * r - np.linalg.norm(there - x[pairs.rows()], axis=1)
    assert np.max(overlap, initial=0.0) < 0.01 * 2.0 * r


def test_boxes_get_their_share_by_volume():
    low, high = AnnularBox(0.01, 0.02, 0.0, 0.01), AnnularBox(0.01, 0.02, 0.02, 0.05)
    x = pack([low, high], [cylinder("shell", "rotor", 0.02, 0.0, 0.05)], 400, 0.3e-3, seed=1)
    assert np.count_nonzero(x[:, 2] < 0.015) == pytest.approx(100, abs=2)


def test_too_much_is_refused_before_trying():
    box = Box((0.01, 0.01, 0.01))
    with pytest.raises(PackingError, match=r"would fill 0\.\d+ .*at most 0.60.*at most \d+ grains fit"):
        pack(box, box.walls(), 1200, 0.5e-3, seed=1)


def test_gap_thinner_than_a_grain_is_refused():
    with pytest.raises(PackingError, match=r"0\.4 mm thin, a grain is 1 mm thick"):
        pack(AnnularBox(0.02, 0.0204, 0.0, 0.01), [], 3, 0.5e-3, seed=1)


def test_stall_is_reported_with_what_was_reached():
    """A slab of 1.2 diameters holds no random packing of 0.55."""
    box = Box((0.01, 0.01, 0.0012))
    count = int(0.55 * box.volume / (4 / 3 * np.pi * 0.5e-3**3))
    with pytest.raises(PackingError, match="cannot be pushed apart: an overlap of") as caught:
        pack(box, box.walls(), count, 0.5e-3, seed=1)
    assert caught.value.overlap > 0.01


def test_grains_between_walls_closer_than_their_diameter_are_refused():
    place = AnnularBox(0.02, 0.0225, 0.0, 0.004)
    walls = [cylinder("inner", "disc", 0.0211, 0.0, 0.004), cylinder("outer", "rotor", 0.0214, 0.0, 0.004)]
    with pytest.raises(PackingError, match="cannot be pushed off the walls: "):
        pack(place, walls, 300, 0.25e-3, seed=1)
