"""Parts of the compiled step, and the columns of a contact's history that each uses."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from geometry.kernels.simd_tables import WIDE
from particles.dem.contact_kernel import LAST_ROLLING, LAST_STORED, LAST_TANGENTIAL, Resistance
from particles.laws.columns import MU_ROLLING, MU_TWISTING
from particles.laws.springs import varies


class ContactColumns(NamedTuple):
    """Columns of a contact's history; what a contact does not remember has none.

    Attributes
    ----------
    rolls, twists : bool
        Whether contacts resist rolling and twisting.
    resistance : Resistance or None
        Where their springs stand; None: nothing resists.
    energy_column : int or None
        First column of the energy budget; None: it is not kept.
    total : int
        Columns in all, a multiple of 4, the width of SIMD gathers (`geometry.kernels.simd_tables`).
    vectors : ndarray of int64
        First columns of what turns with the grains.
    """

    rolls: bool
    twists: bool
    resistance: Resistance | None
    energy_column: int | None
    total: int
    vectors: np.ndarray


def contact_columns(rows: np.ndarray, table: Any, energy_budget: bool) -> ContactColumns:
    """The columns under the parameters ``rows`` (k, columns) of the laws, whose springs have a ``table``."""
    rolls, twists = bool(rows[:, MU_ROLLING].any()), bool(rows[:, MU_TWISTING].any())
    rolling = LAST_STORED + 1 if varies(table) else 3
    twisting = rolling + (3 if rolls else 0)
    last = twisting + (1 if twists else 0)
    resistance = Resistance(rolling if rolls else -1, twisting if twists else -1) if rolls or twists else None
    vectors = [0]
    if rolls:
        vectors.append(rolling)
    if not energy_budget:
        return ContactColumns(rolls, twists, resistance, None, round_up(last), np.array(vectors, dtype=np.int64))
    vectors.append(last + LAST_TANGENTIAL)
    if rolls:
        vectors.append(last + LAST_ROLLING)
    count = last + (8 if twists else 7 if rolls else 4)
    return ContactColumns(rolls, twists, resistance, last, round_up(count), np.array(vectors, dtype=np.int64))


def round_up(columns: int) -> int:
    """Round so many columns up to a multiple of WIDE."""
    return WIDE * -(-columns // WIDE)
