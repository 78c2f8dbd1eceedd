"""Chunks of rows that threads share, and the width of the list's skin."""

import numpy as np
import pytest

from particles import find_pairs
from particles.neighbours.partition import CONTACT, GRAIN, PAIR, WALL, chunk_count, make_chunks
from particles.neighbours.skin import LIST_COST, NARROWEST, WIDEST, next_skin


def _list(n, seed=1):
    rng = np.random.default_rng(seed)
    x = rng.random((n, 3)) * (n / 0.6) ** (1 / 3)
    x = x[np.lexsort((x[:, 0], x[:, 1], np.floor(x[:, 2])))]
    return find_pairs(x, 1.2)


@pytest.mark.parametrize("n", [1, 400, 700, 5000])
def test_every_reaction_between_chunks_has_one_place_and_one_reader(n):
    pairs = _list(n)
    walls = np.zeros(n + 1, dtype=np.int64)
    c = make_chunks(pairs.start, pairs.other, np.zeros(pairs.count, dtype=np.uint8), walls)
    assert c.start[0] == 0 and c.start[-1] == n and np.all(np.diff(c.start) >= 0)
    assert len(c.start) - 1 == min(chunk_count(n), n)
    i, j = pairs.rows(), pairs.other
    chunk_of = np.searchsorted(c.start, np.arange(n), side="right") - 1
    crossing = np.flatnonzero(chunk_of[i] != chunk_of[j])
    assert len(c.reaction) == len(crossing) == c.cross_start[-1]
    # the buffer's places are in the order of the list, chunk by chunk; each late grain reads those of its own pairs
    readers = np.repeat(c.deferred_grain, np.diff(c.reaction_start))
    assert np.array_equal(np.sort(c.reaction_place), np.arange(len(crossing)))
    assert np.array_equal(j[crossing][c.reaction_place], readers)
    assert all(
        np.all(np.diff(c.reaction_place[a:b]) > 0)
        for a, b in zip(c.reaction_start[:-1], c.reaction_start[1:], strict=True)
    )
    assert np.array_equal(np.flatnonzero(c.deferred), c.deferred_grain)
    assert (
        c.deferred_start[0] == 0
        and c.deferred_start[-1] == len(c.deferred_grain)
        and np.ptp(np.diff(c.deferred_start)) <= 1
    )


def test_chunks_share_the_work_evenly():
    pairs = _list(8000)
    touching = (pairs.other % 3 == 0).astype(np.uint8)
    touching[: len(touching) // 4] = 1
    contacts = np.concatenate([[0], np.cumsum(touching)])[pairs.start]
    walls = np.minimum(np.arange(8001), 1000)
    c = make_chunks(pairs.start, pairs.other, touching, walls)
    work = np.diff((GRAIN * np.arange(8001) + PAIR * pairs.start + CONTACT * contacts + WALL * walls)[c.start])
    assert len(work) == 4 and work.max() < 1.02 * work.mean()
    again = make_chunks(pairs.start, pairs.other, np.zeros_like(touching), walls, c.start)
    assert all(np.array_equal(a, b) for a, b in zip(again, c, strict=True))


def test_number_of_chunks_follows_from_the_grains_and_leaves_them_thick():
    counts = [chunk_count(n) for n in (1, 499, 500, 1000, 10_000, 100_000, 1_000_000)]
    assert counts == [1, 1, 2, 2, 6, 12, 24]  # even, so that two threads have the same to do
    # a cube of n grains has n^(1/3) layers: about four or more to a chunk
    assert all(n ** (1 / 3) / chunk_count(n) > 3.5 for n in (1000, 10_000, 100_000, 1_000_000))


def test_skin_approaches_the_least_of_its_price():
    """Pairs and steps that grow linearly with the skin: price B s + C/(k s) is least at sqrt(C/(k B))."""
    k, b = 3e5, 9000.0  # steps and extra pairs a metre
    best, skin = np.sqrt(LIST_COST / (k * b)), 0.25e-3
    for _ in range(40):
        skin = next_skin(skin, round(k * skin), b * skin, 0.5e-3)
    assert skin == pytest.approx(best, rel=0.01)
    price = [b * s + LIST_COST / (k * s) for s in (0.9 * skin, skin, 1.1 * skin)]
    assert price[1] == min(price)


@pytest.mark.parametrize("steps, pairs, limit", [(1, 5.0, WIDEST), (10**9, 5.0, NARROWEST)])
def test_skin_stays_within_its_limits(steps, pairs, limit):
    skin = 0.25e-3
    for _ in range(60):
        skin = next_skin(skin, steps, pairs, 0.5e-3)
    assert skin == pytest.approx(limit * 0.5e-3)


def test_a_list_that_has_not_lived_says_nothing():
    assert next_skin(1e-4, 0, 5.0, 5e-4) == 1e-4 and next_skin(1e-4, 10, 0.0, 5e-4) == 1e-4
