"""Grains whose position or field is not a finite number: an error that names the first of them."""

from __future__ import annotations

import numpy as np


class NotFiniteGrains(ValueError):
    """Grains have a position or a field that is not a finite number."""


def refuse_not_finite(position: np.ndarray, applied: np.ndarray, particle_id: np.ndarray | None = None) -> None:
    """Check positions (n, 3) [m] and applied fields (n, 3) [A/m] of grains; one pass over both arrays.

    Raises
    ------
    NotFiniteGrains
        Names the first grain that has a NaN or an infinity by its `particle_id` (n,), or by its row without one.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a NaN or an infinity stays in a sum
        if np.isfinite(position.sum()) and np.isfinite(applied.sum()):
            return
    bad = ~(np.isfinite(position).all(axis=1) & np.isfinite(applied).all(axis=1))
    if not bad.any():  # only the sum overflowed
        return
    row = int(np.argmax(bad))
    name = f"row {row}" if particle_id is None else f"particle_id {particle_id[row]}"
    x, H = ("(" + ", ".join(f"{value:.4g}" for value in vector[row]) + ")" for vector in (position, applied))
    raise NotFiniteGrains(
        f"{int(bad.sum())} of {len(position)} grains have a position or a field that is not a finite number; the "
        f"first: {name}, position {x} m, field {H} A/m. Grains flung away by a step that is too long, or a "
        "field that did not converge, lead to this: lower time.step or contact.max_overlap; look at the last snapshot"
    )
