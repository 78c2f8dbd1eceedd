"""A sector's list is the list of the full ring made of its copies, each pair of which stands in it once."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from particles import CyclicSector, find_pairs
from particles.neighbours.neighbour_list import cell_order

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("parts", [2, 3, 4, 7, 24, 60])
@pytest.mark.parametrize("ordered", [False, True], ids=["any order", "sorted"])
def test_every_pair_of_the_ring_once(parts, ordered):
    """Copy k of grain i and copy l of grain j are the pair (i, j, l - k); a tree search knows nothing of sectors."""
    sector, n = CyclicSector(2.0 * math.pi / parts), 150
    rng = np.random.default_rng(parts)
    theta, r = rng.random(n) * sector.angle, 1.0 + 0.4 * rng.random(n)
    x = np.stack([r * np.cos(theta), r * np.sin(theta), 0.2 * rng.random(n)], axis=1)
    # just wide enough; with two sectors otherwise a grain would see everything
    cutoff = min(0.99 * math.sin(0.5 * sector.angle), 0.3)
    if ordered:
        x = x[cell_order(x, cutoff)]
    ring = np.concatenate([sector.turn(x, np.full(n, k)) for k in range(parts)])
    image, grain = np.divmod(cKDTree(ring).query_pairs(cutoff, output_type="ndarray"), n)
    swap = grain[:, 0] > grain[:, 1]
    grain[swap], image[swap] = grain[swap, ::-1], image[swap, ::-1]
    apart = (image[:, 1] - image[:, 0]) % parts
    expected, times = np.unique(np.column_stack([grain, apart]), axis=0, return_counts=True)
    assert (times == parts).all()  # the ring repeats itself

    pairs = find_pairs(x, cutoff, sector)
    found, once = np.unique(
        np.column_stack([pairs.rows(), pairs.other, pairs.shift % parts]), axis=0, return_counts=True
    )
    assert (once == 1).all()
    np.testing.assert_array_equal(found, expected)
    if not ordered:  # sorted, all grains at one face may come before those at the other
        assert (pairs.shift > 0).any() and (pairs.shift < 0).any()
