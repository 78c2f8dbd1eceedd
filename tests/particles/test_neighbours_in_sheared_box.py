"""Pairs across the faces of a sheared box: every one once, by the right image, at every offset."""

import numpy as np
import pytest

from particles import GapBox, ShearedBox, find_pairs
from particles.packing.periodic_packing import random_in_box
from particles.sheared_box import MOST, NUMBERS, whole_numbers

D = 1e-3


def box_of(strain, lengths=(5.0, 4.2, 4.6), rate=3.0):
    box = ShearedBox(np.array(lengths) * D, rate)
    box.offset = strain * box.lengths[2]
    box.begin_list()
    return box


def all_pairs(x, reach, box):
    """{(i, j, s)} with i < j, of all images."""
    found = set()
    for s in NUMBERS:
        image = x + s * box.lengths + s[2] * box.offset * np.array([1.0, 0.0, 0.0])
        i, j = np.nonzero(np.linalg.norm(x[:, None] - image[None], axis=-1) < reach)
        found |= {(int(a), int(b), *s.tolist()) for a, b in zip(i, j, strict=True) if a < b}
    return found


@pytest.mark.parametrize("strain", [0.0, 0.31, -0.4, 1.02, 7.83])
@pytest.mark.parametrize("outside", [0.0, 0.15])
def test_pairs_are_those_of_all_images(strain, outside):
    """Grains that have left the box a little are found as well as those in it."""
    box, rng = box_of(strain), np.random.default_rng(5)
    x = rng.uniform(0.0, 1.0, (150, 3)) * box.lengths
    x += rng.uniform(-outside, outside, x.shape) * D
    pairs = find_pairs(x, 1.9 * D, box)
    shift = whole_numbers(pairs.shift)
    found = {(int(i), int(j), *s) for i, j, s in zip(pairs.rows(), pairs.other, shift.tolist(), strict=True)}
    assert len(found) == pairs.count
    assert found == all_pairs(x, 1.9 * D, box)
    assert len({s[2:] for s in found}) > 12  # faces, edges and corners
    # the table of images says the same
    apart = box.place(x[pairs.other], pairs.shift) - x[pairs.rows()]
    assert np.linalg.norm(apart, axis=1).max() < 1.9 * D
    assert apart == pytest.approx(x[pairs.other] + box.images[pairs.shift + MOST, 2:5] - x[pairs.rows()], abs=1e-12 * D)


def test_in_a_gap_pairs_are_those_of_images_along_its_walls():
    """None across them, also far from the origin; grains are packed between the walls, and wrapped into the cell."""
    corner, lengths = np.array([0.0, -500.0, 0.0]), np.array([5.0, 4.2, 3.6]) * D
    box, radius = GapBox(lengths, 3.0, corner), np.full(45, 0.5 * D)
    x = random_in_box(box, radius, seed=2)
    inside = x - corner
    assert (inside >= 0.0).all() and (inside <= lengths).all()
    assert inside[:, 2].min() >= 0.5 * D and (lengths[2] - inside[:, 2]).min() >= 0.5 * D
    pairs = find_pairs(x, 1.9 * D, box)
    shift = whole_numbers(pairs.shift)
    found = {(int(i), int(j), *s) for i, j, s in zip(pairs.rows(), pairs.other, shift.tolist(), strict=True)}
    assert len(found) == pairs.count and not shift[:, 2].any()
    still = ShearedBox(lengths)
    assert found == {one for one in all_pairs(inside, 1.9 * D, still) if one[4] == 0}
    moved = x + np.outer(np.arange(-22, 23), [lengths[0], 2.0 * lengths[1], 0.0])
    assert box.place(moved, box.wraps(moved)) == pytest.approx(x, abs=1e-6 * D)
    assert box.sweep(np.ones((45, 3)), box.wraps(moved)) == pytest.approx(np.ones((45, 3)))


@pytest.mark.parametrize("strain", [0.17, -0.17])
def test_grains_that_the_flow_took_far_out_are_found(strain):
    """In a high box those on top leave it by more than a fifth of the reach before they are wrapped."""
    box, rng = box_of(0.31, lengths=(7.0, 7.0, 14.0)), np.random.default_rng(4)
    x = rng.uniform(0.0, 1.0, (700, 3)) * box.lengths
    box.offset += strain * box.lengths[2]
    x[:, 0] += strain * x[:, 2]
    pairs = find_pairs(x, 1.9 * D, box)
    shift = whole_numbers(pairs.shift)
    found = {(int(i), int(j), *s) for i, j, s in zip(pairs.rows(), pairs.other, shift.tolist(), strict=True)}
    assert found == all_pairs(x, 1.9 * D, box)


def test_grains_of_two_sizes():
    box, rng = box_of(0.6), np.random.default_rng(2)
    x, reach = rng.uniform(0.0, 1.0, (200, 3)) * box.lengths, rng.choice([0.9, 0.2], 200) * D
    pairs = find_pairs(x, None, box, reach)
    rows = pairs.rows()
    every = find_pairs(x, 1.8 * D, box)
    apart = np.linalg.norm(box.place(x[every.other], every.shift) - x[every.rows()], axis=1)
    near = apart < (reach[every.rows()] + reach[every.other])
    wanted = set(zip(every.rows()[near], every.other[near], every.shift[near], strict=True))
    assert set(zip(rows, pairs.other, pairs.shift, strict=True)) == wanted


def test_a_wrap_keeps_distances_and_relative_velocities():
    box, rng = box_of(0.37), np.random.default_rng(1)
    x = rng.uniform(-3.0, 4.0, (90, 3)) * box.lengths  # some have gone far
    v = rng.normal(size=x.shape) + box.flow(x[:, 2])
    wraps = box.wraps(x)
    there, swept = box.place(x, wraps), box.sweep(v, wraps)
    assert ((there >= -1e-15) & (there <= box.lengths * (1.0 + 1e-15))).all()
    assert np.abs(swept - box.flow(there[:, 2]) - (v - box.flow(x[:, 2]))).max() < 1e-12
    assert not box.wraps(0.999 * there + 0.0005 * box.lengths).any()
    # a pair seen before and after: the shift changes by the wraps
    one = find_pairs(there, 2.0 * D, box)
    back = whole_numbers(one.shift) + wraps[one.other] - wraps[one.rows()]
    before = box.place(x[one.other], back) - x[one.rows()]
    after = box.place(there[one.other], one.shift) - there[one.rows()]
    assert before == pytest.approx(after, abs=1e-12 * D)


def test_whole_boxes_in_the_offset_change_no_pair():
    x = np.random.default_rng(8).uniform(0.0, 1.0, (80, 3)) * box_of(0.0).lengths
    near, far = box_of(0.2), box_of(0.2)
    far.offset += 3.0 * far.lengths[0]
    far.begin_list()
    assert far.offset == pytest.approx(near.offset, rel=1e-12)
    one, other = find_pairs(x, 1.5 * D, near), find_pairs(x, 1.5 * D, far)
    assert (one.other == other.other).all() and (one.shift == other.shift).all()


def test_a_box_that_is_too_small_is_refused():
    box = box_of(0.0)
    assert find_pairs(np.array([[0.1, 0.1, 0.1]]), box.widest_cutoff(np.zeros((1, 3))), box).count == 0
    with pytest.raises(ValueError, match="a neighbour twice"):
        find_pairs(np.array([[0.1, 0.1, 0.1]]), 2.2 * D, box)
    with pytest.raises(ValueError, match="edges above 0"):
        ShearedBox([1.0, 0.0, 1.0])
