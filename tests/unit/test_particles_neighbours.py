"""The cell grid finds what the naive search over all pairs finds."""

import math

import numpy as np
import pytest

from particles import CyclicSector, find_pairs


def _brute_force(position, cutoff, sector=None):
    found = set()
    shifts = [0] if sector is None else [0, 1]
    for shift in shifts:
        there = position if sector is None else position @ sector.rotation(shift).T
        near = np.linalg.norm(position[:, None] - there[None], axis=2) < cutoff
        for i, j in zip(*np.nonzero(near), strict=True):
            if shift or i < j:
                found.add((int(i), int(j), shift))
    return found


def _as_set(pairs):
    rows = list(zip(pairs.rows().tolist(), pairs.other.tolist(), pairs.shift.tolist(), strict=True))
    assert len(rows) == len(set(rows))
    return {(i, j, s) if s or i < j else (j, i, s) for i, j, s in rows}


@pytest.mark.parametrize("cutoff", [0.05, 0.2, 3.0])
def test_grid_equals_naive_search(cutoff):
    position = np.random.default_rng(1).random((300, 3)) * [1.0, 0.5, 2.0]
    assert _as_set(find_pairs(position, cutoff)) == _brute_force(position, cutoff)


@pytest.mark.parametrize("parts", [2, 5, 12])
def test_pairs_across_the_faces_of_a_sector(parts):
    sector = CyclicSector(2.0 * math.pi / parts)
    rng = np.random.default_rng(2)
    theta, r = rng.random(400) * sector.angle, 1.0 + rng.random(400)
    position = np.stack([r * np.cos(theta), r * np.sin(theta), rng.random(400)], axis=1)
    pairs = find_pairs(position, 0.15, sector)
    naive = _brute_force(position, 0.15, sector)
    if parts == 2:  # R = R^-1: the naive search sees a pair across the faces from either side
        naive -= {(i, j, 1) for i, j, s in naive if s and position[i, 0] > 0.0}
    assert _as_set(pairs) == naive
    assert (pairs.shift == 1).any()


def test_transposed_index_holds_every_slot_once():
    pairs = find_pairs(np.random.default_rng(3).random((200, 3)), 0.2)
    start, slot = pairs.incoming()
    assert sorted(slot.tolist()) == list(range(pairs.count))
    for j in range(200):
        assert (pairs.other[slot[start[j] : start[j + 1]]] == j).all()


def test_reach_limits_pairs_of_small_grains():
    position = np.array([[0.0, 0, 0], [0.5, 0, 0], [3.0, 0, 0], [4.5, 0, 0]])
    pairs = find_pairs(position, 2.0, reach=np.array([0.2, 0.2, 1.0, 1.0]))
    assert _as_set(pairs) == {(2, 3, 0)}


def test_few_grains_in_a_vast_space_need_little_memory():
    position = np.random.default_rng(4).random((50, 3)) * 1e6
    position[1] = position[0] + [0.5, 0.0, 0.0]
    assert _as_set(find_pairs(position, 1.0)) == {(0, 1, 0)}


def test_narrow_sector_is_refused():
    sector = CyclicSector(math.radians(10.0))
    with pytest.raises(ValueError, match=r"10 degrees is 1\.743 mm wide .* at least two cut-offs = 4 mm"):
        find_pairs(np.array([[0.01, 0.0, 0.0]]), 0.002, sector)


@pytest.mark.parametrize("degrees", [0.0, 100.0, 360.0, -30.0])
def test_angle_must_divide_the_full_turn(degrees):
    with pytest.raises(ValueError, match="sector angle"):
        CyclicSector(math.radians(degrees))


def test_wrap_brings_everything_into_the_wedge():
    sector = CyclicSector(math.radians(40.0))
    position = np.random.default_rng(5).normal(size=(500, 3))
    position[0] = [1.0, -1e-18, 0.0]  # rounds to a full turn
    inside = sector.turn(position, sector.wraps(position))
    theta = np.arctan2(inside[:, 1], inside[:, 0])
    assert (theta > -1e-12).all() and (theta < sector.angle + 1e-12).all()
    assert sector.wraps(position)[0] == 0
