"""Threads that share the chunks of each stage of a step.

All steps of a call are one parallel loop, over threads. In each stage a thread claims chunks by an atomic exchange, its
own part first and then what others have left, and waits at a barrier until all chunks of the stage are complete. A
barrier costs a tenth of a parallel loop of numba's (1.3 microseconds, most of it to hand over the arguments). It waits
for chunks, not for threads: one thread alone can do all of them, and a thread that has lost its core holds up the
others by the chunk that it has claimed, at the most.

Stages are counted through the whole call. A thread that comes late finds the chunks of past stages claimed and their
barriers open, and so runs through them to the present one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.kernels.atomics import WORDS_APART, compare_exchange, fetch_add, load_acquire, sched_yield, store_release
from geometry.kernels.device_functions import device_function

# words that threads share: the open stage, how many of its chunks are complete, what the call returns, and for each
# chunk the first stage in which it has not been claimed
STAGE, COMPLETE, STATUS, STEPS, CHUNKS = 0, WORDS_APART, 2 * WORDS_APART, 2 * WORDS_APART + 1, 3 * WORDS_APART
NONE = -1
SPINS = 20_000  # looks at the open stage before a waiting thread yields its core


class Worker(NamedTuple):
    """One of the threads of a call: its number, how many there are, and the words that they share."""

    number: int
    workers: int
    words: np.ndarray


@device_function(error_model="numpy")
def shared_words(n_chunks):
    """Return the words of a call whose stages have ``n_chunks`` chunks at the most."""
    return np.zeros(CHUNKS + n_chunks * WORDS_APART, dtype=np.int64)


@device_function(without_refcounts=True, error_model="numpy")
def claim(worker, stage, k, n_chunks):
    """Claim the k-th of the chunks of a stage in the order of this thread; NONE where another thread has it."""
    words = worker.words
    c = worker.number * n_chunks // worker.workers + k
    c -= n_chunks if c >= n_chunks else 0
    place = CHUNKS + c * WORDS_APART
    unclaimed = load_acquire(words, place)
    if unclaimed > stage or not compare_exchange(words, place, unclaimed, stage + 1):
        return NONE
    return c


@device_function(without_refcounts=True, error_model="numpy")
def complete(worker, stage, n_chunks):
    """Count a chunk of the stage as complete; the last one opens the next stage."""
    if fetch_add(worker.words, COMPLETE, 1) == n_chunks - 1:
        store_release(worker.words, COMPLETE, 0)
        store_release(worker.words, STAGE, stage + 1)


@device_function(without_refcounts=True, error_model="numpy")
def barrier(worker, stage):
    """Wait until all chunks of the stage are complete."""
    spins = 0
    while load_acquire(worker.words, STAGE) <= stage:
        spins += 1
        if spins > SPINS:
            sched_yield()
