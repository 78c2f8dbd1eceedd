"""Coordination: how many partners a grain touches, walls counted as partners.

A grain with too few contacts carries nothing and rattles in its cage. With friction two contacts can hold a grain
(Thornton, Geotechnique 50 (2000) 43).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from particles.neighbours.contact_table import ContactTable

MIN_CONTACTS = 2  # that can hold a grain with friction


class Coordination(NamedTuple):
    """Mean number of contacts a grain, a pair counted for both of its grains; fraction of grains with less than two."""

    mean: float
    rattlers: float


def contacts_per_grain(contacts: ContactTable, count: int) -> np.ndarray:
    """Number of contacts of each of ``count`` grains, walls included: int64, shape (count,)."""
    pairs = contacts.j >= 0
    return np.bincount(contacts.i, minlength=count) + np.bincount(contacts.j[pairs], minlength=count)


def coordination(contacts: ContactTable, count: int) -> Coordination:
    """Contacts a grain of ``count`` grains."""
    z = contacts_per_grain(contacts, count)
    return Coordination(float(z.mean()), float(1.0 - (z >= MIN_CONTACTS).mean()))
