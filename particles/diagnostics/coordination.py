"""Coordination: how many partners a grain touches, walls counted as partners.

A grain with too few contacts carries nothing and rattles in its cage. With friction two contacts can hold a grain
(Thornton, Geotechnique 50 (2000) 43), without it takes four: three dimensions and one contact to press against. The
mechanical coordination number leaves the rattlers out,

    Z_m = sum of z_i over z_i >= least / number of such grains,

which for ``least`` = 2 is Thornton's (2 N_c - N_1)/(N - N_0 - N_1), N_k being the number of grains with k contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.neighbours.contact_table import ContactTable

WITH_FRICTION, WITHOUT_FRICTION = 2, 4  # least contacts that can hold a grain


@dataclass(frozen=True, slots=True)
class Coordination:
    """Statistics of contacts a grain.

    Attributes
    ----------
    mean : float
        Contacts a grain, walls included; a pair counts for both of its grains.
    mechanical : float or None
        The same over the grains that are no rattlers; None where all are.
    rattlers : float
        Share of grains with fewer contacts than ``least`` [-].
    distribution : ndarray, shape (largest + 1,)
        Share of grains with 0, 1, 2, ... contacts [-].
    least : int
        Fewer contacts make a rattler.
    """

    mean: float
    mechanical: float | None
    rattlers: float
    distribution: np.ndarray
    least: int


def contacts_per_grain(contacts: ContactTable, count: int, *, with_walls: bool = True) -> np.ndarray:
    """Number of contacts of each of ``count`` grains, int64, shape (count,)."""
    pairs = contacts.j >= 0
    i = contacts.i if with_walls else contacts.i[pairs]
    return np.bincount(i, minlength=count) + np.bincount(contacts.j[pairs], minlength=count)


def rattlers(contacts: ContactTable, count: int, *, least: int = WITH_FRICTION, repeat: bool = False) -> np.ndarray:
    """Return which grains have fewer than ``least`` contacts: bool, shape (count,).

    With ``repeat`` contacts with rattlers are removed and the rest is judged again until nothing changes: what is left
    is the backbone.
    """
    pairs = contacts.j >= 0
    j = np.maximum(contacts.j, 0)
    loose = contacts_per_grain(contacts, count) < least
    while repeat:
        kept = ~loose[contacts.i] & ~(pairs & loose[j])
        left = np.bincount(contacts.i[kept], minlength=count)
        left += np.bincount(j[kept & pairs], minlength=count)
        more = left < least
        if np.array_equal(more, loose):
            break
        loose = more
    return loose


def coordination(contacts: ContactTable, count: int, *, least: int = WITH_FRICTION) -> Coordination:
    """Contacts a grain of ``count`` grains; ``least`` is 2 with friction, 4 without."""
    z = contacts_per_grain(contacts, count)
    held = z >= least
    return Coordination(
        mean=float(z.mean()),
        mechanical=float(z[held].mean()) if held.any() else None,
        rattlers=float(1.0 - held.mean()),
        distribution=np.bincount(z) / count,
        least=least,
    )
