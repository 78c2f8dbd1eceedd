"""Words that threads share: of several that try to take one, one does; nothing counted is lost."""

import numpy as np
import pytest
from numba import njit, prange

from geometry.shared_words import LINE, counted, give_way, seen, taken, tell


@njit(parallel=True)
def _take_all(threads, shares, words, takers):
    for thread in prange(threads):
        worker = np.int64(thread)
        for place in range(shares):
            if taken(words, place, 0, worker + 1):
                takers[place] += 1
                counted(words, shares + LINE)
        if seen(words, shares + LINE) < shares:
            give_way()
        else:
            tell(words, shares, 1)


@pytest.mark.parametrize("threads", [1, 4])
def test_each_word_is_taken_once(threads):
    shares = 10_000
    words, takers = np.zeros(shares + 2 * LINE, dtype=np.int64), np.zeros(shares, dtype=np.int64)
    _take_all(threads, shares, words, takers)
    assert np.all(takers == 1) and words[shares + LINE] == shares
    assert set(words[:shares]) <= set(range(1, threads + 1)) and words[shares] == 1
