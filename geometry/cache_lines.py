"""Arrays that begin with a line of the cache.

A row that is read where it lies, out of order, costs a fetch for every line that it touches. Numpy's arrays begin 16 or
48 bytes into a line: rows of 4 doubles then lie on two of them half the time, rows of 12 on three.
"""

from __future__ import annotations

import math

import numpy as np

LINE = 64  # bytes


def on_lines(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros of a ``shape``, the first at the begin of a line."""
    size = math.prod(shape)
    room = np.zeros(size + LINE // 8)
    begin = -room.ctypes.data % LINE // 8
    return room[begin : begin + size].reshape(shape)
