"""Arrays aligned to cache lines.

A row that is read out of order costs a fetch of every cache line that it touches. Numpy's arrays begin 16 or 48 bytes
into a line: rows of 4 doubles then touch two lines half of the time, rows of 12 three.
"""

from __future__ import annotations

import math

import numpy as np

LINE_BYTES = 64  # bytes


def aligned_zeros(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros of a ``shape``, float64, aligned to a cache line."""
    size = math.prod(shape)
    room = np.zeros(size + LINE_BYTES // 8)
    begin = -room.ctypes.data % LINE_BYTES // 8
    return room[begin : begin + size].reshape(shape)
