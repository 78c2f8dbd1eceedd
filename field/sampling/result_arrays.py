"""Output arrays of a sampler for H and grad H: the caller's, checked, or new ones."""

from __future__ import annotations

import numpy as np


def result_arrays(n: int, out: tuple[np.ndarray, np.ndarray] | None) -> tuple[np.ndarray, np.ndarray]:
    """Arrays for H (n, 3) and grad H (n, 3, 3).

    Raises
    ------
    ValueError
        Arrays of another shape or type, or not C-contiguous: compiled kernels would write beyond them.
    """
    if out is None:
        return np.empty((n, 3)), np.empty((n, 3, 3))
    H, grad = out
    for name, array, shape in (("H", H, (n, 3)), ("grad H", grad, (n, 3, 3))):
        if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
            raise ValueError(
                f"`out` for {name} has shape {array.shape} and type {array.dtype}; it must be a C-contiguous float64 "
                f"array of shape {shape}"
            )
    return H, grad
