"""Grown and poured packings, and grains of many sizes: reached fraction, no overlap, inside, seeded, refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.centrifugal import CentrifugalClutch
from particles import CyclicSector, PackingError
from particles.packing.grown_packing import grown_packing, random_close_packing
from particles.packing.packing import require_fit
from particles.packing.poured_packing import poured_packing
from particles.packing.push_apart import TOLERANCE
from particles.packing.random_packing import random_packing
from particles.packing.sizes import LogNormalSizes, UniformSizes
from particles.packing.space import Space

WALL_TOLERANCE = 1.05 * TOLERANCE  # grains in a corner are pushed off both walls in turn


def _cube(radius, fraction):
    side = (4.0 / 3.0 * math.pi * np.sum(radius**3) / fraction) ** (1.0 / 3.0)
    box = Box((side, side, side))
    return Space.of(box, box.walls())


def _right(packing, space, radius, fraction):
    require_fit(packing, space, WALL_TOLERANCE)
    assert np.array_equal(np.sort(packing.radius), np.sort(radius))
    assert space.solid_fraction(packing.radius) == pytest.approx(fraction, rel=1e-12)


def test_equal_grains_grow_to_sixty_per_cent():
    """A cube of 15 diameters, where pushing apart alone stalls."""
    radius = np.full(4000, 0.5e-3)
    space = _cube(radius, 0.60)
    _right(grown_packing(space, radius, seed=1), space, radius, 0.60)


def test_grains_of_many_sizes_grow_denser_than_equal_ones():
    """0.605 in a cube of 12 mean diameters, where not even 0.60 of equal grains fits."""
    radius = 0.5 * LogNormalSizes(1e-3, 1.35).draw(1500, seed=1)
    assert random_close_packing(radius) > 0.655
    space = _cube(radius, 0.605)
    _right(grown_packing(space, radius, seed=2), space, radius, 0.605)


def test_random_close_packing_of_desmond_and_weeks():
    """Equal: 0.634. Two sizes, one to nine by number, radius 2 and 1: delta and S by hand, mean 1.1, variance 0.09."""
    assert random_close_packing(np.full(5, 2.0)) == 0.634
    delta, skewness = 0.3 / 1.1, (0.9 * (-0.1) ** 3 + 0.1 * 0.9**3) / 0.3**3
    expected = 0.634 + 0.0658 * delta + 0.0857 * skewness * delta**2
    assert random_close_packing(np.array([2.0] + 9 * [1.0])) == pytest.approx(expected, rel=1e-12)


def test_loose_growth_needs_no_shaking_and_is_seeded():
    radius = 0.5 * UniformSizes(1e-3, 1.5e-3).draw(300, seed=1)
    space = _cube(radius, 0.3)
    first, again, other = (grown_packing(space, radius, seed=s) for s in (1, 1, 2))
    _right(first, space, radius, 0.3)
    assert np.array_equal(first.position, again.position) and not np.array_equal(first.position, other.position)
    assert np.array_equal(first.radius, again.radius)


def test_too_much_is_refused_before_trying():
    radius = np.full(1000, 0.5e-3)
    with pytest.raises(PackingError, match=r"fill 0\.650 .*at most 0\.63 \(random .* is 0\.634"):
        grown_packing(_cube(radius, 0.65), radius, seed=1)


def test_what_does_not_fit_between_near_walls_is_reported():
    """A slab of 1.2 diameters holds one layer: at most 0.55 at the density of circles on a plane, less at random."""
    box = Box((0.006, 0.006, 0.0012))
    count = int(0.55 * box.volume / (4.0 / 3.0 * math.pi * 0.5e-3**3))
    with pytest.raises(PackingError, match="cannot be pushed apart: an overlap of") as caught:
        grown_packing(Space.of(box, box.walls()), np.full(count, 0.5e-3), seed=1)
    assert caught.value.overlap > TOLERANCE


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.floats(1.0, 10.0), st.floats(0.05, 0.5))
def test_sizes_up_to_one_to_ten_are_packed(seed, ratio, fraction):
    radius = 0.1e-3 * ratio ** np.random.default_rng(seed).random(400)
    space = _cube(radius, fraction)
    _right(random_packing(space, radius, seed=seed), space, radius, fraction)


@pytest.mark.parametrize("pack", [random_packing, grown_packing])
def test_sizes_stay_with_their_places_across_the_faces_of_a_sector(pack):
    cell, sector = ShearCell(0.02, 0.0225, 0.004), CyclicSector(math.radians(30.0))
    space = Space.of(list(cell.fill_boxes().values()), cell.walls(), sector)
    radius = 0.5 * UniformSizes(0.3e-3, 0.6e-3).draw_volume(0.5 * space.volume, seed=1)
    packing = pack(space, radius, seed=1)
    require_fit(packing, space, WALL_TOLERANCE)
    assert space.solid_fraction(radius) == pytest.approx(0.5, abs=5e-4)
    theta = np.arctan2(packing.position[:, 1], packing.position[:, 0])
    assert np.histogram(theta, bins=6, range=(0.0, sector.angle))[0].min() > 0.7 * packing.count / 6  # spread evenly


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 2.0, 0.0), (1.0, 1.0, 1.0)])
def test_a_pour_starts_in_the_upper_part(up):
    """0.06 of the cube at 0.3 above the lid: a fifth of the volume, so the centres are in the upper fifth."""
    radius = 0.5 * UniformSizes(0.6e-3, 0.8e-3).draw(2500, seed=1)
    space = _cube(radius, 0.06)
    packing = poured_packing(space, radius, up=up, seed=1)
    require_fit(packing, space, WALL_TOLERANCE)
    direction = np.array(up) / np.linalg.norm(up)
    rng = np.random.default_rng(0)
    low, high = space.places[0].lower, space.places[0].upper
    heights = (low + rng.random((20_000, 3)) * (high - low)) @ direction
    assert (packing.position @ direction).min() > np.quantile(heights, 0.78)


def test_a_pour_into_a_clutch_with_vanes():
    clutch = CentrifugalClutch()
    space = Space.of(list(clutch.fill_boxes().values()), clutch.walls())
    radius = 0.5 * UniformSizes(10e-3, 15e-3).draw(150, seed=1)
    packing = poured_packing(space, radius, up=(0.0, 1.0, 0.0), seed=1)
    require_fit(packing, space, 0.05)
    assert packing.position[:, 1].mean() > 0.05


def test_a_pour_needs_a_direction_that_the_sector_keeps():
    cell = ShearCell(0.02, 0.0225, 0.004)
    space = Space.of(list(cell.fill_boxes().values()), cell.walls(), CyclicSector(math.radians(30.0)))
    with pytest.raises(ValueError, match="turns from sector to sector"):
        poured_packing(space, np.full(10, 1e-4), up=(0.0, 1.0, 0.0), seed=1)
    with pytest.raises(ValueError, match="a direction of three components"):
        poured_packing(space, np.full(10, 1e-4), up=(0.0, 0.0, 0.0), seed=1)
