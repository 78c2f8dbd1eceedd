"""Atomics: of several threads that try to exchange a word, one succeeds; no addition is lost."""

import numpy as np
import pytest
from numba import njit, prange

from geometry.kernels.atomics import WORDS_APART, compare_exchange, fetch_add, load_acquire, sched_yield, store_release


@njit(parallel=True)
def _take_all(threads, shares, words, takers):
    for thread in prange(threads):
        worker = np.int64(thread)
        for place in range(shares):
            if compare_exchange(words, place, 0, worker + 1):
                takers[place] += 1
                fetch_add(words, shares + WORDS_APART, 1)
        if load_acquire(words, shares + WORDS_APART) < shares:
            sched_yield()
        else:
            store_release(words, shares, 1)


@pytest.mark.parametrize("threads", [1, 4])
def test_each_word_is_taken_once(threads):
    shares = 10_000
    words, takers = np.zeros(shares + 2 * WORDS_APART, dtype=np.int64), np.zeros(shares, dtype=np.int64)
    _take_all(threads, shares, words, takers)
    assert np.all(takers == 1) and words[shares + WORDS_APART] == shares
    assert set(words[:shares]) <= set(range(1, threads + 1)) and words[shares] == 1
